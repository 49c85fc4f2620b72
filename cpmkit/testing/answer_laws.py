"""The laws of every source: the form of its answers, and feet against each other, the query and the manifold."""

from __future__ import annotations

from functools import partial

import numpy as np

from cpmkit.manifold.abilities import edge_limit_of
from cpmkit.manifold.source import ClosestPoints, ClosestPointSource
from cpmkit.testing.queries import Subject, certain_rows, law, require, require_refusal, require_rows, symmetric_points
from cpmkit.types import Floats

#: Shares of the size: step from a foot to points around it, and least step along the manifold to a query beyond a foot.
AROUND_SHARE, AWAY_SHARE = 1e-4, 1e-3
#: Shares for three questions on the feet of points around a foot. The manifold is flat if these feet leave the tangent
#: space by less than the first share of their spread. A query is beyond the foot if its direction has a tangential part
#: above the second. The manifold ends if their mean is off the foot by the third: 0 inside, 0.3 steps at a straight
#: rim.
FLAT_SHARE, BEYOND_SHARE, ONE_SIDED_SHARE = 0.05, 0.3, 0.05


@law()
def check_statement(subject: Subject) -> None:
    """A source states its dimensions, finite ordered bounds and whether it is exact."""
    source = subject.source
    require(isinstance(source, ClosestPointSource), "It lacks a member of ClosestPointSource.")
    require(source.dim in (2, 3), f"dim is {source.dim!r}, not 2 or 3.")
    allowed = (None, *range(source.dim + 1))
    require(source.manifold_dim in allowed, f"manifold_dim is {source.manifold_dim!r}, not one of {allowed}.")
    require(isinstance(source.exact, (bool, np.bool_)), f"exact is {source.exact!r}, not True or False.")
    bounds = source.bounds
    shape, kind = (2, source.dim), np.float64
    require(bounds.shape == shape and bounds.dtype == kind, f"bounds are {bounds.dtype} {bounds.shape}, not float64.")
    require(np.isfinite(bounds).all() and (bounds[0] <= bounds[1]).all(), f"bounds are {bounds.tolist()}.")


@law("anywhere")
def check_shapes(subject: Subject, x: Floats) -> None:
    """Every array of an answer has its length, its shape and its type, is finite, and empty for no queries."""
    _require_arrays(subject.source.closest_point(x[:0]), x[:0])
    feet = subject.source.closest_point(x)
    _require_arrays(feet, x)
    require_rows(np.isfinite(feet.points).all(axis=1), x, "The foot is", feet.points)
    require_rows(np.isfinite(feet.distance), x, "distance is", feet.distance)
    if feet.local is not None:
        require_rows(np.isfinite(feet.local).all(axis=1), x, "local is", feet.local)


@law("anywhere", together=True)
def check_input_untouched(subject: Subject, x: Floats) -> None:
    """The queries are not modified, and share no memory with the answer."""
    queries = x.copy()
    feet = subject.source.closest_point(queries)
    require_rows((queries == x).all(axis=1), x, "The query was changed", queries)
    require(not np.shares_memory(feet.points, queries), "The answer shares memory with the queries.")


@law("anywhere")
def check_batches(subject: Subject, x: Floats) -> None:
    """An answer does not depend on the other queries of its batch."""
    whole = subject.source.closest_point(x.copy())  # not in the batch of all laws: where feet tie, rounding decides
    for parts in (np.array_split(x, 3), [x[i : i + 1] for i in range(min(3, len(x)))]):
        answers = [subject.source.closest_point(np.ascontiguousarray(part)) for part in parts]
        queries = np.concatenate(parts)
        points = np.concatenate([answer.points for answer in answers])
        edge = np.concatenate([answer.edge for answer in answers])
        apart = np.linalg.norm(points - whole.points[: len(queries)], axis=1)
        require_rows(apart <= subject.round_off(queries), queries, "In a smaller batch the foot moves by", apart)
        require_rows(edge == whole.edge[: len(queries)], queries, "In a smaller batch edge becomes", edge)


