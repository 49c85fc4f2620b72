"""Compiled: what a velocity adds to the rows of a sparse matrix, summed over samples patch by patch.

All is in spacings inside a patch. Of a sample come the values N_i of the splines and ``D_i = v . grad N_i``, and what
the equation makes of them besides, ``R_i = - a (tr H_i - n' H_i n) - grad a . grad N_i + c N_i``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.forms.galerkin.fixed_kernels import decode_normals
from cpmkit.forms.galerkin.fixed_point import PLACE_UNIT
from cpmkit.forms.galerkin.space.energy_kernels import room_for, second_of, slope_of, sort_columns, value_of
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled

#: What is added: all with (v . grad u) phi first, or with -u v . grad phi; of a rate or of streamlines alone.
CONVECTIVE, CONSERVATIVE, RATE, STREAMLINES = 0, 1, 2, 3


@compiled
def transport_forms(
    forms: Floats,
    splines: Any,
    kind: int,
    t: Floats,
    v: Floats,
    g: Floats,
    normals: Floats,
    spacing: float,
    a: float,
    c: float,
) -> None:
    """Write three rows: N, D and R at the place ``t`` (3,) of the cell; v and g = grad a (3,)."""
    room = room_for(splines)
    codim, d = normals.shape
    x, y, z = t[0], t[1], t[2]
    u0, u1, u2 = v[0] / spacing, v[1] / spacing, v[2] / spacing
    g0, g1, g2 = g[0] / spacing, g[1] / spacing, g[2] / spacing
    second = a / spacing**2
    xx, yy, zz, xy, xz, yz = 1.0, 1.0, 1.0, 0.0, 0.0, 0.0
    for k in range(codim):
        n0, n1 = normals[k, 0], normals[k, 1]
        n2 = normals[k, 2] if d == 3 else 0.0
        xx -= n0 * n0
        yy -= n1 * n1
        zz -= n2 * n2
        xy -= 2.0 * n0 * n1
        xz -= 2.0 * n0 * n2
        yz -= 2.0 * n1 * n2
    for i in range(room):
        X, dX = value_of(splines, kind, 0, i, x), slope_of(splines, kind, 0, i, x)
        Y, dY = value_of(splines, kind, 1, i, y), slope_of(splines, kind, 1, i, y)
        Z, dZ = value_of(splines, kind, 2, i, z), slope_of(splines, kind, 2, i, z)
        bend = xx * second_of(splines, kind, 0, i, x) * Y * Z + yy * X * second_of(splines, kind, 1, i, y) * Z
        bend += zz * X * Y * second_of(splines, kind, 2, i, z)
        bend += xy * dX * dY * Z + xz * dX * Y * dZ + yz * X * dY * dZ
        forms[i] = X * Y * Z
        along_x, along_y, along_z = dX * Y * Z, X * dY * Z, X * Y * dZ
        forms[room + i] = u0 * along_x + u1 * along_y + u2 * along_z
        forms[2 * room + i] = c * (X * Y * Z) - second * bend - (g0 * along_x + g1 * along_y + g2 * along_z)


@compiled
def scatter_unsymmetric(block: Floats, room: int, columns: Ints, indptr: Any, indices: Any, data: Floats) -> None:
    """Add a ``block`` with rows of ``room`` of the unknowns ``columns`` to a matrix."""
    width = len(columns)
    rank, ascending = np.empty(width, dtype=np.int64), np.empty(width, dtype=indices.dtype)
    sort_columns(columns, rank, ascending)
    for i in range(width):
        to: Any = np.uint64(indptr[columns[i]])  # unsigned, so that no index is tested for its sign
        for m in range(width):
            while indices[to] < ascending[m]:
                to += np.uint64(1)
            data[to] += block[i * room + rank[m]]


@compiled
def add_transport(
    unknowns: Ints,
    spacing: float,
    splines: Any,
    order: Any,
    start: Ints,
    places: Any,
    weights: Floats,
    directions: Any,
    velocity: Floats,
    upstream: Floats,
    a: Floats,
    of_a: Floats,
    c: Floats,
    terms: int,
    matrix: Any,
) -> None:
    """Add sum w [(v . grad u) phi + tau (v . grad phi) (v . grad u - a Lap u + c u)] to ``matrix``.

    Parameters
    ----------
    places, directions : (q, d), (q, c, e) int32
        As of `FixedSamples`.
    velocity : (q, d) float64
        v, tangential.
    upstream : (q,) float64
        tau.
    a, c : (q,) or (1,) float64
        The diffusivity, and the factor of u.
    of_a : (q, d) or (0, d) float64
        The gradient of the diffusivity, tangential; none where it is constant.
    terms : int
        CONVECTIVE as it stands; CONSERVATIVE with -u v . grad phi first; of a RATE, tau (v . grad phi) (c u - a Lap u);
        STREAMLINES, tau (v . grad phi) (v . grad u), with a = c = 0.
    matrix : (indptr, indices, data)
        In the pattern of the space.
    """
    indptr, indices, data = matrix
    d = places.shape[1]
    kind, width, room = d - 2, unknowns.shape[1], room_for(splines)
    forms, block = np.zeros(3 * room), np.zeros(room * room)
    t, v, g, normals = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((directions.shape[1], d))
    for p in range(len(unknowns)):
        block[:] = 0.0
        for s in range(start[p], start[p + 1]):
            q = order[s]
            w = weights[q]
            if w == 0.0:
                continue
            for axis in range(d):
                t[axis] = PLACE_UNIT * places[q, axis] + 0.5
                v[axis] = velocity[q, axis]
                if len(of_a):
                    g[axis] = of_a[q, axis]
            own, factor = a[q if len(a) > 1 else 0], c[q if len(c) > 1 else 0]
            decode_normals(directions[q], normals)
            transport_forms(forms, splines, kind, t, v, g, normals, spacing, own, factor)
            N, D, R = forms[:room], forms[room : 2 * room], forms[2 * room :]
            for i in range(width):
                through = w * upstream[q] * D[i]
                forth = 0.0 if terms == RATE else through + w * N[i] if terms == CONVECTIVE else through
                back = w * D[i] if terms == CONSERVATIVE else 0.0
                row = block[i * room : (i + 1) * room]
                for j in range(room):
                    row[j] += forth * D[j] + through * R[j] - back * N[j]
        scatter_unsymmetric(block, room, unknowns[p], indptr, indices, data)


@compiled
def add_upstream(
    unknowns: Ints,
    spacing: float,
    splines: Any,
    order: Any,
    start: Ints,
    places: Any,
    weights: Floats,
    velocity: Floats,
    upstream: Floats,
    f: Floats,
    load: Floats,
) -> None:
    """Add sum w tau (v . grad phi) f to ``load`` (n, channels), ``f`` (q, channels), or (1, channels) for all."""
    d = places.shape[1]
    kind, width, channels, room = d - 2, unknowns.shape[1], load.shape[1], room_for(splines)
    forms, normals = np.zeros(3 * room), np.zeros((0, d))
    t, v, none = np.zeros(3), np.zeros(3), np.zeros(3)
    for p in range(len(unknowns)):
        for s in range(start[p], start[p + 1]):
            q = order[s]
            if weights[q] * upstream[q] == 0.0:
                continue
            for axis in range(d):
                t[axis] = PLACE_UNIT * places[q, axis] + 0.5
                v[axis] = velocity[q, axis]
            transport_forms(forms, splines, kind, t, v, none, normals, spacing, 0.0, 0.0)
            for channel in range(channels):
                density = weights[q] * upstream[q] * f[q if len(f) > 1 else 0, channel]
                for place in range(width):
                    load[unknowns[p, place], channel] += density * forms[room + place]
