"""Whether two conditions say the same: a boundary with the same on both sides needs no left."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.scene.laws import Interface

if TYPE_CHECKING:
    from cpmkit.scene.condition import Condition


def same_condition(first: Any, second: Any) -> bool:
    """Tell whether two conditions are of one kind with equal numbers, equal formulas or the same callables."""
    if first is second:
        return True
    if type(first) is not type(second) or not is_dataclass(first):
        return False
    return all(_equal(getattr(first, field.name), getattr(second, field.name)) for field in fields(first) if field.init)


def sides_differ(left: Condition, right: Condition) -> bool:
    """Tell whether it matters which side of a boundary is called left.

    Where both hold one condition it does not, nor across a contact that is the same from both sides.
    """
    law = left.law
    if isinstance(law, Interface):
        return not (law.left == law.right and _equal(law.jump, 0.0))
    return not same_condition(left, right)


def _equal(first: Any, second: Any) -> bool:
    if first is second:
        return True
    if callable(first) or callable(second):
        return callable(first) and callable(second) and _same_function(first, second)
    if isinstance(first, (list, tuple)) and isinstance(second, (list, tuple)):
        return len(first) == len(second) and all(map(_equal, first, second))
    if first is None or second is None:
        return False
    return np.array_equal(np.asarray(first), np.asarray(second))


def _same_function(first: Any, second: Any) -> bool:
    """Tell whether two callables are equal: formulas are by their text, a bound method by its object."""
    try:
        return bool(first == second)
    except ValueError:  # some class compares arrays entry by entry
        return False
