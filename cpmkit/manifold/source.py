"""The contract of a source, a manifold known by its closest points; its answers, and their checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cpmkit.errors import InputError
from cpmkit.types import Bools, Floats, Ints

#: Words for manifolds of dimension 0 to 3.
MANIFOLD_WORDS = ("points", "a curve", "a surface", "a solid")


@dataclass(frozen=True, eq=False)
class Rows:
    """A table of records: each field is an array with one row for each record, or None."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))

    def take(self, index: NDArray[Any]) -> Self:
        """Return the records with the given ``index``, integers (k,) or a mask (n,), as a new table."""

        def select(values: Any) -> Any:
            """Return the selected rows of a column, which is an array, None, a table or a list of these."""
            if isinstance(values, list):
                return [select(part) for part in values]
            return values.take(index) if isinstance(values, Rows) else None if values is None else values[index]

        return type(self)(*[select(getattr(self, field.name)) for field in fields(self)])

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return one table of the records of ``parts``, at least one, in order; a field None in a part is None."""

        def concatenate(column: list[Any]) -> Any:
            """Return the parts of one column joined; None if a part is None."""
            if any(values is None for values in column):
                return None
            return column[0].join(column) if isinstance(column[0], Rows) else np.concatenate(column)

        return cls(*[concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)])

    def replace_rows(self, rows: Ints, new: Self) -> Self:
        """Return the table with records ``new`` in place of those at ``rows`` (k,); a field None in either is None."""
        order = np.arange(len(self))
        order[rows] = len(self) + np.arange(len(rows))
        return self.join([self, new]).take(order)


@dataclass(frozen=True, eq=False)
class ClosestPoints(Rows):
    """The answer to n closest point queries."""

    points: Floats  #: (n, d): the feet, a closest point of each query, in the scene's unit of length.
    #: (n,): distance from the query to the manifold: it decides which nodes are in the band. It is 1-Lipschitz and at
    #: most ``|x - points|``; for an exact source the two are equal.
    distance: Floats
    #: (n,): -1 where the foot is interior; k >= 0 where it lies on edge loop k of an open surface, or on end k of an
    #: open curve (0 the start, 1 the end). Numbers are below 1000, or below the source's ``edge_limit`` where it has
    #: this attribute (a multiple of 1000).
    edge: Ints
    element: Ints | None = None  #: (n,): the triangle, segment, patch or union member that holds the foot.
    local: Floats | None = None  #: (n, m): coordinates in that element: barycentric, t or (u, v).
    #: (n,): True where the search may have missed the closest point. ``None``: all feet are certain.
    doubtful: Bools | None = None


@runtime_checkable
class ClosestPointSource(Protocol):
    """A manifold that is known by its closest points.

    :mod:`cpmkit.testing` checks the laws that every source obeys. Data are read-only properties: with plain attributes
    mypy would refuse frozen dataclasses.
    """

    @property
    def dim(self) -> int:
        """Dimension d of the space, 2 or 3."""

    @property
    def manifold_dim(self) -> int | None:
        """Dimension of the manifold: 0 points, 1 a curve, 2 a surface, d a solid; ``None`` for a mixed union."""

    @property
    def bounds(self) -> Floats:
        """(2, d) finite lower and upper corner of a box that contains the manifold."""

    @property
    def exact(self) -> bool:
        """Whether feet, except ``doubtful`` ones, are nearest points of the manifold; False for a smoothed mesh."""

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return a closest point of each row of ``x``.

        ``x`` is (n, d) float64 and is not modified. A query with several closest points (the centre of a sphere) gets
        one of them, never the query itself.

        Raises
        ------
        InputError
            If ``x`` contains NaN or infinity, or its shape is not (n, d).
        """


def source_repr(source: ClosestPointSource, name: str | None = None) -> str:
    """Return one line, the ``repr`` of a source: its name, dimensions, number of vertices with values, and bounds.

    ``name`` is by default that of its class; it stands alone if the rest cannot be read. A dataclass prints all arrays.
    """
    name = name or type(source).__name__
    try:
        kind = "parts of several dimensions" if source.manifold_dim is None else MANIFOLD_WORDS[source.manifold_dim]
        vertices = getattr(source, "value_count", None)
        count = "" if vertices is None else f" with {vertices:,} vertices"
        lower, upper = (
            f"({', '.join(f'{value:.4g}' for value in corner)})" for corner in np.asarray(source.bounds, np.float64)
        )
    except Exception:  # a debugger may print an object before its fields are set
        return f"<{name}>"
    return f"<{name}: {kind} in {source.dim}D{count}, from {lower} to {upper}>"


def check_source(source: Any, label: str, alternatives: str = "") -> None:
    """Raise InputError if ``source`` is no ClosestPointSource, or its bounds are not (2, d) finite numbers.

    ``label`` is its name in the message, ``alternatives`` a text about other arguments that the caller accepts.
    """
    if not isinstance(source, ClosestPointSource):
        raise InputError(
            f"{label} must be a closest point source (dim, manifold_dim, bounds, exact, closest_point)"
            f"{alternatives and ', or ' + alternatives}, got {type(source).__name__}."
        )
    bounds = np.asarray(source.bounds, dtype=np.float64)
    if bounds.shape != (2, source.dim) or not np.isfinite(bounds).all():
        raise InputError(f"the bounds of {label} must be (2, {source.dim}) finite numbers, got {bounds.tolist()}.")


def check_answer(answer: Any, x: Floats, source: Any, origin: Floats, union: bool) -> None:
    """Raise InputError if the ``answer`` of ``source`` to queries breaks the contract; the message names the source.

    The queries ``x`` (n, d) are relative to ``origin`` (d,). Answers of a ``union`` must contain the number of a member
    for each query. The contract is broken by another type or shape, missing members, or a foot or distance that is not
    finite; no other law is checked.
    """
    name = _class_names(source)
    if not isinstance(answer, ClosestPoints):
        raise InputError(
            f"closest_point of {name} must return ClosestPoints(points, distance, edge), got {type(answer).__name__}."
        )
    for field, shape in (("points", x.shape), ("distance", x.shape[:1]), ("edge", x.shape[:1])):
        got = np.shape(getattr(answer, field))
        if got != shape:
            raise InputError(
                f"closest_point of {name} must return {field} of shape {shape} for {len(x)} queries, got {got}."
            )
    if union and answer.element is None:
        raise InputError(f"closest_point of {name}, a union, must return the member of each foot as element.")
    if not (np.isfinite(answer.distance).all() and np.isfinite(answer.points).all()):
        bad = ~(np.isfinite(answer.distance) & np.isfinite(answer.points).all(axis=1))
        first = int(np.argmax(bad))
        raise InputError(
            f"closest_point of {name} must return finite points and distances, got "
            f"{np.asarray(answer.points)[first].tolist()} at distance {float(answer.distance[first]):g} for the query "
            f"{(x[first] + origin).tolist()} and for {int(bad.sum())} of {len(x)} queries."
        )


def _class_names(source: Any) -> str:
    """Return the name of a source's class, followed for a combination by "of" and that of the source inside it."""
    inner = getattr(source, "of", None)
    return type(source).__name__ + (f" of {_class_names(inner)}" if hasattr(inner, "closest_point") else "")
