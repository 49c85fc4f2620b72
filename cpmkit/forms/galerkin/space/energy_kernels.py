"""Kernels that sum energies over samples, patch by patch, directly into the rows of a sparse matrix.

In the plane the third factor of every spline is 1, so that the same kernels serve plane and space (``kind`` is 0 in the
plane and 1 in space). A patch is a connected part of the manifold in one lattice cell, on which (degree + 1)^d
splines are not zero: it reads their coefficients, the unknowns. Inside a patch lengths are in spacings; x, y and z are
coordinates in [0, 1] in its lattice cell.
A sample adds products of linear forms in the coefficients of u: the slopes along the axes times the tensor times these
slopes, and squares of second and third derivatives along normals and of the value. Each product is a pair of rows
of an array ``forms``: one row for each linear form, the second times tensor or weight, with one entry for each spline
that the patch reads.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.space.pattern_kernels import scatter
from cpmkit.forms.galerkin.space.quantised_samples import PLACE_UNIT, decode_normals
from cpmkit.forms.galerkin.space.sample_kernels import derivatives_of, row_length, splines_read
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints

#: Number of pairs of rows that are gathered before their products are added, and the largest number for one sample.
GATHERED, FORMS_OF_A_SAMPLE = 64, 12
#: Number of pairs whose products are added in one pass over a block.
SWEEP = 8


@compiled
def fill_value_form(forms: Floats, splines: Any, kind: int, x: float, y: float, z: float, weight: float) -> None:
    """Fill two rows of ``forms`` with the splines at (x, y, z), then times ``weight``, as `fill_sample_forms` does."""
    room = row_length(splines)
    for i in range(room):
        X, Y, Z = derivatives_of(splines, kind, 0, i, x, y, z)
        forms[i] = X * Y * Z
        forms[room + i] = weight * (X * Y * Z)


@compiled
def fill_second_form(
    forms: Floats, splines: Any, kind: int, x: float, y: float, z: float, n: tuple[float, float, float], weight: float
) -> None:
    """Fill two rows with second derivatives along ``n``, then times ``weight``; arguments as of `fill_sample_forms`."""
    room, (nx, ny, nz) = row_length(splines), n
    for i in range(room):
        X, Y, Z = derivatives_of(splines, kind, 0, i, x, y, z)
        dX, dY, dZ = derivatives_of(splines, kind, 1, i, x, y, z)
        dX, dY, dZ = nx * dX, ny * dY, nz * dZ
        ddX, ddY, ddZ = derivatives_of(splines, kind, 2, i, x, y, z)
        form = nx * nx * ddX * Y * Z + ny * ny * X * ddY * Z + nz * nz * X * Y * ddZ
        form += 2.0 * (dX * dY * Z + dX * Y * dZ + X * dY * dZ)
        forms[i] = form
        forms[room + i] = weight * form


@compiled
def fill_sample_forms(
    forms: Floats,
    splines: Any,
    kind: int,
    place: tuple[float, float, float],
    tensor: tuple[float, float, float, float, float, float],
    n: tuple[float, float, float],
    second_weight: float,
    value_weight: float,
) -> None:
    """Fill five pairs of rows of ``forms``: the slopes of the splines, their second derivatives, and their values.

    Rows have `row_length` entries, one for each spline of the cell. The first three pairs are the slopes along each
    axis at ``place`` (x, y, z), coordinates in [0, 1] in the cell, and the symmetric ``tensor`` times these, given by
    its entries xx, xy, xz, yy, yz and zz. Then follow the pairs of `fill_second_form` along ``n``, with
    ``second_weight``, and of `fill_value_form`, with ``value_weight``. ``kind`` is 0 in the plane and 1 in space.
    """
    room, (x, y, z), (nx, ny, nz) = row_length(splines), place, n
    xx, xy, xz, yy, yz, zz = tensor
    for i in range(room):
        X, Y, Z = derivatives_of(splines, kind, 0, i, x, y, z)
        dX, dY, dZ = derivatives_of(splines, kind, 1, i, x, y, z)
        ddX, ddY, ddZ = derivatives_of(splines, kind, 2, i, x, y, z)
        along_x, along_y, along_z = dX * Y * Z, X * dY * Z, X * Y * dZ
        forms[i] = along_x
        forms[room + i] = xx * along_x + xy * along_y + xz * along_z
        forms[2 * room + i] = along_y
        forms[3 * room + i] = xy * along_x + yy * along_y + yz * along_z
        forms[4 * room + i] = along_z
        forms[5 * room + i] = xz * along_x + yz * along_y + zz * along_z
        bend = nx * nx * ddX * Y * Z + ny * ny * X * ddY * Z + nz * nz * X * Y * ddZ
        bend += 2.0 * (nx * dX * (ny * dY) * Z + nx * dX * Y * (nz * dZ) + X * (ny * dY) * (nz * dZ))
        forms[6 * room + i] = bend
        forms[7 * room + i] = second_weight * bend
        forms[8 * room + i] = X * Y * Z
        forms[9 * room + i] = value_weight * (X * Y * Z)


@compiled
def fill_third_form(
    forms: Floats, splines: Any, kind: int, x: float, y: float, z: float, n: tuple[float, float, float], weight: float
) -> None:
    """Fill two rows with third derivatives along ``n``, then times ``weight``; arguments as of `fill_sample_forms`."""
    room, (nx, ny, nz) = row_length(splines), n
    for i in range(room):
        X, Y, Z = derivatives_of(splines, kind, 0, i, x, y, z)
        dX, dY, dZ = derivatives_of(splines, kind, 1, i, x, y, z)
        dX, dY, dZ = nx * dX, ny * dY, nz * dZ
        ddX, ddY, ddZ = derivatives_of(splines, kind, 2, i, x, y, z)
        ddX, ddY, ddZ = nx * nx * ddX, ny * ny * ddY, nz * nz * ddZ
        third_x, third_y, third_z = derivatives_of(splines, kind, 3, i, x, y, z)
        form = nx * nx * nx * third_x * Y * Z
        form += ny * ny * ny * X * third_y * Z
        form += nz * nz * nz * X * Y * third_z + 6.0 * dX * dY * dZ
        form += 3.0 * (ddX * (dY * Z + Y * dZ) + ddY * (dX * Z + X * dZ) + ddZ * (dX * Y + X * dY))
        forms[i] = form
        forms[room + i] = weight * form


@compiled
def fill_tensor(q: int, normals: Floats, a: float, tensors: Floats, e1: float, weight: float, C: Floats) -> None:
    """Fill ``C`` (3, 3) with ``weight`` times (P A P + e1 a (I - P)), P the projection onto the tangent space.

    ``normals`` (c, d) are orthonormal; A is ``tensors[q]`` of sample ``q``, or ``tensors[0]`` if there is one for all
    samples, or a times the identity where ``tensors`` is empty.
    """
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
    for c in range(codim):  # subtract the parts along each of the orthonormal normals in turn
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
def add_products(forms: Floats, splines: Any, count: int, width: int, block: Floats) -> None:
    """Add the outer products of the first ``count`` pairs of rows of ``forms`` to the upper half of ``block``.

    ``count`` is a multiple of `SWEEP`; ``width`` is the number of splines of a patch. ``block`` (room^2,) has rows of
    length room = `row_length`.
    """
    room = row_length(splines)
    for i in range(splines_read(splines)):  # a constant number, so that the compiler lays out each row for itself
        if i == width:
            break
        row = block[i * room : (i + 1) * room]
        for r in range(0, count, SWEEP):
            F = forms[2 * room * r : 2 * room * (r + SWEEP)]
            a, b, c, d = F[i], F[i + 2 * room], F[i + 4 * room], F[i + 6 * room]
            e, f, g, h = F[i + 8 * room], F[i + 10 * room], F[i + 12 * room], F[i + 14 * room]
            for j in range(i // 4 * 4, room):
                row[j] += (
                    (a * F[j + room] + b * F[j + 3 * room])
                    + (c * F[j + 5 * room] + d * F[j + 7 * room])
                    + (e * F[j + 9 * room] + f * F[j + 11 * room])
                    + (g * F[j + 13 * room] + h * F[j + 15 * room])
                )


@compiled
def add_energy(
    unknowns: Ints,
    spacing: float,
    splines: Any,
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
    e3: float,
    matrix: Any,
) -> None:
    """Add sum w [grad u' A grad u + e1 a |normal part|^2 + e2 h^2 a (n' H n)^2 + c u^2] to ``matrix``.

    The gradient is the tangential one, its normal part the derivative along normals, and H the Hessian. For cubic
    splines e3 h^4 a times the square of the third derivative along n is added too.

    ``unknowns`` (p, w): the unknowns that each patch reads.
    ``spacing``, ``splines``: h, and the tuple of the degree in `SPLINES`.
    ``order``, ``start`` (q,), (p + 1,): the samples sorted by patch, and where the samples of each patch start.
    ``places``, ``weights``, ``directions``: as in `QuantisedSamples`.
    ``a`` (q,), (1,) or (0,): at the samples, constant, or absent: then only the term with c is added.
    ``tensors`` (q, d, d), (1, d, d) or (0, d, d): A, or none where A is a times the identity.
    ``c`` (q,), (1,) or (0,): at the samples, constant, or absent.
    ``e1``, ``e2``, ``e3``: factors of the stabilisation.
    ``matrix`` (indptr, indices, data): the matrix in CSR format, of which ``data`` is added to.
    """
    indptr, indices, data = matrix
    codim, d = directions.shape[1], places.shape[1]
    kind, width, room = d - 2, unknowns.shape[1], row_length(splines)
    C, z, normals = np.empty((3, 3)), 0.0, np.empty((codim, d))
    forms, block = np.empty(2 * room * (GATHERED + SWEEP)), np.empty(room * room)
    C[:], forms[:] = 0.0, 0.0
    none: Any = np.int64(0)
    standing = np.empty(len(indptr) - 1, dtype=np.uint32)
    for p in range(len(unknowns)):
        block[:] = 0.0
        count = none
        for s in range(start[p], start[p + 1]):
            q = order[s]
            if weights[q] == 0.0:
                continue
            if count + FORMS_OF_A_SAMPLE > GATHERED:
                _add_gathered(forms, splines, count, width, block)
                count = none
            x = PLACE_UNIT * places[q, 0] + 0.5
            y = PLACE_UNIT * places[q, 1] + 0.5
            if d == 3:
                z = PLACE_UNIT * places[q, 2] + 0.5
            factor = weights[q] * c[q if len(c) > 1 else 0] if len(c) else 0.0
            rows = forms[2 * room * count :]
            if len(a) == 0:
                fill_value_form(rows, splines, kind, x, y, z, factor)
                count += 1
                continue
            weight = weights[q] / spacing**2
            own = a[q if len(a) > 1 else 0]
            decode_normals(directions[q], normals)
            fill_tensor(q, normals, own, tensors, e1, weight, C)
            tensor = C[0, 0], C[0, 1], C[0, 2], C[1, 1], C[1, 2], C[2, 2]
            n = combined_normal(normals, none, none, 1.0, 0.0) if codim else (0.0, 0.0, 0.0)
            fill_sample_forms(rows, splines, kind, (x, y, z), tensor, n, weight * e2 * own, factor)
            count += 5 if len(c) else 4
            for one in range(codim):
                for two in range(one, codim):
                    share = 1.0 if one == two else np.sqrt(0.5)
                    other = 0.0 if one == two else share
                    n = combined_normal(normals, one, two, share, other)
                    if two > 0:
                        fill_second_form(forms[2 * room * count :], splines, kind, x, y, z, n, weight * e2 * own)
                        count += 1
                    if len(splines) < 4:
                        continue
                    fill_third_form(forms[2 * room * count :], splines, kind, x, y, z, n, weight * e3 * own)
                    count += 1
                    if one < two:  # a cubic form in two normals has four coefficients
                        n = combined_normal(normals, one, two, share, -other)
                        fill_third_form(forms[2 * room * count :], splines, kind, x, y, z, n, weight * e3 * own)
                        count += 1
        _add_gathered(forms, splines, count, width, block)
        scatter(block, room, unknowns[p], indptr, indices, data, standing, True)


@compiled
def combined_normal(normals: Floats, one: int, two: int, share: float, other: float) -> tuple[float, float, float]:
    """Return ``share`` times normal number ``one`` plus ``other`` times number ``two`` of ``normals`` (c, d)."""
    nx = share * normals[one, 0] + other * normals[two, 0]
    ny = share * normals[one, 1] + other * normals[two, 1]
    nz = share * normals[one, 2] + other * normals[two, 2] if normals.shape[1] == 3 else 0.0
    return nx, ny, nz


@compiled
def _add_gathered(forms: Floats, splines: Any, count: int, width: int, block: Floats) -> None:
    """Add the products of ``count`` pairs of rows to ``block``; pairs up to a multiple of `SWEEP` are set to zero."""
    room, whole = row_length(splines), (count + SWEEP - 1) // SWEEP * SWEEP
    forms[2 * room * count : 2 * room * whole] = 0.0
    add_products(forms, splines, whole, width, block)
