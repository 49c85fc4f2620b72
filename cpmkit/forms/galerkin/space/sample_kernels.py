"""Kernels: loads summed over samples, and values and gradients of splines at samples.

A patch is a connected part of the manifold in one lattice cell, on which (degree + 1)^d splines are not zero: it reads
their coefficients, the unknowns.

Tuples ``splines`` and ``third`` have the lengths of the numbers of splines that a patch reads along each of the first
two axes and along the third, 1 in the plane: the compiler knows these lengths, and the entries are unused.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.options import DEGREES
from cpmkit.forms.galerkin.space.quantised_samples import PLACE_UNIT, decode_normals
from cpmkit.forms.galerkin.space.spline_space import spline_pieces
from cpmkit.runtime.compilation import compiled, inlined
from cpmkit.types import Floats, Ints

#: By degree a tuple whose length is the number of splines that a cell reads along an axis: a constant for the compiler.
SPLINES = {degree: (0,) * (degree + 1) for degree in DEGREES}


def _pieces() -> Floats:
    """Return the polynomials in t (3, 2, 4, 4) of the splines that a cell reads along an axis, and of their slopes.

    The axes are: the degree less 1; the order of the derivative; the coefficients, that of 1 first; the spline.
    """
    table = np.zeros((len(DEGREES), 2, 4, 4))
    for degree in DEGREES:
        for order in range(2):
            own = np.polynomial.polynomial.polyder(spline_pieces(degree).T, order)
            table[degree - 1, order, : len(own), : degree + 1] = own
    return table


def _polynomials() -> Floats:
    """Return a row (76, 64) of coefficients for each degree, factor, order of the derivative, and power of t.

    Columns are the splines that a cell reads. Factors are those along the three axes in space, of which the last two
    are those of the plane, and then 1, the third factor in the plane. Powers and orders ascend, the latter up to the
    degree. So few rows because each kernel that reads the table contains it, and is compiled with it.
    """
    rows = []
    for degree in DEGREES:
        width = degree + 1
        digits = np.indices((width,) * 3).reshape(3, -1)
        for factor in range(4):
            for order in range(width):
                own = np.zeros((width - order, 64))
                if factor < 3:
                    pieces = np.polynomial.polynomial.polyder(spline_pieces(degree).T, order)
                    own[:, : width**3] = pieces[:, digits[factor]]
                elif order == 0:
                    own[0, : width**2] = 1.0
                rows.append(own)
    return np.concatenate(rows)


#: Constants of the kernels: the compiler knows that no store changes them, and vectorises loops over them.
PIECES, POLYNOMIALS = _pieces(), _polynomials()


@inlined
def splines_read(splines: Any) -> int:
    """Return the number of splines that a cell in space reads, a constant for the compiler: len(``splines``) cubed."""
    return len(splines) ** 3


@inlined
def row_length(splines: Any) -> int:
    """Return the length of a row of forms: the splines that a cell in space reads, up to a multiple of four."""
    return (len(splines) ** 3 + 3) // 4 * 4


@inlined
def derivatives_of(
    splines: Any, kind: int, order: int, i: int, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the derivatives of ``order`` 0 to 3 at (x, y, z) of the three factors of spline ``i`` of a cell.

    x, y and z in [0, 1] are coordinates in the cell, and derivatives are by them; ``kind`` is 0 in the plane and 1 in
    space; the length of the tuple ``splines`` is the degree plus one.
    """
    width = len(splines)
    if order >= width:
        return 0.0, 0.0, 0.0
    each, last = width * (width + 1) // 2, width - 1 - order
    first = 4 * ((width - 1) * each // 3 - 1) + (1 - kind) * each + order * width - order * (order - 1) // 2
    second, third = first + each, first + 2 * each
    X, Y, Z = POLYNOMIALS[first + last, i], POLYNOMIALS[second + last, i], POLYNOMIALS[third + last, i]
    for k in range(last - 1, -1, -1):
        X = POLYNOMIALS[first + k, i] + x * X
        Y = POLYNOMIALS[second + k, i] + y * Y
        Z = POLYNOMIALS[third + k, i] + z * Z
    return X, Y, Z


@inlined
def fill_spline_values(t: float, width: int, values: Floats) -> None:
    """Fill ``values`` (width,) with the values at ``t`` of the splines of degree width - 1 on a cell, along an axis."""
    T = PIECES[width - 2, 0]
    for i in range(width):
        values[i] = T[0, i] + t * (T[1, i] + t * (T[2, i] + t * T[3, i]))


@inlined
def fill_spline_slopes(t: float, width: int, slopes: Floats) -> None:
    """Fill ``slopes`` (width,) with the derivatives at ``t`` of the splines of degree width - 1 on a cell."""
    T = PIECES[width - 2, 1]
    for i in range(width):
        slopes[i] = T[0, i] + t * (T[1, i] + t * T[2, i])


@inlined
def gather_coefficients(unknowns: Ints, u: Floats, of_patch: Floats) -> None:
    """Fill ``of_patch`` (channels w,), by channel, with the rows ``unknowns`` (w,) of a patch in ``u``."""
    width = len(unknowns)
    for channel in range(u.shape[1]):
        for place in range(width):
            of_patch[channel * width + place] = u[unknowns[place], channel]


@compiled
def add_load(
    unknowns: Ints, patch: Any, splines: Any, third: Any, places: Any, weights: Floats, f: Floats, load: Floats
) -> None:
    """Add sum_q weights[q] f[q] N_j(y_q) to each row j of ``load`` (n, channels), for the splines N_j.

    ``f`` is (q, channels), or (1, channels) where it is constant; ``places`` (q, d) are those of `QuantisedSamples`.
    Consecutive samples in the same ``patch`` (q,), which reads ``unknowns`` (p, w), are summed before they are added.
    ``splines`` and ``third`` have the lengths of the numbers of splines along the first two axes and the third.
    """
    width, channels, last = unknowns.shape[1], load.shape[1], len(places) - 1
    along, depth = len(splines), len(third)
    X, Y, Z = np.empty(along), np.empty(along), np.empty(depth)
    values, sums = np.empty(width), np.empty((channels, width))
    Z[0], sums[:] = 1.0, 0.0
    for q in range(len(places)):
        fill_spline_values(PLACE_UNIT * places[q, 0] + 0.5, along, X)
        fill_spline_values(PLACE_UNIT * places[q, 1] + 0.5, along, Y)
        if depth > 1:
            fill_spline_values(PLACE_UNIT * places[q, 2] + 0.5, depth, Z)
        at = np.uint64(0)  # unsigned, so that no index is tested for its sign
        for i in range(along):
            for j in range(along):
                both = weights[q] * X[i] * Y[j]
                for k in range(depth):
                    values[at] = both * Z[k]
                    at += np.uint64(1)
        for channel in range(channels):
            density = f[q if len(f) > 1 else 0, channel]
            for place in range(width):
                sums[channel, place] += density * values[place]
        p = patch[q]
        if q < last and patch[q + 1] == p:
            continue
        for place in range(width):
            for channel in range(channels):
                load[unknowns[p, place], channel] += sums[channel, place]
        sums[:] = 0.0


@compiled
def fill_values(unknowns: Ints, patch: Any, splines: Any, third: Any, places: Any, u: Floats, values: Floats) -> None:
    """Fill ``values`` (q, channels) with those of the splines with coefficients ``u`` (n, channels) at samples.

    The other arguments are those of :func:`add_load`.
    """
    channels = u.shape[1]
    along, depth = len(splines), len(third)
    X, Y, Z = np.empty(along), np.empty(along), np.empty(depth)
    Z[0] = 1.0
    of_patch = np.empty(channels * along * along * depth)
    last = -1
    for q in range(len(places)):
        p = patch[q]
        if p != last:
            last = p
            gather_coefficients(unknowns[p], u, of_patch)
        fill_spline_values(PLACE_UNIT * places[q, 0] + 0.5, along, X)
        fill_spline_values(PLACE_UNIT * places[q, 1] + 0.5, along, Y)
        if depth > 1:
            fill_spline_values(PLACE_UNIT * places[q, 2] + 0.5, depth, Z)
        at = np.uint64(0)
        for channel in range(channels):
            total = 0.0
            for i in range(along):
                layer = 0.0
                for j in range(along):
                    line = 0.0
                    for k in range(depth):
                        line += of_patch[at] * Z[k]
                        at += np.uint64(1)
                    layer += Y[j] * line
                total += X[i] * layer
            values[q, channel] = total


@inlined
def fill_splines_at_place(place: Any, along: int, depth: int, values: Floats, steps: Floats) -> None:
    """Fill ``values`` and ``steps`` (3, along), for each axis, with the splines at a sample and their slopes.

    ``place`` (d,) is that of the sample in `QuantisedSamples`. Slopes are derivatives with respect to coordinates in
    spacings. In the plane, where ``depth`` is 1, the third rows are left as they are.
    """
    for axis in range(3 if depth > 1 else 2):
        t = PLACE_UNIT * place[axis] + 0.5
        fill_spline_values(t, along, values[axis])
        fill_spline_slopes(t, along, steps[axis])


@inlined
def make_tangential(normals: Floats, vector: Floats) -> None:
    """Subtract from ``vector`` (3,), in place, its components along orthonormal ``normals`` (c, d)."""
    for c in range(normals.shape[0]):
        across = 0.0
        for axis in range(normals.shape[1]):
            across += normals[c, axis] * vector[axis]
        for axis in range(normals.shape[1]):
            vector[axis] -= across * normals[c, axis]


@compiled
def fill_gradients(
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
    """Fill ``slopes`` (q, channels, d) with the tangential gradients at samples.

    ``u`` (n, channels) are coefficients of splines; ``directions`` are those of `QuantisedSamples`, the other arguments
    those of :func:`add_load`. ``spacing`` is h.
    """
    channels, d = u.shape[1], places.shape[1]
    along, depth = len(splines), len(third)
    values, steps = np.empty((3, along)), np.empty((3, along))
    values[:], steps[:] = 1.0, 0.0
    X, Y, Z, dX, dY, dZ = values[0], values[1], values[2], steps[0], steps[1], steps[2]
    normals, own = np.empty((directions.shape[1], d)), np.empty(3)
    own[:] = 0.0
    of_patch = np.empty(channels * along * along * depth)
    last = -1
    for q in range(len(slopes)):
        p = patch[q]
        if p != last:
            last = p
            gather_coefficients(unknowns[p], u, of_patch)
        fill_splines_at_place(places[q], along, depth, values, steps)
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
def add_gradient_load(
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
    """Add sum_q weights[q] field[q] . grad N_j(y_q) over the first samples to ``load`` (n,), for the splines N_j.

    Only the tangential part of ``field`` (q, d) is used; the other arguments are those of :func:`fill_gradients`.
    """
    width, d, last = unknowns.shape[1], places.shape[1], len(field) - 1
    along, depth = len(splines), len(third)
    values, steps = np.empty((3, along)), np.empty((3, along))
    values[:], steps[:] = 1.0, 0.0
    X, Y, Z, dX, dY, dZ = values[0], values[1], values[2], steps[0], steps[1], steps[2]
    normals, own = np.empty((directions.shape[1], d)), np.empty(3)
    own[:] = 0.0
    sums = np.empty(along * along * depth)
    sums[:] = 0.0
    for q in range(len(field)):
        fill_splines_at_place(places[q], along, depth, values, steps)
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
