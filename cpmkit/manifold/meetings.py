"""Places where members of different dimension in a union meet, computed from closest points and cached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np

from cpmkit.manifold.abilities import HasMesh, members_of
from cpmkit.manifold.local_source import largest_dim
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.types import Bools, Floats

#: Members touch where they are nearer than this share of the union's largest side: rounding, and errors of meshes.
TOUCHING_SHARE = 1e-5
#: A member lies on another in part if more than this share of its points touch it.
PART_SHARE = 0.02
#: A rim reaches the edge of a solid if it is nearer than this share of the largest side: the chords of a polygon of 32
#: corners are off the circle by a quarter of a percent of its diameter.
REACHED_SHARE = 3e-3
#: A curve and a surface are tangent between two places if their distance between is below so many touching distances.
TANGENT_FACTOR = 10.0
#: Number of points on a curve at which its distance from other members is computed.
CURVE_SAMPLES = 4000


@dataclass(frozen=True, eq=False)
class Meeting:
    """Two members of a union that meet, of different dimension."""

    lower: int  #: The number of the member of lower dimension.
    higher: int  #: The number of the other member.
    #: "along": all of the lower member lies on the other, or on the boundary of a solid. "points": they meet at single
    #: points. "in part": a part of the lower member lies on or in the other. "within": the lower member lies in a solid
    #: and divides it. "inside": the lower member is a curve in a solid in space.
    how: Literal["along", "points", "in part", "within", "inside"]
    #: (k, d): points where they meet, for "points" all of them; for "in part" a point where the lower one leaves.
    places: Floats


#: The meetings of unions in use: to find them takes some thousand closest points.
_MEETINGS: WeakKeyDictionary[ClosestPointSource, tuple[Meeting, ...]] = WeakKeyDictionary()


def meetings_of(surface: ClosestPointSource) -> Sequence[Meeting]:
    """Return a meeting for each pair of members of different dimension in a union that meet, whatever the spacing."""
    if surface not in _MEETINGS:
        found = [_meeting(surface, *pair) for pair in pairs_of_dimensions(members_of(surface))]
        _MEETINGS[surface] = tuple(each for each in found if each is not None)
    return _MEETINGS[surface]


def _meeting(surface: ClosestPointSource, lower: int, higher: int) -> Meeting | None:
    """Return how two members of a union meet, given by their numbers; None if they do not touch."""
    members, touching = members_of(surface), touching_distance(surface)
    of_lower, of_higher = members[lower], members[higher]
    x, step = samples_of(of_lower)
    on = is_near(of_higher, x, surface)
    if largest_dim(of_higher) == of_higher.dim:
        around = (x[:, None] + _steps(of_higher.dim, touching)).reshape(-1, of_higher.dim)
        inside = is_near(of_higher, around, surface).reshape(len(x), -1).all(axis=1)
        if inside.any():
            if not on.all():
                return Meeting(lower, higher, "in part", _where_it_leaves(x, on))
            divides = largest_dim(of_lower) == of_higher.dim - 1
            return Meeting(lower, higher, "within" if divides else "inside", x)
    if on.all():
        return Meeting(lower, higher, "along", x)
    if on.sum() > max(PART_SHARE * len(x), 2):
        return Meeting(lower, higher, "in part", _where_it_leaves(x, on))
    if step:
        places = _crossings(of_lower, of_higher, x, step, touching)
    else:
        gap, places = approaches(of_lower, of_higher, touching, touching)
        places = places if gap == 0 else places[:0]
    return Meeting(lower, higher, "points", _at_ends(of_lower, places, touching)) if len(places) else None


def _where_it_leaves(samples: Floats, on: Bools) -> Floats:
    """Return the sample (1, d) off another member that is nearest to those ``on`` it (n,), of ``samples`` (n, d)."""
    from scipy.spatial import cKDTree

    off = samples[~on]
    return off[[int(cKDTree(samples[on]).query(off)[0].argmin())]]


def samples_of(source: ClosestPointSource) -> tuple[Floats, float]:
    """Return points (n, d) of a source, and for a curve with a mesh the distance between neighbours, else 0."""
    box = np.asarray(source.bounds, dtype=np.float64)
    size = float(np.ptp(box, axis=0).max())
    if largest_dim(source) == 1 and isinstance(source, HasMesh):
        vertices, cells = source.mesh(size / 200)
        start, chord = vertices[cells[:, 0]], vertices[cells[:, 1]] - vertices[cells[:, 0]]
        length = norms(chord)
        step = float(length.sum()) / CURVE_SAMPLES
        count = np.ceil(length / step).astype(np.int64)
        each = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(each)) - np.repeat(np.cumsum(count) - count, count)) / count[each]
        points = start[each] + share[:, None] * chord[each]
        return source.closest_point(np.concatenate([points, vertices])).points, step
    axes = np.linspace(box[0], box[1], round(2000 ** (1 / source.dim))).T
    feet = source.closest_point(np.array([*product(*axes)]))
    ends_first = (feet.edge < 0).astype(np.float64)
    return feet.points[_distinct(feet.points, ends_first, 0.01 * size)], 0.0


def crossings(curve: ClosestPointSource, other: ClosestPointSource, of: ClosestPointSource) -> Floats:
    """Return the points (k, d) where a curve meets another source, to rounding relative to the size of ``of``."""
    samples, step = samples_of(curve)
    return _crossings(curve, other, samples, step, touching_distance(of))


def _crossings(
    curve: ClosestPointSource, other: ClosestPointSource, samples: Floats, step: float, touching: float
) -> Floats:
    """Return the points (k, d) where a curve with ``samples`` (n, d), a ``step`` apart, meets another member."""
    x = samples[norms(other.closest_point(samples).points - samples) <= step]
    x, y = _project_in_turn(curve, other, x, 1e-3 * touching)
    gap = norms(y - x)
    x, gap = x[gap <= touching], gap[gap <= touching]
    chosen = _distinct(x, gap, 2 * step)
    return _without_tangents(curve, other, x[chosen], touching)


def _without_tangents(curve: ClosestPointSource, other: ClosestPointSource, places: Floats, touching: float) -> Floats:
    """Return the ``places`` (k, d), sorted by gap, with one place where the curve runs along the other source.

    Where the two are tangent, many points of the curve touch; neighbours are one place if the curve touches between.
    """
    if len(places) < 2:
        return places
    from scipy.spatial import cKDTree

    from cpmkit.runtime.index_sets import connected_components

    distance, near = (each[:, 1:] for each in cKDTree(places).query(places, min(3, len(places))))
    row, column = np.nonzero(distance <= 1.5 * distance[:, :1])  # not past a neighbour
    pairs = np.stack([row, near[row, column]], axis=1)
    chord = places[pairs]
    middle = curve.closest_point(chord.mean(axis=1)).points
    straight = norms(middle - chord.mean(axis=1)) <= 0.1 * norms(chord[:, 1] - chord[:, 0])
    joined = straight & (norms(other.closest_point(middle).points - middle) <= TANGENT_FACTOR * touching)
    count, label = connected_components(len(places), pairs[joined])
    return places[[int(np.flatnonzero(label == k)[0]) for k in range(count)]]


def edges_near(source: ClosestPointSource, places: Floats) -> dict[int, Floats]:
    """Return points (m, d) of each edge loop of ``source`` on which some of ``places`` (k, d) lie, by its number.

    The test moves the places a little, since by rounding the closest point of an end may be off all edges.
    """
    steps = _steps(source.dim, touching_distance(source))
    feet = source.closest_point((places[:, None] + steps).reshape(-1, source.dim))
    return {int(loop): feet.points[feet.edge == loop] for loop in np.unique(feet.edge[feet.edge >= 0])}


def reaches_edge(lower: ClosestPointSource, source: ClosestPointSource, points: Floats, loop: int | None) -> Bools:
    """Return whether (n,) ``lower`` reaches the edge ``loop`` of ``source`` at each of ``points`` (n, d) of its rims.

    ``loop`` None means any edge. As for :func:`edges_near`, the test moves the points a little; one move is longer,
    outwards from ``lower``, since a polygon may be off a curved edge.
    """
    steps, dim = _steps(source.dim, touching_distance(source)), source.dim
    around = points[:, None] + steps
    outward = unit((around - lower.closest_point(around.reshape(-1, dim)).points.reshape(around.shape)).sum(axis=1))
    beyond = points + REACHED_SHARE / TOUCHING_SHARE * touching_distance(source) * outward
    queries = np.concatenate([around, beyond[:, None]], axis=1).reshape(-1, dim)
    edge = source.closest_point(queries).edge.reshape(len(points), len(steps) + 1)
    return np.asarray(((edge >= 0) if loop is None else (edge == loop)).any(axis=1))


def distinct_places(places: Floats, of: ClosestPointSource) -> Floats:
    """Return ``places`` (k, d) without repetitions, to rounding relative to the size of ``of``."""
    return places[sorted(_distinct(places, np.zeros(len(places)), 4 * touching_distance(of)))]


def is_near(source: ClosestPointSource, points: Floats, of: ClosestPointSource) -> Bools:
    """Return whether (n,) each of ``points`` (n, d) touches a source, relative to the size of ``of``."""
    return np.asarray(norms(source.closest_point(points).points - points) <= touching_distance(of))


def touching_distance(source: ClosestPointSource) -> float:
    """Return the distance up to which something touches a source: a share of its largest side."""
    return TOUCHING_SHARE * float(np.ptp(np.asarray(source.bounds, dtype=np.float64), axis=0).max())


def _steps(dim: int, touching: float) -> Floats:
    """Return steps (2 d, d) along the axes, a few times as long as ``touching``."""
    return 4 * touching * np.concatenate([np.eye(dim), -np.eye(dim)])


def _at_ends(source: ClosestPointSource, places: Floats, touching: float) -> Floats:
    """Return ``places`` (k, d) on a source, moved onto its edge if they are about as near as ``touching``."""
    feet = source.closest_point((places[:, None] + _steps(source.dim, touching)).reshape(-1, source.dim))
    at_edge = (feet.edge >= 0).reshape(len(places), -1)
    moved = feet.points.reshape(len(places), -1, source.dim)[np.arange(len(places)), at_edge.argmax(axis=1)]
    return np.where(np.asarray(at_edge.any(axis=1))[:, None], moved, places)


def pairs_of_dimensions(members: Sequence[ClosestPointSource]) -> list[tuple[int, int]]:
    """Return the numbers of all pairs of ``members`` of different dimension, that of lower dimension first."""
    dims = [largest_dim(member) for member in members]
    return [(low, high) for low, high in permutations(range(len(members)), 2) if dims[low] < dims[high]]


def approaches(
    lower: ClosestPointSource, higher: ClosestPointSource, within: float, touching: float
) -> tuple[float, Floats]:
    """Return the least distance of two members, and the places (k, d) of ``lower`` where it is at most ``within``.

    The places, in a fixed order and at least ``within`` and 2 percent of the bounds apart, are found by alternating
    projections from up to 64 of about 1000 points, which may miss some. A distance up to ``touching`` is returned as 0.
    """
    boxes = np.array([lower.bounds, higher.bounds], dtype=np.float64)
    low, high = boxes[:, 0].max(axis=0) - within, boxes[:, 1].min(axis=0) + within
    if (low > high).any():
        return np.inf, np.zeros((0, lower.dim))
    size = float(np.ptp(boxes, axis=(0, 1)).max())
    axes = np.linspace(low, high, round(1000 ** (1 / lower.dim))).T
    x = lower.closest_point(np.array([*product(*axes)])).points
    y = higher.closest_point(x).points
    starts = _distinct(x, norms(y - x), 0.01 * size)[:64]
    x, y = _project_in_turn(lower, higher, x[starts], touching)
    gap = np.where(norms(y - x) <= touching, 0.0, norms(y - x))
    x, gap = (each[gap <= (within if gap.min() > 0 else 0.0)] for each in (x, gap))
    chosen = _distinct(x, gap, max(within, 0.02 * size))
    x, gap = x[chosen], gap[chosen]
    return float(gap.max(initial=0.0)), x[np.lexsort(np.round(x / size, 6).T[::-1])]


def _project_in_turn(
    lower: ClosestPointSource, higher: ClosestPointSource, x: Floats, near: float
) -> tuple[Floats, Floats]:
    """Return points x and y, (k, d) each, on two sources, by alternating projections until all pairs are ``near``."""
    y = higher.closest_point(x).points
    for _ in range(200):
        if norms(y - x).max(initial=0.0) <= near:
            break
        x = lower.closest_point(y).points
        y = higher.closest_point(x).points
    return x, y


def _distinct(points: Floats, distance: Floats, apart: float) -> list[int]:
    """Return rows of ``points`` (n, d), by ascending ``distance`` (n,), that are at least ``apart`` from each other."""
    left, chosen = np.argsort(distance, kind="stable"), []
    while len(left):
        chosen.append(int(left[0]))
        left = left[norms(points[left] - points[left[0]]) > apart]
    return chosen
