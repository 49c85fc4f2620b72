"""The laws of form: what every answer looks like, whatever the manifold."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import InputError
from cpmkit.protocols import ClosestPoints, ClosestPointSource, Floats
from cpmkit.testing.law import law, query_law, require, require_rows
from cpmkit.testing.queries import Subject


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


@query_law()
def check_shapes(subject: Subject, x: Floats) -> None:
    """Every array of an answer has its length, its shape and its type."""
    _require_arrays(subject.source.closest_point(x), x)


@law()
def check_empty(subject: Subject) -> None:
    """No queries get no answers, in arrays of the right shapes."""
    x = np.empty((0, subject.source.dim))
    _require_arrays(subject.source.closest_point(x), x)


@query_law(together=True)
def check_input_untouched(subject: Subject, x: Floats) -> None:
    """The queries are not written to."""
    given = x.copy()
    feet = subject.source.closest_point(given)
    require_rows((given == x).all(axis=1), x, "The query was changed", given)
    require(not np.shares_memory(feet.points, given), "The answer shares memory with the queries.")


@query_law()
def check_batches(subject: Subject, x: Floats) -> None:
    """An answer does not depend on the queries that are asked with it."""
    whole = subject.source.closest_point(x.copy())  # not in the batch of all laws: where feet tie, rounding decides
    for parts in (np.array_split(x, 3), [x[i : i + 1] for i in range(min(3, len(x)))]):
        pieces = [subject.source.closest_point(np.ascontiguousarray(part)) for part in parts]
        target = np.concatenate(parts)
        points = np.concatenate([piece.points for piece in pieces])
        edge = np.concatenate([piece.edge for piece in pieces])
        apart = np.linalg.norm(points - whole.points[: len(target)], axis=1)
        require_rows(apart <= subject.round_off(target), target, "Asked in parts, the foot moves by", apart)
        require_rows(edge == whole.edge[: len(target)], target, "Asked in parts, edge becomes", edge)


@query_law()
def check_finite(subject: Subject, x: Floats) -> None:
    """Finite queries get finite answers."""
    feet = subject.feet(x)
    require_rows(np.isfinite(feet.points).all(axis=1), x, "The foot is", feet.points)
    require_rows(np.isfinite(feet.distance), x, "distance is", feet.distance)
    if feet.local is not None:
        require_rows(np.isfinite(feet.local).all(axis=1), x, "local is", feet.local)


@law()
def check_bad_input(subject: Subject) -> None:
    """NaN, infinity and wrong shapes are refused with InputError."""
    dim = subject.source.dim
    for value in (np.nan, np.inf, -np.inf):
        x = np.tile(subject.centre, (3, 1))
        x[1, dim - 1] = value
        _require_refused(subject.source, x, f"a coordinate {value}")
    for shape in ((dim,), (4, dim + 1), (4, 1), (2, 2, dim)):
        _require_refused(subject.source, np.zeros(shape), f"the shape {shape}")


@query_law()
def check_edge(subject: Subject, x: Floats) -> None:
    """``edge`` is -1 or the number of an edge: of a curve 0 or 1, of a point none."""
    numbers: dict[int | None, int] = {0: -1, 1: 1}
    last = numbers.get(subject.source.manifold_dim)

    edge = subject.feet(x).edge
    require_rows(edge >= -1, x, "edge is", edge)
    if last is not None:
        require_rows(edge <= last, x, "edge is", edge)


def _require_arrays(feet: ClosestPoints, x: Floats) -> None:
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


def _require_refused(source: ClosestPointSource, x: Floats, what: str) -> None:
    try:
        source.closest_point(x)
    except InputError:
        return
    except Exception as error:
        raise AssertionError(f"Queries with {what} raise {type(error).__name__}, not InputError.") from error
    raise AssertionError(f"Queries with {what} are accepted.")
