"""Advection by a velocity: its matrices, upwinding and loads, and the stabilisation that it needs.

With the cell number P = |v| h / a the equation is tested with phi + tau v . grad phi (streamline upwinding, Brooks and
Hughes 1982), ``tau = h / |v| max(0, 1 - 1 / P) / sqrt(2^2 + (16 / P)^2)``. Below P = 1 tau is zero. All terms of the
equation, -a Lap u included, are tested with this function, so that the method stays consistent. The stabilisation off
the manifold is proportional to a, or to a share of |v| h if that is larger, since v would deflect u off the manifold.

A sample contributes the values N_i of the splines, ``D_i = v . grad N_i``, and the rest of the equation,
``R_i = - a (tr H_i - n' H_i n) - grad a . grad N_i + c N_i``. The kernels work patch by patch, in units of the spacing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.options import Stabilisation
from cpmkit.forms.galerkin.space.energy import add_ghosts, gradient_load, kernel_arguments, stabilisation_data
from cpmkit.forms.galerkin.space.pattern_kernels import scatter
from cpmkit.forms.galerkin.space.quantised_samples import PLACE_UNIT, decode_normals
from cpmkit.forms.galerkin.space.sample_kernels import derivatives_of, row_length
from cpmkit.forms.galerkin.space.spline_space import SplineSpace
from cpmkit.grid.lattice import Lattice
from cpmkit.linear.multigrid.solver import Level
from cpmkit.runtime.compilation import compiled
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.equations import VectorField
from cpmkit.types import Floats, Ints, SparseMatrix

#: tau is at most h / |v| over the first number, and h^2 / a over the second. On a circle cut at a point, with a layer
#: at the cut, u exceeds its range at no cell number from 10 to 1000 and six positions, by 4 percent at 5, where the
#: layer is h / 5 wide; with h / (4 |v|) alone by 3.3 percent. With 1 in place of 2 errors upstream are 10 times larger.
LIMIT_BY_SPEED, LIMIT_BY_DIFFUSION = 2.0, 16.0
#: The stabilisation is proportional to the larger of a and this share of |v| h.
STABILISATION_SHARE = 0.1
#: At boundaries a velocity, which may jump there, is evaluated at this share of the way to the centre of the cell.
INSIDE_SHARE = 1e-6


@compiled
def fill_advection_forms(
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
    """Fill ``forms`` (3 room,) with N, D = v . grad N and R = -a Lap N - g . grad N + c N of each spline N at a sample.

    ``t`` (3,) in [0, 1] is its place in the cell; v and g = grad a are (3,), ``normals`` (codim, d), ``a`` and ``c``
    the diffusivity and the factor of u; room is the `row_length` of ``splines``. ``kind`` is 0 in the plane and 1 in
    space; ``spacing`` is h.
    """
    room = row_length(splines)
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
        X, Y, Z = derivatives_of(splines, kind, 0, i, x, y, z)
        dX, dY, dZ = derivatives_of(splines, kind, 1, i, x, y, z)
        ddX, ddY, ddZ = derivatives_of(splines, kind, 2, i, x, y, z)
        bend = xx * ddX * Y * Z + yy * X * ddY * Z
        bend += zz * X * Y * ddZ
        bend += xy * dX * dY * Z + xz * dX * Y * dZ + yz * X * dY * dZ
        forms[i] = X * Y * Z
        along_x, along_y, along_z = dX * Y * Z, X * dY * Z, X * Y * dZ
        forms[room + i] = u0 * along_x + u1 * along_y + u2 * along_z
        forms[2 * room + i] = c * (X * Y * Z) - second * bend - (g0 * along_x + g1 * along_y + g2 * along_z)


@compiled
def add_advection(
    unknowns: Ints,
    spacing: float,
    splines: Any,
    order: Any,
    start: Ints,
    places: Any,
    weights: Floats,
    directions: Any,
    velocity: Floats,
    upwinding: Floats,
    a: Floats,
    gradient_of_a: Floats,
    c: Floats,
    convective: float,
    conservative: float,
    matrix: Any,
) -> None:
    """Add sum w tau (v . grad phi) (v . grad u - div(a grad u) + c u) and the advection itself to ``matrix``.

    The advection is ``convective`` times sum w (v . grad u) phi, less ``conservative`` times sum w u v . grad phi.

    ``unknowns``, ``order``, ``start`` (p, width), (q,) and (p + 1,) integers: the unknowns of each patch, and its
        samples ``order[start[p]:start[p + 1]]``.
    ``spacing``, ``splines``: h, and the tuple of the degree in `SPLINES`.
    ``places``, ``weights``, ``directions`` (q, d), (q,), (q, c, e): those of `QuantisedSamples`.
    ``velocity``, ``upwinding`` (q, d), (q,): the tangential velocity v and the upwinding time tau at the samples.
    ``a``, ``c`` (q,) or (1,): the diffusivity, and the factor of u.
    ``gradient_of_a`` (q, d) or (0, d): the gradient of the diffusivity, tangential; none where it is constant.
    ``matrix`` (indptr, indices, data): a matrix in CSR format, with the sparsity pattern of the space.
    """
    indptr, indices, data = matrix
    d = places.shape[1]
    kind, width, room = d - 2, unknowns.shape[1], row_length(splines)
    forms, block = np.zeros(3 * room), np.zeros(room * room)
    standing = np.empty(len(indptr) - 1, dtype=np.uint32)
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
                if len(gradient_of_a):
                    g[axis] = gradient_of_a[q, axis]
            own, factor = a[q if len(a) > 1 else 0], c[q if len(c) > 1 else 0]
            decode_normals(directions[q], normals)
            fill_advection_forms(forms, splines, kind, t, v, g, normals, spacing, own, factor)
            N, D, R = forms[:room], forms[room : 2 * room], forms[2 * room :]
            for i in range(width):
                through = w * upwinding[q] * D[i]
                forth, back = through + convective * w * N[i], conservative * w * D[i]
                row = block[i * room : (i + 1) * room]
                for j in range(room):
                    row[j] += forth * D[j] + through * R[j] - back * N[j]
        scatter(block, room, unknowns[p], indptr, indices, data, standing, False)


@dataclass(frozen=True, eq=False)
class Advection:
    """The terms of an equation with a velocity, at the samples."""

    space: SplineSpace  #: The splines and their samples.
    velocity: Floats  #: (q, d): the tangential part v of the velocity at the samples.
    upwinding: Floats  #: (q,): the upwinding time tau at the samples.
    #: a, c (q,) or (1,): the diffusivity, and the factor of u in the tested equation, c + div v if it is conservative.
    a: Floats
    c: Floats
    gradient_of_a: Floats  #: (q, d) or (0, d): the gradient of a; empty where a is constant.
    conservative: bool  #: Whether the equation has div(v u) in place of v . grad u.

    def matrix_with_advection(self, matrix: SparseMatrix, stabilisation: Stabilisation) -> SparseMatrix:
        """Return a ``matrix`` (n, n) in the space's pattern plus these terms and the ``stabilisation`` they need."""
        space, data = self.space, matrix.data.copy()
        speed = np.linalg.norm(self.velocity, axis=1)
        more = np.maximum(STABILISATION_SHARE * speed * space.dof_map.spacing - self.a, 0.0)
        if more.any():
            data += stabilisation_data(space, more, stabilisation)
            add_ghosts(space, more, stabilisation, data)
        advection = (0.0, 1.0) if self.conservative else (1.0, 0.0)
        _add_terms(space, self.velocity, self.upwinding, data, advection, self.a, self.gradient_of_a, self.c)
        return space.matrix(data)

    def upwinding_matrix(self, share: float) -> SparseMatrix:
        """Return ``share`` times the upwinding (n, n) that the first coarser level of multigrid needs.

        Its tau is h / (2 |v|) at any cell number.
        """
        data = np.zeros(len(self.space.indices))
        times = upwinding_times(np.linalg.norm(self.velocity, axis=1), np.zeros(1), self.space.dof_map.spacing)
        _add_terms(self.space, self.velocity, share * times, data)
        return self.space.matrix(data)

    def add_load(self, f: Floats, load: Floats) -> None:
        """Add the integrals of tau (v . grad phi) f to ``load`` (n, channels), in place; f (p, channels) at samples."""
        if self.upwinding.any():
            field = self.upwinding[: len(f), None] * self.velocity[: len(f)]
            for channel in range(load.shape[1]):
                load[:, channel] += gradient_load(self.space, f[:, [channel]] * field)


