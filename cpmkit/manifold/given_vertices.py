"""Vertices of a mesh given by their numbers, in place of points."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.protocols import Floats, HasGivenMesh, Ints


def vertex_numbers(given: Any) -> Ints | None:
    """Return whole numbers given alone or in one row, as an array (k,); None for anything else."""
    if isinstance(given, (str, bytes, bool)) or not (isinstance(given, (int, np.integer)) or hasattr(given, "__len__")):
        return None
    try:
        array = np.asarray(given)
    except ValueError:
        return None
    return np.atleast_1d(array) if array.dtype.kind in "iu" and array.ndim < 2 and array.size else None


def vertices_of(surface: Any, numbers: Ints, what: str) -> Floats:
    """Return the vertices (k, d) of a surface that was made from a mesh, by their numbers.

    Raises
    ------
    SceneError
        If it was not, a number is not among its vertices, or the numbers may be the coordinates of a point.
    """
    dim = int(surface.dim)
    if not isinstance(surface, HasGivenMesh):
        raise SceneError(
            f"{what} is {shown(numbers.tolist())}, numbers of vertices, and the surface is no mesh; give points (k, "
            f"{dim})."
        )
    if len(numbers) == dim:
        text = shown(numbers.tolist())
        raise SceneError(
            f"{what} is {text}, which may be a point or {len(numbers)} numbers of vertices; give [{text}] for the "
            f"point, or vertices[{text}]."
        )
    vertices = surface.given_mesh[0]
    bad = np.flatnonzero((numbers < 0) | (numbers >= len(vertices)))
    if len(bad):
        raise SceneError(f"{what} must name vertices from 0 to {len(vertices) - 1}, got {shown(int(numbers[bad[0]]))}.")
    return np.asarray(vertices[numbers], dtype=np.float64)
