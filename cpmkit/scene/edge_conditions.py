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
    """A condition and the part of the edge where it holds; ``where`` None is the rest, where no earlier part holds."""

    condition: Condition
    where: Callable[[Floats], Any] | None = None

    @property
    def summary(self) -> str:
        """The condition and its part of the edge, in words."""
        if self.where is None:
            return f"{self.condition.kind} on the rest"
        text = self.where.text if isinstance(self.where, Expression) else "a function of position holds"
        return f"{self.condition.kind} where {text}"


@dataclass(frozen=True, eq=False)
class ByPosition:
    """Conditions on parts of the edge, in order: the first part that contains a point determines the condition there.

    A scene makes it from the list that is given as its ``edge``; see :class:`cpmkit.Scene`.
    """

    parts: tuple[Part, ...]

    def number_at(self, points: Floats) -> Ints:
        """Return the number (n,) of the first part that contains each of ``points`` (n, d); -1 where no part does."""
        number = np.full(len(points), -1)
        for k, part in enumerate(self.parts):
            rest = np.flatnonzero(number < 0)
            label = f"`where` of part {k} of the edge"
            holds = True if part.where is None else evaluate_data(part.where, points[rest], 1, label)[:, 0] != 0
            number[rest[np.broadcast_to(holds, len(rest))]] = k
        return number

    def along(self, points: Floats) -> list[tuple[Condition, Ints]]:
        """Return each condition with the rows (m,) of ``points`` (n, d), in the scene's coordinates, where it holds.

        Raises
        ------
        SceneError
            If a point is in no part.
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
    """Return True for a list with a condition, a part or a pair (condition, where); False for data of channels."""
    return is_sequence(value) and any(isinstance(entry, (Condition, Part)) or _is_pair(entry) for entry in value)


def _is_pair(entry: Any) -> bool:
    return isinstance(entry, tuple) and len(entry) == 2


def as_parts(entries: Any) -> ByPosition:
    """Return the conditions by position given as a list of conditions, pairs (condition, where) or parts.

    Raises
    ------
    SceneError
        If an entry has no condition, if an entry before the last one holds everywhere, or if ``where`` is neither a
        formula nor a function, or depends on t.
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
    """Return the ``where`` of part ``number`` as a function of points (n, d); None stays None.

    Raises
    ------
    SceneError
        If the value is neither a formula nor a function, or depends on t.
    """
    label = f"`where` of part {number} of the edge"
    function: Any = read_formula(Expression, value, label) if isinstance(value, str) else value
    if function is not None and not callable(function):
        raise SceneError(f"{label} must be a formula such as 'x < 0', or a function of points, got {shown(value)}.")
    if function is not None and takes_time(function):
        raise SceneError(f"{label} depends on t, and parts of the edge stay where they are; leave t out.")
    checked: Callable[[Floats], Any] | None = function
    return checked


#: Conditions of the edge or of one edge loop: a single condition, or several by position.
LoopConditions = Condition | ByPosition
#: Conditions of the edge of a manifold: the same on all loops, or by the number of the loop.
EdgeConditions = LoopConditions | Mapping[int, LoopConditions]
#: Values that a scene accepts for the edge or for one edge loop.
EdgeInput = LoopConditions | Data | list[Condition | tuple[Condition | Data, Where]]


