"""Conditions on the edge of a manifold: one condition, one for each loop, or several by position."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, place, shown
from cpmkit.formulas.expressions import Expression
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.scene.conditions import Condition, as_condition
from cpmkit.scene.data import Data, evaluate_data, is_sequence, read_formula, takes_time
from cpmkit.types import Floats, Ints

#: Where a part of the edge is: a formula such as ``x < 0``, or a function of points (n, d) that returns (n,).
Where = str | Callable[[Floats], Any]


@dataclass(frozen=True, eq=False)
class Part:
    """A condition and where on the edge it holds; None means wherever no earlier part holds."""

    condition: Condition
    where: Callable[[Floats], Any] | None = None

    @property
    def summary(self) -> str:
        """The condition and where it holds, in words."""
        if self.where is None:
            return f"{self.condition.kind} on the rest"
        text = self.where.text if isinstance(self.where, Expression) else "a function of position holds"
        return f"{self.condition.kind} where {text}"


@dataclass(frozen=True, eq=False)
class ByPosition:
    """Conditions for parts of the edge, in order: at a point the condition of the first part that contains it holds.

    They are the list that a scene takes as its ``edge``; see :class:`cpmkit.Scene`.
    """

    parts: tuple[Part, ...]

    def number_at(self, points: Floats) -> Ints:
        """Return the number (n,) of the part that contains each of ``points`` (n, d), -1 where none does."""
        number = np.full(len(points), -1)
        for k, part in enumerate(self.parts):
            rest = np.flatnonzero(number < 0)
            label = f"`where` of part {k} of the edge"
            holds = True if part.where is None else evaluate_data(part.where, points[rest], 1, label)[:, 0] != 0
            number[rest[np.broadcast_to(holds, len(rest))]] = k
        return number

    def along(self, points: Floats) -> list[tuple[Condition, Ints]]:
        """Return each condition with the rows of ``points`` (n, d), in the scene's coordinates, at which it holds.

        Raises
        ------
        SceneError
            If no part contains a point.
        """
        number = self.number_at(points)
        uncovered = np.flatnonzero(number < 0)
        if len(uncovered):
            raise SceneError(
                f"no part of `edge` holds at {len(uncovered)} of {len(points)} points of the edge, such as "
                f"{place(points[uncovered[0]])}; add a last condition without `where`, which holds on the rest."
            )
        return [(part.condition, np.flatnonzero(number == k)) for k, part in enumerate(self.parts)]


def is_by_position(value: Any) -> bool:
    """Return True for a list of parts, which are conditions or pairs, False for data of several channels."""
    return is_sequence(value) and any(isinstance(entry, (Condition, Part)) or _is_pair(entry) for entry in value)


def _is_pair(entry: Any) -> bool:
    return isinstance(entry, tuple) and len(entry) == 2


def as_parts(entries: Any) -> ByPosition:
    """Return the conditions by position of a list of conditions, pairs (condition, where), or parts.

    Raises
    ------
    SceneError
        If an entry has no condition, if an entry before the last holds everywhere, or if ``where`` is neither a formula
        nor a function.
    """
    parts = []
    for number, entry in enumerate(entries):
        part = entry
        if not isinstance(entry, Part):
            condition, where = entry if _is_pair(entry) else (entry, None)
            part = Part(as_condition(condition), _as_where(where, number))
        if not isinstance(part.condition, Condition):
            raise SceneError(
                f"`edge` by position must be a list of pairs (condition, where), the last one "
                f"a condition alone, which holds on the rest, got {shown(part.condition)} as part {number}."
            )
        if part.where is None and number < len(entries) - 1:
            raise SceneError(
                f"part {number} of `edge`, {part.condition.kind}, has no `where` and holds on the rest, so that the "
                "parts after it hold nowhere; give it one, or put it last."
            )
        parts.append(part)
    return ByPosition(tuple(parts))


def _as_where(value: Any, number: int) -> Callable[[Floats], Any] | None:
    label = f"`where` of part {number} of the edge"
    function: Any = read_formula(Expression, value, label) if isinstance(value, str) else value
    if function is not None and not callable(function):
        raise SceneError(f"{label} must be a formula such as 'x < 0', or a function of points, got {shown(value)}.")
    if function is not None and takes_time(function):
        raise SceneError(f"{label} depends on t, and parts of the edge stay where they are; leave t out.")
    checked: Callable[[Floats], Any] | None = function
    return checked


#: Conditions of an edge or a loop of it: one, or several by position.
LoopConditions = Condition | ByPosition
#: Conditions of the edge of a manifold: the same on all of it, or by the number of the loop.
EdgeConditions = LoopConditions | Mapping[int, LoopConditions]
#: Values that are accepted for an edge or a loop of it.
EdgeInput = LoopConditions | Data | list[Condition | tuple[Condition | Data, Where]]


def as_edge(value: Any) -> Any:
    """Return the conditions of an edge from the values that a scene accepts; other values as they are.

    Raises
    ------
    SceneError
        If a list of parts is not accepted by :func:`as_parts`.
    """
    match value:
        case Mapping():
            return {loop: as_edge(entry) for loop, entry in value.items()}
        case ByPosition():
            return value
    return as_parts(value) if is_by_position(value) else as_condition(value)


def conditions_of_edge(edge: EdgeConditions) -> list[Condition]:
    """Return all conditions of an edge."""
    return [part.condition for part, _ in parts_of_edge(edge)]


def parts_of_edge(edge: EdgeConditions) -> list[tuple[Part, ByPosition | None]]:
    """Return all conditions of an edge as parts, each with the conditions by position that it belongs to, or None."""
    parts: list[tuple[Part, ByPosition | None]] = []
    for conditions in _loops(edge):
        match conditions:
            case ByPosition():
                parts += [(part, conditions) for part in conditions.parts]
            case _:
                parts.append((Part(conditions), None))
    return parts


def _loops(edge: EdgeConditions) -> list[LoopConditions]:
    return [*edge.values()] if isinstance(edge, Mapping) else [edge]


def shape_of_edge(edge: EdgeConditions) -> Any:
    """Return the numbers of the loops and where parts are: the structure, which does not change with the data."""
    match edge:
        case Mapping():
            return {loop: shape_of_edge(conditions) for loop, conditions in edge.items()}
        case ByPosition():
            return tuple(part.where for part in edge.parts)
    return None


def map_conditions(edge: Any, function: Callable[[Condition], Condition]) -> Any:
    """Return the conditions of an edge with ``function`` applied to each."""
    match edge:
        case Mapping():
            return {loop: map_conditions(conditions, function) for loop, conditions in edge.items()}
        case ByPosition():
            parts = tuple(replace(part, condition=function(part.condition)) for part in edge.parts)
            return replace(edge, parts=parts)
    return function(edge)


def position_parts(edge: EdgeConditions) -> list[ByPosition]:
    """Return the conditions by position of an edge, of all its loops."""
    return [conditions for conditions in _loops(edge) if isinstance(conditions, ByPosition)]


def conditions_along(edge: EdgeConditions, loops: Ints, points: Floats) -> list[tuple[Condition, Ints]]:
    """Return each condition with the rows at which it holds.

    Parameters
    ----------
    edge : EdgeConditions
        Conditions of the edge.
    loops : (n,) int64
        Number of the loop that each point lies on.
    points : (n, d) float64
        In the scene's coordinates.

    Raises
    ------
    SceneError
        If there is no condition for a loop, or no part contains a point.
    """
    pairs: list[tuple[Condition, Ints]] = []
    for loop in np.unique(loops).tolist() if isinstance(edge, Mapping) else [None]:
        rows = np.arange(len(points)) if loop is None else np.flatnonzero(loops == loop)
        conditions: Any = edge if loop is None else _of_loop(edge, loop)
        if isinstance(conditions, ByPosition):
            pairs += [(condition, rows[part]) for condition, part in conditions.along(points[rows])]
        else:
            pairs.append((conditions, rows))
    return [(condition, rows) for condition, rows in pairs if len(rows)]


def check_parts_used(edge: EdgeConditions, used: list[Condition]) -> None:
    """Refuse parts by position whose condition is not among the ``used``, as no sample of the edge is in them.

    Raises
    ------
    SceneError
        Naming the first such part.
    """
    ids = {id(condition) for condition in used}
    for number, part in ((k, part) for parts in position_parts(edge) for k, part in enumerate(parts.parts)):
        if id(part.condition) not in ids:
            raise SceneError(
                f"part {number} of `edge`, {part.summary}, holds at no point of the edge that this spacing sees; "
                "correct `where`, use a smaller spacing, or leave the part out."
            )


def edge_condition(edge: EdgeConditions, loop: int) -> Condition:
    """Return the condition of edge ``loop``.

    Raises
    ------
    SceneError
        If there is no condition for the loop, or there are several by position: use :func:`conditions_along`.
    """
    condition = _of_loop(edge, loop)
    if isinstance(condition, ByPosition):
        raise SceneError("`edge` gives conditions by position, where one for a whole loop is needed.")
    return condition


def _of_loop(edge: EdgeConditions, loop: int) -> LoopConditions:
    if not isinstance(edge, Mapping):
        return edge
    if loop not in edge:
        raise SceneError(
            f"the surface has an edge loop {loop} for which `edge` gives no condition; it has {sorted(edge)}."
        )
    return edge[loop]


def sample_edge_point(source: ClosestPointSource, part: Part, parts: ByPosition | None) -> Floats:
    """Return a point (1, d) of the edge of ``source`` at which to evaluate the data of a ``part`` of it.

    It is in the part, one of ``parts``, if the closest points of a few points around the bounds include such a point:
    data may be undefined elsewhere.
    """
    bounds = np.asarray(source.bounds, dtype=np.float64)
    centre, reach = bounds.mean(axis=0), np.ptp(bounds, axis=0)
    lattices = [bounds.T]
    if parts is not None:  # seven points an axis, from before the bounds to past them
        lattices.append((bounds[0] + np.linspace(-0.25, 1.25, 7)[:, None] * reach).T)
    queries = np.array([*(point for lattice in lattices for point in product(*lattice)), centre])
    feet = LocalSource(source, np.zeros(source.dim)).closest_point(queries)
    on = np.flatnonzero(feet.edge >= 0)
    if parts is not None and len(on):
        inside = on[parts.number_at(feet.points[on]) == parts.parts.index(part)]
        on = inside if len(inside) else on
    return feet.points[[on[0] if len(on) else 0]]
