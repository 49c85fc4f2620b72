"""What holds on the edge of a manifold: one condition, one for each loop, or conditions by position along it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, place, shown
from cpmkit.formulas.expressions import Expression
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import ClosestPointSource, Floats, Ints
from cpmkit.scene.conditions import Condition, as_condition
from cpmkit.scene.data import Data, evaluate_data, read_formula, takes_time

#: Where a part of the edge holds: a formula such as ``x < 0``, or a function of points (n, d) that returns (n,).
Where = str | Callable[[Floats], Any]
#: How parts are written, in refusals.
PARTS = "a list of pairs (condition, where), the last one a condition alone, which holds on the rest"


@dataclass(frozen=True, eq=False)
class Part:
    """A condition, and where on the edge it holds: everywhere that no earlier part does where that is None."""

    condition: Condition
    where: Callable[[Floats], Any] | None = None

    @property
    def summary(self) -> str:
        """What holds where, in words."""
        if self.where is None:
            return f"{self.condition.kind} on the rest"
        text = self.where.text if isinstance(self.where, Expression) else "a function of position holds"
        return f"{self.condition.kind} where {text}"


@dataclass(frozen=True, eq=False)
class ByPosition:
    """Conditions for parts of the edge: at each point that of the first part whose ``where`` holds.

    Made of the list that a scene is given as its ``edge``; see :class:`cpmkit.Scene`.
    """

    parts: tuple[Part, ...]

    def number_at(self, points: Floats) -> Ints:
        """Return the number (n,) of the part that holds at points (n, d) in the scene's coordinates, -1 for none."""
        number = np.full(len(points), -1)
        for k, part in enumerate(self.parts):
            left = np.flatnonzero(number < 0)
            label = f"`where` of part {k} of the edge"
            holds = True if part.where is None else evaluate_data(part.where, points[left], 1, label)[:, 0] != 0
            number[left[np.broadcast_to(holds, len(left))]] = k
        return number

    def along(self, points: Floats) -> list[tuple[Condition, Ints]]:
        """Return each condition with the rows of points (n, d), in the scene's coordinates, at which it holds.

        Raises
        ------
        SceneError
            If no part holds at a point.
        """
        number = self.number_at(points)
        without = np.flatnonzero(number < 0)
        if len(without):
            raise SceneError(
                f"no part of `edge` holds at {len(without)} of {len(points)} points of the edge, such as "
                f"{place(points[without[0]])}; add a last condition without `where`, which holds on the rest."
            )
        return [(part.condition, np.flatnonzero(number == k)) for k, part in enumerate(self.parts)]


def is_by_position(given: Any) -> bool:
    """Tell parts from data with one entry a channel: of these none is a condition or a pair."""
    return isinstance(given, (list, tuple)) and any(
        isinstance(one, (Condition, Part)) or (isinstance(one, tuple) and len(one) == 2) for one in given
    )


def as_parts(given: Any) -> ByPosition:
    """Return the parts that are given: conditions, alone or in pairs with where they hold, or parts themselves.

    Raises
    ------
    SceneError
        If one is no condition, holds everywhere before the last, or where it holds is no formula or function.
    """
    parts = []
    for number, one in enumerate(given):
        if not isinstance(one, Part):
            condition, where = one if isinstance(one, tuple) and len(one) == 2 else (one, None)
            one = Part(as_condition(condition), _where(where, number))
        if not isinstance(one.condition, Condition):
            raise SceneError(f"`edge` by position must be {PARTS}, got {shown(one.condition)} as part {number}.")
        if one.where is None and number < len(given) - 1:
            raise SceneError(
                f"part {number} of `edge`, {one.condition.kind}, has no `where` and holds on the rest, so that the "
                "parts after it hold nowhere; give it one, or put it last."
            )
        parts.append(one)
    return ByPosition(tuple(parts))


def _where(given: Any, number: int) -> Callable[[Floats], Any] | None:
    label = f"`where` of part {number} of the edge"
    made: Any = read_formula(Expression, given, label) if isinstance(given, str) else given
    if made is not None and not callable(made):
        raise SceneError(f"{label} must be a formula such as 'x < 0', or a function of points, got {shown(given)}.")
    if made is not None and takes_time(made):
        raise SceneError(f"{label} depends on t, and parts of the edge stay where they are; leave t out.")
    found: Callable[[Floats], Any] | None = made
    return found


#: Where on an edge a datum can be asked is sought from so many points an axis, from before the bounds to past them.
ASKED_PER_AXIS, PAST_BOUNDS_SHARE = 7, 0.25
#: What holds on an edge or a loop of it: one condition, or some by position.
LoopConditions = Condition | ByPosition
#: What holds on the edge of a manifold: the same for all of it, or for each loop, by its number.
EdgeConditions = LoopConditions | Mapping[int, LoopConditions]
#: What may be given for an edge or a loop of it.
EdgeInput = LoopConditions | Data | list[Condition | tuple[Condition | Data, Where]]


