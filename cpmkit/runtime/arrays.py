"""Checks of numbers, arrays and colours that users give, made once where they enter the library."""

from __future__ import annotations

import re
from contextlib import suppress
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
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(
            f"{label} must be finite: {len(bad)} of {len(points)} rows hold NaN or infinity, first row {bad[0]}."
        )
    return points


def as_positions(x: Any, dim: int, label: str = "points") -> Floats:
    """Return ``x`` as a (n, dim) float64 array of points whose size permits computing areas and volumes.

    ``label`` is for messages. Raises InputError if ``x`` is not (n, dim) finite numbers, or fails :func:`check_size`.
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
    """Return ``x`` as a float if it is a length between 1 / :data:`LARGEST_LENGTH` and :data:`LARGEST_LENGTH`.

    Raises InputError, whose message begins with ``label``, if ``x`` is not such a number.
    """
    value = positive(x, label)
    if not 1.0 / LARGEST_LENGTH <= value <= LARGEST_LENGTH:
        raise InputError(
            f"{label} must be from {1.0 / LARGEST_LENGTH:g} to {LARGEST_LENGTH:g}, got {shown(x)}; choose another unit "
            "of length."
        )
    return value


def as_vector(x: Any, dim: int, label: str) -> Floats:
    """Return ``x`` as a new (dim,) float64 array of finite numbers.

    Raises InputError, whose message begins with ``label``, if ``x`` is not ``dim`` finite numbers.
    """
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
    """Return ``x`` as a float if it is a finite number; truth values and text are refused.

    Raises InputError, whose message begins with ``label``, if ``x`` is not a finite number.
    """
    value = _as_float(x)
    if not np.isfinite(value):
        raise InputError(f"{label} must be a finite number, got {shown(x)}.")
    return value


def positive(x: Any, label: str) -> float:
    """Return ``x`` as a float if it is a finite number above zero; truth values and text are refused.

    Raises InputError, whose message begins with ``label``, if ``x`` is not such a number.
    """
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


def whole(x: Any, label: str, least: int = 0, most: int | None = None) -> int:
    """Return ``x`` as an int if it is a whole number from ``least`` to ``most``; True, text and 2.0 are refused.

    Without ``most`` there is no upper bound. Raises InputError, whose message begins with ``label``, for other ``x``.
    """
    accepted = isinstance(x, (int, np.integer)) and not isinstance(x, bool)
    if not accepted or x < least or (most is not None and x > most):
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


#: The named colours of CSS (W3C, CSS Color Module Level 4, section 6.1), which are those of SVG.
_NAMES = """
aliceblue f0f8ff antiquewhite faebd7 aqua 00ffff aquamarine 7fffd4 azure f0ffff beige f5f5dc bisque ffe4c4 black
000000 blanchedalmond ffebcd blue 0000ff blueviolet 8a2be2 brown a52a2a burlywood deb887 cadetblue 5f9ea0
chartreuse 7fff00 chocolate d2691e coral ff7f50 cornflowerblue 6495ed cornsilk fff8dc crimson dc143c cyan 00ffff
darkblue 00008b darkcyan 008b8b darkgoldenrod b8860b darkgray a9a9a9 darkgreen 006400 darkgrey a9a9a9 darkkhaki
bdb76b darkmagenta 8b008b darkolivegreen 556b2f darkorange ff8c00 darkorchid 9932cc darkred 8b0000 darksalmon
e9967a darkseagreen 8fbc8f darkslateblue 483d8b darkslategray 2f4f4f darkslategrey 2f4f4f darkturquoise 00ced1
darkviolet 9400d3 deeppink ff1493 deepskyblue 00bfff dimgray 696969 dimgrey 696969 dodgerblue 1e90ff firebrick
b22222 floralwhite fffaf0 forestgreen 228b22 fuchsia ff00ff gainsboro dcdcdc ghostwhite f8f8ff gold ffd700
goldenrod daa520 gray 808080 green 008000 greenyellow adff2f grey 808080 honeydew f0fff0 hotpink ff69b4
indianred cd5c5c indigo 4b0082 ivory fffff0 khaki f0e68c lavender e6e6fa lavenderblush fff0f5 lawngreen 7cfc00
lemonchiffon fffacd lightblue add8e6 lightcoral f08080 lightcyan e0ffff lightgoldenrodyellow fafad2 lightgray
d3d3d3 lightgreen 90ee90 lightgrey d3d3d3 lightpink ffb6c1 lightsalmon ffa07a lightseagreen 20b2aa lightskyblue
87cefa lightslategray 778899 lightslategrey 778899 lightsteelblue b0c4de lightyellow ffffe0 lime 00ff00
limegreen 32cd32 linen faf0e6 magenta ff00ff maroon 800000 mediumaquamarine 66cdaa mediumblue 0000cd
mediumorchid ba55d3 mediumpurple 9370db mediumseagreen 3cb371 mediumslateblue 7b68ee mediumspringgreen 00fa9a
mediumturquoise 48d1cc mediumvioletred c71585 midnightblue 191970 mintcream f5fffa mistyrose ffe4e1 moccasin
ffe4b5 navajowhite ffdead navy 000080 oldlace fdf5e6 olive 808000 olivedrab 6b8e23 orange ffa500 orangered
ff4500 orchid da70d6 palegoldenrod eee8aa palegreen 98fb98 paleturquoise afeeee palevioletred db7093 papayawhip
ffefd5 peachpuff ffdab9 peru cd853f pink ffc0cb plum dda0dd powderblue b0e0e6 purple 800080 rebeccapurple 663399
red ff0000 rosybrown bc8f8f royalblue 4169e1 saddlebrown 8b4513 salmon fa8072 sandybrown f4a460 seagreen 2e8b57
seashell fff5ee sienna a0522d silver c0c0c0 skyblue 87ceeb slateblue 6a5acd slategray 708090 slategrey 708090
snow fffafa springgreen 00ff7f steelblue 4682b4 tan d2b48c teal 008080 thistle d8bfd8 tomato ff6347 turquoise
40e0d0 violet ee82ee wheat f5deb3 white ffffff whitesmoke f5f5f5 yellow ffff00 yellowgreen 9acd32
"""
NAMED_COLOURS = dict(zip(_NAMES.split()[::2], _NAMES.split()[1::2], strict=True))


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
    digits = NAMED_COLOURS.get(word) or (word[1:] if is_hexadecimal else "")
    if not digits:
        raise InputError(
            f"{label} must be a name of CSS or #rrggbb, got {shown(colour)}{did_you_mean(word, NAMED_COLOURS)}."
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
