"""Formulas as text in place of functions, from Python as in scene files: ``Poisson("x*y")``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, ClassVar

from cpmkit.errors import SceneError, shown
from cpmkit.formulas.expressions import Expression
from cpmkit.protocols import Floats
from cpmkit.scene.data import Data, evaluate_data, takes_time

#: The type that fields are declared with which hold data, and that of vector fields.
DATA_TYPE, VECTOR_TYPE = "Data", "VectorField"


@dataclass(frozen=True)
class FieldOfEntries:
    """A vector field written as one number, formula or function a coordinate."""

    entries: tuple[Data, ...]
    what: str = "a vector field"
    takes_time: ClassVar[bool] = False

    def __call__(self, points: Floats) -> Floats:
        """Return the vectors (n, d) at points (n, d)."""
        return evaluate_data(self.entries, points, points.shape[1], self.what)


def read_formulas(stated: Any, what: str) -> None:
    """Put functions in the place of formulas in all fields of a frozen dataclass that hold data or vector fields.

    Raises
    ------
    SceneError
        If a formula does not parse, or uses what is not offered; ``what`` names whose it is.
    """
    for one in fields(stated):
        given, kind = getattr(stated, one.name), str(one.type)
        name = f"{one.name} of {what}"
        made = given
        if VECTOR_TYPE in kind and isinstance(given, (list, tuple)):
            made = field_of_entries(given, name)
        elif DATA_TYPE in kind:
            made = as_data(given, name)
        if made is not given:
            object.__setattr__(stated, one.name, made)


def as_data(given: Any, what: str) -> Any:
    """Return text as the function that it spells, lists entry by entry, columns as arrays, anything else as it is."""
    if hasattr(given, "to_numpy"):  # of pandas and its like
        return given.to_numpy()
    if isinstance(given, str):
        return formula(Expression, given, what)
    if isinstance(given, (list, tuple)) and _holds_text(given):
        return [as_data(entry, f"entry {number} of {what}") for number, entry in enumerate(given, 1)]
    return given


def field_of_entries(given: Any, what: str) -> FieldOfEntries:
    """Return a vector field of one number, formula or function a coordinate.

    Raises
    ------
    SceneError
        If one of them depends on t.
    """
    entries = tuple(as_data(entry, f"entry {number} of {what}") for number, entry in enumerate(given, 1))
    if takes_time(entries):
        raise SceneError(f"{what} must not depend on t, got {shown(given)}.")
    return FieldOfEntries(entries, what)


def formula(make: Callable[..., Any], text: Any, what: str, *more: Any) -> Any:
    """Return what a kind of formula makes of text; an error names ``what`` it is for."""
    try:
        return make(text, *more)
    except SceneError as error:
        raise SceneError(f"{what}: {error}") from error


def _holds_text(given: Any) -> bool:
    return any(isinstance(entry, str) or (isinstance(entry, (list, tuple)) and _holds_text(entry)) for entry in given)
