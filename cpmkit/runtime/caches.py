"""What is large and quickly made again: kept as long as somebody holds it, and no longer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from inspect import getattr_static
from typing import Any, Generic, TypeVar
from weakref import ReferenceType, ref

Made = TypeVar("Made")


@dataclass(eq=False)
class Weakly(Generic[Made]):
    """One thing that all who hold it at the same time share."""

    _held: ReferenceType[Any] | None = None

    def get(self, make: Callable[[], Made]) -> Made:
        """Return what others hold, or make it."""
        found: Made | None = None if self._held is None else self._held()
        if found is None:
            found = make()
            self._held = ref(found)
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {"_held": None}  # a weak reference does not pickle


def without_cached(made: object) -> dict[str, Any]:
    """Return the state of an object without its cached properties: factors and weak references do not pickle."""
    kind = type(made)
    return {
        name: value
        for name, value in vars(made).items()
        if not isinstance(getattr_static(kind, name, None), cached_property)
    }
