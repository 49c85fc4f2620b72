"""Repair of a mesh: welding of vertices, removal of repeated cells, separation of cells that share only a vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.mesh.adjacency import cut_corners
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Bools, Floats, Ints

#: Vertices nearer to each other than this share of the largest side of the mesh's box are welded: an exact comparison
#: fails under noise of 1e-7, and a seam that is not welded acts as a cut.
WELDED_SIZE_SHARE = 1e-6
#: A direction along which few vertices of any mesh have the same coordinate.
SKEW_DIRECTION = np.array([0.4619, 0.7253, 0.5104])


@dataclass(frozen=True)
class RepairReport:
    """Number of repairs of each kind.

    Attributes
    ----------
    welded : int
        Vertices merged with another vertex at the same place.
    doubled : int
        Cells removed because they named a vertex twice after welding, or had the corners of another cell.
    fans : int
        Vertices added where fans of cells met that share no edge.
    """

    welded: int
    doubled: int
    fans: int


def repair(mesh: Mesh) -> tuple[Mesh, RepairReport]:
    """Return a mesh with the same geometry whose cells are connected exactly over shared edges, and a report.

    Contact in a single vertex does not connect: heat would flow through the point where two spheres touch. Curves stay
    connected where several segments meet.

    Parameters
    ----------
    mesh : Mesh
        Without boundaries; its unused vertices are left out.
    """
    vertex_of, cells, remaining, report = repaired_cells(mesh)
    midpoints = None if mesh.midpoints is None else mesh.midpoints[remaining]
    return Mesh.of(mesh.vertices[vertex_of], cells, midpoints), report


def has_distinct_vertices(mesh: Mesh) -> bool:
    """Return whether no two vertices are at one place; parts of cells of a repaired mesh then need no repair."""
    return bool((_welded_vertices(mesh.vertices) == np.arange(len(mesh.vertices))).all())


def repaired_cells(mesh: Mesh) -> tuple[Ints, Ints, Bools, RepairReport]:
    """Return the cells of the repaired mesh, and their relation to those of ``mesh``.

    Returns
    -------
    vertex_of : (v,) int64
        The vertex of ``mesh`` that each vertex of the repaired mesh copies.
    cells : (n, k) int64
    remaining : (m,) bool
        Which cells of ``mesh`` remain, in the order of ``cells``.
    report : RepairReport
    """
    from cpmkit.mesh import mesh_kernels

    place = _welded_vertices(mesh.vertices)
    cells = place[mesh.cells]
    remaining: Bools = mesh_kernels.distinct_cells(np.sort(cells, axis=1), len(mesh.vertices))
    welded = Mesh.of(mesh.vertices, np.ascontiguousarray(cells[remaining]))
    corners = cut_corners(welded)
    vertex_of = np.empty(int(corners.max(initial=-1)) + 1, dtype=np.int64)
    vertex_of[corners] = welded.cells
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[vertex_of] = True
    report = RepairReport(
        welded=int((place != np.arange(len(place))).sum()),
        doubled=len(mesh.cells) - len(welded.cells),
        fans=len(vertex_of) - int(used.sum()),
    )
    return vertex_of, corners, remaining, report


def box_size(vertices: Floats) -> float:
    """Return the largest side of the bounding box of vertices (v, d)."""
    return max(float(np.ptp(column)) for column in vertices.T)  # ten times as fast as over the first axis


def _welded_vertices(vertices: Floats) -> Ints:
    """Return for each vertex (v,) the representative of all vertices at the same place, up to the welding tolerance."""
    from cpmkit.mesh import mesh_kernels

    tolerance = WELDED_SIZE_SHARE * box_size(vertices) if len(vertices) else 0.0
    direction = SKEW_DIRECTION[: vertices.shape[1]]
    along = vertices @ (direction / np.linalg.norm(direction))
    first: Ints = mesh_kernels.merge_near_vertices(np.ascontiguousarray(vertices), along, np.argsort(along), tolerance)
    return first
