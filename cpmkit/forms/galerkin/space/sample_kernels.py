"""Compiled: loads summed over samples, and splines read at them."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.fixed_point import PLACE_UNIT
from cpmkit.forms.galerkin.space.energy_kernels import room_for, value_of
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled, inlined


@inlined
def spline_values(t: float, width: int, values: Floats) -> None:
    """Fill ``values`` (width,) with the splines that a cell reads at t along an axis: 2, 3 or 4 of degree 1, 2 or 3."""
    s = 1.0 - t
    if width == 3:
        values[0], values[1], values[2] = 0.5 * s * s, 0.5 + t * s, 0.5 * t * t
    elif width == 2:
        values[0], values[1] = s, t
    else:
        values[0], values[3] = s * s * s / 6, t * t * t / 6
        values[1], values[2] = 2 / 3 + t * t * (0.5 * t - 1.0), 2 / 3 + s * s * (0.5 * s - 1.0)


@inlined
def spline_slopes(t: float, width: int, slopes: Floats) -> None:
    """Fill ``slopes`` (width,) with their derivatives with respect to t."""
    s = 1.0 - t
    if width == 3:
        slopes[0], slopes[1], slopes[2] = -s, s - t, t
    elif width == 2:
        slopes[0], slopes[1] = -1.0, 1.0
    else:
        slopes[0], slopes[3] = -0.5 * s * s, 0.5 * t * t
        slopes[1], slopes[2] = t * (1.5 * t - 2.0), s * (2.0 - 1.5 * s)


@inlined
def splines_along(width: int, d: int) -> int:
    """Return how many splines an axis a patch reads that reads ``width`` of them."""
    along = 2
    while along**d < width:
        along += 1
    return along


@compiled
def spline_products(place: Any, along: int, values: Floats, products: Floats) -> None:
    """Fill ``products`` (along^d,) with the splines of a patch at a ``place`` (d,) of fixed point in its cell.

    ``values`` (along,) is room for those of one axis.
    """
    size = 1
    products[0] = 1.0
    for axis in range(len(place)):
        spline_values(PLACE_UNIT * place[axis] + 0.5, along, values)
        for i in range(size - 1, -1, -1):
            product, first = products[i], along * i
            for k in range(along):
                products[first + k] = product * values[k]
        size *= along


@compiled
def add_load(
    unknowns: Ints,
    spacing: float,
    splines: Any,
    order: Any,
    start: Ints,
    places: Any,
    weights: Floats,
    f: Floats,
    load: Floats,
) -> None:
    """Add sum w[q] f[q] N_j(y_q) to ``load`` (n, channels), ``f`` (q, channels), or (1, channels) for all.

    ``places`` (q, d): as of `FixedSamples`; ``splines``: as of the kernels of energies.
    """
    kind, width, channels, room = places.shape[1] - 2, unknowns.shape[1], load.shape[1], room_for(splines)
    products, sums, z = np.empty(room), np.empty(room * channels), 0.0
    for p in range(len(unknowns)):
        sums[:] = 0.0
        for s in range(start[p], start[p + 1]):
            q = order[s]
            if weights[q] == 0.0:
                continue
            x, y = PLACE_UNIT * places[q, 0] + 0.5, PLACE_UNIT * places[q, 1] + 0.5
            if kind:
                z = PLACE_UNIT * places[q, 2] + 0.5
            for i in range(room):
                X, Y = value_of(splines, kind, 0, i, x), value_of(splines, kind, 1, i, y)
                products[i] = X * Y * value_of(splines, kind, 2, i, z)
            for channel in range(channels):
                density, own = weights[q] * f[q if len(f) > 1 else 0, channel], sums[channel * room :]
                for i in range(room):
                    own[i] += density * products[i]
        for place in range(width):
            for channel in range(channels):
                load[unknowns[p, place], channel] += sums[channel * room + place]


@compiled
def read_values(unknowns: Ints, patch: Any, places: Any, u: Floats, values: Floats) -> None:
    """Fill ``values`` (q, channels) with those of u (n, channels) at the samples."""
    width = unknowns.shape[1]
    along = splines_along(width, places.shape[1])
    products, own = np.empty(width), np.empty(along)
    for q in range(len(places)):
        p = patch[q]
        spline_products(places[q], along, own, products)
        for channel in range(u.shape[1]):
            total = 0.0
            for place in range(width):
                total += products[place] * u[unknowns[p, place], channel]
            values[q, channel] = total


@inlined
def splines_by_axis(point: Floats, cell: Any, spacing: float, along: int, values: Floats, steps: Floats) -> None:
    """Fill ``values`` and ``steps`` (3, along) with the splines of a cell at a point and their slopes, by axis."""
    for axis in range(len(cell)):
        t = point[axis] / spacing - cell[axis] + 0.5
        spline_values(t, along, values[axis])
        spline_slopes(t, along, steps[axis])


@compiled
def read_slopes(
    unknowns: Ints, cells: Ints, spacing: float, patch: Any, points: Floats, normals: Floats, u: Floats, slopes: Floats
) -> None:
    """Fill ``slopes`` (q, channels, d) with the tangential gradients of u (n, channels) at the samples."""
    d = cells.shape[1]
    along = splines_along(unknowns.shape[1], d)
    depth = along if d == 3 else 1
    values, steps = np.ones((3, along)), np.zeros((3, along))
    own = np.empty(3)
    for q in range(len(points)):
        p = patch[q]
        splines_by_axis(points[q], cells[p], spacing, along, values, steps)
        for channel in range(u.shape[1]):
            own[:] = 0.0
            place = 0
            for i in range(along):
                for j in range(along):
                    both = values[0, i] * values[1, j]
                    first, second = steps[0, i] * values[1, j], values[0, i] * steps[1, j]
                    for k in range(depth):
                        value = u[unknowns[p, place], channel]
                        own[0] += value * first * values[2, k]
                        own[1] += value * second * values[2, k]
                        own[2] += value * both * steps[2, k]
                        place += 1
            own /= spacing
            for c in range(normals.shape[1]):
                across = 0.0
                for axis in range(d):
                    across += normals[q, c, axis] * own[axis]
                for axis in range(d):
                    own[axis] -= across * normals[q, c, axis]
            for axis in range(d):
                slopes[q, channel, axis] = own[axis]


@compiled
def add_slope_load(
    unknowns: Ints, cells: Ints, spacing: float, patch: Any, points: Floats, weighted: Floats, load: Floats
) -> None:
    """Add sum weighted[q] . grad N_j(y_q) to ``load`` (n,), ``weighted`` (q, d) the vectors times their weights."""
    d = cells.shape[1]
    along = splines_along(unknowns.shape[1], d)
    depth = along if d == 3 else 1
    values, steps = np.ones((3, along)), np.zeros((3, along))
    third = 2 if d == 3 else 0
    for q in range(len(points)):
        p = patch[q]
        splines_by_axis(points[q], cells[p], spacing, along, values, steps)
        x, y = weighted[q, 0] / spacing, weighted[q, 1] / spacing
        z = weighted[q, third] / spacing if d == 3 else 0.0
        place = 0
        for i in range(along):
            for j in range(along):
                across = x * steps[0, i] * values[1, j] + y * values[0, i] * steps[1, j]
                both = z * values[0, i] * values[1, j]
                for k in range(depth):
                    load[unknowns[p, place]] += across * values[2, k] + both * steps[2, k]
                    place += 1
