"""Conditions on the edge of a manifold: one condition, one for each loop, or several by position."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
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
from cpmkit.scene.laws import Law
from cpmkit.types import Floats, Ints


class EdgeLoopError(SceneError):
    """A table `edge` lacks a loop of the manifold, or has one that the manifold lacks.

    ``text`` is the message, with the fields ``loop``, ``given`` (the numbers in the table) and ``loops`` (those of the
    manifold, or those that the table lacks).
    """

    def __init__(self, text: str, loop: int, given: Iterable[int], loops: Iterable[int] = ()) -> None:
        self.text, self.loop, self.given, self.loops = text, loop, [*given], [*loops]
        lists = [", ".join(map(str, numbers)) for numbers in (self.given, self.loops)]
        super().__init__(text.format(loop=loop, given=lists[0] or "none", loops=lists[1]))

    def renumber(self, given: Iterable[int], number_of: Callable[[int], int]) -> EdgeLoopError:
        """Return the error for a scene whose table has the numbers ``given``; ``number_of`` renumbers the loops."""
        return EdgeLoopError(self.text, number_of(self.loop), given, map(number_of, self.loops))


#: Where a part of the edge is: a formula such as ``x < 0``, or a function of points (n, d) that returns (n,).
Where = str | Callable[[Floats], Any]


@dataclass(frozen=True, eq=False)
class Part:
    """A condition and the part of the edge where it holds; ``where`` None is the rest, where no earlier part holds."""

    condition: Condition
    where: Callable[[Floats], Any] | None = None


@dataclass(frozen=True, eq=False)
class ByPosition:
    """Conditions on parts of the edge, in order: the first part that contains a point determines the condition there.

    A scene makes it from the list that is given as its ``edge``; see :class:`cpmkit.Scene`.
    """

    parts: tuple[Part, ...]

    def part_at(self, points: Floats) -> Ints:
        """Return the number (n,) of the first part that contains each of ``points`` (n, d); -1 where no part does.

        Points are in the scene's coordinates. Raises InputError, as :func:`evaluate_data`, for values of a `where`.
        """
        number = np.full(len(points), -1)
        for k, part in enumerate(self.parts):
            rest = np.flatnonzero(number < 0)
            label = f"`where` of part {k} of the edge"
            holds = True if part.where is None else evaluate_data(part.where, points[rest], 1, label)[:, 0] != 0
            number[rest[np.broadcast_to(holds, len(rest))]] = k
        return number


def _is_pair(entry: Any) -> bool:
    return isinstance(entry, tuple) and len(entry) == 2


def _as_part(entry: Any, number: int, is_last: bool) -> Part:
    """Return the part of the edge given as a condition or a pair (condition, where), ``number`` its index from 0.

    ``is_last`` is True for the last part. Raises SceneError if it has no condition, if it holds everywhere and is not
    the last part, or if ``where`` is neither a formula that parses nor a function, or depends on t.
    """
    label = f"`where` of part {number} of the edge"
    condition, where = entry if _is_pair(entry) else (entry, None)
    condition = as_condition(condition)
    if isinstance(where, str):
        where = read_formula(Expression, where, label)
    if not isinstance(condition, Condition):
        raise SceneError(
            "`edge` by position must be a list of pairs (condition, where), the last one a condition alone, which "
            f"holds on the rest, got {shown(condition)} as part {number}."
        )
    if where is None and not is_last:
        raise SceneError(
            f"part {number} of `edge`, {condition.kind}, has no `where` and holds on the rest, so that the parts after "
            "it hold nowhere; give it one, or put it last."
        )
    if where is not None and not callable(where):
        raise SceneError(f"{label} must be a formula such as 'x < 0', or a function of points, got {shown(where)}.")
    if takes_time(where):
        raise SceneError(f"{label} depends on t, and parts of the edge stay where they are; leave t out.")
    return Part(condition, where)


#: Conditions of the edge or of one edge loop: a single condition, or several by position.
LoopConditions = Condition | ByPosition
#: Conditions of the edge of a manifold: the same on all loops, or by the number of the loop. For a part of a union, the
#: number None stands for all other loops.
EdgeConditions = LoopConditions | Mapping[int, LoopConditions]
#: Values that a scene accepts for the edge or for one edge loop.
EdgeInput = LoopConditions | Data | list[Condition | tuple[Condition | Data, Where]]


def as_edge(value: Any) -> Any:
    """Return the argument ``edge`` of a scene as conditions: data as Dirichlet, lists of pairs as :class:`ByPosition`.

    A mapping from numbers of loops is converted loop by loop, other values are returned unchanged. Raises SceneError if
    a part is not accepted.
    """
    if isinstance(value, Mapping):
        return {loop: as_edge(value[loop]) for loop in sorted(value, key=str)}
    # A list of data has an entry for each channel.
    if is_sequence(value) and any(isinstance(entry, Condition) or _is_pair(entry) for entry in value):
        return ByPosition(tuple(_as_part(entry, k, k == len(value) - 1) for k, entry in enumerate(value)))
    return as_condition(value)


def loops_of_edge(edge: EdgeConditions) -> dict[int | None, ByPosition]:
    """Return the conditions of each edge loop by its number, or under None those that hold on every other loop.

    The condition of a whole loop is one part with ``where`` None.
    """
    loops: dict[Any, LoopConditions] = {**edge} if isinstance(edge, Mapping) else {None: edge}
    return {
        loop: conditions if isinstance(conditions, ByPosition) else ByPosition((Part(conditions),))
        for loop, conditions in loops.items()
    }


def parts_of_edge(edge: EdgeConditions) -> list[tuple[Part, ByPosition]]:
    """Return pairs of a part of the edge and the :class:`ByPosition` of its loop that contains it, for all parts."""
    return [(part, loop) for loop in loops_of_edge(edge).values() for part in loop.parts]


def conditions_of_edge(edge: EdgeConditions) -> list[Condition]:
    """Return the conditions of an edge, of all its loops and parts."""
    return [part.condition for part, _ in parts_of_edge(edge)]


def edge_structure(edge: EdgeConditions) -> Any:
    """Return by the number of each loop (None: every loop) the list of its parts' ``where``, None for the rest."""
    return {loop: [part.where for part in conditions.parts] for loop, conditions in loops_of_edge(edge).items()}


