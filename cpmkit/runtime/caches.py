"""Caches: shared values that are freed when unused, and the state of an object without its cached properties."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from inspect import getattr_static
from typing import Any, Generic, TypeVar
from weakref import ReferenceType, ref

Made = TypeVar("Made")


@dataclass(eq=False)
class WeakCache(Generic[Made]):
    """A cache of one large value that is quick to compute, shared by all users and freed when none refers to it."""

    _reference: ReferenceType[Any] | None = None

    def get(self, make: Callable[[], Made]) -> Made:
        """Return the cached value if any user still refers to it, else that of ``make()``, which is then cached."""
        value: Made | None = None if self._reference is None else self._reference()
        if value is None:
            value = make()
            self._reference = ref(value)
        return value

    def __getstate__(self) -> dict[str, Any]:
        return {"_reference": None}  # a weak reference does not pickle


def state_without_cached(instance: object) -> dict[str, Any]:
    """Return the attributes of an object to pickle: all but its cached properties, such as factors of a matrix."""
    kind = type(instance)
    return {
        name: value
        for name, value in vars(instance).items()
        if not isinstance(getattr_static(kind, name, None), cached_property)
    }
