"""Caches: values that live as long as somebody uses them, and the state of an object without cached properties."""

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
    """One large value, quickly computed again, that all users share as long as one of them refers to it."""

    _reference: ReferenceType[Any] | None = None

    def get(self, make: Callable[[], Made]) -> Made:
        """Return the value that others refer to, or that of ``make()``."""
        value: Made | None = None if self._reference is None else self._reference()
        if value is None:
            value = make()
            self._reference = ref(value)
        return value

    def __getstate__(self) -> dict[str, Any]:
        return {"_reference": None}  # a weak reference does not pickle


def state_without_cached(instance: object) -> dict[str, Any]:
    """Return the attributes of an object to pickle: without cached properties, such as factors of a matrix."""
    kind = type(instance)
    return {
        name: value
        for name, value in vars(instance).items()
        if not isinstance(getattr_static(kind, name, None), cached_property)
    }