@dataclass(frozen=True, eq=False)
class JoinedAdvection:
    """The terms of an equation with a velocity on the parts of a union, whose unknowns follow one another."""

    parts: tuple[Advection, ...]
    conservative: bool  #: Whether the equation has div(v u) in place of v . grad u.

    def upwinding_matrix(self, share: float) -> SparseMatrix:
        """Return ``share`` times the upwinding (n, n) that the first coarser level of multigrid needs."""
        from scipy.sparse import block_diag

        return block_diag([part.upwinding_matrix(share) for part in self.parts], format="csr")


def join_advections(parts: Sequence[Any]) -> JoinedAdvection | None:
    """Return the terms of a velocity on the ``parts`` of a union; None if the equation has no velocity."""
    found = tuple(part for part in parts if part is not None)
    return JoinedAdvection(found, found[0].conservative) if found else None


def upwinded_levels(levels: Sequence[Level], added: SparseMatrix) -> list[Level]:
    """Return multigrid ``levels`` with upwinding: ``added`` (n, n) for the first of them, doubled for each further."""
    upwinded = []
    for level in levels:
        added = (level.prolongation.T @ added @ level.prolongation).tocsr()
        upwinded.append(replace(level, added=added))
        added = 2.0 * added
    return upwinded


def _add_terms(
    space: SplineSpace,
    velocity: Floats,
    upwinding: Floats,
    data: Floats,
    advection: tuple[float, float] = (0.0, 0.0),
    a: Floats | None = None,
    gradient_of_a: Floats | None = None,
    c: Floats | None = None,
) -> None:
    """Add the terms of :func:`add_advection` to the entries ``data`` (z,), in place; coefficients None are zero.

    ``advection`` are the factors of the convective and the conservative terms.
    """
    samples, zero = space.samples, np.zeros(1)
    sample_arrays = samples.places, samples.weights, samples.directions, velocity, upwinding
    coefficients = zero if a is None else a, velocity[:0] if gradient_of_a is None else gradient_of_a
    matrix = space.indptr, space.indices, data
    add_advection(*kernel_arguments(space), *sample_arrays, *coefficients, zero if c is None else c, *advection, matrix)


