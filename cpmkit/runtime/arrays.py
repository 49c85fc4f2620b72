"""Checks of numbers, arrays and colours that users give, made once where they enter the library."""

from __future__ import annotations

import re
from contextlib import suppress
from functools import cache
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.runtime.messages import did_you_mean
from cpmkit.types import Floats

#: Largest coordinate and length, and inverse of the least length, in any unit: fourth powers do not overflow.
LARGEST_LENGTH = 1e50


def as_points(x: Any, dim: int, label: str = "points") -> Floats:
    """Return ``x`` as a C-contiguous (n, dim) float64 array of finite numbers, which may share the memory of ``x``.

    ``label`` names the data in messages. Raises InputError if the shape is not (n, dim), or an entry is not finite.
    """
    points = np.ascontiguousarray(_as_floats(x, f"{label} must be numbers of shape (n, {dim})"))
    if points.ndim != 2 or points.shape[1] != dim:
        raise InputError(f"{label} must have shape (n, {dim}), got {np.shape(x)}.")
    if not np.isfinite(points).all():
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        raise InputError(
            f"{label} must be finite: {len(bad)} of {len(points)} rows hold NaN or infinity, first row {bad[0]}."
        )
    return points


def as_positions(x: Any, dim: int, label: str = "points") -> Floats:
    """Return ``x`` as a (n, dim) float64 array of finite points that :func:`check_size` accepts.

    ``label`` names ``x`` in messages. Raises InputError if ``x`` is not (n, dim) finite numbers, one is above
    :data:`LARGEST_LENGTH` in size, or all points, unless they are equal, are in a box smaller than its inverse.
    """
    points = as_points(x, dim, label)
    check_size(points, label)
    return points


def check_size(points: Floats, label: str) -> None:
    """Raise if coordinates of ``points`` (n, d) are too large, or their extent too small, to compute with.

    ``label`` names the points in messages. Raises InputError if a coordinate is larger in size than
    :data:`LARGEST_LENGTH`, or the largest side of the bounding box is below the inverse of this number but not zero.
    """
    farthest = float(np.abs(points).max(initial=0.0))
    if farthest > LARGEST_LENGTH:
        raise InputError(
            f"{label} must lie within {LARGEST_LENGTH:g} of zero, got {farthest:.3g}; choose a larger unit of length."
        )
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if 0.0 < extent < 1.0 / LARGEST_LENGTH:
        raise InputError(
            f"{label} must be at least {1.0 / LARGEST_LENGTH:g} across, got {extent:.3g}; choose a smaller unit of "
            "length."
        )


def length(x: Any, label: str) -> float:
    """Return ``x``, from 1 / :data:`LARGEST_LENGTH` to this, as a float; else raise an InputError with ``label``."""
    value = positive(x, label)
    if not 1.0 / LARGEST_LENGTH <= value <= LARGEST_LENGTH:
        raise InputError(
            f"{label} must be from {1.0 / LARGEST_LENGTH:g} to {LARGEST_LENGTH:g}, got {shown(x)}; choose another unit "
            "of length."
        )
    return value


def as_vector(x: Any, dim: int, label: str) -> Floats:
    """Return ``x``, ``dim`` finite numbers, as a new (dim,) float64 array; else raise an InputError with ``label``."""
    vector = np.array(_as_floats(x, f"{label} must be {dim} numbers"))
    if vector.shape != (dim,) or not np.isfinite(vector).all():
        raise InputError(f"{label} must be {dim} finite numbers, got {shown(x)}.")
    return vector


def _as_floats(x: Any, accepted: str) -> Floats:
    """Return ``x`` as float64, not copied if possible; raise InputError, which begins with ``accepted``, otherwise."""
    with suppress(TypeError, ValueError, OverflowError):
        # NumPy would convert texts, dates and truth values to numbers, in lists also those beside numbers.
        entries = np.asarray(x, dtype=object).flat if isinstance(x, (list, tuple)) else ()
        if np.asarray(x).dtype.kind not in "bUSmM" and {bool, np.bool_}.isdisjoint(map(type, entries)):
            return np.asarray(x, dtype=np.float64)
    raise InputError(f"{accepted}, got {shown(x)}.")


def number(x: Any, label: str) -> float:
    """Return a finite number ``x`` as a float; else, also for text or True, raise an InputError with ``label``."""
    value = _as_float(x)
    if not np.isfinite(value):
        raise InputError(f"{label} must be a finite number, got {shown(x)}.")
    return value


