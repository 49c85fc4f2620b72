"""Rims that face each other across a gap, boundaries near rims, and junctions of curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.forms.collocation.ghosts.ghost_geometry import ALONGSIDE_COSINE
from cpmkit.forms.collocation.side_view import BoundaryOnLattice
from cpmkit.forms.collocation.unresolved_geometry.meeting_boundaries import STRIP_SPACINGS
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.types import Bools, Floats, Ints

#: Half widths of gaps (spacings) that are tested in front of a rim; wider gaps hardly leak. Then the middle of a gap is
#: found by this many bisections.
HALF_GAPS_SPACINGS, GAP_BISECTIONS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0), 12
#: One point of a rim is examined in each cell of this many spacings.
RIM_SAMPLE_SPACINGS = 1.5
#: Least cosines: of the conormal with the direction to a foot ahead, and of that foot with the rim that it faces.
AHEAD_COSINE, FACING_COSINE = 0.5, 0.8
#: A gap narrower than this many spacings does not count as a gap.
TOUCHING_SPACINGS = 1e-3
#: Step, in spacings, of the differences that give a rim's conormal: across a narrower gap they are wrong.
CONORMAL_STEP_SPACINGS = 0.005
#: In a gap of at most this many spacings there are hardly any nodes past either rim.
BRIDGED_GAP_SPACINGS = 1.5
#: Rims that face each other so narrowly along this many spacings form a slit, not the tip of a notch or a small hole.
SLIT_LENGTH_SPACINGS = 6.0
#: Hardly any value leaks across a gap of this many spacings: a spacing of the gap over this number resolves it.
WIDE_GAP_SPACINGS = 6.0
#: A boundary nearer to a rim than this many spacings is on it, and runs along it if this many samples do; a curve that
#: ends at a rim has one or two there.
ON_RIM_SPACINGS, RIM_RUN_SAMPLES = 1e-3, 3
#: The closest point on a rim near a boundary is found from a point this many spacings past the rim.
PAST_RIM_SPACINGS = 0.05
#: Members of a union are examined where feet of neighbouring nodes on them are within this many spacings.
MEMBER_SEARCH_SPACINGS = 3.0
#: Number of alternating projections on two curves, which converge to a common point; curves nearer than this many
#: spacings then meet.
ALTERNATING_PROJECTIONS, MEETING_CURVES_SPACINGS = 40, 1e-2
#: Distance, in spacings, of the queries around a point that decide whether a curve ends there.
END_PROBE_SPACINGS = 0.05


@dataclass(frozen=True, eq=False)
class FacingRims:
    """The narrowest gap between a rim and another part of the manifold, or another part of the rim.

    Attributes
    ----------
    point : (d,) float64
        A point in the gap, in the scene's coordinates.
    gap : float
        The width of the gap.
    local : bool
        Whether stencils do not bridge it, or only at the tip of a notch or around a small hole.
    """

    point: Floats
    gap: float
    local: bool


@dataclass(frozen=True, eq=False)
class RimStrip:
    """A boundary near a rim.

    Attributes
    ----------
    boundary : int
        Number of the boundary.
    loop : int
        Number of the rim's loop.
    points : (k, d) float64
        Points of the boundary that are near the rim, nearest first, in the scene's coordinates.
    width : float
        The least distance.
    on_rim : bool
        Whether the boundary runs along the rim itself.
    """

    boundary: int
    loop: int
    points: Floats
    width: float
    on_rim: bool


@dataclass(frozen=True, eq=False)
class Junction:
    """A point, (d,) in the scene's coordinates, at which ``arms`` curves meet."""

    point: Floats
    arms: int


# Rims that face each other. Stencils of one rim read nodes whose closest points are on the other. Nodes past a rim
# satisfy its condition only where they are nearer to it than to any other part: in a gap of a spacing or two
# hardly any are, and values leak from one side to the other as if the gap were bridged.


def find_narrowest_gap(surface: LocalSource, band: Band, lattice: Lattice) -> list[FacingRims]:
    """Return a list of the narrowest gap in front of a rim of the manifold; it is empty if there is no gap.

    A gap that stencils bridge is preferred, unless it is that of a notch or a small hole. The number of queries grows
    with the length of the rims; without rims there are none.
    """
    past = np.flatnonzero(band.feet.edge >= 0)
    if not len(past):
        return []
    rim, outward, loop = _rim_samples(surface, band, past)
    far = np.full(len(rim), HALF_GAPS_SPACINGS[-1] * band.spacing)
    facing = _faces_another(surface, rim, outward, far, band.spacing)[0]
    rows, middle, across = _gaps_ahead(surface, rim[facing], outward[facing], band.spacing)
    if not len(rows):
        return []
    rows = np.flatnonzero(facing)[rows]
    gap = np.linalg.norm(across - rim[rows], axis=1)
    bridged = np.flatnonzero(gap <= BRIDGED_GAP_SPACINGS * band.spacing)
    if surface.largest_dim > 1 and len(bridged):
        bridged = bridged[_on_long_stretch(rim[rows[bridged]], loop[rows[bridged]], band.spacing)]
    chosen = bridged[gap[bridged].argmin()] if len(bridged) else gap.argmin()
    return [FacingRims(lattice.to_scene(middle[[chosen]])[0], float(gap[chosen]), not len(bridged))]