@law()
def check_bad_input(subject: Subject) -> None:
    """NaN, infinity and wrong shapes are refused with InputError."""
    dim = subject.source.dim
    for value in (np.nan, np.inf, -np.inf):
        x = np.tile(subject.centre, (3, 1))
        x[1, dim - 1] = value
        require_refusal(partial(subject.source.closest_point, x), f"a coordinate {value}")
    for shape in ((dim,), (4, dim + 1), (4, 1), (2, 2, dim)):
        require_refusal(partial(subject.source.closest_point, np.zeros(shape)), f"the shape {shape}")


@law("anywhere")
def check_edge(subject: Subject, x: Floats) -> None:
    """``edge`` is -1 or the number of an edge: of a curve 0 or 1, of a point none, else below the source's limit.

    The limit is 1000, or the source's ``edge_limit``, a multiple of 1000.
    """
    limit = edge_limit_of(subject.source)
    require(limit > 0 and limit % 1000 == 0, f"The limit of the edges' numbers is {limit}, no multiple of 1000.")
    limit = {0: 0, 1: 2}.get(subject.source.manifold_dim, limit)
    edge = subject.feet(x).edge
    require_rows((edge >= -1) & (edge < limit), x, f"The limit of edge is {limit}, and it is", edge)


@law("near", together=True)
def check_rims(subject: Subject, x: Floats) -> None:
    """A foot is on an edge, ``edge >= 0``, where its query lies beyond it along the manifold; there the manifold ends.

    Feet at which the manifold is not flat are left out: at creases, corners and junctions.
    """
    m, dim, step = subject.source.manifold_dim, subject.source.dim, AROUND_SHARE * subject.size
    if not m:
        return
    feet = subject.feet(x)
    x, feet = x[certain_rows(feet)], feet.take(certain_rows(feet))
    steps = step * np.random.default_rng(0).normal(size=(8, dim))
    around = feet.points[:, None] + np.concatenate([steps, -steps])
    offsets = subject.source.closest_point(around.reshape(-1, dim)).points.reshape(around.shape) - feet.points[:, None]
    spread, axes = np.linalg.svd(offsets, full_matrices=False)[1:]
    flat = (spread[:, m - 1] > step) & (spread[:, m:] < FLAT_SHARE * spread[:, [m - 1]]).all(axis=1)
    along = np.linalg.norm(np.einsum("nkd,nd->nk", axes[:, :m], x - feet.points), axis=1)
    least = np.maximum(AWAY_SHARE * subject.size, (BEYOND_SHARE + subject.case.turning_angle) * feet.distance)
    inside = ~flat | (along < least)
    require_rows(inside | (feet.edge >= 0), x, "The query lies beyond an end of the manifold, and edge is", feet.edge)
    ends = ~flat | (np.linalg.norm(offsets.mean(axis=1), axis=1) > ONE_SIDED_SHARE * step)
    require_rows(ends | (feet.edge < 0), x, "The manifold does not end at the foot, and edge is", feet.edge)


@law("near unless exact", together=True)
def check_idempotence(subject: Subject, x: Floats) -> None:
    """The closest point of a foot is that foot, at distance zero."""
    feet = subject.feet(x)
    feet = feet.take(certain_rows(feet))
    again = subject.source.closest_point(np.ascontiguousarray(feet.points))
    apart = np.linalg.norm(again.points - feet.points, axis=1)
    round_off = subject.round_off(feet.points)
    require_rows(apart <= round_off, feet.points, "The closest point of a foot is apart from it by", apart)
    require_rows(again.distance <= round_off, feet.points, "A foot lies off the manifold by", again.distance)


@law("anywhere", together=True)
def check_lipschitz(subject: Subject, x: Floats) -> None:
    """Distances differ by no more than the queries are apart."""
    rng = np.random.default_rng(0)
    steps = subject.size * 10.0 ** rng.uniform(-6, 0, (len(x), 1)) * rng.normal(size=x.shape)
    both = np.concatenate([x, x + steps])
    distance_after_step = subject.source.closest_point(np.ascontiguousarray(both[len(x) :])).distance
    distance = np.concatenate([subject.feet(x).distance, distance_after_step])
    apart = np.linalg.norm(both[:, None] - both, axis=2)
    round_off = subject.round_off(both)
    excess = np.abs(distance[:, None] - distance) - apart - round_off[:, None] - round_off
    excess = excess.max(axis=1)
    require_rows(excess <= 0, both, "distance grows faster than the query moves, by", excess)


