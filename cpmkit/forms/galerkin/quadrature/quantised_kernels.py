"""Compiled: encoding and decoding of the quantised positions and normals of samples, see `QuantisedSamples`."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.samples import NORMAL_UNIT, PLACE_UNIT
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints


@compiled
def decode_places(places: Any, patch: Any, cells: Ints, spacing: float, points: Floats) -> None:
    """Fill ``points`` (q, d) with the positions of samples, relative to the origin of the lattice.

    ``places`` (q, d) are the quantised positions relative to the centres of lattice cells; sample q is in cell
    ``cells[patch[q]]``, with ``cells`` (p, d) and ``patch`` (q,).
    """
    for q in range(len(places)):
        for axis in range(places.shape[1]):
            points[q, axis] = spacing * (cells[patch[q], axis] + PLACE_UNIT * places[q, axis])


@compiled
def encode_normals(normals: Floats, directions: Any) -> None:
    """Fill ``directions`` (q, 1, 2) with quantised ``normals`` (q, 1, 3) of a surface.

    A normal is projected to the octahedron |x| + |y| + |z| = 1, which is unfolded into a square.
    """
    for q in range(len(normals)):
        n = normals[q, 0]
        size = abs(n[0]) + abs(n[1]) + abs(n[2])
        x, y = n[0] / size, n[1] / size
        if n[2] < 0:  # the lower half is folded outwards over the edges of the upper one
            x, y = (1 - abs(y)) * (1.0 if x >= 0 else -1.0), (1 - abs(x)) * (1.0 if y >= 0 else -1.0)
        directions[q, 0, 0], directions[q, 0, 1] = np.rint(x / NORMAL_UNIT), np.rint(y / NORMAL_UNIT)


@compiled
def decode_normals(directions: Any, normals: Floats) -> None:
    """Fill ``normals`` (c, d) with the orthonormal normals of a sample, from its quantised ``directions`` (c, e).

    e is d where directions are components of normals, or 2 where they are positions on an unfolded octahedron.
    """
    codim, d = normals.shape
    for c in range(codim):
        if directions.shape[1] == d:
            for i in range(d):
                normals[c, i] = directions[c, i]
        else:
            x, y = NORMAL_UNIT * directions[c, 0], NORMAL_UNIT * directions[c, 1]
            z = 1 - abs(x) - abs(y)
            if z < 0:
                x, y = (1 - abs(y)) * (1.0 if x >= 0 else -1.0), (1 - abs(x)) * (1.0 if y >= 0 else -1.0)
            normals[c, 0], normals[c, 1], normals[c, 2] = x, y, z
        for other in range(c):
            along = 0.0
            for i in range(d):
                along += normals[other, i] * normals[c, i]
            for i in range(d):
                normals[c, i] -= along * normals[other, i]
        square = 0.0
        for i in range(d):
            square += normals[c, i] * normals[c, i]
        scale = 1.0 / np.sqrt(square)
        for i in range(d):
            normals[c, i] *= scale


@compiled
def decode_all_normals(directions: Any, normals: Floats) -> None:
    """Fill ``normals`` (q, c, d) with the orthonormal normals of samples, from their ``directions`` (q, c, e)."""
    for q in range(len(normals)):
        decode_normals(directions[q], normals[q])