def _rim_samples(surface: LocalSource, band: Band, past: Ints) -> tuple[Floats, Floats, Ints]:
    """Return one point (k, d) of the rims in each cell, the outward conormals (k, d) there, and the loops (k,).

    ``past`` are the nodes past an edge, whose closest points are on the rims.
    """
    h, offset = band.spacing, band.positions[past] - band.feet.points[past]
    length = np.linalg.norm(offset, axis=1)
    cells = np.floor(band.feet.points[past] / (RIM_SAMPLE_SPACINGS * h)).astype(np.int64)
    order = np.argsort(-length, kind="stable")  # the farthest node defines the direction best
    labelled = np.column_stack([cells, band.feet.edge[past]])[order]
    chosen = order[np.unique(labelled, axis=0, return_index=True)[1]]
    feet, offset, length = band.feet.take(past[chosen]), offset[chosen], length[chosen]
    outward = offset / np.maximum(length, CONORMAL_STEP_SPACINGS * h)[:, None]
    by_differences = (surface.dimensions_at(feet) < surface.dim) | (length < CONORMAL_STEP_SPACINGS * h)
    rows = np.flatnonzero(by_differences)
    outward[rows] = outward_conormals(surface, feet.take(rows), CONORMAL_STEP_SPACINGS * h)
    return feet.points, outward, feet.edge


def _gaps_ahead(surface: LocalSource, rim: Floats, outward: Floats, spacing: float) -> tuple[Ints, Floats, Floats]:
    """Return the rim points (k,) that face another part of the manifold, and the middles and far ends of the gaps.

    ``rim`` (n, d) are points of rims, ``outward`` (n, d) the conormals there; middles and far ends are (k, d).
    """
    low, high = np.zeros(len(rim)), np.full(len(rim), np.inf)
    for step in HALF_GAPS_SPACINGS:
        rows = np.flatnonzero(np.isinf(high))
        ahead = np.full(len(rows), step * spacing)
        hit = _faces_another(surface, rim[rows], outward[rows], ahead, spacing)[0]
        high[rows[hit]], low[rows[~hit]] = step * spacing, step * spacing
    rows = np.flatnonzero(np.isfinite(high))
    start, b, low, high = rim[rows], outward[rows], low[rows], high[rows]
    for _ in range(GAP_BISECTIONS):
        middle = 0.5 * (low + high)
        hit = _faces_another(surface, start, b, middle, spacing)[0]
        low, high = np.where(hit, low, middle), np.where(hit, middle, high)
    across = _faces_another(surface, start, b, high, spacing)[1]
    middle_point = start + high[:, None] * b
    back, chord = middle_point - across, start - across
    width = np.linalg.norm(chord, axis=1)
    opposite = np.sum(back * chord, axis=1) > FACING_COSINE * np.linalg.norm(back, axis=1) * width
    is_gap = opposite & (width > TOUCHING_SPACINGS * spacing)
    return rows[is_gap], middle_point[is_gap], across[is_gap]


def _faces_another(
    surface: LocalSource, start: Floats, outward: Floats, ahead: Floats, spacing: float
) -> tuple[Bools, Floats]:
    """Return whether (k,) each rim point faces another part of the manifold, and the closest points (k, d).

    They are the closest points of the points ``ahead`` (k,) of the rim along ``outward`` (k, d).
    """
    feet = surface.closest_point(start + ahead[:, None] * outward).points
    distance = np.linalg.norm(feet - start, axis=1)
    is_ahead = np.sum((feet - start) * outward, axis=1) > AHEAD_COSINE * distance
    return is_ahead & (distance > CONORMAL_STEP_SPACINGS * spacing), feet


