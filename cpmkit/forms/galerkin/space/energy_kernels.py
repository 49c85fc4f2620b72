"""Compiled: energies summed over samples, patch by patch, straight into the rows of a sparse matrix.

The plane is treated as a space one node deep. Inside a patch all is measured in spacings. A sample adds products of
linear forms in the coefficients: of the slopes along the axes with what its tensor makes of them, of the second
derivatives along normals, of the value.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled

#: Linear forms that are gathered before their products are added; at most eight belong to one sample.
GATHERED = 64
#: The unknowns of a patch, 27, and room to have rows of whole vectors of four.
ROOM = 28


@compiled
def splines_at(point: Floats, cell: Ints, spacing: float, f: Floats) -> None:
    """Fill ``f`` (3, 3, 3): value, slope and second derivative; axis; node of the splines at a point."""
    f[0, 2], f[1, 2], f[2, 2] = 1.0, 0.0, 0.0
    for axis in range(len(cell)):
        t = point[axis] / spacing - cell[axis] + 0.5
        s = 1.0 - t
        f[0, axis, 0], f[0, axis, 1], f[0, axis, 2] = 0.5 * s * s, 0.5 + t * s, 0.5 * t * t
        f[1, axis, 0], f[1, axis, 1], f[1, axis, 2] = -s, s - t, t
        f[2, axis, 0], f[2, axis, 1], f[2, axis, 2] = 1.0, -2.0, 1.0


@compiled
def tensor_at(q: int, normals: Floats, a: Floats, tensors: Floats, e1: float, C: Floats) -> None:
    """Fill ``C`` (3, 3): the coefficient between tangents, and e1 times a between normals."""
    codim, d = normals.shape[1:]
    for i in range(d):
        for j in range(d):
            along = 0.0
            for c in range(codim):
                along += normals[q, c, i] * normals[q, c, j]
            C[i, j] = (i == j) - along
    if len(tensors):
        P = C[:d, :d].copy()
        for i in range(d):
            for j in range(d):
                total = 0.0
                for k in range(d):
                    for m in range(d):
                        total += P[i, k] * tensors[q, k, m] * P[m, j]
                C[i, j] = total + e1 * a[q] * ((i == j) - P[i, j])
        return
    for i in range(d):
        for j in range(d):
            C[i, j] = a[q] * (C[i, j] + e1 * ((i == j) - C[i, j]))


@compiled
def slope_forms(f: Floats, C: Floats, weight: float, d: int, left: Floats, right: Floats) -> None:
    """Fill d rows: the slopes along the axes, and what the tensor makes of them times the weight."""
    depth = 3 if d == 3 else 1
    place = 0
    for i in range(3):
        for j in range(3):
            value = f[0, 0, i] * f[0, 1, j]
            along_x, along_y = f[1, 0, i] * f[0, 1, j], f[0, 0, i] * f[1, 1, j]
            for k in range(depth):
                x, y, z = along_x, along_y, 0.0
                if d == 3:
                    x, y, z = x * f[0, 2, k], y * f[0, 2, k], value * f[1, 2, k]
                    left[2, place] = z
                    right[2, place] = weight * (C[2, 0] * x + C[2, 1] * y + C[2, 2] * z)
                left[0, place], left[1, place] = x, y
                right[0, place] = weight * (C[0, 0] * x + C[0, 1] * y + C[0, 2] * z)
                right[1, place] = weight * (C[1, 0] * x + C[1, 1] * y + C[1, 2] * z)
                place += 1


@compiled
def second_form(f: Floats, nx: float, ny: float, nz: float, weight: float, d: int, left: Floats, right: Floats) -> None:
    """Fill a row: the second derivative along (nx, ny, nz), and it times the weight."""
    depth = 3 if d == 3 else 1
    place = 0
    for i in range(3):
        for j in range(3):
            value = nz * nz * f[0, 0, i] * f[0, 1, j]
            slope = 2.0 * nz * (nx * f[1, 0, i] * f[0, 1, j] + ny * f[0, 0, i] * f[1, 1, j])
            second = nx * nx * f[2, 0, i] * f[0, 1, j] + ny * ny * f[0, 0, i] * f[2, 1, j]
            second += 2.0 * nx * ny * f[1, 0, i] * f[1, 1, j]
            for k in range(depth):
                form = second
                if d == 3:
                    form = second * f[0, 2, k] + slope * f[1, 2, k] + value * f[2, 2, k]
                left[place], right[place] = form, weight * form
                place += 1


@compiled
def value_form(f: Floats, weight: float, d: int, left: Floats, right: Floats) -> None:
    """Fill a row: the value, and it times the weight."""
    depth = 3 if d == 3 else 1
    place = 0
    for i in range(3):
        for j in range(3):
            for k in range(depth):
                form = f[0, 0, i] * f[0, 1, j]
                if d == 3:
                    form *= f[0, 2, k]
                left[place], right[place] = form, weight * form
                place += 1


@compiled
def add_products(left: Floats, right: Floats, rows: int, width: int, block: Floats) -> None:
    """Add to the upper half of ``block`` the products of the first ``rows`` forms."""
    for i in range(width):
        for r in range(rows):
            factor = left[r, i]
            for j in range(i, width):
                block[i, j] += factor * right[r, j]


@compiled
def scatter(block: Floats, columns: Ints, indptr: Any, indices: Any, data: Floats) -> None:
    """Add the upper half of a symmetric ``block`` of the unknowns ``columns``, and its mirror image, to a matrix."""
    width = len(columns)
    rank = np.argsort(columns)
    for i in range(width):
        at = indptr[columns[i]]
        for m in range(width):
            j = rank[m]
            while indices[at] < columns[j]:
                at += 1
            data[at] += block[i, j] if i <= j else block[j, i]


@compiled
def add_energy(
    unknowns: Ints,
    cells: Ints,
    spacing: float,
    order: Ints,
    start: Ints,
    points: Floats,
    weights: Floats,
    normals: Floats,
    a: Floats,
    tensors: Floats,
    c: Floats,
    e1: float,
    e2: float,
    matrix: Any,
) -> None:
    """Add sum w [grad u' A grad u + e1 a |normal part|^2 + e2 h^2 a (n' H n)^2 + c u^2] to ``matrix``.

    ``a`` (q,), or empty for no energy of slopes; ``tensors`` (q, d, d), or empty where A is a times the identity;
    ``c`` (q,), or empty; ``matrix``: (indptr, indices, data).
    """
    indptr, indices, data = matrix
    codim, d = normals.shape[1:]
    width = unknowns.shape[1]
    f, C = np.zeros((3, 3, 3)), np.zeros((3, 3))
    left, right, block = np.zeros((GATHERED, ROOM)), np.zeros((GATHERED, ROOM)), np.zeros((ROOM, ROOM))
    for p in range(len(cells)):
        block[:] = 0.0
        rows = 0
        for s in range(start[p], start[p + 1]):
            q = order[s]
            if weights[q] == 0.0:
                continue
            if rows + 8 > GATHERED:
                add_products(left, right, rows, width, block)
                rows = 0
            splines_at(points[q], cells[p], spacing, f)
            if len(c):
                value_form(f, weights[q] * c[q], d, left[rows], right[rows])
                rows += 1
            if len(a) == 0:
                continue
            weight = weights[q] / spacing**2
            tensor_at(q, normals, a, tensors, e1, C)
            slope_forms(f, C, weight, d, left[rows : rows + d], right[rows : rows + d])
            rows += d
            weight *= e2 * a[q]
            for one in range(codim):
                for two in range(one, codim):
                    share = 1.0 if one == two else np.sqrt(0.5)
                    other = 0.0 if one == two else share
                    nx = share * normals[q, one, 0] + other * normals[q, two, 0]
                    ny = share * normals[q, one, 1] + other * normals[q, two, 1]
                    nz = share * normals[q, one, 2] + other * normals[q, two, 2] if d == 3 else 0.0
                    second_form(f, nx, ny, nz, weight, d, left[rows], right[rows])
                    rows += 1
        add_products(left, right, rows, width, block)
        scatter(block, unknowns[p], indptr, indices, data)


@compiled
def add_squares(runs: Ints, stencil: Floats, factors: Floats, matrix: Any) -> None:
    """Add the squares of differences: ``factors`` (r,) times (stencil . u[runs])^2 with ``runs`` (r, k)."""
    indptr, indices, data = matrix
    for r in range(len(runs)):
        for one in range(len(stencil)):
            i = runs[r, one]
            for two in range(len(stencil)):
                j = runs[r, two]
                low, high = indptr[i], indptr[i + 1]
                while low < high:
                    middle = (low + high) // 2
                    if indices[middle] < j:
                        low = middle + 1
                    else:
                        high = middle
                data[low] += factors[r] * (stencil[one] * stencil[two])


@compiled
def add_load(
    unknowns: Ints,
    cells: Ints,
    spacing: float,
    order: Ints,
    start: Ints,
    points: Floats,
    densities: Floats,
    load: Floats,
) -> None:
    """Add sum densities[q] N_j(y_q) to ``load`` (n, channels); ``densities`` (q, channels) hold the weights."""
    width, d = unknowns.shape[1], cells.shape[1]
    f, left, right = np.zeros((3, 3, 3)), np.zeros(ROOM), np.zeros(ROOM)
    for p in range(len(cells)):
        for s in range(start[p], start[p + 1]):
            q = order[s]
            splines_at(points[q], cells[p], spacing, f)
            value_form(f, 1.0, d, left, right)
            for place in range(width):
                for channel in range(load.shape[1]):
                    load[unknowns[p, place], channel] += left[place] * densities[q, channel]


@compiled
def read_values(
    unknowns: Ints, cells: Ints, spacing: float, patch: Ints, points: Floats, u: Floats, values: Floats
) -> None:
    """Fill ``values`` (q, channels) with those of u (n, channels) at the samples."""
    width, d = unknowns.shape[1], cells.shape[1]
    f, left, right = np.zeros((3, 3, 3)), np.zeros(ROOM), np.zeros(ROOM)
    for q in range(len(points)):
        p = patch[q]
        splines_at(points[q], cells[p], spacing, f)
        value_form(f, 1.0, d, left, right)
        for channel in range(u.shape[1]):
            total = 0.0
            for place in range(width):
                total += left[place] * u[unknowns[p, place], channel]
            values[q, channel] = total
