"""Compiled: places and normals of samples out of numbers of fixed point."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.fixed_samples import PLACE_UNIT
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def decode(places: Any, patch: Any, cells: Ints, spacing: float, points: Floats) -> None:
    """Fill ``points`` (q, d) with those at ``places`` (q, d) from the nodes of ``cells`` (p, d), by ``patch`` (q,)."""
    for q in range(len(places)):
        for axis in range(places.shape[1]):
            points[q, axis] = spacing * (cells[patch[q], axis] + PLACE_UNIT * places[q, axis])


@compiled
def decode_normals(directions: Any, normals: Floats) -> None:
    """Fill ``normals`` (c, d) with those of a sample, out of its ``directions`` (c, d): orthonormal to rounding."""
    for c in range(normals.shape[0]):
        for i in range(normals.shape[1]):
            normals[c, i] = directions[c, i]
        for other in range(c):
            along = 0.0
            for i in range(normals.shape[1]):
                along += normals[other, i] * normals[c, i]
            for i in range(normals.shape[1]):
                normals[c, i] -= along * normals[other, i]
        square = 0.0
        for i in range(normals.shape[1]):
            square += normals[c, i] * normals[c, i]
        shorter = 1.0 / np.sqrt(square)
        for i in range(normals.shape[1]):
            normals[c, i] *= shorter


@compiled
def decode_all_normals(directions: Any, normals: Floats) -> None:
    """Fill ``normals`` (q, c, d) with those of all samples, out of their ``directions`` (q, c, d)."""
    for q in range(len(normals)):
        decode_normals(directions[q], normals[q])