@law("anywhere")
def check_distance(subject: Subject, x: Floats) -> None:
    """``distance`` is not negative and never above |x - points|; of an exact source the two are equal."""
    feet = subject.feet(x)
    excess = feet.distance - np.linalg.norm(x - feet.points, axis=1)
    require_rows(feet.distance >= 0, x, "distance is", feet.distance)
    require_rows(excess <= subject.round_off(x), x, "distance is above |x - points| by", excess)
    if subject.source.exact:
        require_rows(-excess <= subject.round_off(x), x, "distance is below |x - points| by", -excess)


@law("anywhere")
def check_nearest(subject: Subject, x: Floats) -> None:
    """No point of the manifold is nearer than ``distance``: neither a sample nor the foot of another query."""
    feet = subject.feet(x)
    others = np.concatenate([feet.points, subject.known_points])
    excess = feet.distance - np.linalg.norm(x[:, None] - others, axis=2).min(axis=1)
    require_rows(excess <= subject.round_off(x), x, "A point of the manifold is nearer than distance, by", excess)


@law("near")
def check_foot(subject: Subject, x: Floats) -> None:
    """A foot of a source that is not exact lies within turning angle x distance of the exact foot.

    The exact foot is not known, but its distance is: |x - points| is at most (1 + turning angle) x distance, which is
    checked. A foot that slides along the manifold by much less than the distance passes.
    """
    if subject.source.exact:
        return
    feet = subject.feet(x)
    allowed = (1 + subject.case.turning_angle) * feet.distance + subject.round_off(x)
    excess = np.linalg.norm(x - feet.points, axis=1) - allowed
    require_rows((excess <= 0) | ~certain_rows(feet), x, "|x - points| is too large by", excess)


@law()
def check_degenerate(subject: Subject) -> None:
    """A query with many closest points gets a foot on the manifold, not nearer; nor farther if the source is exact."""
    x = symmetric_points(subject)
    feet = subject.source.closest_point(x)
    require_rows(np.isfinite(feet.points).all(axis=1), x, "The foot is", feet.points)
    off = subject.source.closest_point(np.ascontiguousarray(feet.points)).distance
    require_rows(off <= subject.round_off(x), x, "The foot lies off the manifold by", off)
    for axis in range(subject.source.dim):
        step = 1e-3 * subject.size * np.eye(subject.source.dim)[axis]
        distance = subject.source.closest_point(x + step).distance
        nearer = distance - np.linalg.norm(x - feet.points, axis=1)
        excess = (np.abs(nearer) if subject.source.exact else nearer) - np.linalg.norm(step)
        require_rows(excess <= subject.round_off(x), x, "The foot is nearer or farther than the manifold, by", excess)


@law("anywhere")
def check_bounds(subject: Subject, x: Floats) -> None:
    """The bounds contain every foot and every sample."""
    lower, upper = subject.source.bounds
    points = np.concatenate([subject.feet(x).points, subject.known_points])
    beyond = np.maximum(lower - points, points - upper).max(axis=1)
    require_rows(beyond <= subject.round_off(points), points, "A point of the manifold is outside by", beyond)


def _require_arrays(feet: ClosestPoints, x: Floats) -> None:
    """Raise AssertionError unless all arrays of the answer ``feet`` to queries ``x`` (n, d) have shape and type."""
    n, dim = x.shape
    expected = {
        "points": ((n, dim), np.float64),
        "distance": ((n,), np.float64),
        "edge": ((n,), np.int64),
        "element": ((n,), np.int64),
        "local": ((n, None), np.float64),
        "doubtful": ((n,), np.bool_),
    }
    for name, (shape, kind) in expected.items():
        array = getattr(feet, name)
        if array is None and name in ("element", "local", "doubtful"):
            continue
        require(isinstance(array, np.ndarray), f"{name} is {type(array).__name__}, not an array.")
        fits = array.ndim == len(shape) and all(w in (None, s) for w, s in zip(shape, array.shape, strict=True))
        require(fits and array.dtype == kind, f"{name} is {array.dtype} {array.shape} for {n} queries in {dim}D.")
