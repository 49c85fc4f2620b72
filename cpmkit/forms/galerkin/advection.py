"""A velocity at the samples: cell numbers, how far upstream the equation is tested, how strongly u is held.

With the cell number P = |v| h / a the equation is tested with phi + tau v . grad phi (streamline upwinding, Brooks and
Hughes 1982), ``tau = h / |v| max(0, 1 - 1 / P) / sqrt(2^2 + (16 / P)^2)``: nothing below P = 1, and nothing that the
solution of the equation would feel, as all of the equation is tested so, -a Lap u included. What holds u off the
manifold is in units of a or, where it is larger, of a share of |v| h: what is carried along would bend u there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.quadrature.quantised_kernels import decode_normals
from cpmkit.forms.galerkin.quadrature.samples import PLACE_UNIT
from cpmkit.forms.galerkin.space.energy import Stabilisation, add_ghosts, kernel_arguments, stabilisation_data
from cpmkit.forms.galerkin.space.energy_kernels import room_for, second_of, slope_of, sort_columns, value_of
from cpmkit.forms.galerkin.space.spline_space import SplineSpace
from cpmkit.grid.lattice import Lattice
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.runtime.compilation import compiled
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.equations import VectorField
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


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


#: Below this cell number the equation is tested with phi alone.
UPWIND_CELL_NUMBER = 1.0
#: tau is at most h / |v| over the first, and h^2 / a over the second. A circle cut at a point, with a layer at the cut,
#: at cell numbers of 10 to 1000 and six positions: nothing above its range; with h / (4 |v|) alone up to 3.3 percent,
#: and 1 in place of 2 leaves errors ten times as large upstream. At 5, where the layer is h / 5 wide, 4 percent.
LIMIT_BY_SPEED, LIMIT_BY_DIFFUSION = 2.0, 16.0
#: Share of |v| h that u is held by at least.
HOLDING_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Advection:
    """What a velocity does at the samples.

    Attributes
    ----------
    space : Space
        The splines and their samples.
    velocity : (q, d) float64
        v, its tangential part.
    upstream : (q,) float64
        tau, a time.
    a, c : (q,) or (1,) float64
        The diffusivity; and the factor of u in the equation as it is tested, with div v where it is conservative.
    of_a : (q, d) or (0, d) float64
        The gradient of a; none where it is constant.
    conservative : bool
        Whether the equation has div(v u) in place of v . grad u.
    """

    space: SplineSpace
    velocity: Floats
    upstream: Floats
    a: Floats
    c: Floats
    of_a: Floats
    conservative: bool

    def added_to(self, matrix: csr_array, strength: Stabilisation) -> csr_array:
        """Return a stiffness with the terms of the velocity, and u held as they need it."""
        space, data = self.space, matrix.data.copy()
        speed = np.linalg.norm(self.velocity, axis=1)
        more = np.maximum(HOLDING_SHARE * speed * space.dof_map.spacing - self.a, 0.0)
        if more.any():
            data += stabilisation_data(space, more, strength)
            add_ghosts(space, more, strength, data)
        terms = CONSERVATIVE if self.conservative else CONVECTIVE
        self._add(data, self.upstream, terms, self.a, self.c, self.of_a)
        return space.matrix(data)

    def mass_upstream(self) -> csr_array | None:
        """Return the integrals of tau (v . grad phi) u, which belong to a rate; None where tau is zero."""
        if not self.upstream.any():
            return None
        data = np.zeros(len(self.space.indices))
        self._add(data, self.upstream, RATE, c=np.ones(1))
        return self.space.matrix(data)

    def on_levels(self, levels: Sequence[Level], share: float) -> list[Level]:
        """Return levels with the upwinding that their spacings need, for an operator that has ``share`` of this.

        With h / (2 |v|) everywhere, not only above a cell number of one, twice the spacing needs twice as much more.
        """
        data = np.zeros(len(self.space.indices))
        times = upstream_times(np.linalg.norm(self.velocity, axis=1), np.zeros(1), self.space.dof_map.spacing)
        self._add(data, share * times, STREAMLINES)
        added, found = self.space.matrix(data), []
        for level in levels:
            added = (level.prolongation.T @ added @ level.prolongation).tocsr()
            found.append(replace(level, added=added))
            added = 2.0 * added
        return found

    def add_load(self, f: Floats, load: Floats) -> None:
        """Add the integrals of tau (v . grad phi) f to ``load`` (n, channels), f (q, channels) or (1, channels)."""
        if self.upstream.any():
            samples = self.space.samples
            of_samples = samples.places, samples.weights, self.velocity, self.upstream
            add_upstream(*kernel_arguments(self.space), *of_samples, np.ascontiguousarray(f, dtype=np.float64), load)

    def _add(
        self,
        data: Floats,
        upstream: Floats,
        terms: int,
        a: Floats | None = None,
        c: Floats | None = None,
        of_a: Floats | None = None,
    ) -> None:
        space, samples, none = self.space, self.space.samples, np.zeros(1)
        coefficients = none if a is None else a, self.of_a[:0] if of_a is None else of_a, none if c is None else c
        of_samples = samples.places, samples.weights, samples.directions, self.velocity, upstream
        matrix = space.indptr, space.indices, data
        add_transport(*kernel_arguments(space), *of_samples, *coefficients, terms, matrix)


def upstream_times(speed: Floats, a: Floats, spacing: float) -> Floats:
    """Return tau (q,) where v is ``speed`` (q,) long and the diffusivity is ``a`` (q,) or (1,)."""
    moving = speed > 0
    across = np.divide(spacing, speed, out=np.zeros_like(speed), where=moving)
    inverse = np.divide(a, speed * spacing, out=np.full_like(speed, np.inf), where=moving)  # of the cell number
    share = np.maximum(0.0, 1.0 - UPWIND_CELL_NUMBER * inverse)
    limit = np.where(share > 0, inverse, 0.0)
    return np.asarray(across * share / np.hypot(LIMIT_BY_SPEED, LIMIT_BY_DIFFUSION * limit))


#: At boundaries a velocity is read so far inside the cell, as a share of the way to its middle: it may jump there.
INSIDE_SHARE = 1e-6


def velocity_at(velocity: VectorField, points: Floats, normals: Floats, lattice: Lattice) -> Floats:
    """Return the tangential part (k, d) of a velocity at ``points`` (k, d) with ``normals`` (k, c, d).

    Raises
    ------
    InputError
        If it has another number of coordinates.
    """
    v = evaluate_data(velocity, lattice.to_scene(points), None, "the velocity")
    if v.shape[1] != points.shape[1]:
        raise InputError(f"the velocity must be vectors of shape (n, {points.shape[1]}), got (n, {v.shape[1]}).")
    along = np.einsum("qd,qcd->qc", v, normals)
    return np.asarray(v - np.einsum("qc,qcd->qd", along, normals))


def outward_speed(velocity: VectorField, samples: BoundarySamples, lattice: Lattice) -> Floats:
    """Return v . b (b,) at boundary samples, b out of their cells."""
    points = samples.points + INSIDE_SHARE * (samples.centres - samples.points)
    return np.asarray(np.einsum("bd,bd->b", velocity_at(velocity, points, samples.normals, lattice), samples.conormals))
