"""What depends on the splines and samples alone: made once, shared by all equations on one prepared scene."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

Made = TypeVar("Made")


class cached_on_space(Generic[Made]):
    """A property that is made when it is first asked for, and kept in the instance's ``shared``.

    ``dataclasses.replace`` hands that mapping on: what is made of one restated scene serves all others.
    """

    def __init__(self, make: Callable[[Any], Made]) -> None:
        self.make, self.__doc__ = make, make.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, instance: None, owner: type) -> cached_on_space[Made]: ...

    @overload
    def __get__(self, instance: object, owner: type) -> Made: ...

    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        if self.name not in instance.shared:
            instance.shared[self.name] = self.make(instance)
        return instance.shared[self.name]
