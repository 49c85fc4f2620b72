"""The attribute transform of SVG as affine maps of the plane."""

from __future__ import annotations

import re

import numpy as np

from cpmkit.plugin import Floats, InputError, shown
from cpmkit_svg.scanner import Scanner

ONE_TRANSFORM = re.compile(r"[\s,]*([A-Za-z]+)\s*\(([^()]*)\)")
#: How many numbers each takes.
ACCEPTED = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,)}


def transform(text: str, what: str) -> Floats:
    """Return the affine map (2, 3) of a list of transforms, the last of which acts first.

    Raises
    ------
    InputError
        If a transform is none of SVG, or has another count of numbers; ``what`` names it.
    """
    whole, place = np.eye(3), 0
    while text[place:].strip(" \t\r\n,"):
        found = ONE_TRANSFORM.match(text, place)
        if found is None or found[1] not in ACCEPTED:
            raise InputError(f"transform of {what} must be a list of {', '.join(ACCEPTED)}, got {shown(text[place:])}.")
        scanner, numbers = Scanner(found[2], f"transform of {what}"), []
        while not scanner.ended:
            numbers += scanner.numbers(1)
        if len(numbers) not in ACCEPTED[found[1]]:
            raise InputError(f"transform of {what}: {found[1]} takes {ACCEPTED[found[1]]} numbers, got {len(numbers)}.")
        whole, place = whole @ _matrix(found[1], numbers), found.end()
    return whole[:2]


def _matrix(name: str, given: list[float]) -> Floats:
    a, b, c, d, e, f = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0
    if name == "matrix":
        a, b, c, d, e, f = given
    elif name == "translate":
        e, f = (*given, 0.0)[:2]
    elif name == "scale":
        a, d = given[0], given[-1]
    elif name == "rotate":
        cosine, sine = np.cos(np.radians(given[0])), np.sin(np.radians(given[0]))
        x, y = given[1:] or (0.0, 0.0)
        a, b, c, d = cosine, sine, -sine, cosine
        e, f = x - a * x - c * y, y - b * x - d * y
    elif name == "skewX":
        c = np.tan(np.radians(given[0]))
    else:
        b = np.tan(np.radians(given[0]))
    return np.array([[a, c, e], [b, d, f], [0, 0, 1]])


def combined(outer: Floats, inner: Floats) -> Floats:
    """Return the map (2, 3) that applies ``inner`` (2, 3) and then ``outer``."""
    return outer[:, :2] @ inner + np.hstack([np.zeros((2, 2)), outer[:, 2:]])
