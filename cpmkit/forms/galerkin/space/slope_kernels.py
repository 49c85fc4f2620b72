"""Compiled: gradients of splines at all samples, and vectors there summed against gradients of splines.

Samples are taken as `FixedSamples` holds them, places and normals in numbers of fixed point: nothing of their size is
made. What follows each other in one patch shares its coefficients, or its sums.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.fixed_kernels import decode_normals
from cpmkit.forms.galerkin.fixed_point import PLACE_UNIT
from cpmkit.forms.galerkin.space.sample_kernels import gather, spline_slopes, spline_values
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled, inlined


@inlined
def splines_by_place(place: Any, along: int, depth: int, values: Floats, steps: Floats) -> None:
    """Fill ``values`` and ``steps`` (3, along) with the splines of a cell at a place and their slopes, by axis."""
    for axis in range(3 if depth > 1 else 2):
        t = PLACE_UNIT * place[axis] + 0.5
        spline_values(t, along, values[axis])
        spline_slopes(t, along, steps[axis])


@inlined
def make_tangential(normals: Floats, vector: Floats) -> None:
    """Take the part along ``normals`` (c, d), orthonormal, out of a ``vector`` (3,)."""
    for c in range(normals.shape[0]):
        across = 0.0
        for axis in range(normals.shape[1]):
            across += normals[c, axis] * vector[axis]
        for axis in range(normals.shape[1]):
            vector[axis] -= across * normals[c, axis]


@compiled
def read_slopes_at_samples(
    unknowns: Ints,
    spacing: float,
    patch: Any,
    splines: Any,
    third: Any,
    places: Any,
    directions: Any,
    u: Floats,
    slopes: Floats,
) -> None:
    """Fill ``slopes`` (q, channels, d) with the tangential gradients of u (n, channels) at the first q samples.

    ``splines`` and ``third``: as of `add_load`.
    """
    channels, d = u.shape[1], places.shape[1]
    along, depth = len(splines), len(third)
    values, steps = np.ones((3, along)), np.zeros((3, along))
    X, Y, Z, dX, dY, dZ = values[0], values[1], values[2], steps[0], steps[1], steps[2]
    normals, own = np.empty((directions.shape[1], d)), np.zeros(3)
    of_patch = np.empty(channels * along * along * depth)
    last = -1
    for q in range(len(slopes)):
        p = patch[q]
        if p != last:
            last = p
            gather(unknowns[p], u, of_patch)
        splines_by_place(places[q], along, depth, values, steps)
        decode_normals(directions[q], normals)
        at = np.uint64(0)  # unsigned, so that no index is tested for its sign
        for channel in range(channels):
            own[:] = 0.0
            for i in range(along):
                still, along_y, along_z = 0.0, 0.0, 0.0
                for j in range(along):
                    line, step = 0.0, 0.0
                    for k in range(depth):
                        line += of_patch[at] * Z[k]
                        step += of_patch[at] * dZ[k]
                        at += np.uint64(1)
                    still += Y[j] * line
                    along_y += dY[j] * line
                    along_z += Y[j] * step
                own[0] += dX[i] * still
                own[1] += X[i] * along_y
                own[2] += X[i] * along_z
            own /= spacing
            make_tangential(normals, own)
            for axis in range(d):
                slopes[q, channel, axis] = own[axis]


@compiled
def add_slope_load_of_samples(
    unknowns: Ints,
    spacing: float,
    patch: Any,
    splines: Any,
    third: Any,
    places: Any,
    directions: Any,
    weights: Floats,
    field: Floats,
    load: Floats,
) -> None:
    """Add sum w[q] field[q] . grad N_j(y_q) over the first samples to ``load`` (n,), of ``field`` (q, d) as tangential.

    ``splines`` and ``third``: as of `add_load`.
    """
    width, d, last = unknowns.shape[1], places.shape[1], len(field) - 1
    along, depth = len(splines), len(third)
    values, steps = np.ones((3, along)), np.zeros((3, along))
    X, Y, Z, dX, dY, dZ = values[0], values[1], values[2], steps[0], steps[1], steps[2]
    normals, own = np.empty((directions.shape[1], d)), np.zeros(3)
    sums = np.zeros(along * along * depth)
    for q in range(len(field)):
        splines_by_place(places[q], along, depth, values, steps)
        decode_normals(directions[q], normals)
        for axis in range(d):
            own[axis] = field[q, axis]
        make_tangential(normals, own)
        own *= weights[q] / spacing
        at = np.uint64(0)
        for i in range(along):
            for j in range(along):
                across = own[0] * dX[i] * Y[j] + own[1] * X[i] * dY[j]
                both = own[2] * X[i] * Y[j]
                for k in range(depth):
                    sums[at] += across * Z[k] + both * dZ[k]
                    at += np.uint64(1)
        p = patch[q]
        if q < last and patch[q + 1] == p:
            continue
        for place in range(width):
            load[unknowns[p, place]] += sums[place]
        sums[:] = 0.0
