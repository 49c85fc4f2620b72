"""Boundaries inside a solid as pairs of cells, one per side: curves in a plane solid, and functions for surfaces too.

Curves may end on the skin and cross each other: they are split where they meet, and parts outside are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np

from cpmkit.errors import SceneError, place
from cpmkit.forms.galerkin.conditions.boundary_sides import DIFFERENCE_SPACINGS
from cpmkit.forms.galerkin.solids.skin import (
    LONGEST_EDGES,
    FlatPart,
    Skin,
    areas_of,
    joined,
    with_turned,
)
from cpmkit.forms.galerkin.solids.tip_extensions import EXTENDED_SPACINGS, extended_curve_ends
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.adjacency import WELDED_SIZE_SHARE, box_size, facets_of_two_cells, repair
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.sectors import sector_facets
from cpmkit.meshing.meeting_curves import Curve, FlatCurve, meetings_of_curves, split_at, split_at_own_crossings
from cpmkit.runtime.index_sets import connected_components
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Ints

#: A boundary that ends at less than this distance, in spacings, from the skin or another boundary without meeting it is
#: refused: the two are probably meant to meet.
NEAR_MISS_SPACINGS = 0.05
#: The message about a boundary outside of the solid.
OUTSIDE = "boundary {!r} lies outside the solid and would act on nothing; look where it lies."
#: With singular functions a boundary is divided at so many distances from a tip, a spacing and its halves.
GRADED_HALVINGS = 11
#: A boundary is continued past a tip up to this share of the distance to the next tip.
TIP_SHARE = 0.45


def boundaries_inside(scene: Scene, lattice: Lattice) -> list[FlatPart]:
    """Return the boundaries of a scene on a solid as flat cells, in their order."""
    return [FlatPart.of(localize(boundary.source, lattice.origin), lattice) for boundary in scene.boundaries]


@dataclass(frozen=True, eq=False)
class MeetingCurves:
    """The skin of a plane solid and the boundaries inside, split where they meet."""

    skin: list[list[FlatPart]]  #: The parts of the skin, of each member of a union.
    inside: list[FlatPart]  #: The boundaries.
    extensions: list[Mesh]  #: Segments that continue each boundary past its tips.
    points: Floats  #: (k, 2): where parts, boundaries and extensions meet.


def split_where_curves_meet(
    skin: Sequence[Sequence[FlatPart]],
    inside: Sequence[FlatPart],
    names: Sequence[str],
    solid: LocalSource,
    lattice: Lattice,
    is_graded: bool,
) -> MeetingCurves:
    """Return the parts of the ``skin`` of a plane solid and the boundaries ``inside``, split where they meet.

    If ``is_graded``, boundaries and extensions are split near tips too, ever more finely.

    ``names`` are those of the boundaries. Raises SceneError if two curves touch or run along each other, or a boundary
    ends very near another curve without meeting it.
    """
    skin_parts = [part for member in skin for part in member]
    count = len(skin_parts)
    parts = [replace(part, mesh=repair(part.mesh)[0]) for part in (*skin_parts, *inside)]
    parts[count:] = [
        replace(part, mesh=split_at_own_crossings(part.mesh, None if part.geometry == "flat" else part.source))
        for part in parts[count:]
    ]
    curves: list[Curve] = [
        (FlatCurve(part.mesh) if part.boundary is None else part.boundary, part.mesh) for part in parts
    ]
    labels = ["the boundary of the solid"] * count + [f"boundary {name!r}" for name in names]
    meetings = _meetings(curves, labels, count, LONGEST_EDGES[2] * lattice.spacing)
    tips = {k: _tips(parts[k].mesh, meetings[k], solid) for k in range(count, len(parts))}
    at_tips = np.concatenate([parts[k].mesh.vertices[own] for k, own in tips.items()])
    extensions = []
    for number, own in tips.items():
        made = extended_curve_ends(parts[number].mesh, curves[number][0], own, EXTENDED_SPACINGS * lattice.spacing)
        for tip in range(len(own)):
            _check_not_near(made.vertices[2 * tip], number, curves, labels, lattice)
            _shorten(made, tip, at_tips, curves, meetings, LONGEST_EDGES[2] * lattice.spacing)
        extensions.append(made)
    if is_graded:
        distances: Floats = lattice.spacing * 0.5 ** np.arange(GRADED_HALVINGS, dtype=np.float64)
        for number, made in zip(tips, extensions, strict=True):
            for tip, ahead in made.vertices.reshape(-1, 2, 2):
                behind = tip - distances[:, None] * unit((ahead - tip)[None])
                meetings[number] = np.concatenate([meetings[number], curves[number][0].closest_point(behind).points])
        extensions = [_graded(made, distances) for made in extensions]
    split = [
        replace(part, mesh=repair(split_at(curve, part.mesh, points))[0]) if len(points) else part
        for part, (curve, _), points in zip(parts, curves, meetings, strict=True)
    ]
    starts = np.cumsum([0] + [len(member) for member in skin])
    members = [split[start:end] for start, end in pairwise(starts)]
    return MeetingCurves(members, split[count:], extensions, np.concatenate([*meetings, at_tips]))


def _graded(extension: Mesh, distances: Floats) -> Mesh:
    """Return the segments of an ``extension`` split at ``distances`` (n,), descending, from the tips at their start."""
    start, end = extension.vertices.reshape(-1, 2, extension.dim).transpose(1, 0, 2)
    length = norms(end - start)[:, None]
    shares = np.minimum(np.column_stack([np.zeros_like(length), np.divide(distances[::-1], length)]), 1.0)
    points = start[:, None] + np.column_stack([shares, np.ones_like(length)])[..., None] * (end - start)[:, None]
    count = points.shape[1]
    cells = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1) + count * np.arange(len(start))[:, None, None]
    return repair(Mesh.of(points.reshape(-1, extension.dim), cells.reshape(-1, 2)))[0]


def _meetings(curves: Sequence[Curve], labels: Sequence[str], count: int, length: float) -> list[Floats]:
    """Return the points (k, 2) of each curve at which it meets others; the first ``count`` curves are the skin.

    Raises SceneError, with the ``labels`` of two curves, if they touch or run along each other.
    """
    meetings = [mesh.vertices[:0] for _, mesh in curves]
    for i, j in combinations(range(len(curves)), 2):
        if j < count or _are_apart(curves[i][1], curves[j][1], length):
            continue
        found = meetings_of_curves([curves[i], curves[j]], length)
        if found is None:
            raise SceneError(f"{labels[j]} touches {labels[i]}, or runs along it; let it cross, or keep away from it.")
        meetings[i], meetings[j] = np.concatenate([meetings[i], found[0]]), np.concatenate([meetings[j], found[1]])
    return meetings


def _are_apart(first: Mesh, second: Mesh, gap: float) -> bool:
    """Return whether the boxes of two meshes are farther apart than ``gap`` along an axis."""
    low, high = (
        np.maximum(first.vertices.min(axis=0), second.vertices.min(axis=0)),
        np.minimum(first.vertices.max(axis=0), second.vertices.max(axis=0)),
    )
    return bool((low > high + gap).any())


def _check_not_near(tip: Floats, number: int, curves: Sequence[Curve], labels: Sequence[str], lattice: Lattice) -> None:
    """Raise SceneError if the ``tip`` (d,) of the curve ``number`` is very near another curve without meeting it."""
    for other, (curve, _) in enumerate(curves):
        gap = float(curve.closest_point(tip[None]).distance[0])
        if other != number and gap < NEAR_MISS_SPACINGS * lattice.spacing:
            raise SceneError(
                f"{labels[number]} ends {gap:.2g} from {labels[other]} near {place(lattice.to_scene(tip))}, nearer "
                f"than {NEAR_MISS_SPACINGS:g} spacings; let it meet it, or end it farther away."
            )


def _shorten(
    extension: Mesh, tip: int, tips: Floats, curves: Sequence[Curve], meetings: list[Floats], length: float
) -> None:
    """Shorten segment ``tip`` of an ``extension``, in place, to where it meets a curve or comes near another tip.

    ``tips`` (k, 2) are the ends of all curves. Where the segment meets a curve, the point is added to its ``meetings``.
    """
    at, ahead = extension.vertices[2 * tip : 2 * tip + 2]
    others = norms(tips - at)
    reach = TIP_SHARE * others[others > 0].min(initial=np.inf)
    ahead = at + min(1.0, reach / float(norms(ahead - at))) * (ahead - at)
    for other, curve in enumerate(curves):
        ahead, where = _first_meeting(at, ahead, curve, length)
        meetings[other] = np.concatenate([meetings[other], where])
    extension.vertices[2 * tip + 1] = ahead


def _tips(mesh: Mesh, meetings: Floats, solid: LocalSource) -> Ints:
    """Return the vertices (k,) at which a curve ends inside the ``solid`` and meets no other: not at ``meetings``."""
    ends = np.flatnonzero(np.bincount(mesh.cells.ravel(), minlength=len(mesh.vertices)) == 1)
    ends = ends[solid.closest_point(mesh.vertices[ends]).edge < 0]
    apart = norms(mesh.vertices[ends, None] - meetings).min(axis=1, initial=np.inf)
    return np.asarray(ends[apart > 2 * WELDED_SIZE_SHARE * box_size(mesh.vertices)])


def _first_meeting(start: Floats, end: Floats, curve: Curve, length: float) -> tuple[Floats, Floats]:
    """Return the ``end`` (d,) of a segment from ``start`` (d,), moved to where the segment first meets a ``curve``.

    The second result is that point as (1, d), or (0, d) if the segment meets the curve nowhere.
    """
    segment = Mesh.of(np.stack([start, end]), np.array([[0, 1]]))
    reach = 0.5 * float(norms(end - start))
    if curve[0].closest_point(0.5 * (start + end)[None]).distance[0] > reach * (1 + 1e-6):
        return end, np.zeros((0, len(start)))
    found = meetings_of_curves([(FlatCurve(segment), segment), curve], length)
    points = np.zeros((0, len(start))) if found is None else found[0]
    distance = norms(points - start)
    points = points[distance > 1e-3 * norms(end - start)]
    if not len(points):
        return end, points
    first = points[np.argmin(norms(points - start))]
    return first, first[None]


def with_curves_inside(
    skin: Skin,
    inside: Sequence[FlatPart],
    extensions: Sequence[Mesh],
    oriented: Sequence[OrientedBoundary],
    solid: LocalSource,
    lattice: Lattice,
) -> Skin:
    """Return the ``skin`` of a plane solid with two cells at each place of curves ``inside`` and of ``extensions``.

    Raises SceneError if a curve leaves no trace inside the solid.
    """
    parts = []
    for number, (part, boundary) in enumerate(zip(inside, oriented, strict=True)):
        mesh = _cells_inside(part.curved(lattice), solid, boundary.boundary.name)
        plus = left_of_normals(mesh, boundary, lattice)
        parts.append(_two_sided(part, mesh, number, plus, np.zeros(len(plus), dtype=bool)))
        if len(extensions[number].cells):
            flat = FlatPart(part.source, extensions[number], "flat", (), None).curved(lattice)
            plus = left_of_normals(flat, boundary, lattice)
            parts.append(_two_sided(part, flat, number, plus, np.ones(len(plus), dtype=bool)))
    return joined([skin, *parts])


def _two_sided(part: FlatPart, mesh: Mesh, number: int, plus: Bools, beyond: Bools) -> Skin:
    """Return the cells of a boundary inside, followed by the same cells with opposite normals.

    ``number`` is that of the boundary, ``plus`` (m,) is whether its left side is where the normals of ``mesh`` point,
    and ``beyond`` (m,) whether a cell is past a tip.
    """
    turned = with_turned(mesh, np.arange(len(mesh.cells)))
    midpoints = None
    if mesh.midpoints is not None and turned.midpoints is not None:
        midpoints = np.concatenate([mesh.midpoints, turned.midpoints])
    both = Mesh.of(mesh.vertices, np.concatenate([mesh.cells, turned.cells]), midpoints)
    owner, twin = np.full(len(both.cells), number), np.roll(np.arange(len(both.cells)), len(mesh.cells))
    left = np.concatenate([~plus, plus])
    return Skin(both, part.geometry, part.warnings, owner, left, np.tile(beyond, 2), twin)


def _cells_inside(mesh: Mesh, solid: LocalSource, name: str) -> Mesh:
    """Return the cells of a boundary's ``mesh`` whose centres lie in the ``solid``, as a mesh of their own.

    Raises SceneError, with the boundary's ``name``, if there are none.
    """
    within = solid.closest_point(mesh.centres).edge < 0
    if not within.any():
        raise SceneError(OUTSIDE.format(name))
    used, cells = np.unique(mesh.cells[within], return_inverse=True)
    return Mesh.of(
        mesh.vertices[used],
        cells.reshape(-1, mesh.cells.shape[1]),
        None if mesh.midpoints is None else mesh.midpoints[within],
    )


def left_of_normals(mesh: Mesh, boundary: OrientedBoundary, lattice: Lattice) -> Bools:
    """Return whether (m,) the left side of a ``boundary`` is where the normal of each of its cells points.

    The result is the same for all cells of a connected part that are oriented alike.
    """
    areas = areas_of(mesh)
    feet, on = boundary.feet(lattice.to_scene(mesh.centres) - boundary.left.origin)
    leftward = boundary.leftward(feet, on, DIFFERENCE_SPACINGS * lattice.spacing)
    votes, winding = dots(areas, leftward), mesh.winding
    pairs = facets_of_two_cells(mesh)[1] // mesh.cells.shape[1]
    count, part = connected_components(len(mesh.cells), pairs)
    sums = np.bincount(part, votes * winding, count)
    return np.where(winding == 0, votes, sums[part] * winding) > 0


def welded(skin: Skin, points: Floats) -> Skin:
    """Return the skin with one vertex at each of the ``points`` (k, d), at which cells end, and no cells within one."""
    from scipy.spatial import KDTree

    mesh = skin.mesh
    vertices, number = mesh.vertices.copy(), np.arange(len(mesh.vertices))
    tolerance = 2 * WELDED_SIZE_SHARE * box_size(vertices)
    for at, near in zip(points, KDTree(vertices).query_ball_point(points, tolerance), strict=True):
        if near:  # curves may meet outside of the solid
            number[near] = number[near].min()
            vertices[near] = at
    cells = number[mesh.cells]
    kept = np.flatnonzero(cells[:, 0] != cells[:, -1])  # a curve may cross a knot plane very near a point
    position = np.append(np.cumsum(np.bincount(kept, minlength=len(cells))) - 1, -1)
    whole = Mesh.of(vertices, cells[kept], None if mesh.midpoints is None else mesh.midpoints[kept])
    owner, left, beyond = skin.owner[kept], skin.left[kept], skin.beyond_tip[kept]
    return replace(skin, mesh=whole, owner=owner, left=left, beyond_tip=beyond, twin=position[skin.twin[kept]])


def check_sectors(skin: Skin, mesh: Mesh, names: Sequence[str], lattice: Lattice) -> Ints:
    """Return the facets (m, k) of a ``mesh`` of the skin by :func:`sector_facets`.

    Raises SceneError if a boundary goes on outside of the solid.
    """
    facets, is_open = sector_facets(mesh)
    cells = np.flatnonzero(is_open.any(axis=1))
    if len(cells):
        owner = skin.owner[cells % len(skin.owner)]
        label = f"boundary {names[owner.max()]!r}" if owner.max() >= 0 else "the boundary of the solid"
        at = place(lattice.to_scene(mesh.vertices[mesh.cells[cells[0]]].mean(axis=0)))
        raise SceneError(f"{label} leaves the solid, or lies upon another one, near {at}; end it there.")
    return facets