def positive(x: Any, label: str) -> float:
    """Return a finite number ``x`` above zero as a float; raise InputError with ``label`` for all else, also True."""
    value = _as_float(x)
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{label} must be a finite number above zero, got {shown(x)}.")
    return value


def _as_float(x: Any) -> float:
    """Return ``x``, a real number or an array () of one, as a float: infinity if too large, NaN for anything else."""
    if isinstance(x, np.ndarray) and x.ndim == 0:
        x = x[()]
    if isinstance(x, bool) or not isinstance(x, (int, float, np.integer, np.floating)):
        return np.nan
    try:
        return float(x)
    except OverflowError:
        return np.inf


def is_whole(x: Any) -> bool:
    """Return whether ``x`` is an integer of Python or NumPy; True and False are none."""
    return isinstance(x, (int, np.integer)) and not isinstance(x, bool)


def whole(x: Any, label: str, least: int = 0, most: int | None = None) -> int:
    """Return ``x`` as an int if it is a whole number from ``least`` to ``most``; True, text and 2.0 are refused.

    Without ``most`` there is no upper bound. Raises InputError, whose message begins with ``label``, for other ``x``.
    """
    if not is_whole(x) or x < least or (most is not None and x > most):
        bounds = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise InputError(f"{label} must be a whole number {bounds}, got {shown(x)}.")
    return int(x)


def one_row_each(values: Any, count: int, label: str) -> Floats:
    """Return ``values`` (count, ...), data of a source, as float64.

    ``label`` names the vertices or samples in the message. Raises InputError if there are not ``count`` rows.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or len(array) != count:
        raise InputError(f"values must have one row for each of the {count} {label}, got shape {array.shape}.")
    return array


@cache
def named_colours() -> dict[str, str]:
    """Return the hexadecimal rrggbb of each colour of CSS by name (W3C, CSS Color Module Level 4, section 6.1)."""
    from importlib.resources import files

    table = files("cpmkit.runtime").joinpath("css_colours.txt").read_text(encoding="utf-8")
    return dict(line.split() for line in table.splitlines())


def as_colour(colour: Any, label: str = "a colour") -> Floats:
    """Return a colour as red, green and blue (3,) in sRGB, each from 0 to 1.

    Parameters
    ----------
    colour : str or three numbers
        A name of CSS, ``"#f80"``, ``"#ff8800"``, or numbers from 0 to 1.
    label : str
        Name of the colour in errors.

    Raises
    ------
    InputError
        If ``colour`` is none of these.

    Examples
    --------
    >>> as_colour("#ff8000").round(2).tolist()
    [1.0, 0.5, 0.0]
    >>> as_colour("navvy")
    Traceback (most recent call last):
    cpmkit.errors.InputError: a colour must be a name of CSS or #rrggbb, got 'navvy' (did you mean 'navy'?).
    """
    if not isinstance(colour, str):
        return np.asarray(as_colours([colour], label)[0])
    word = colour.strip().lower()
    is_hexadecimal = re.fullmatch(r"#(?:[0-9a-f]{3}|[0-9a-f]{6})", word)
    digits = named_colours().get(word) or (word[1:] if is_hexadecimal else "")
    if not digits:
        raise InputError(
            f"{label} must be a name of CSS or #rrggbb, got {shown(colour)}{did_you_mean(word, named_colours())}."
        )
    pairs = [2 * digit for digit in digits] if len(digits) == 3 else re.findall("..", digits)
    return np.array([int(pair, 16) / 255 for pair in pairs])


def as_colours(colours: Any, label: str = "colours") -> Floats:
    """Return ``colours``, (k, 3) numbers from 0 to 1 in sRGB, as float64.

    Raises InputError, whose message begins with ``label``, if the shape differs, or a number is outside of this range.
    """
    checked = as_points(colours, 3, label)
    outside = checked[(checked < 0) | (checked > 1)]
    if len(outside):
        raise InputError(f"{label} must be numbers from 0 to 1, got {outside[0]:g}; divide those up to 255 by it.")
    return checked


def not_negative(x: Any, label: str) -> float:
    """Return ``x`` as a float if it is a finite number of at least zero; else raise an InputError with ``label``."""
    return positive(x, f"{label}, where it is not zero,") if number(x, label) != 0 else 0.0
