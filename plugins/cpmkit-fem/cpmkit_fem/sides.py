"""The sides of boundaries in a mesh that is cut along them: where conditions hold, and where points read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cpmkit.plugin import SIDES, Bools, CutMesh, Floats, Interface, Ints, Scene, SceneError, Side, Value
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.location import nearest_on_cells
from cpmkit_fem.rim import RimPart

#: Points nearer to a boundary than this share of an edge lie on it.
ON_EDGE_SHARE = 1e-9
#: Data are asked for nodes on boundaries so far from their feet there, towards the middle of their cells.
INWARD_SHARE = 1e-4
#: Step of differences where sources give no directions of their own, as a share of an edge.
DIFFERENCE_EDGE_SHARE = 0.5


def sides_of(scene: Scene, mesh: CellMesh, cut: CutMesh) -> Sequence[RimPart]:
    """Return the facets on each side of each boundary with the law that holds there, and couples no two sides.

    Raises
    ------
    SceneError
        If a point of the surface holds anything but one value.
    """
    parts = []
    for number, boundary in enumerate(scene.boundaries):
        what, on = f"boundary {boundary.name!r}", cut.owner == number
        for side, those in zip(SIDES, (cut.left, ~cut.left), strict=True):
            law = boundary.condition(side).law
            if isinstance(law, Interface):
                continue  # a tie
            parts.append(RimPart(law, mesh, mesh.with_midpoints(cut.edges[on & those]), what, boundary.source))
            at = cut.points.get(number)
            if at is not None:
                if not isinstance(law, Value):
                    raise SceneError(
                        f"{what} is a point of a surface and has {boundary.condition(side).kind}, where backend='fem' "
                        "takes Dirichlet alone; give it a value, or take a small circle."
                    )
                parts.append(RimPart(law, mesh, at[:, None], what, boundary.source))
    return [part for part in parts if len(part.edges)]


def located(
    scene: Scene, mesh: CellMesh, cut: CutMesh | None, points: Floats, wanted: Mapping[str, Side]
) -> tuple[Ints, Floats]:
    """Return the cell (n,) that each of ``points`` (n, d) is read in, and its barycentric coordinates (n, k).

    The nearest one on the point's own side of each boundary; of points on a boundary the side is ``wanted``, or left.
    """
    face, local = nearest_on_cells(mesh.nodes, mesh.corners, points)
    if cut is None:
        return face, local
    edge = mesh.mean_edge
    for number, boundary in enumerate(scene.boundaries):
        beside = _beside(mesh, cut, number)
        rows = np.flatnonzero(np.any([one[face] for one in beside], axis=0))
        oriented = scene.oriented(boundary)
        if not len(rows) or not oriented.has_left:
            continue
        signed = oriented.signed_distance(points[rows] - oriented.left.origin, DIFFERENCE_EDGE_SHARE * edge)
        on = boundary.source.closest_point(points[rows]).distance <= ON_EDGE_SHARE * edge
        left = np.where(on, wanted.get(boundary.name, "left") == "left", signed > 0)
        for is_left, (own, other) in ((True, beside), (False, beside[::-1])):
            astray = rows[(left == is_left) & ~np.isnan(signed) & other[face[rows]] & ~own[face[rows]]]
            if len(astray):
                kept = np.flatnonzero(~other | own)
                there, local[astray] = nearest_on_cells(mesh.nodes, mesh.corners[kept], points[astray])
                face[astray] = kept[there]
    return face, local


def on_own_side(scene: Scene, mesh: CellMesh, cut: CutMesh | None) -> Floats:
    """Return the nodes (n, d); on boundaries their feet there, a little towards the cells that they belong to."""
    if cut is None or not len(cut.edges):
        return mesh.nodes
    size, cells = len(mesh.nodes), mesh.cells
    on, count = np.unique(mesh.with_midpoints(cut.edges)), np.bincount(cells.ravel(), minlength=size)
    centres = np.repeat(mesh.nodes[mesh.corners].mean(axis=1), cells.shape[1], axis=0)
    total = np.stack([np.bincount(cells.ravel(), one, minlength=size) for one in centres.T], axis=1)
    points = mesh.nodes.copy()
    for number, boundary in enumerate(scene.boundaries):
        own = np.unique(mesh.with_midpoints(cut.edges[cut.owner == number]))
        if len(own):
            points[own] = boundary.source.closest_point(points[own]).points
    points[on] += INWARD_SHARE * (total[on] / count[on, None] - mesh.nodes[on])
    return points


def _beside(mesh: CellMesh, cut: CutMesh, number: int) -> tuple[Bools, Bools]:
    """Return which cells (m,) have a corner on the left of a boundary, and which on its right; tips are on none."""
    found = []
    sides = [np.unique(cut.edges[(cut.owner == number) & those]) for those in (cut.left, ~cut.left)]
    for own, other in (sides, sides[::-1]):
        on = np.zeros(len(mesh.nodes), dtype=bool)
        on[np.setdiff1d(own, other)] = True
        found.append(np.asarray(on[mesh.corners].any(axis=1)))
    return found[0], found[1]