def as_edge(value: Any) -> Any:
    """Return the conditions of an edge from any value that a scene accepts; other values unchanged.

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
    """Return the conditions of an edge, of all its loops and parts."""
    return [part.condition for part, _ in parts_of_edge(edge)]


def parts_of_edge(edge: EdgeConditions) -> list[tuple[Part, ByPosition | None]]:
    """Return all parts of an edge, each with the :class:`ByPosition` that contains it.

    A condition of a whole loop, or of the whole edge, is a part with ``where`` None, and comes with None.
    """
    parts: list[tuple[Part, ByPosition | None]] = []
    for conditions in _conditions_of_loops(edge):
        match conditions:
            case ByPosition():
                parts += [(part, conditions) for part in conditions.parts]
            case _:
                parts.append((Part(conditions), None))
    return parts


def _conditions_of_loops(edge: EdgeConditions) -> list[LoopConditions]:
    """Return the conditions of each loop for which they are given, or those of the whole edge as the only entry."""
    return [*edge.values()] if isinstance(edge, Mapping) else [edge]


def edge_structure(edge: EdgeConditions) -> Any:
    """Return the loop numbers and the ``where`` of each part: the structure of an edge, which data do not change."""
    match edge:
        case Mapping():
            return {loop: edge_structure(conditions) for loop, conditions in edge.items()}
        case ByPosition():
            return tuple(part.where for part in edge.parts)
    return None


def map_conditions(edge: Any, function: Callable[[Condition], Condition]) -> Any:
    """Return the conditions of an edge, each replaced by ``function(condition)``."""
    match edge:
        case Mapping():
            return {loop: map_conditions(conditions, function) for loop, conditions in edge.items()}
        case ByPosition():
            parts = tuple(replace(part, condition=function(part.condition)) for part in edge.parts)
            return replace(edge, parts=parts)
    return function(edge)


def conditions_by_position(edge: EdgeConditions) -> list[ByPosition]:
    """Return the :class:`ByPosition` of each loop that has conditions by position."""
    return [conditions for conditions in _conditions_of_loops(edge) if isinstance(conditions, ByPosition)]


def conditions_along(edge: EdgeConditions, loops: Ints, points: Floats) -> list[tuple[Condition, Ints]]:
    """Return each condition of an edge that holds at any of ``points``, with the rows (m,) of these.

    Parameters
    ----------
    edge : EdgeConditions
        Conditions of the edge.
    loops : (n,) int64
        Number of the edge loop of each point.
    points : (n, d) float64
        Points of the edge, in the scene's coordinates.

    Raises
    ------
    SceneError
        If a loop has no condition, or a point is in no part.
    """
    pairs: list[tuple[Condition, Ints]] = []
    for loop in np.unique(loops).tolist() if isinstance(edge, Mapping) else [None]:
        rows = np.arange(len(points)) if loop is None else np.flatnonzero(loops == loop)
        conditions: Any = edge if loop is None else _conditions_of_loop(edge, loop)
        if isinstance(conditions, ByPosition):
            pairs += [(condition, rows[part]) for condition, part in conditions.along(points[rows])]
        else:
            pairs.append((conditions, rows))
    return [(condition, rows) for condition, rows in pairs if len(rows)]


def check_parts_used(edge: EdgeConditions, used: list[Condition]) -> None:
    """Raise if the condition of a part by position is not among ``used``, the conditions that hold at edge samples.

    Raises
    ------
    SceneError
        For the first such part.
    """
    ids = {id(condition) for condition in used}
    for number, part in ((k, part) for parts in conditions_by_position(edge) for k, part in enumerate(parts.parts)):
        if id(part.condition) not in ids:
            raise SceneError(
                f"part {number} of `edge`, {part.summary}, holds at no point of the edge that this spacing sees; "
                "correct `where`, use a smaller spacing, or leave the part out."
            )


def edge_condition(edge: EdgeConditions, loop: int) -> Condition:
    """Return the condition of edge loop number ``loop``.

    Raises
    ------
    SceneError
        If the loop has no condition, or several by position, for which there is :func:`conditions_along`.
    """
    condition = _conditions_of_loop(edge, loop)
    if isinstance(condition, ByPosition):
        raise SceneError("`edge` gives conditions by position, where one for a whole loop is needed.")
    return condition


def _conditions_of_loop(edge: EdgeConditions, loop: int) -> LoopConditions:
    """Return the conditions of edge ``loop``; conditions that are not given loop by loop hold on every loop.

    Raises
    ------
    SceneError
        If the loop has none.
    """
    if not isinstance(edge, Mapping):
        return edge
    if loop not in edge:
        raise SceneError(
            f"the surface has an edge loop {loop} for which `edge` gives no condition; it has {sorted(edge)}."
        )
    return edge[loop]


def sample_edge_point(source: ClosestPointSource, part: Part, parts: ByPosition | None) -> Floats:
    """Return a point (1, d) of the edge of ``source`` at which the data of its ``part`` can be evaluated.

    The point is in ``part``, one of ``parts``, if the closest points of a few points around the bounds include one
    that is, since data may be undefined elsewhere.
    """
    bounds = np.asarray(source.bounds, dtype=np.float64)
    centre, reach = bounds.mean(axis=0), np.ptp(bounds, axis=0)
    lattices = [bounds.T]
    if parts is not None:  # seven points on each axis, beyond both ends of the bounds
        lattices.append((bounds[0] + np.linspace(-0.25, 1.25, 7)[:, None] * reach).T)
    queries = np.array([*(point for lattice in lattices for point in product(*lattice)), centre])
    feet = LocalSource(source, np.zeros(source.dim)).closest_point(queries)
    on = np.flatnonzero(feet.edge >= 0)
    if parts is not None and len(on):
        inside = on[parts.number_at(feet.points[on]) == parts.parts.index(part)]
        on = inside if len(inside) else on
    return feet.points[[on[0] if len(on) else 0]]