def as_edge(given: Any) -> Any:
    """Return what is given for an edge as a scene keeps it; what is no condition comes back as it is.

    Raises
    ------
    SceneError
        If parts by position are not what they should be.
    """
    if isinstance(given, Mapping):
        return {loop: as_edge(one) for loop, one in given.items()}
    if isinstance(given, ByPosition):
        return given
    return as_parts(given) if is_by_position(given) else as_condition(given)


def conditions_of_edge(edge: EdgeConditions) -> list[Condition]:
    """Return all conditions of an edge."""
    return [part.condition for part, _ in parts_of_edge(edge)]


def parts_of_edge(edge: EdgeConditions) -> list[tuple[Part, ByPosition | None]]:
    """Return all conditions of an edge as parts, each with those beside which it holds where there are any."""
    found: list[tuple[Part, ByPosition | None]] = []
    for one in edge.values() if isinstance(edge, Mapping) else [edge]:
        found += [(part, one) for part in one.parts] if isinstance(one, ByPosition) else [(Part(one), None)]
    return found


def shape_of_edge(edge: EdgeConditions) -> Any:
    """Return which loops an edge has conditions for, and where parts of it hold: what data alone do not change."""
    if isinstance(edge, Mapping):
        return {loop: shape_of_edge(one) for loop, one in edge.items()}
    return tuple(part.where for part in edge.parts) if isinstance(edge, ByPosition) else None


def position_parts(edge: EdgeConditions) -> list[ByPosition]:
    """Return what of an edge goes by position."""
    held = edge.values() if isinstance(edge, Mapping) else [edge]
    return [one for one in held if isinstance(one, ByPosition)]


def conditions_along(edge: EdgeConditions, loops: Ints, points: Floats) -> list[tuple[Condition, Ints]]:
    """Return each condition with the rows at which it holds.

    Parameters
    ----------
    edge : EdgeConditions
        Of a scene.
    loops : (n,) int64
        The loop of the edge that each point lies on.
    points : (n, d) float64
        In the scene's coordinates.

    Raises
    ------
    SceneError
        If a loop is not in the table, or no part holds at a point.
    """
    found: list[tuple[Condition, Ints]] = []
    for loop in np.unique(loops).tolist() if isinstance(edge, Mapping) else [None]:
        rows = np.arange(len(points)) if loop is None else np.flatnonzero(loops == loop)
        one: Any = edge if loop is None else _of_loop(edge, loop)
        if isinstance(one, ByPosition):
            found += [(condition, rows[own]) for condition, own in one.along(points[rows])]
        else:
            found.append((one, rows))
    return [(condition, rows) for condition, rows in found if len(rows)]


def check_parts_used(edge: EdgeConditions, met: list[Condition]) -> None:
    """Refuse parts by position that hold at no point of the edge.

    Raises
    ------
    SceneError
        In one sentence.
    """
    known = {id(one) for one in met}
    for number, part in ((k, part) for one in position_parts(edge) for k, part in enumerate(one.parts)):
        if id(part.condition) not in known:
            raise SceneError(
                f"part {number} of `edge`, {part.summary}, holds at no point of the edge that this spacing sees; "
                "correct `where`, use a smaller spacing, or leave the part out."
            )


def edge_condition(edge: EdgeConditions, loop: int) -> Condition:
    """Return the condition of edge ``loop``.

    Raises
    ------
    SceneError
        If the edge is a table and the loop is not in it, or conditions go by position; :func:`conditions_along` tells
        which hold where.
    """
    one = _of_loop(edge, loop)
    if isinstance(one, ByPosition):
        raise SceneError("`edge` gives conditions by position, where one for a whole loop is needed.")
    return one


def _of_loop(edge: EdgeConditions, loop: int) -> LoopConditions:
    if not isinstance(edge, Mapping):
        return edge
    if loop not in edge:
        raise SceneError(
            f"the surface has an edge loop {loop} for which `edge` gives no condition; it has {sorted(edge)}."
        )
    return edge[loop]


def sample_edge_point(source: ClosestPointSource, part: Part, beside: ByPosition | None) -> Floats:
    """Return a point (1, d) of the edge of ``source`` at which the data of a part of it can be asked.

    One where the part holds, if such a point is seen from around the bounds; data may be undefined elsewhere.
    """
    bounds = np.asarray(source.bounds, dtype=np.float64)
    centre, reach = bounds.mean(axis=0), np.ptp(bounds, axis=0)
    places = [bounds.T]
    if beside is not None:
        shares = np.linspace(-PAST_BOUNDS_SHARE, 1 + PAST_BOUNDS_SHARE, ASKED_PER_AXIS)
        places.append((bounds[0] + shares[:, None] * reach).T)
    target = np.array([*(point for one in places for point in product(*one)), centre])
    feet = LocalSource(source, np.zeros(source.dim)).closest_point(target)
    on = np.flatnonzero(feet.edge >= 0)
    if beside is not None and len(on):
        own = on[beside.number_at(feet.points[on]) == beside.parts.index(part)]
        on = own if len(own) else on
    return feet.points[[on[0] if len(on) else 0]]
