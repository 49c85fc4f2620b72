"""Points and vertices in place of a boundary's source: arrays of points, and numbers of the surface's vertices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.manifold.given_vertices import vertex_numbers
from cpmkit.plugins import source
from cpmkit.protocols import ClosestPointSource, Ints

#: The kind that is made of them.
POINTS_KIND = "points"


@dataclass(frozen=True, eq=False)
class VertexNumbers:
    """Numbers (k,) of vertices of a surface that is not known yet."""

    numbers: Ints


def given_boundary(given: Any) -> Any:
    """Return the source of points (k, d) or of one point, or the numbers of vertices; anything else as it is.

    One whole number, and whole numbers in one row, are numbers of vertices.
    """
    if isinstance(given, (ClosestPointSource, str, bytes, bool)) or callable(given):
        return given
    numbers = vertex_numbers(given)
    if numbers is not None:
        return VertexNumbers(numbers)
    try:
        array = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        return given
    is_point = array.ndim == 1 and len(array) in (2, 3)
    return source(POINTS_KIND, at=np.atleast_2d(array)) if is_point or array.ndim == 2 else given
