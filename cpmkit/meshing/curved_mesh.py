"""What the manifold does between the vertices of a mesh, and the mesh made to follow it."""

from __future__ import annotations

from collections.abc import Sequence

from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.mesh import CellGeometry, Edges, Mesh
from cpmkit.mesh.subdivision import split_at_knot_planes
from cpmkit.meshing.curved_from_normals import curve_from_normals
from cpmkit.meshing.curved_from_points import curve_from_points


def curve_cells(
    mesh: Mesh,
    bend: CellGeometry,
    source: LocalSource,
    boundaries: Sequence[LocalSource | None],
    spacing: float,
    edges: Edges | None = None,
) -> Mesh:
    """Return the mesh, split and cut, as its samples are to be taken from; segments end on knot planes.

    Parameters
    ----------
    mesh : SampleMesh
        Of flat cells.
    bend : "flat", "feet" or "normals"
        As ``cells_of`` said; "feet" for a mesh that was found by closest points.
    source : LocalSource
        The manifold.
    boundaries : sequence of LocalSource
        By their number in ``mesh.owner``; None where a boundary stays where the mesh has it.
    spacing : float
        h of the lattice.
    edges : Edges, optional
        Of the mesh; where it is bent by normals these are needed, and found if they are not given.
    """
    if bend == "feet":
        return curve_from_points(mesh, source, boundaries, spacing)
    if bend == "normals":
        return curve_from_normals(mesh, source, boundaries, edges)
    return split_at_knot_planes(mesh, spacing) if mesh.manifold_dim == 1 else mesh
