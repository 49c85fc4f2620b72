"""The sides of boundaries in a mesh that is cut along them: their conditions, and the cells of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cpmkit.plugin import SIDES, Bools, CutMesh, Floats, Interface, Ints, Scene, SceneError, Side, Value
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.location import nearest_cells
from cpmkit_fem.rim import RimPart

#: Points nearer to a boundary than this share of an edge lie on it.
ON_EDGE_SHARE = 1e-9
#: Share of the way from a node on a boundary to the centre of its cells at which its data are evaluated.
INWARD_SHARE = 1e-4
#: Step of differences where sources give no directions of their own, as a share of an edge.
DIFFERENCE_EDGE_SHARE = 0.5


def sides_of(scene: Scene, mesh: CellMesh, cut: CutMesh) -> Sequence[RimPart]:
    """Return the facets on each side of each boundary with the side's law, except laws that couple two sides.

    Raise SceneError if a boundary that is a point of the surface has another condition than a value.
    """
    parts = []
    for number, boundary in enumerate(scene.boundaries):
        label, on = f"boundary {boundary.name!r}", cut.owner == number
        for side, those in zip(SIDES, (cut.left, ~cut.left), strict=True):
            law = boundary.condition(side).law
            if isinstance(law, Interface):
                continue  # a tie
            parts.append(RimPart(law, mesh, mesh.facet_nodes(cut.edges[on & those]), label, boundary.source))
            at = cut.points.get(number)
            if at is not None:
                if not isinstance(law, Value):
                    raise SceneError(
                        f"{label} is a point of a surface and has {boundary.condition(side).kind}, where backend='fem' "
                        "takes Dirichlet alone; give it a value, or take a small circle."
                    )
                parts.append(RimPart(law, mesh, at[:, None], label, boundary.source))
    return [part for part in parts if len(part.edges)]


def locate_points(
    scene: Scene, mesh: CellMesh, cut: CutMesh | None, points: Floats, wanted: Mapping[str, Side]
) -> tuple[Ints, Floats]:
    """Return the cell (n,) in which each of ``points`` (n, d) is evaluated, and its barycentric coordinates (n, k).

    It is the nearest cell, unless that touches a boundary from the other side than the point's: then the nearest other
    cell. For points on a boundary the side is ``wanted[name]``, by default left. Without ``cut``, and beside boundaries
    that are points of a surface, it is the nearest cell.
    """
    face, local = nearest_cells(mesh.nodes, mesh.corners, points)
    if cut is None:
        return face, local
    edge = mesh.mean_edge
    for number, boundary in enumerate(scene.boundaries):
        of_sides = _cells_of_sides(mesh, cut, number)
        rows = np.flatnonzero(np.any([cells[face] for cells in of_sides], axis=0))
        oriented = scene.oriented(boundary)
        if not len(rows) or not oriented.has_left:
            continue
        signed = oriented.signed_distance(points[rows] - oriented.left.origin, DIFFERENCE_EDGE_SHARE * edge)
        on = boundary.source.closest_point(points[rows]).distance <= ON_EDGE_SHARE * edge
        left = np.where(on, wanted.get(boundary.name, "left") == "left", signed > 0)
        for is_left, (own_side, other) in ((True, of_sides), (False, of_sides[::-1])):
            wrong = rows[(left == is_left) & ~np.isnan(signed) & other[face[rows]] & ~own_side[face[rows]]]
            if len(wrong):
                allowed = np.flatnonzero(~other | own_side)
                nearest, local[wrong] = nearest_cells(mesh.nodes, mesh.corners[allowed], points[wrong])
                face[wrong] = allowed[nearest]
    return face, local


def points_on_own_side(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> Floats:
    """Return the nodes (n, d), those on boundaries moved onto these and from there a little towards their own cells.

    The last way is :data:`INWARD_SHARE` of that to the mean centre of the node's cells. Without ``cut`` all nodes stay,
    and so do those at points of a surface.
    """
    if cut is None or not len(cut.edges):
        return mesh.nodes
    size, cells = len(mesh.nodes), mesh.cells
    on, count = np.unique(mesh.facet_nodes(cut.edges)), np.bincount(cells.ravel(), minlength=size)
    centres = np.repeat(mesh.nodes[mesh.corners].mean(axis=1), cells.shape[1], axis=0)
    total = np.stack([np.bincount(cells.ravel(), axis, minlength=size) for axis in centres.T], axis=1)
    points = mesh.nodes.copy()
    for number, boundary in enumerate(scene.boundaries):
        nodes = np.unique(mesh.facet_nodes(cut.edges[cut.owner == number]))
        if len(nodes):
            points[nodes] = boundary.source.closest_point(points[nodes]).points
    points[on] += INWARD_SHARE * (total[on] / count[on, None] - mesh.nodes[on])
    return points


def _cells_of_sides(mesh: CellMesh, cut: CutMesh, number: int) -> tuple[Bools, Bools]:
    """Return (m,) which cells touch boundary ``number`` from the left, and (m,) which from the right.

    One corner on the boundary suffices. Ends of the boundary, which are on both sides, do not count.
    """
    touching = []
    sides = [np.unique(cut.edges[(cut.owner == number) & those]) for those in (cut.left, ~cut.left)]
    for side, other in (sides, sides[::-1]):
        on = np.zeros(len(mesh.nodes), dtype=bool)
        on[np.setdiff1d(side, other)] = True
        touching.append(np.asarray(on[mesh.corners].any(axis=1)))
    return touching[0], touching[1]
