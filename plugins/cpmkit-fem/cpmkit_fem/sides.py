"""The sides of boundaries in a triangulation that is cut along them: where conditions hold, and where points read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cpmkit.plugin import SIDES, Bools, CutMesh, Floats, Interface, Ints, Scene, SceneError, Side, Value
from cpmkit_fem.location import nearest_on_triangles
from cpmkit_fem.rim import RimPart
from cpmkit_fem.triangulation import Triangulation

#: Points nearer to a boundary than this share of an edge lie on it.
ON_EDGE_SHARE = 1e-9
#: Step of differences where sources give no directions of their own, as a share of an edge.
DIFFERENCE_EDGE_SHARE = 0.5


def sides_of(scene: Scene, mesh: Triangulation, cut: CutMesh) -> Sequence[RimPart]:
    """Return the edges on each side of each boundary with the law that holds there, and couples no two sides.

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
            parts.append(RimPart(law, mesh, cut.edges[on & those], what, boundary.source))
            at = cut.points.get(number)
            if at is not None:
                if not isinstance(law, Value):
                    raise SceneError(
                        f"{what} is a point of a surface and has {boundary.condition(side).kind}, where backend='fem' "
                        "takes Dirichlet alone; give it a value, or take a small circle."
                    )
                parts.append(RimPart(law, mesh, np.repeat(at[:, None], 2, axis=1), what, boundary.source))
    return [part for part in parts if len(part.edges)]


def located(
    scene: Scene, mesh: Triangulation, cut: CutMesh | None, points: Floats, wanted: Mapping[str, Side]
) -> tuple[Ints, Floats]:
    """Return the triangle (n,) that each of ``points`` (n, d) is read in, and its barycentric coordinates (n, 3).

    The nearest one on the point's own side of each boundary; of points on a boundary the side is ``wanted``, or left.
    """
    face, local = nearest_on_triangles(mesh.vertices, mesh.faces, points)
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
                there, local[astray] = nearest_on_triangles(mesh.vertices, mesh.faces[kept], points[astray])
                face[astray] = kept[there]
    return face, local


def _beside(mesh: Triangulation, cut: CutMesh, number: int) -> tuple[Bools, Bools]:
    """Return which triangles (m,) have a corner on the left of a boundary, and which on its right; tips are on none."""
    found = []
    sides = [np.unique(cut.edges[(cut.owner == number) & those]) for those in (cut.left, ~cut.left)]
    for own, other in (sides, sides[::-1]):
        on = np.zeros(len(mesh.vertices), dtype=bool)
        on[np.setdiff1d(own, other)] = True
        found.append(on[mesh.faces].any(axis=1))
    return found[0], found[1]
