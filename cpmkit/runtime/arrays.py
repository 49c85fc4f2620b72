"""What comes in at the door: arrays are checked once here and trusted afterwards."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.protocols import Floats

#: Coordinates and lengths are at most this, and lengths at least one over this: fourth powers of them are numbers.
LARGEST_LENGTH = 1e50


def as_points(x: Any, dim: int, what: str = "points") -> Floats:
    """Return ``x`` as a C-contiguous (n, dim) float64 array of finite numbers.

    Raises
    ------
    InputError
        If the shape is not (n, dim), or an entry is not a finite number.
    """
    points = np.ascontiguousarray(_as_floats(x, f"{what} must be numbers of shape (n, {dim})"))
    if points.ndim != 2 or points.shape[1] != dim:
        raise InputError(f"{what} must have shape (n, {dim}), got {np.shape(x)}.")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(
            f"{what} must be finite: {len(bad)} of {len(points)} rows hold NaN or infinity, first row {bad[0]}."
        )
    return points


def as_positions(x: Any, dim: int, what: str = "points") -> Floats:
    """Return ``x`` as :func:`as_points` does, if areas and volumes between such points can be computed.

    Raises
    ------
    InputError
        If they cannot, or ``x`` is not (n, dim) finite numbers.
    """
    points = as_points(x, dim, what)
    check_size(points, what)
    return points


def check_size(points: Floats, what: str) -> None:
    """Refuse ``points`` (n, d) whose coordinates are too large, or too close together, to compute with.

    Raises
    ------
    InputError
        If they are.
    """
    farthest = float(np.abs(points).max(initial=0.0))
    if farthest > LARGEST_LENGTH:
        raise InputError(
            f"{what} must lie within {LARGEST_LENGTH:g} of zero, got {farthest:.3g}; choose a larger unit of length."
        )
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if 0.0 < extent < 1.0 / LARGEST_LENGTH:
        raise InputError(
            f"{what} must be at least {1.0 / LARGEST_LENGTH:g} across, got {extent:.3g}; choose a smaller unit of "
            "length."
        )


def length(x: Any, what: str) -> float:
    """Return ``x`` as a float if it is a number above zero that lengths may have.

    Raises
    ------
    InputError
        If it is not.
    """
    value = positive(x, what)
    if not 1.0 / LARGEST_LENGTH <= value <= LARGEST_LENGTH:
        raise InputError(
            f"{what} must be from {1.0 / LARGEST_LENGTH:g} to {LARGEST_LENGTH:g}, got {shown(x)}; choose another unit "
            "of length."
        )
    return value


def as_vector(x: Any, dim: int, what: str) -> Floats:
    """Return ``x`` as a (dim,) float64 array of finite numbers.

    Raises
    ------
    InputError
        If ``x`` is not ``dim`` finite numbers.
    """
    vector = np.array(_as_floats(x, f"{what} must be {dim} numbers"))
    if vector.shape != (dim,) or not np.isfinite(vector).all():
        raise InputError(f"{what} must be {dim} finite numbers, got {shown(x)}.")
    return vector


def _as_floats(x: Any, accepted: str) -> Floats:
    """Return ``x`` as float64, or refuse what holds something else than numbers by the sentence that it begins with."""
    with suppress(TypeError, ValueError, OverflowError):
        array = np.asarray(x, dtype=np.float64)
        if not _holds_no_numbers(x):
            return array
    raise InputError(f"{accepted}, got {shown(x)}.")


def _holds_no_numbers(x: Any) -> bool:
    """Tell whether what NumPy would make numbers of is, or holds, text or true and false."""
    if isinstance(x, np.ndarray):
        return x.dtype.kind in "bUSmM"
    rows = x if isinstance(x, (list, tuple)) else ()
    entries = [entry for row in rows for entry in (row if isinstance(row, (list, tuple)) else [row])]
    return any(isinstance(entry, (bool, np.bool_, str, bytes)) for entry in entries)


def number(x: Any, what: str) -> float:
    """Return ``x`` as a float if it is a finite number; true, false and text are none.

    Raises
    ------
    InputError
        If it is not.
    """
    value = _as_float(x)
    if not np.isfinite(value):
        raise InputError(f"{what} must be a finite number, got {shown(x)}.")
    return value


def positive(x: Any, what: str) -> float:
    """Return ``x`` as a float if it is a finite number above zero; true and text are none.

    Raises
    ------
    InputError
        If it is not.
    """
    value = _as_float(x)
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{what} must be a finite number above zero, got {shown(x)}.")
    return value


def _as_float(x: Any) -> float:
    """Return a real number, or an array that holds one, as a float; NaN for anything else."""
    if isinstance(x, np.ndarray) and x.ndim == 0:
        x = x[()]
    if isinstance(x, bool) or not isinstance(x, (int, float, np.integer, np.floating)):
        return np.nan
    try:
        return float(x)
    except OverflowError:
        return np.inf


def whole(x: Any, what: str, least: int = 0, most: int | None = None) -> int:
    """Return ``x`` as an int if it is a whole number from ``least`` to ``most``; true, text and 2.0 are none.

    Raises
    ------
    InputError
        If it is not.
    """
    accepted = isinstance(x, (int, np.integer)) and not isinstance(x, bool)
    if not accepted or x < least or (most is not None and x > most):
        bounds = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise InputError(f"{what} must be a whole number {bounds}, got {shown(x)}.")
    return int(x)


def one_row_each(values: Any, count: int, what: str) -> Floats:
    """Return ``values`` as float64 if they have one row for each of ``count`` things.

    Raises
    ------
    InputError
        If they have not.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or len(array) != count:
        raise InputError(f"values must have one row for each of the {count} {what}, got shape {array.shape}.")
    return array
