"""The laws of feet: what closest points are against each other, against the query and against the manifold."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.testing.law import law, query_law, require_rows, sure
from cpmkit.testing.queries import Subject, for_queries, symmetric_points


@query_law("near unless exact", together=True)
def check_idempotence(subject: Subject, x: Floats) -> None:
    """The closest point of a foot is that foot, at no distance."""
    feet = subject.feet(x)
    feet = feet.take(sure(feet))
    again = subject.source.closest_point(np.ascontiguousarray(feet.points))
    apart = np.linalg.norm(again.points - feet.points, axis=1)
    round_off = subject.round_off(feet.points)
    require_rows(apart <= round_off, feet.points, "A foot moves when asked again, by", apart)
    require_rows(again.distance <= round_off, feet.points, "A foot lies off the manifold by", again.distance)


@query_law(together=True)
def check_lipschitz(subject: Subject, x: Floats) -> None:
    """Distances differ by no more than the queries are apart."""
    rng = np.random.default_rng(0)
    steps = subject.size * 10.0 ** rng.uniform(-6, 0, (len(x), 1)) * rng.normal(size=x.shape)
    both = np.concatenate([x, x + steps])
    beside = subject.source.closest_point(np.ascontiguousarray(both[len(x) :])).distance
    distance = np.concatenate([subject.feet(x).distance, beside])
    apart = np.linalg.norm(both[:, None] - both, axis=2)
    round_off = subject.round_off(both)
    excess = np.abs(distance[:, None] - distance) - apart - round_off[:, None] - round_off
    excess = excess.max(axis=1)
    require_rows(excess <= 0, both, "distance grows faster than the query moves, by", excess)


@query_law()
def check_distance(subject: Subject, x: Floats) -> None:
    """``distance`` is not negative and never above |x - points|; of an exact source the two are equal."""
    feet = subject.feet(x)
    excess = feet.distance - np.linalg.norm(x - feet.points, axis=1)
    require_rows(feet.distance >= 0, x, "distance is", feet.distance)
    require_rows(excess <= subject.round_off(x), x, "distance is above |x - points| by", excess)
    if subject.source.exact:
        require_rows(-excess <= subject.round_off(x), x, "distance is below |x - points| by", -excess)


@law()
def check_nearest(subject: Subject) -> None:
    """No point of the manifold is nearer than ``distance``: neither a sample nor the foot of another query."""
    known = subject.known_points()

    def hold(x: Floats) -> None:
        feet = subject.feet(x)
        others = feet.points if known is None else np.concatenate([feet.points, known])
        nearest = np.linalg.norm(x[:, None] - others, axis=2).min(axis=1)
        excess = feet.distance - nearest
        require_rows(excess <= subject.round_off(x), x, "A point of the manifold is nearer than distance, by", excess)

    for_queries(subject, hold)


@law()
def check_foot(subject: Subject) -> None:
    """A foot of a source that is not exact lies within turning angle x distance of the exact foot.

    The exact foot is not known, but its distance is: so |x - points| is at most
    (1 + turning angle) x distance, and that is what is checked. A foot that slides along the
    manifold by much less than the distance passes.
    """

    def hold(x: Floats) -> None:
        feet = subject.feet(x)
        allowed = (1 + subject.case.turning_angle) * feet.distance + subject.round_off(x)
        excess = np.linalg.norm(x - feet.points, axis=1) - allowed
        require_rows((excess <= 0) | ~sure(feet), x, "|x - points| is too large by", excess)

    if not subject.source.exact:
        for_queries(subject, hold, within_radius=True)


@law()
def check_degenerate(subject: Subject) -> None:
    """A query with many closest points gets one of them, never itself."""
    x = symmetric_points(subject)
    feet = subject.source.closest_point(x)
    require_rows(np.isfinite(feet.points).all(axis=1), x, "The foot is", feet.points)
    off = subject.source.closest_point(np.ascontiguousarray(feet.points)).distance
    require_rows(off <= subject.round_off(x), x, "The foot lies off the manifold by", off)
    for axis in range(subject.source.dim):
        step = 1e-3 * subject.size * np.eye(subject.source.dim)[axis]
        beside = subject.source.closest_point(x + step).distance
        drop = beside - np.linalg.norm(step) - np.linalg.norm(x - feet.points, axis=1)
        require_rows(drop <= subject.round_off(x), x, "The foot is nearer than the manifold, by", drop)


@law()
def check_bounds(subject: Subject) -> None:
    """The bounds hold every foot and every sample."""
    lower, upper = subject.source.bounds
    known = subject.known_points()

    def hold(x: Floats) -> None:
        points = subject.feet(x).points
        points = points if known is None else np.concatenate([points, known])
        beyond = np.maximum(lower - points, points - upper).max(axis=1)
        require_rows(beyond <= subject.round_off(points), points, "A point of the manifold is outside by", beyond)

    for_queries(subject, hold)
