"""Shapes of SVG as path data: lines, polygons, rectangles, circles and ellipses besides paths."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from cpmkit.plugin import InputError, shown
from cpmkit_svg.scanner import LARGEST_NUMBER, Scanner

LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?:px)?\s*")


def parse_length(text: str, label: str) -> float:
    """Return a length in the user's unit, a number with or without ``px`` after it.

    Raise InputError, which names ``label``, if it is something else, or larger than numbers of SVG are.
    """
    found = LENGTH.fullmatch(text)
    if found is None or abs(float(found[1])) > LARGEST_NUMBER:
        raise InputError(f"{label} must be a number, or one with px after it, got {shown(text)}.")
    return float(found[1])


def shape_path_data(name: str, attributes: Mapping[str, str], label: str) -> str:
    """Return the path data of an element ``name`` of :data:`SHAPES` with ``attributes``; empty if it has no points.

    Raise InputError, which names ``label``, if an attribute is damaged, or a rectangle has round corners.
    """
    if name == "path":
        return attributes.get("d", "")
    if name in ("polyline", "polygon"):
        return _polyline_path_data(attributes.get("points", ""), name == "polygon", label)

    def of(key: str) -> float:
        return parse_length(attributes.get(key, "0"), f"{key} of {label}")

    return SHAPES_OF_NUMBERS[name](of)


def _polyline_path_data(points: str, closed: bool, label: str) -> str:
    """Return path data of the corners in an attribute ``points``; raise InputError, naming ``label``, if damaged."""
    scanner, numbers = Scanner(points, f"points of {label}"), []
    while not scanner.at_end:
        numbers += scanner.numbers(2)
    return f"M {' '.join(map(repr, numbers))} {'Z' if closed else ''}" if numbers else ""


def _line_path_data(of: Callable[[str], float]) -> str:
    return f"M {of('x1')!r} {of('y1')!r} L {of('x2')!r} {of('y2')!r}"


def _rectangle_path_data(of: Callable[[str], float]) -> str:
    """Return the path data of a rectangle with the numbers ``of(key)``; raise InputError if its corners are round."""
    if of("rx") or of("ry"):
        raise InputError("rectangles with rounded corners are not read; make a path of them.")
    return f"M {of('x')!r} {of('y')!r} h {of('width')!r} v {of('height')!r} h {-of('width')!r} Z"


def _circle_data(of: Callable[[str], float]) -> str:
    return _ellipse_path_data(of("cx"), of("cy"), of("r"), of("r"))


def _ellipse_data(of: Callable[[str], float]) -> str:
    return _ellipse_path_data(of("cx"), of("cy"), of("rx"), of("ry"))


def _ellipse_path_data(x: float, y: float, rx: float, ry: float) -> str:
    """Return the path data of an ellipse about (x, y) with radii rx and ry, of two half arcs."""
    half = f"A {rx!r} {ry!r} 0 0 1"
    return f"M {x + rx!r} {y!r} {half} {x - rx!r} {y!r} {half} {x + rx!r} {y!r} Z"


SHAPES_OF_NUMBERS = {
    "line": _line_path_data,
    "rect": _rectangle_path_data,
    "circle": _circle_data,
    "ellipse": _ellipse_data,
}
#: Elements that draw a curve.
SHAPES = ("path", "polyline", "polygon", *SHAPES_OF_NUMBERS)
