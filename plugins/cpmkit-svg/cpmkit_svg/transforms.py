"""The SVG attribute ``transform`` as an affine map of the plane."""

from __future__ import annotations

import re

import numpy as np

from cpmkit.plugin import Floats, InputError, shown
from cpmkit_svg.scanner import Scanner

ONE_TRANSFORM = re.compile(r"[\s,]*([A-Za-z]+)\s*\(([^()]*)\)")
#: Accepted counts of numbers of each transform.
ACCEPTED = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,)}


def parse_transform(text: str, label: str) -> Floats:
    """Return the affine map (2, 3) of a list of transforms, the last of which acts first: a matrix, then a translation.

    Raise InputError if a transform is not in SVG, or has another count of numbers; ``label`` names the element in the
    message.
    """
    whole, place = np.eye(3), 0
    while text[place:].strip(" \t\r\n,"):
        match = ONE_TRANSFORM.match(text, place)
        if match is None or match[1] not in ACCEPTED:
            raise InputError(
                f"transform of {label} must be a list of {', '.join(ACCEPTED)}, got {shown(text[place:])}."
            )
        scanner, numbers = Scanner(match[2], f"transform of {label}"), []
        while not scanner.at_end:
            numbers += scanner.numbers(1)
        if len(numbers) not in ACCEPTED[match[1]]:
            raise InputError(
                f"transform of {label}: {match[1]} takes {ACCEPTED[match[1]]} numbers, got {len(numbers)}."
            )
        whole, place = whole @ _transform_matrix(match[1], numbers), match.end()
    return whole[:2]


def _transform_matrix(name: str, numbers: list[float]) -> Floats:
    """Return the matrix (3, 3), acting on (x, y, 1), of the SVG transform ``name`` with ``numbers``."""
    a, b, c, d, e, f = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0
    if name == "matrix":
        a, b, c, d, e, f = numbers
    elif name == "translate":
        e, f = (*numbers, 0.0)[:2]
    elif name == "scale":
        a, d = numbers[0], numbers[-1]
    elif name == "rotate":
        cosine, sine = np.cos(np.radians(numbers[0])), np.sin(np.radians(numbers[0]))
        x, y = numbers[1:] or (0.0, 0.0)
        a, b, c, d = cosine, sine, -sine, cosine
        e, f = x - a * x - c * y, y - b * x - d * y
    elif name == "skewX":
        c = np.tan(np.radians(numbers[0]))
    else:
        b = np.tan(np.radians(numbers[0]))
    return np.array([[a, c, e], [b, d, f], [0, 0, 1]])


def compose_maps(outer: Floats, inner: Floats) -> Floats:
    """Return the affine map (2, 3), of matrix and translation, that applies ``inner`` (2, 3) and then ``outer``."""
    return outer[:, :2] @ inner + np.hstack([np.zeros((2, 2)), outer[:, 2:]])
