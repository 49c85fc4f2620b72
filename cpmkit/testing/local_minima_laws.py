"""The laws of local minima of the distance, a foot on every sheet near a query; sources without them obey the laws."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cpmkit.errors import InputError
from cpmkit.manifold.abilities import HasLocalMinima, HasMembers, members_of
from cpmkit.manifold.source import ClosestPoints, ClosestPointSource
from cpmkit.testing.queries import Subject, certain, law, query_law, require, require_rows
from cpmkit.types import Floats, Ints

#: The radii of the searches, relative to the size.
RADII_SHARES = (0.2, 0.5)
#: Length of the step from a foot towards its query, relative to their distance.
TOWARDS_QUERY_SHARE = 1e-3
#: Distance from a foot of the points that are compared with it, relative to the size.
AROUND_FOOT_SHARE = 1e-5


@query_law(ability=HasLocalMinima)
def check_local_minima(subject: Subject, x: Floats) -> None:
    """Feet within a radius lie on the manifold at their distance, ordered by row and distance, the closest point first.

    A larger radius adds feet and removes none.
    """
    small, large = (share * subject.size for share in RADII_SHARES)

    closest = subject.feet(x)
    rows, feet = subject.source.local_minima(x, large)
    _require_order(subject, x, rows, feet)
    expected = np.flatnonzero(closest.distance <= large)
    require(
        np.array_equal(np.unique(rows), expected), "The queries with feet are not those whose closest point is near."
    )
    require((feet.distance <= large).all(), "A foot lies beyond the radius.")
    first = np.flatnonzero(np.diff(rows, prepend=-1))
    apart = np.abs(_foot_distances(x, rows, feet)[first] - np.linalg.norm(x - closest.points, axis=1)[rows[first]])
    allowed = subject.round_off(x)[rows]
    require_rows(apart <= allowed[first], x[rows[first]], "The first foot is not the closest point, by", apart)
    off = subject.source.closest_point(np.ascontiguousarray(feet.points)).distance
    require_rows(off <= subject.round_off(feet.points), x[rows], "A foot lies off the manifold by", off)
    excess = feet.distance - _foot_distances(x, rows, feet)
    require_rows(excess <= allowed, x[rows], "distance is above |x - points| by", excess)
    if subject.source.exact:
        require_rows(-excess <= allowed, x[rows], "distance is below |x - points| by", -excess)
    within = subject.source.local_minima(x, small)[1]
    same = np.array_equal(within.points, feet.points[feet.distance <= small])
    require(same, "The feet within a small radius are not those that a large one finds there.")


@query_law("near unless exact", HasLocalMinima)
def check_sheets(subject: Subject, x: Floats) -> None:
    """Feet of one query are distinct local minima; each is the closest point of a point a little nearer the query.

    The query therefore lies along the normal, between the normals at a crease, or beyond the edge. For an exact source
    other points around a foot are farther away. The members of a union are checked one by one: where two touch, a foot
    on one may be no local minimum of both.
    """
    rows, feet = subject.source.local_minima(x, RADII_SHARES[1] * subject.size)
    for member, chosen in _by_member(subject.source, feet):
        _require_distinct(x, rows[chosen], feet.take(chosen), subject)
        chosen = chosen[certain(feet.take(chosen))]
        points, towards = feet.points[chosen], TOWARDS_QUERY_SHARE * (x[rows[chosen]] - feet.points[chosen])
        nearest = member.closest_point(np.ascontiguousarray(points + towards)).points
        slid = np.linalg.norm(nearest - points, axis=1)
        allowed = subject.case.turning_angle * np.linalg.norm(towards, axis=1) + subject.round_off(points)
        require_rows(slid <= allowed, x[rows[chosen]], "From a point nearer the query, the foot slides", slid)
        if member.exact:
            _require_minima(member, x[rows[chosen]], points, subject)


@law(HasLocalMinima)
def check_bad_radius(subject: Subject) -> None:
    """Wrong queries, and a radius not above zero, are refused with InputError."""
    good, dim = subject.centre[None], subject.source.dim
    rows, feet = subject.source.local_minima(np.empty((0, dim)), subject.size)
    require(len(rows) == len(feet) == 0, "No queries have feet.")
    for x, radius in (
        (good * np.nan, 1.0),
        (np.zeros((4, dim + 1)), 1.0),
        (good, 0.0),
        (good, -1.0),
        (good, float("nan")),
    ):
        try:
            subject.source.local_minima(x, radius)
        except InputError:
            continue
        raise AssertionError(f"Queries of shape {x.shape} with a radius of {radius} are accepted.")


def _foot_distances(x: Floats, rows: Ints, feet: ClosestPoints) -> Floats:
    """Return the distances (k,) of feet from their queries, the rows ``rows`` (k,) of ``x``."""
    return np.asarray(np.linalg.norm(x[rows] - feet.points, axis=1))


def _require_order(subject: Subject, x: Floats, rows: Ints, feet: ClosestPoints) -> None:
    """Require that ``rows`` (k,) are whole numbers that ascend, and the feet of each query are ordered by distance."""
    require(rows.dtype == np.int64 and rows.shape == (len(feet),), f"{rows.dtype} {rows.shape} rows of {len(feet)}.")
    step = np.diff(rows)
    require((step >= 0).all(), "The rows do not ascend.")
    back = -np.diff(feet.distance)[step == 0]
    require_rows(
        back <= subject.round_off(x)[rows[1:][step == 0]], x[rows[1:]][step == 0], "Feet come nearer, by", back
    )


def _by_member(source: ClosestPointSource, feet: ClosestPoints) -> Iterator[tuple[ClosestPointSource, Ints]]:
    """Yield each member of a union, or the source itself, with the indices of its feet."""
    for number, member in enumerate(members_of(source)):
        yield member, np.flatnonzero(feet.element == number) if isinstance(source, HasMembers) else np.arange(len(feet))


def _require_distinct(x: Floats, rows: Ints, feet: ClosestPoints, subject: Subject) -> None:
    """Require that no two feet of a query coincide; ``rows`` (k,) are the queries of the feet."""
    order = np.lexsort((*feet.points.T, rows))
    ahead = np.roll(order, -1)
    apart = np.linalg.norm(feet.points[ahead] - feet.points[order], axis=1)
    twice = (rows[ahead] == rows[order]) & (ahead != order) & (apart <= subject.round_off(feet.points[order]))
    require_rows(~twice, x[rows[order]], "Two feet are apart by", apart)


def _require_minima(source: ClosestPointSource, x: Floats, points: Floats, subject: Subject) -> None:
    """Require that, of two opposite points beside each foot, at least one is no nearer to the query.

    The other may be nearer where the foot is beside the edge of a facet.
    """
    step = AROUND_FOOT_SHARE * subject.size * np.random.default_rng(0).normal(size=points.shape)
    both = [source.closest_point(np.ascontiguousarray(points + sign * step)).points for sign in (1.0, -1.0)]
    gain = np.linalg.norm(x - points, axis=1) - np.max([np.linalg.norm(x - side, axis=1) for side in both], axis=0)
    require_rows(gain <= subject.round_off(x), x, "There are nearer points on both sides of a foot, by", gain)
