"""Compiled: energies summed over samples, patch by patch, straight into the rows of a sparse matrix.

The plane is treated as a space one node deep. Inside a patch all is measured in spacings. A sample adds products of
linear forms in the coefficients: of the slopes along the axes with what its tensor makes of them, of the second
derivatives along normals, of the value.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.fixed_kernels import decode_normals
from cpmkit.forms.galerkin.fixed_point import PLACE_UNIT
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled

#: Linear forms that are gathered before their products are added; at most eight belong to one sample.
GATHERED = 64
#: The unknowns of a patch, 27, and room to have rows of whole vectors of four.
ROOM = 28
#: So many forms are taken in one sweep over a block.
SWEEP = 8


def _polynomials() -> Floats:
    """Return (2, 3, 6, ROOM), for the plane and for space, by axis: the polynomial in t of the spline of each place.

    The six are the coefficients of 1, t, t^2 of its value, of 1, t of its slope, and its second derivative.
    """
    spline = np.array([[0.5, -1, 0.5, -1, 1, 1], [0.5, 1, -1, 1, -2, -2], [0, 0, 0.5, 0, 1, 1]])
    table = np.zeros((2, 3, 6, ROOM))
    for d in (2, 3):
        digits = np.indices((3,) * d).reshape(d, -1)
        for axis in range(d):
            table[d - 2, axis, :, : 3**d] = spline[digits[axis]].T
    table[0, 2, 0, :9] = 1.0
    return table


#: A constant of the kernels: what they store elsewhere cannot change it, so that loops over it become vectors.
POLYNOMIALS = _polynomials()


@compiled
def value_form(forms: Floats, kind: int, x: float, y: float, z: float, weight: float) -> None:
    """Write a pair of rows: the value at (x, y, z) in the cell, and it times the weight."""
    T = POLYNOMIALS
    for i in range(ROOM):
        X = T[kind, 0, 0, i] + x * (T[kind, 0, 1, i] + x * T[kind, 0, 2, i])
        Y = T[kind, 1, 0, i] + y * (T[kind, 1, 1, i] + y * T[kind, 1, 2, i])
        Z = T[kind, 2, 0, i] + z * (T[kind, 2, 1, i] + z * T[kind, 2, 2, i])
        forms[i] = X * Y * Z
        forms[ROOM + i] = weight * (X * Y * Z)


@compiled
def slope_forms(
    forms: Floats,
    kind: int,
    x: float,
    y: float,
    z: float,
    xx: float,
    xy: float,
    xz: float,
    yy: float,
    yz: float,
    zz: float,
) -> None:
    """Write three pairs of rows: the slopes along the axes, and what the tensor of these six numbers makes of them."""
    T = POLYNOMIALS
    for i in range(ROOM):
        X = T[kind, 0, 0, i] + x * (T[kind, 0, 1, i] + x * T[kind, 0, 2, i])
        Y = T[kind, 1, 0, i] + y * (T[kind, 1, 1, i] + y * T[kind, 1, 2, i])
        Z = T[kind, 2, 0, i] + z * (T[kind, 2, 1, i] + z * T[kind, 2, 2, i])
        along_x = (T[kind, 0, 3, i] + x * T[kind, 0, 4, i]) * Y * Z
        along_y = X * (T[kind, 1, 3, i] + y * T[kind, 1, 4, i]) * Z
        along_z = X * Y * (T[kind, 2, 3, i] + z * T[kind, 2, 4, i])
        forms[i] = along_x
        forms[ROOM + i] = xx * along_x + xy * along_y + xz * along_z
        forms[2 * ROOM + i] = along_y
        forms[3 * ROOM + i] = xy * along_x + yy * along_y + yz * along_z
        forms[4 * ROOM + i] = along_z
        forms[5 * ROOM + i] = xz * along_x + yz * along_y + zz * along_z


@compiled
def second_form(
    forms: Floats, kind: int, x: float, y: float, z: float, nx: float, ny: float, nz: float, weight: float
) -> None:
    """Write a pair of rows: the second derivative along (nx, ny, nz), and it times the weight."""
    T = POLYNOMIALS
    for i in range(ROOM):
        X = T[kind, 0, 0, i] + x * (T[kind, 0, 1, i] + x * T[kind, 0, 2, i])
        Y = T[kind, 1, 0, i] + y * (T[kind, 1, 1, i] + y * T[kind, 1, 2, i])
        Z = T[kind, 2, 0, i] + z * (T[kind, 2, 1, i] + z * T[kind, 2, 2, i])
        dX = nx * (T[kind, 0, 3, i] + x * T[kind, 0, 4, i])
        dY = ny * (T[kind, 1, 3, i] + y * T[kind, 1, 4, i])
        dZ = nz * (T[kind, 2, 3, i] + z * T[kind, 2, 4, i])
        form = (
            nx * nx * T[kind, 0, 5, i] * Y * Z + ny * ny * X * T[kind, 1, 5, i] * Z + nz * nz * X * Y * T[kind, 2, 5, i]
        )
        form += 2.0 * (dX * dY * Z + dX * Y * dZ + X * dY * dZ)
        forms[i] = form
        forms[ROOM + i] = weight * form


@compiled
def tensor_at(q: int, normals: Floats, a: float, tensors: Floats, e1: float, weight: float, C: Floats) -> None:
    """Fill ``C`` (3, 3) with the weight times the coefficient between tangents, and times e1 a between normals."""
    codim, d = normals.shape
    for i in range(d):
        for j in range(d):
            across = 0.0
            for c in range(codim):
                across += normals[c, i] * normals[c, j]
            C[i, j] = weight * a * ((i == j) - (1.0 - e1) * across)
            if len(tensors):
                C[i, j] = weight * tensors[q if len(tensors) > 1 else 0, i, j]
    if len(tensors) == 0:
        return
    for c in range(codim):  # less the tensor's parts along normals, which are orthonormal: one after the other
        n = normals[c]
        for side in range(2):
            for i in range(d):
                along = 0.0
                for k in range(d):
                    along += n[k] * (C[i, k] if side else C[k, i])
                for j in range(d):
                    if side:
                        C[i, j] -= along * n[j]
                    else:
                        C[j, i] -= along * n[j]
    for i in range(d):
        for j in range(d):
            for c in range(codim):
                C[i, j] += weight * e1 * a * normals[c, i] * normals[c, j]


@compiled
def add_products(forms: Floats, count: int, width: int, block: Floats) -> None:
    """Add to the upper half of ``block`` the products of the first ``count`` pairs of rows, a multiple of SWEEP."""
    for i in range(ROOM - 1):  # a constant number, so that the compiler lays out each row for itself
        if i == width:
            break
        row = block[i * ROOM : (i + 1) * ROOM]
        for r in range(0, count, SWEEP):
            F = forms[2 * ROOM * r : 2 * ROOM * (r + SWEEP)]
            a, b, c, d = F[i], F[i + 2 * ROOM], F[i + 4 * ROOM], F[i + 6 * ROOM]
            e, f, g, h = F[i + 8 * ROOM], F[i + 10 * ROOM], F[i + 12 * ROOM], F[i + 14 * ROOM]
            for j in range(i // 4 * 4, ROOM):
                row[j] += (
                    (a * F[j + ROOM] + b * F[j + 3 * ROOM])
                    + (c * F[j + 5 * ROOM] + d * F[j + 7 * ROOM])
                    + (e * F[j + 9 * ROOM] + f * F[j + 11 * ROOM])
                    + (g * F[j + 13 * ROOM] + h * F[j + 15 * ROOM])
                )


@compiled
def sort_columns(columns: Ints, rank: Ints, ascending: Any) -> None:
    """Fill ``ascending`` (k,) with the ``columns`` (k,) in order, and ``rank`` (k,) with where each stood."""
    for i in range(len(columns)):
        at = i
        while at > 0 and ascending[at - 1] > columns[i]:
            ascending[at], rank[at] = ascending[at - 1], rank[at - 1]
            at -= 1
        ascending[at], rank[at] = columns[i], i


@compiled
def scatter(block: Floats, columns: Ints, indptr: Any, indices: Any, data: Floats) -> None:
    """Add the upper half of a symmetric ``block`` of the unknowns ``columns``, and its mirror image, to a matrix."""
    width = len(columns)
    rank, ascending = np.empty(width, dtype=np.int64), np.empty(width, dtype=indices.dtype)
    sort_columns(columns, rank, ascending)
    for i in range(width):
        to: Any = np.uint64(indptr[columns[i]])  # unsigned, so that no index is tested for its sign
        for m in range(width):
            while indices[to] < ascending[m]:
                to += np.uint64(1)
            j = rank[m]
            data[to] += block[i * ROOM + j] if i <= j else block[j * ROOM + i]


@compiled
def add_energy(
    unknowns: Ints,
    spacing: float,
    order: Any,
    start: Ints,
    places: Any,
    weights: Floats,
    directions: Any,
    a: Floats,
    tensors: Floats,
    c: Floats,
    e1: float,
    e2: float,
    matrix: Any,
) -> None:
    """Add sum w [grad u' A grad u + e1 a |normal part|^2 + e2 h^2 a (n' H n)^2 + c u^2] to ``matrix``.

    ``places`` and ``directions`` are those of `FixedSamples`; ``a`` (q,), or (1,) for all, or empty for no energy of
    slopes; ``tensors`` (q, d, d), or empty where A is a times the identity; ``c`` (q,), (1,) or empty; ``matrix``:
    (indptr, indices, data).
    """
    indptr, indices, data = matrix
    codim, d = directions.shape[1], places.shape[1]
    kind, width = d - 2, unknowns.shape[1]
    C, z, normals = np.zeros((3, 3)), 0.0, np.zeros((codim, d))
    forms, block = np.zeros(2 * ROOM * (GATHERED + SWEEP)), np.zeros(ROOM * ROOM)
    for p in range(len(unknowns)):
        block[:] = 0.0
        count = 0
        for s in range(start[p], start[p + 1]):
            q = order[s]
            if weights[q] == 0.0:
                continue
            if count + 8 > GATHERED:
                _add_gathered(forms, count, width, block)
                count = 0
            x = PLACE_UNIT * places[q, 0] + 0.5
            y = PLACE_UNIT * places[q, 1] + 0.5
            if d == 3:
                z = PLACE_UNIT * places[q, 2] + 0.5
            if len(c):
                value_form(forms[2 * ROOM * count :], kind, x, y, z, weights[q] * c[q if len(c) > 1 else 0])
                count += 1
            if len(a) == 0:
                continue
            weight = weights[q] / spacing**2
            own = a[q if len(a) > 1 else 0]
            decode_normals(directions[q], normals)
            tensor_at(q, normals, own, tensors, e1, weight, C)
            rows = forms[2 * ROOM * count :]
            slope_forms(rows, kind, x, y, z, C[0, 0], C[0, 1], C[0, 2], C[1, 1], C[1, 2], C[2, 2])
            count += d
            weight *= e2 * own
            for one in range(codim):
                for two in range(one, codim):
                    share = 1.0 if one == two else np.sqrt(0.5)
                    other = 0.0 if one == two else share
                    nx = share * normals[one, 0] + other * normals[two, 0]
                    ny = share * normals[one, 1] + other * normals[two, 1]
                    nz = share * normals[one, 2] + other * normals[two, 2] if d == 3 else 0.0
                    second_form(forms[2 * ROOM * count :], kind, x, y, z, nx, ny, nz, weight)
                    count += 1
        _add_gathered(forms, count, width, block)
        scatter(block, unknowns[p], indptr, indices, data)


@compiled
def _add_gathered(forms: Floats, count: int, width: int, block: Floats) -> None:
    whole = (count + SWEEP - 1) // SWEEP * SWEEP
    forms[2 * ROOM * count : 2 * ROOM * whole] = 0.0
    add_products(forms, whole, width, block)
