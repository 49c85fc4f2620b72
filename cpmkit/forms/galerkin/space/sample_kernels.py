"""Compiled: loads summed over samples, and splines read at them."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.fixed_point import PLACE_UNIT
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def spline_products(place: Any, products: Floats) -> None:
    """Fill ``products`` (3^d,) with the splines of a patch at a ``place`` (d,) of fixed point in its cell."""
    d = len(place)
    size = 1
    products[0] = 1.0
    for axis in range(d):
        t = PLACE_UNIT * place[axis] + 0.5
        s = 1.0 - t
        left, middle, right = 0.5 * s * s, 0.5 + t * s, 0.5 * t * t
        for i in range(size - 1, -1, -1):
            value = products[i]
            products[3 * i] = value * left
            products[3 * i + 1] = value * middle
            products[3 * i + 2] = value * right
        size *= 3


@compiled
def add_load(
    unknowns: Ints,
    patch: Any,
    places: Any,
    weights: Floats,
    f: Floats,
    load: Floats,
) -> None:
    """Add sum w[q] f[q] N_j(y_q) to ``load`` (n, channels), ``f`` (q, channels), or (1, channels) for all.

    ``places`` (q, d): as of `FixedSamples`. What follows each other in one ``patch`` (q,) is summed there first.
    """
    width, channels = unknowns.shape[1], load.shape[1]
    products, sums = np.empty(width), np.zeros(width * channels)
    for q in range(len(places)):
        spline_products(places[q], products)
        for channel in range(channels):
            density, first = weights[q] * f[q if len(f) > 1 else 0, channel], np.uint64(channel * width)
            for place in range(np.uint64(width)):  # unsigned, so that no index is tested for its sign
                sums[first + place] += products[place] * density
        if q + 1 < len(places) and patch[q + 1] == patch[q]:
            continue
        for place in range(width):
            for channel in range(channels):
                load[unknowns[patch[q], place], channel] += sums[channel * width + place]
        sums[:] = 0.0


@compiled
def read_values(unknowns: Ints, patch: Any, places: Any, u: Floats, values: Floats) -> None:
    """Fill ``values`` (q, channels) with those of u (n, channels) at the samples."""
    width = unknowns.shape[1]
    products = np.empty(width)
    for q in range(len(places)):
        p = patch[q]
        spline_products(places[q], products)
        for channel in range(u.shape[1]):
            total = 0.0
            for place in range(width):
                total += products[place] * u[unknowns[p, place], channel]
            values[q, channel] = total


@compiled
def read_slopes(
    unknowns: Ints, cells: Ints, spacing: float, patch: Any, points: Floats, normals: Floats, u: Floats, slopes: Floats
) -> None:
    """Fill ``slopes`` (q, channels, d) with the tangential gradients of u (n, channels) at the samples."""
    d, width = cells.shape[1], unknowns.shape[1]
    values, steps = np.empty((3, 3)), np.empty((3, 3))
    values[:], steps[:] = 1.0, 0.0
    own = np.empty(3)
    for q in range(len(points)):
        p = patch[q]
        for axis in range(d):
            t = points[q, axis] / spacing - cells[p, axis] + 0.5
            s = 1.0 - t
            values[axis, 0], values[axis, 1], values[axis, 2] = 0.5 * s * s, 0.5 + t * s, 0.5 * t * t
            steps[axis, 0], steps[axis, 1], steps[axis, 2] = -s / spacing, (s - t) / spacing, t / spacing
        for channel in range(u.shape[1]):
            own[:] = 0.0
            for place in range(width):
                value = u[unknowns[p, place], channel]
                for axis in range(d):
                    product, rest = value, place
                    for other in range(d - 1, -1, -1):
                        product *= (steps if other == axis else values)[other, rest % 3]
                        rest //= 3
                    own[axis] += product
            for c in range(normals.shape[1]):
                along = 0.0
                for axis in range(d):
                    along += normals[q, c, axis] * own[axis]
                for axis in range(d):
                    own[axis] -= along * normals[q, c, axis]
            for axis in range(d):
                slopes[q, channel, axis] = own[axis]
