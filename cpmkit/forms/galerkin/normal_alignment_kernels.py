"""Compiled: integrals of splines and of their products with consistently oriented normals."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.space.quantised_samples import PLACE_UNIT, decode_normals
from cpmkit.forms.galerkin.space.sample_kernels import spline_values
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints


@compiled
def add_oriented_normals(
    unknowns: Ints, patch: Any, splines: Any, samples: tuple[Any, Any, Floats], cell: Any, signs: Floats, sums: Floats
) -> None:
    """Add to ``sums`` (n, 4) the integral of each spline, and of its product with the oriented normal of a surface.

    Parameters
    ----------
    unknowns : (p, width) integers
        The unknowns of each patch.
    patch : (q,) integers
        The patch of each sample; consecutive samples of one patch are accumulated locally before being scattered.
    splines : tuple
        Its length is the number of splines per axis that are not zero in a lattice cell.
    samples : tuple
        The places, directions and weights of `QuantisedSamples`.
    cell : (q,) int32
        The cell of each sample.
    signs : (m,) float64
        Orientation of each cell, by which its normals are multiplied.
    sums : (n, 4) float64
    """
    places, directions, weights = samples
    width, along, last = unknowns.shape[1], len(splines), len(places) - 1
    X, Y, Z, normals = np.empty(along), np.empty(along), np.empty(along), np.empty((1, 3))
    values, of_patch = np.empty(width), np.zeros(4 * width)
    area, first, second = of_patch[:width], of_patch[width : 2 * width], of_patch[2 * width : 3 * width]
    third = of_patch[3 * width :]
    for q in range(len(places)):
        spline_values(PLACE_UNIT * places[q, 0] + 0.5, along, X)
        spline_values(PLACE_UNIT * places[q, 1] + 0.5, along, Y)
        spline_values(PLACE_UNIT * places[q, 2] + 0.5, along, Z)
        at = np.uint64(0)  # unsigned, so that no index is tested for its sign
        for i in range(along):
            for j in range(along):
                both = weights[q] * X[i] * Y[j]
                for k in range(along):
                    values[at] = both * Z[k]
                    at += np.uint64(1)
        decode_normals(directions[q], normals)
        sign = signs[cell[q]]
        x, y, z = sign * normals[0, 0], sign * normals[0, 1], sign * normals[0, 2]
        for place in range(width):
            area[place] += values[place]
            first[place] += x * values[place]
            second[place] += y * values[place]
            third[place] += z * values[place]
        p = patch[q]
        if q < last and patch[q + 1] == p:
            continue
        for place in range(width):
            for channel in range(4):
                sums[unknowns[p, place], channel] += of_patch[channel * width + place]
        of_patch[:] = 0.0
