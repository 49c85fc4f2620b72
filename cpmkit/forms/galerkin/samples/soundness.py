"""Making a mesh sound: welded, each cell once, and each fan of cells at a vertex with a vertex of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.galerkin.sample_mesh import SampleMesh
from cpmkit.forms.galerkin.samples.cutting import corners_of
from cpmkit.protocols import Bools, Floats, Ints

#: Vertices nearer to each other than this share of the largest side of the mesh's box are one: exact comparison is
#: defeated by noise of 1e-7, and a seam that is not welded acts as a cut.
WELDED_SIZE_SHARE = 1e-6


@dataclass(frozen=True)
class Mended:
    """What was not sound about a mesh.

    Attributes
    ----------
    welded : int
        Vertices that lay at the place of another.
    doubled : int
        Cells that named a vertex twice after that, or had the corners of another.
    fans : int
        Vertices that were added, because cells met there that no edge joins.
    """

    welded: int
    doubled: int
    fans: int


def sound(mesh: SampleMesh) -> tuple[SampleMesh, Mended]:
    """Return a mesh of the same places on which cells hang together just where they share an edge, and what changed.

    Contact through a vertex alone is none: two spheres that touch at one would be short-circuited there. Curves stay
    joined where several segments meet.

    Parameters
    ----------
    mesh : SampleMesh
        Not cut by boundaries; unused vertices are left out.
    """
    place = _places(mesh.vertices)
    cells = place[mesh.cells]
    kept = _distinct(cells, len(mesh.vertices))
    midpoints = None if mesh.midpoints is None else mesh.midpoints[kept]
    welded = SampleMesh.of(mesh.vertices, np.ascontiguousarray(cells[kept]), midpoints)
    corners = corners_of(welded)
    at = np.empty(int(corners.max(initial=-1)) + 1, dtype=np.int64)
    at[corners] = welded.cells
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[at] = True
    mended = Mended(
        welded=int((place != np.arange(len(place))).sum()),
        doubled=len(mesh.cells) - len(welded.cells),
        fans=len(at) - int(used.sum()),
    )
    return SampleMesh.of(mesh.vertices[at], corners, midpoints), mended


def _places(vertices: Floats) -> Ints:
    """Return (v,) the first vertex at the place of each."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(vertices)
    tolerance = WELDED_SIZE_SHARE * float(np.ptp(vertices, axis=0).max(initial=0.0)) if count else 0.0
    pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray") if count else np.zeros((0, 2), dtype=int)
    if not len(pairs):
        return np.arange(count)
    graph = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    piece = connected_components(graph, directed=False)[1]
    return np.asarray(np.unique(piece, return_index=True)[1][piece], dtype=np.int64)


def _distinct(cells: Ints, count: int) -> Bools:
    """Return which cells (m,) have different corners, and not those of an earlier cell."""
    corners = np.sort(cells, axis=1)
    rows = np.flatnonzero((corners[:, 1:] > corners[:, :-1]).all(axis=1))
    corners = corners[rows]
    if count < 2**21:  # three numbers fit in one
        key = corners[:, 0]
        for k in range(1, corners.shape[1]):
            key = (key << 21) | corners[:, k]
        first = np.unique(key, return_index=True)[1]
    else:
        first = np.unique(corners, axis=0, return_index=True)[1]
    kept = np.zeros(len(cells), dtype=bool)
    kept[rows[first]] = True
    return kept
