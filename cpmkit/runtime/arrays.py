"""What comes in at the door: arrays are checked once here and trusted afterwards."""

from __future__ import annotations

import re
from contextlib import suppress
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.protocols import Floats
from cpmkit.runtime.messages import did_you_mean

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
_WORDS = _NAMES.split()
NAMED_COLOURS = dict(zip(_WORDS[::2], _WORDS[1::2], strict=True))
_HEX = re.compile(r"#(?:[0-9a-fA-F]{3}|[0-9a-fA-F]{6})")


def as_colour(given: Any, what: str = "a colour") -> Floats:
    """Return red, green and blue (3,), each from 0 to 1, of sRGB as screens show them.

    Parameters
    ----------
    given : str or three numbers
        A name of CSS, ``"#f80"``, ``"#ff8800"``, or numbers from 0 to 1.
    what : str
        Named in errors.

    Raises
    ------
    InputError
        If it is none of these.

    Examples
    --------
    >>> as_colour("#ff8000").round(2).tolist()
    [1.0, 0.5, 0.0]
    >>> as_colour("navvy")
    Traceback (most recent call last):
    cpmkit.errors.InputError: a colour must be a name of CSS or #rrggbb, got 'navvy' (did you mean 'navy'?).
    """
    if not isinstance(given, str):
        return np.asarray(as_colours([given], what)[0])
    word = given.strip().lower()
    digits = NAMED_COLOURS.get(word) or (word[1:] if _HEX.fullmatch(word) else "")
    if not digits:
        raise InputError(
            f"{what} must be a name of CSS or #rrggbb, got {shown(given)}{did_you_mean(word, NAMED_COLOURS)}."
        )
    pairs = [2 * digit for digit in digits] if len(digits) == 3 else re.findall("..", digits)
    return np.array([int(pair, 16) / 255 for pair in pairs])


def as_colours(given: Any, what: str = "colours") -> Floats:
    """Return colours (k, 3) of numbers from 0 to 1.

    Raises
    ------
    InputError
        If they are of another shape, or a number lies outside.
    """
    colours = as_points(given, 3, what)
    outside = colours[(colours < 0) | (colours > 1)]
    if len(outside):
        raise InputError(f"{what} must be numbers from 0 to 1, got {outside[0]:g}; divide those up to 255 by it.")
    return colours