def convection_matrix(space: SplineSpace, field: Floats) -> SparseMatrix:
    """Return the matrix (n, n) of sum w u (field . grad v); ``field`` (p, d) is zero beyond the first p samples."""
    data, velocity = np.zeros(len(space.indices)), np.zeros(space.samples.places.shape)
    velocity[: len(field)] = field
    _add_terms(space, velocity, np.zeros(len(velocity)), data, (0.0, 1.0))
    return space.matrix(-data)


def upwinding_times(speed: Floats, a: Floats, spacing: float) -> Floats:
    """Return the factor tau (q,) of streamline upwinding: h / |v| max(0, 1 - 1 / P) / sqrt(2^2 + (16 / P)^2).

    ``speed`` (q,) is |v|, ``a`` (q,) or (1,) the diffusivity, P = |v| h / a. tau is zero where the speed is, and where
    P <= 1; for a = 0 it is h / (2 |v|).
    """
    moving = speed > 0
    crossing_time = np.divide(spacing, speed, out=np.zeros_like(speed), where=moving)
    inverse = np.divide(a, speed * spacing, out=np.full_like(speed, np.inf), where=moving)  # of the cell number
    share = np.maximum(0.0, 1.0 - inverse)
    limit = np.where(share > 0, inverse, 0.0)
    return np.asarray(crossing_time * share / np.hypot(LIMIT_BY_SPEED, LIMIT_BY_DIFFUSION * limit))


def tangential_velocity(velocity: VectorField, points: Floats, normals: Floats, lattice: Lattice) -> Floats:
    """Return the tangential part (k, d) of a velocity at ``points`` (k, d) with ``normals`` (k, c, d).

    Points are relative to the lattice's origin. Raises InputError if the velocity does not have d components.
    """
    v = evaluate_data(velocity, lattice.to_scene(points), None, "the velocity")
    if not v.any():  # also the number 0, for a member of a union
        return np.zeros_like(points)
    if v.shape[1] != points.shape[1]:
        raise InputError(f"the velocity must be vectors of shape (n, {points.shape[1]}), got (n, {v.shape[1]}).")
    normal_part = np.einsum("qd,qcd->qc", v, normals)
    return np.asarray(v - np.einsum("qc,qcd->qd", normal_part, normals))


def outward_speed(velocity: VectorField, samples: BoundarySamples, lattice: Lattice) -> Floats:
    """Return v . b (b,) at boundary ``samples``, b the conormal out of the cell, v evaluated just inside the cell."""
    points = samples.points + INSIDE_SHARE * (samples.centres - samples.points)
    v = tangential_velocity(velocity, points, samples.normals, lattice)
    return np.asarray(np.einsum("bd,bd->b", v, samples.conormals))
