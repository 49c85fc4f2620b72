"""Conditions for parts of an edge by position: the list that a scene is given as its ``edge``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import SceneError, place, shown
from cpmkit.formulas.expressions import Expression
from cpmkit.protocols import Floats, Ints
from cpmkit.scene.condition import Condition
from cpmkit.scene.conditions import as_condition
from cpmkit.scene.data import evaluate_data, takes_time
from cpmkit.scene.formula_data import formula

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
    def told(self) -> str:
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
            what = f"`where` of part {k} of the edge"
            holds = True if part.where is None else evaluate_data(part.where, points[left], 1, what)[:, 0] != 0
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


def parts_of(given: Any) -> ByPosition:
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
    what = f"`where` of part {number} of the edge"
    made: Any = formula(Expression, given, what) if isinstance(given, str) else given
    if made is not None and not callable(made):
        raise SceneError(f"{what} must be a formula such as 'x < 0', or a function of points, got {shown(given)}.")
    if made is not None and takes_time(made):
        raise SceneError(f"{what} depends on t, and parts of the edge stay where they are; leave t out.")
    found: Callable[[Floats], Any] | None = made
    return found
