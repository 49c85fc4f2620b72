"""Making a mesh sound: welded, each cell once, and each fan of cells at a vertex with a vertex of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.mesh.adjacency import cut_corners
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Bools, Floats, Ints

#: Vertices nearer to each other than this share of the largest side of the mesh's box are one: exact comparison is
#: defeated by noise of 1e-7, and a seam that is not welded acts as a cut.
WELDED_SIZE_SHARE = 1e-6
#: A direction in which few vertices of any mesh lie at the same height.
SKEW = np.array([0.4619, 0.7253, 0.5104])


@dataclass(frozen=True)
class RepairReport:
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


def repair(mesh: Mesh) -> tuple[Mesh, RepairReport]:
    """Return a mesh of the same places on which cells hang together just where they share an edge, and what changed.

    Contact through a vertex alone is none: two spheres that touch at one would be short-circuited there. Curves stay
    joined where several segments meet.

    Parameters
    ----------
    mesh : Mesh
        Not cut by boundaries; unused vertices are left out.
    """
    at, corners, kept, mended = repaired_cells(mesh)
    midpoints = None if mesh.midpoints is None else mesh.midpoints[kept]
    return Mesh.of(mesh.vertices[at], corners, midpoints), mended


def has_distinct_vertices(mesh: Mesh) -> bool:
    """Tell whether a mesh whose cells are parts of those of a sound one is sound: no two vertices are at one place."""
    return bool((_places(mesh.vertices) == np.arange(len(mesh.vertices))).all())


def repaired_cells(mesh: Mesh) -> tuple[Ints, Ints, Bools, RepairReport]:
    """Return which vertex (v,) each of a sound mesh is, its cells (k, c), those (m,) of the mesh, and what changed."""
    place = _places(mesh.vertices)
    cells = place[mesh.cells]
    kept = _distinct(cells, len(mesh.vertices))
    welded = Mesh.of(mesh.vertices, np.ascontiguousarray(cells[kept]))
    corners = cut_corners(welded)
    at = np.empty(int(corners.max(initial=-1)) + 1, dtype=np.int64)
    at[corners] = welded.cells
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[at] = True
    mended = RepairReport(
        welded=int((place != np.arange(len(place))).sum()),
        doubled=len(mesh.cells) - len(welded.cells),
        fans=len(at) - int(used.sum()),
    )
    return at, corners, kept, mended


def box_size(vertices: Floats) -> float:
    """Return the largest side of the box of vertices (v, d); column by column, in a tenth of the time."""
    return max(float(np.ptp(column)) for column in vertices.T)


def _places(vertices: Floats) -> Ints:
    """Return (v,) the first vertex at the place of each."""
    from cpmkit.mesh import mesh_kernels

    tolerance = WELDED_SIZE_SHARE * box_size(vertices) if len(vertices) else 0.0
    along = vertices @ (SKEW[: vertices.shape[1]] / np.linalg.norm(SKEW[: vertices.shape[1]]))
    found: Ints = mesh_kernels.places(np.ascontiguousarray(vertices), along, np.argsort(along), tolerance)
    return found


def _distinct(cells: Ints, count: int) -> Bools:
    """Return which cells (m,) have different corners, and not those of an earlier cell."""
    from cpmkit.mesh import mesh_kernels

    kept: Bools = mesh_kernels.distinct(np.sort(cells, axis=1), count)
    return kept
