"""Data of a scene: numbers, lists by channel, and functions of position, time or the solution, also as formulas."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from types import FunctionType
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import CpmkitError, InputError, ResolutionError, SceneError, place, shown
from cpmkit.formulas.expressions import Expression
from cpmkit.runtime.arrays import number
from cpmkit.types import Floats


class Functional(ABC):
    """Base class of right-hand sides that are a functional, known by its values on test functions, plus a function.

    The function of points is ``beside``; ``form`` is a discretised scene, :class:`cpmkit.forms.galerkin.form.Galerkin`.
    """

    beside: Data

    @property
    @abstractmethod
    def channels(self) -> int:
        """Number of channels of the functional."""

    @property
    def takes_time(self) -> bool:
        """True if the function ``beside`` depends on the time."""
        return takes_time(self.beside)

    @abstractmethod
    def values(self, form: Any) -> Floats:
        """Return the values (n, channels) of the functional, without ``beside``, on the ``form``'s n test functions."""

    def loads(self, form: Any, time: float | None = None) -> Floats:
        """Return load vectors (n, channels) in ``form`` of functional plus ``beside``, at ``time`` (None: no time)."""
        return self.values(form) if is_zero(self.beside) else form.load(self.beside, time) + self.values(form)


#: A number; one entry for each channel; a callable of points (n, d) and, if it has a parameter ``t`` without a default,
#: of the time; a formula as text; or, as a right-hand side, a functional.
Data = float | str | list[Any] | tuple[Any, ...] | Floats | Callable[..., Any] | Functional
#: Data with one value for all channels; such data, or a tensor; and one of them for each channel, stored as a tuple.
ScalarData = Data
TensorData = Data
ChannelData = Any
#: Largest absolute value of data, in any unit: sums of their squares do not overflow.
LARGEST_DATUM = 1e100


def is_sequence(value: Any) -> bool:
    """Return True for a list or a tuple; its entries belong to channels, coordinates or rows."""
    return isinstance(value, (list, tuple))


def is_zero(data: Any) -> bool:
    """Return True for data that are the number zero in all channels."""
    return not callable(data) and not np.any(np.asarray(data, dtype=object))


def takes_time(data: Any) -> bool:
    """Return True if data depend on the time: if they, or an entry of them, have a parameter ``t`` without a default.

    A ``t`` with a default is a value that the caller bound (``lambda x, t=thickness: ...``), not the time. For an
    object with an attribute ``takes_time`` the result is that attribute.
    """
    if is_sequence(data):
        return any(takes_time(entry) for entry in data)
    declared = getattr(data, "takes_time", None)
    if declared is not None:
        return bool(declared)
    if not callable(data):
        return False
    if isinstance(data, FunctionType) and "t" not in data.__code__.co_varnames and not data.__dict__:
        return False  # each time step asks, and inspecting the signature takes a hundred times longer
    try:
        t = inspect.signature(data).parameters.get("t")
    except (TypeError, ValueError):  # some built-in functions have no signature
        return False
    return t is not None and t.default is t.empty and t.kind is not t.VAR_POSITIONAL


