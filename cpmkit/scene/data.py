"""Data of a scene: numbers, one a channel, or functions of position and, in problems with a time, of time."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from types import FunctionType
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import CpmkitError, InputError, SceneError, shown
from cpmkit.formulas.expressions import Expression
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import number


class Functional:
    """A right-hand side that is no function of points; see :mod:`cpmkit.scene.functionals`."""

    @property
    def channels(self) -> int:
        """Number of its channels."""
        raise NotImplementedError


#: A number, one entry a channel, or a callable of points (n, d) and, where it has a parameter ``t`` without a default,
#: of the time; text that spells such a function, which is read where the data are given; as a right-hand side also what
#: is known by its integrals alone.
Data = float | str | list[Any] | tuple[Any, ...] | Floats | Callable[..., Any] | Functional
#: What data may be in size: sums of their squares are numbers.
LARGEST_DATUM = 1e100


def takes_time(data: Data) -> bool:
    """Tell whether data, or one entry of them, is a callable with a parameter ``t`` that has no default.

    A default is a value that the caller bound (``lambda x, t=thickness: ...``), not a place for the time.
    """
    if isinstance(data, (list, tuple)):
        return any(takes_time(entry) for entry in data)
    declared = getattr(data, "takes_time", None)
    if isinstance(declared, bool):
        return declared
    if not callable(data):
        return False
    if isinstance(data, FunctionType) and "t" not in data.__code__.co_varnames and not data.__dict__:
        return False  # told in a hundredth of the time that its signature takes, for each step of a run asks
    try:
        target = inspect.signature(data).parameters.get("t")
    except (TypeError, ValueError):  # some built-in functions tell no signature
        return False
    return target is not None and target.default is target.empty and target.kind is not target.VAR_POSITIONAL


def evaluate_data(data: Data, points: Floats, channels: int | None, label: str, time: float | None = None) -> Floats:
    """Return data at points as (n, channels).

    Parameters
    ----------
    data : Data
        A number, one entry a channel (numbers or callables), or a callable of the points.
    points : (n, d) float64
        Where the data are read, in the scene's coordinates.
    channels : int or None
        How many channels are wanted; a single number serves all of them. None: as many as the data have.
    label : str
        Named in the error.
    time : float, optional
        Given to callables with a parameter ``t`` that has no default.

    Raises
    ------
    InputError
        If the number of channels differs, a callable returns another shape, a value is not finite, or a callable
        asks for the time of a problem that has none.
    """
    n = len(points)
    if isinstance(data, Functional):
        raise InputError(
            f"{label} is a {type(data).__name__}, which is known by its integrals alone and has no values at points; "
            "it is accepted as the right-hand side f in the form 'galerkin'."
        )
    if callable(data):
        if takes_time(data) and time is None:
            raise InputError(f"{label} depends on t, and the problem has no time; use Heat or Wave.")
        try:
            values = _as_floats(data(points, t=time) if takes_time(data) else data(points))
        except CpmkitError:
            raise
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{label} must return numbers of shape ({n},) or ({n}, channels): {shown(str(error))}."
            ) from error
        if values.ndim == 0:
            values = np.broadcast_to(values, (n,))
        values = values[:, None] if values.ndim == 1 else values
    elif isinstance(data, (list, tuple, np.ndarray)) and np.ndim(np.asarray(data, dtype=object)) > 0:
        parts = [evaluate_data(entry, points, 1, label, time) for entry in data]
        values = np.concatenate(parts, axis=1) if parts else np.zeros((n, 0))
    else:
        values = np.full((n, 1), as_number(data, label))
    if values.ndim != 2 or len(values) != n:
        raise InputError(f"{label} must give shape ({n},) or ({n}, channels) at {n} points, got {values.shape}.")
    if channels is not None and values.shape[1] != channels:
        if values.shape[1] != 1:
            raise InputError(f"{label} has {values.shape[1]} channels where the scene has {channels}.")
        values = np.repeat(values, channels, axis=1)
    if not np.isfinite(values).all():
        raise InputError(
            f"{label} must be finite, got NaN or infinity at {int((~np.isfinite(values)).any(axis=1).sum())} points."
        )
    if np.abs(values).max(initial=0.0) > LARGEST_DATUM:
        raise InputError(
            f"{label} must be at most {LARGEST_DATUM:g} in size, for its squares are summed, got "
            f"{np.abs(values).max():.3g}; choose another unit."
        )
    return np.ascontiguousarray(values)


def _as_floats(values: Any) -> Floats:
    """Return what a callable gave as float64; truth values count as 1 and 0.

    Raises
    ------
    TypeError
        If they are text, or complex.
    """
    made = np.asarray(values)
    if made.dtype.kind not in "biufO":
        raise TypeError(f"got an array of {made.dtype}")
    return np.asarray(made, dtype=np.float64)


def as_number(data: Any, label: str) -> float:
    """Return ``data`` as a float if it is a finite number; true, false and text are none.

    Raises
    ------
    InputError
        If it is not; ``label`` names it.
    """
    try:
        return number(data, label)
    except InputError as error:
        raise InputError(
            f"{label} must be a finite number, one entry a channel, or a function of points such as "
            f"ck.VertexData(surface, values), got {shown(data)}."
        ) from error


#: The type that fields are declared with which hold data, and that of vector fields.
DATA_TYPE, VECTOR_TYPE = "Data", "VectorField"


@dataclass(frozen=True)
class FieldOfEntries:
    """A vector field written as one number, formula or function a coordinate."""

    entries: tuple[Data, ...]
    label: str = "a vector field"
    takes_time: ClassVar[bool] = False

    def __call__(self, points: Floats) -> Floats:
        """Return the vectors (n, d) at points (n, d)."""
        return evaluate_data(self.entries, points, points.shape[1], self.label)


def read_formulas(stated: Any, label: str) -> None:
    """Put functions in the place of formulas in all fields of a frozen dataclass that hold data or vector fields.

    Raises
    ------
    SceneError
        If a formula does not parse, or uses what is not offered; ``label`` names whose it is.
    """
    for one in fields(stated):
        given, kind = getattr(stated, one.name), str(one.type)
        name = f"{one.name} of {label}"
        made = given
        if VECTOR_TYPE in kind and isinstance(given, (list, tuple)):
            made = as_vector_field(given, name)
        elif DATA_TYPE in kind:
            made = as_data(given, name)
        if made is not given:
            object.__setattr__(stated, one.name, made)


def as_data(given: Any, label: str) -> Any:
    """Return text as the function that it spells, lists entry by entry, columns as arrays, anything else as it is."""
    if hasattr(given, "to_numpy"):  # of pandas and its like
        return given.to_numpy()
    if isinstance(given, str):
        return read_formula(Expression, given, label)
    if isinstance(given, (list, tuple)) and _holds_text(given):
        return [as_data(entry, f"entry {number} of {label}") for number, entry in enumerate(given, 1)]
    return given


def as_vector_field(given: Any, label: str) -> FieldOfEntries:
    """Return a vector field of one number, formula or function a coordinate.

    Raises
    ------
    SceneError
        If one of them depends on t.
    """
    entries = tuple(as_data(entry, f"entry {number} of {label}") for number, entry in enumerate(given, 1))
    if takes_time(entries):
        raise SceneError(f"{label} must not depend on t, got {shown(given)}.")
    return FieldOfEntries(entries, label)


def read_formula(make: Callable[..., Any], text: Any, label: str, *more: Any) -> Any:
    """Return what a kind of formula makes of text; an error names ``label`` it is for."""
    try:
        return make(text, *more)
    except SceneError as error:
        raise SceneError(f"{label}: {error}") from error


def _holds_text(given: Any) -> bool:
    return any(isinstance(entry, str) or (isinstance(entry, (list, tuple)) and _holds_text(entry)) for entry in given)