def _on_long_stretch(rim: Floats, loop: Ints, spacing: float) -> Bools:
    """Return whether (k,) each point (k, d) is on a stretch of a rim longer than the tip of a notch or a small hole."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    first, second = cKDTree(rim).query_pairs(2 * RIM_SAMPLE_SPACINGS * spacing, output_type="ndarray").T
    same = loop[first] == loop[second]
    graph = csr_array((np.ones(int(same.sum())), (first[same], second[same])), shape=(len(rim), len(rim)))
    count, label = connected_components(graph, directed=False)
    low, high = np.full((count, rim.shape[1]), np.inf), np.full((count, rim.shape[1]), -np.inf)
    np.minimum.at(low, label, rim)
    np.maximum.at(high, label, rim)
    return np.asarray(np.linalg.norm(high - low, axis=1)[label] >= SLIT_LENGTH_SPACINGS * spacing)


# Boundaries along a rim of the manifold, less than a spacing from it or on it


def find_rim_strips(
    boundaries: Sequence[BoundaryOnLattice], surface: LocalSource, band: Band, lattice: Lattice
) -> list[RimStrip]:
    """Return the boundaries near rims; without rims there are no closest point queries."""
    from scipy.spatial import cKDTree

    h, past, strips = band.spacing, np.flatnonzero(band.feet.edge >= 0), []
    for number, boundary in enumerate(boundaries if len(past) else ()):
        if not boundary.has_sides:
            continue
        points = surface.closest_point(boundary.samples).points
        distance, nearest = cKDTree(band.feet.points[past]).query(points)
        close = np.flatnonzero(distance < 3 * STRIP_SPACINGS * h)
        if not len(close):
            continue
        points, rim = points[close], band.feet.take(past[nearest[close]])
        outward = outward_conormals(surface, rim, CONORMAL_STEP_SPACINGS * h)
        inside = np.sum((rim.points - points) * outward, axis=1, keepdims=True)
        foot = surface.closest_point(points + (inside + PAST_RIM_SPACINGS * h) * outward)
        width = np.linalg.norm(foot.points - points, axis=1)
        seen = boundary.side_view(points, h, h)
        beside = (width[seen.rows] < STRIP_SPACINGS * h) & (foot.edge[seen.rows] >= 0) & ~seen.end
        beside &= np.abs(np.sum(seen.conormal * outward[seen.rows], axis=1)) > ALONGSIDE_COSINE
        rows = seen.rows[beside]
        rows = rows[np.argsort(width[rows], kind="stable")]
        if len(rows):
            on_rim = width[rows] < ON_RIM_SPACINGS * h
            along, least = bool(on_rim.all() or on_rim.sum() >= RIM_RUN_SAMPLES), float(width[rows[0]])
            strips.append(RimStrip(number, int(foot.edge[rows[0]]), lattice.to_scene(points[rows]), least, along))
    return strips


# Junctions of a manifold of curves: points at which three arms or more meet


def find_junctions(surface: LocalSource, band: Band, lattice: Lattice) -> list[Junction]:
    """Return the junctions of a union of curves, at which three arms or more meet; none for other manifolds."""
    members = surface.members
    if len(members) < 2 or surface.manifold_dim != 1 or band.feet.element is None:
        return []
    one, other = band.neighbours()
    element, points = band.feet.element, band.feet.points
    close = np.linalg.norm(points[one] - points[other], axis=1) < MEMBER_SEARCH_SPACINGS * band.spacing
    meetings: list[Floats] = []
    for first, second in combinations(range(len(members)), 2):
        beside = close & (np.minimum(element[one], element[other]) == first)
        beside &= np.maximum(element[one], element[other]) == second
        if beside.any():
            meetings += _common_points(members[first], members[second], points[one[beside]], band.spacing)
    distinct: list[Floats] = []
    for point in meetings:
        if all(np.linalg.norm(point - known) > END_PROBE_SPACINGS * band.spacing for known in distinct):
            distinct.append(point)
    arms = [sum(_arms_at(member, point, band.spacing) for member in members) for point in distinct]
    pairs = zip(distinct, arms, strict=True)
    return [Junction(lattice.to_scene(point[None])[0], count) for point, count in pairs if count > 2]


def _common_points(first: LocalSource, second: LocalSource, start: Floats, spacing: float) -> list[Floats]:
    """Return the points (d,) common to two curves that alternating projections reach from ``start`` (k, d).

    Points less than about a spacing apart are returned once.
    """
    start = start[np.unique(np.round(start / spacing).astype(np.int64), axis=0, return_index=True)[1]]
    on_second = start
    for _ in range(ALTERNATING_PROJECTIONS):
        on_first = first.closest_point(on_second).points
        on_second = second.closest_point(on_first).points
    on_first = on_first[np.linalg.norm(on_first - on_second, axis=1) < MEETING_CURVES_SPACINGS * spacing]
    return list(on_first[np.unique(np.round(on_first / spacing).astype(np.int64), axis=0, return_index=True)[1]])


def _arms_at(member: LocalSource, point: Floats, spacing: float) -> int:
    """Return the number of arms of a curve that leave a point: 0 if it is not on the curve, 1 at ends, 2 elsewhere."""
    if member.closest_point(point[None]).distance[0] > 2 * MEETING_CURVES_SPACINGS * spacing:
        return 0
    shifts = END_PROBE_SPACINGS * spacing * np.concatenate([np.eye(len(point)), -np.eye(len(point))])
    return 1 if (member.closest_point(point + shifts).edge >= 0).any() else 2