def evaluate_data(data: Data, points: Floats, channels: int | None, label: str, time: float | None = None) -> Floats:
    """Return the values (n, channels) of data at points.

    Parameters
    ----------
    data : Data
        A number, one entry for each channel (numbers or callables), or a callable of the points.
    points : (n, d) float64
        The points, in the scene's coordinates.
    channels : int or None
        Number of channels; data of one channel are repeated for all. None: as many as the data have.
    label : str
        Name of the data in errors.
    time : float, optional
        Argument of callables with a parameter ``t`` without a default.

    Raises
    ------
    InputError
        If the number of channels differs, a callable returns another shape than (), (n,) or (n, channels), a value is
        not finite or too large, data are a functional, or data depend on the time and there is none.
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
            function = getattr(data, "nearest_values", data)  # of data by member, without a check
            result = np.asarray(function(points, t=time) if takes_time(data) else function(points))
            if result.dtype.kind not in "biufO":  # text, or complex numbers
                raise TypeError(f"got an array of {result.dtype}")
            values = result.astype(np.float64)
        except CpmkitError:
            raise
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{label} must return numbers of shape ({n},) or ({n}, channels): {shown(str(error))}."
            ) from error
        if values.ndim == 0:
            values = np.broadcast_to(values, (n,))
        values = values[:, None] if values.ndim == 1 else values
    elif np.ndim(np.asarray(data, dtype=object)) > 0:
        entries: Any = data
        parts = [evaluate_data(entry, points, 1, label, time) for entry in entries]
        values = np.concatenate(parts, axis=1) if parts else np.zeros((n, 0))
    else:
        try:
            values = np.full((n, 1), number(data, label))
        except InputError as error:
            raise InputError(
                f"{label} must be a finite number, one entry a channel, or a function of points such as "
                f"ck.VertexData(surface, values), got {shown(data)}."
            ) from error
    if values.ndim != 2 or len(values) != n:
        raise InputError(f"{label} must give shape ({n},) or ({n}, channels) at {n} points, got {values.shape}.")
    if channels is not None and values.shape[1] != channels:
        if values.shape[1] != 1:
            raise InputError(f"{label} has {values.shape[1]} channels where the scene has {channels}.")
        values = np.repeat(values, channels, axis=1)
    if not np.isfinite(values).all():
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        several = f"{len(bad)} points, such as " if len(bad) > 1 else ""
        raise InputError(f"{label} must be finite, got NaN or infinity at {several}{place(points[bad[0]])}.")
    if np.abs(values).max(initial=0.0) > LARGEST_DATUM:
        raise InputError(
            f"{label} must be at most {LARGEST_DATUM:g} in size, for its squares are summed, got "
            f"{np.abs(values).max():.3g}; choose another unit."
        )
    return np.ascontiguousarray(values)


@dataclass(frozen=True)
class FieldOfEntries:
    """A vector field on points (n, d), given by a number or a function of points for each component."""

    entries: tuple[Data, ...]
    label: str = "a vector field"
    takes_time: ClassVar[bool] = False

    def __call__(self, points: Floats) -> Floats:
        """Return the values (n, components) at points (n, d)."""
        return evaluate_data(self.entries, points, len(self.entries), self.label)


def replace_formulas(instance: Any, label: str) -> None:
    """Replace the formulas in the fields of an equation or condition, ``instance``, by functions, in place.

    Only fields whose types are ``Data`` or ``VectorField`` are replaced; pandas columns in them become arrays.
    ``label`` names the instance in messages. Raises SceneError if a formula does not parse, or a component of a vector
    field depends on t.
    """
    for member in fields(instance):
        value, kind = getattr(instance, member.name), str(member.type)
        name = f"{member.name} of {label}"
        if "VectorField" in kind and is_sequence(value):
            object.__setattr__(instance, member.name, as_vector_field(value, name))
        elif "Data" in kind:
            object.__setattr__(instance, member.name, as_data(value, name))


def as_data(value: Any, label: str) -> Any:
    """Return data with formulas replaced by functions and pandas columns by arrays; other values unchanged.

    Lists and tuples become lists of converted entries. Raises SceneError, with ``label``, if a formula does not parse.
    """
    if hasattr(value, "to_numpy"):
        return value.to_numpy()
    if isinstance(value, str):
        return read_formula(Expression, value, label)
    if is_sequence(value):
        return [as_data(entry, f"entry {number} of {label}") for number, entry in enumerate(value, 1)]
    return value


def as_vector_field(components: Any, label: str) -> FieldOfEntries:
    """Return the vector field with these ``components``: a number, formula or function for each coordinate.

    Raises SceneError, with ``label`` for the field, if a component depends on t, or a formula does not parse.
    """
    entries = tuple(as_data(entry, f"entry {number} of {label}") for number, entry in enumerate(components, 1))
    if takes_time(entries):
        raise SceneError(f"{label} must not depend on t, got {shown(components)}.")
    return FieldOfEntries(entries, label)


def read_formula(kind: Callable[..., Any], text: Any, label: str, *more: Any) -> Any:
    """Return ``kind(text, *more)``, the function that a formula ``text`` describes; ``kind`` is such as ``Expression``.

    Raises SceneError if ``kind`` does; the message then begins with ``label``, the name of the datum.
    """
    try:
        return kind(text, *more)
    except SceneError as error:
        raise SceneError(f"{label}: {error}") from error


def call_pointwise(
    function: Callable[..., Any],
    arrays: tuple[Floats, ...],
    shape: tuple[int, ...],
    label: str,
    time: float | None = None,
    least: int = 1,
    finite: bool = True,
) -> Floats:
    """Return the values of a function at points, of this ``shape``: (p,) or (p, channels).

    The function receives the first of ``arrays`` (p, ...), as many as it has parameters without defaults, and at least
    ``least``; if it has a parameter ``t`` without a default, it also receives ``time``, unless None. It may return one
    number for all points, and (p,) in place of (p, 1). Raises InputError, with ``label`` for the function, if it raises
    a TypeError or ValueError, returns another shape, or returns NaN or infinity and ``finite`` is True.
    """
    timed = {"t": time} if time is not None and takes_time(function) else {}
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):  # some built-in functions have no signature
        parameters = {}.values()
    needed = [each for each in parameters if each.default is each.empty and each.kind is not each.VAR_KEYWORD]
    count = max(sum(each.name not in timed for each in needed), least)
    try:
        values = np.asarray(function(*arrays[:count], **timed), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{label} must return numbers of shape {shape}: {shown(str(error))}.") from error
    if values.ndim == 0 or (values.shape == shape[:1] and shape[1:] == (1,)):
        values = np.broadcast_to(values.reshape(-1, *shape[1:]), shape)
    if values.shape != shape or (finite and not np.isfinite(values).all()):
        bad = "" if np.isfinite(values).all() else " with NaN or infinity"
        at = "" if time is None else f" at time {time:.4g}"
        raise InputError(f"{label} must return finite numbers of shape {shape}, got shape {values.shape}{bad}{at}.")
    return values


#: Step of differences, as a share of the varied quantity: above the square root of the rounding error.
DIFFERENCE_SHARE = 1e-6


def central_difference(function: Callable[[Floats], Floats], x: Floats, step: Floats | None = None) -> Floats:
    """Return the derivative (k,), by central differences, of a function that acts on each entry of x (k,) separately.

    The ``step`` (k,) is by default 1e-6 of the largest absolute value of x, or 1e-6 if all are zero.
    """
    if step is None:
        step = np.full_like(x, DIFFERENCE_SHARE * (np.abs(x).max(initial=0.0) or 1.0))
    return np.asarray((function(x + step) - function(x - step)) / (2 * step))


#: A function of points (p, d), values (p, channels) and, if it has a parameter ``t`` without a default, the time, that
#: returns values (p, channels).
AfterStep = Callable[..., Any]


#: A function of u (p, channels), of points (p, d) if it has a second parameter, and of the time if it has a parameter
#: ``t`` without a default, that returns rates (p, channels); or the formulas of the channels.
Reaction = Callable[..., Any] | str | Sequence[str]


def reaction_rates(reaction: Any, u: Floats, points: Floats, time: float, start: float = 0.0) -> Floats:
    """Return the rates (p, channels) of a reaction for values u (p, channels) at ``points`` (p, d) and ``time``.

    Raises InputError if they have another shape, or are not finite at ``start``, the time of the initial data; raises
    ResolutionError if they are not finite at another time. Rates above 1e100 in size count as not finite.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        values = call_pointwise(reaction, (u.copy(), points), u.shape, "the reaction", time, finite=False)
    if not np.abs(values).max(initial=0.0) <= LARGEST_DATUM:
        if time == start:
            raise InputError("the reaction must be finite for the initial data, got NaN, infinity or more than 1e100.")
        raise ResolutionError(
            f"The reaction ceased to be finite at time {time:.4g}: it is taken from the step before, and the step must "
            "be shorter than the time in which the fastest part of it acts; use a shorter step. If a shorter step does "
            "not move that time, the equation itself has no solution beyond it."
        )
    return np.ascontiguousarray(values)