def map_conditions(edge: Any, function: Callable[[Condition], Condition]) -> Any:
    """Return the conditions of an edge in the same tables and parts, each replaced by ``function(condition)``."""
    if isinstance(edge, Mapping):
        return {loop: map_conditions(conditions, function) for loop, conditions in edge.items()}
    if isinstance(edge, ByPosition):
        return ByPosition(tuple(replace(part, condition=function(part.condition)) for part in edge.parts))
    return function(edge)


def conditions_along(edge: EdgeConditions, loops: Ints, points: Floats) -> list[tuple[Condition, Ints]]:
    """Return pairs (condition of the edge, indices (m,) of the ``points`` where it holds), with m above zero.

    ``points`` (n, d) lie on the edge, in the scene's coordinates; ``loops`` (n,) are the numbers of their edge loops.

    Raises
    ------
    SceneError
        If a loop has no condition, or a point is in no part.
    """
    pairs: list[tuple[Condition, Ints]] = []
    for loop in np.unique(loops).tolist() if isinstance(edge, Mapping) else [None]:
        rows = np.arange(len(points)) if loop is None else np.flatnonzero(loops == loop)
        conditions = _conditions_of_loop(edge, loop, loops)
        number = conditions.part_at(points[rows])
        uncovered = points[rows[number < 0]]
        if len(uncovered):
            raise SceneError(
                f"no part of `edge` holds at {len(uncovered)} of {len(rows)} points of the edge, such as "
                f"{place(uncovered[0])}; add a last condition without `where`, which holds on the rest."
            )
        pairs += [(part.condition, rows[number == k]) for k, part in enumerate(conditions.parts)]
    return [(condition, rows) for condition, rows in pairs if len(rows)]


def check_parts_used(edge: EdgeConditions, used: Iterable[Law]) -> None:
    """Raise SceneError for the first of several parts of a loop whose law is not in ``used``, compared by identity.

    ``used`` are the laws that hold at some sample of the edge.
    """
    ids = {id(law) for law in used}
    for part, loop in parts_of_edge(edge):
        if len(loop.parts) > 1 and id(part.condition.law) not in ids:
            text = part.where.text if isinstance(part.where, Expression) else "a function of position holds"
            where = "on the rest" if part.where is None else f"where {text}"
            raise SceneError(
                f"part {loop.parts.index(part)} of `edge`, {part.condition.kind} {where}, holds at no point of the "
                "edge that this spacing sees; correct `where`, use a smaller spacing, or leave the part out."
            )


def edge_condition(edge: EdgeConditions, loop: int) -> Condition:
    """Return the condition of edge loop ``loop``, that of its first part if it has several; SceneError if none."""
    return _conditions_of_loop(edge, loop, [loop]).parts[0].condition


def _conditions_of_loop(edge: EdgeConditions, loop: int | None, seen: Iterable[int]) -> ByPosition:
    """Return the conditions that hold on edge loop number ``loop``; it may be None if they hold on every loop.

    Raises SceneError if the loop has none; the message names all of the loops ``seen`` that have none.
    """
    loops = loops_of_edge(edge)
    if None not in loops and loop not in loops:
        assert loop is not None
        raise EdgeLoopError(
            "the table `edge` has the loops {given}, and the manifold's loops {loops} are missing; a table names every "
            "loop, with Neumann(0) where nothing flows.",
            loop,
            [number for number in loops if number is not None],
            sorted({*map(int, seen)} - {*loops}),
        )
    return loops[loop if loop in loops else None]


def sample_edge_point(source: ClosestPointSource, part: Part, parts: ByPosition) -> Floats:
    """Return a point (1, d) at which the data of a ``part`` of the edge of ``source`` are evaluated to count channels.

    ``parts`` are all parts of its loop. The point is the closest point to a query around the bounds: in ``part`` if
    some closest point is, since data may be undefined elsewhere; or else on the edge; or else on the manifold.
    """
    bounds = np.asarray(source.bounds, dtype=np.float64)
    queries = [*product(*bounds.T), bounds.mean(axis=0)]
    if len(parts.parts) > 1:  # seven points on each axis, beyond both ends of the bounds
        queries += product(*(bounds[0] + np.linspace(-0.25, 1.25, 7)[:, None] * np.ptp(bounds, axis=0)).T)
    feet = LocalSource(source, np.zeros(source.dim)).closest_point(np.array(queries))
    on = np.flatnonzero(feet.edge >= 0)
    inside = on[parts.part_at(feet.points[on]) == parts.parts.index(part)]
    return feet.points[[*inside, *on, 0][:1]]
