"""Matrices and loads of the splines: energies summed over samples, and the stabilisation off the manifold.

The energy of u is sum w a |tangential part of grad u|^2. The energy does not determine the spline off the manifold; the
stabilisation does: e1 a |normal derivative|^2, e2 h^2 a (n' H n)^2 with H the Hessian of u and, for cubic splines, e3
h^4 a times the square of the third derivative along normals, summed over the same samples; and the ghost penalty, the
sum of squared differences of the coefficients along the axes, of order degree + 1. The derivatives along normals vanish
where u is constant along normals, the ghost penalty where u is a polynomial of the degree of the splines.

Splines whose support contains almost nothing of the manifold have almost no energy. A further penalty, the floor, on
the differences of their coefficients along the axes makes the energy larger than boundary terms. The floor vanishes on
polynomials of a lower degree than the splines'; a penalty on the coefficients themselves would cause an error that
grows with refinement and with contrasts of a.
"""

from __future__ import annotations

from math import comb
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.dof_map import lines_through
from cpmkit.forms.galerkin.options import Stabilisation
from cpmkit.forms.galerkin.space.pattern_kernels import add_squared_differences
from cpmkit.forms.galerkin.space.sample_kernels import SPLINES, add_gradient_load, add_load, fill_gradients, fill_values
from cpmkit.forms.galerkin.space.spline_space import SplineSpace
from cpmkit.runtime.index_sets import inverse_index
from cpmkit.types import Floats, Ints, SparseMatrix

#: The slice of all samples.
EVERY_SAMPLE = slice(None)


#: The floor is added for unknowns whose diagonal entry over the coefficient is below this share of the median.
LIGHT_SHARE = 1e-4
#: The factor of the floor as a share of that median, for degrees 2 and 3 and for degree 1, where the matrix of a circle
#: in a knot plane is still definite with half of this number, but not with a tenth.
FLOOR_SHARE, LINEAR_FLOOR_SHARE = 1e-3, 0.2
#: A part of a solid is thin if all splines there have integrals below this share of a cell: slabs up to .4 spacings.
THIN_SHARE = 1 / 3
#: The floor of thin patches over the ghost penalty. In rods of .01 spacings products of squares of the coordinates have
#: energies below rounding; with 1e-10 some eigenvalues are still wrong.
THIN_FLOOR = 1e-8


def differences(order: int) -> Floats:
    """Return the coefficients (order + 1,) of a finite difference of neighbouring values: 1, -2, 1 for order 2."""
    return np.array([(-1.0) ** (order - k) * comb(order, k) for k in range(order + 1)])


def stiffness_with_floor(
    space: SplineSpace,
    a: Floats | float,
    stabilisation: Stabilisation,
    c: Floats | float | None = None,
    scale: Floats | None = None,
) -> SparseMatrix:
    """Return the matrix (n, n) of sum w (a grad u . grad v + c u v), with the stabilisation and the floor.

    The floor is the penalty on splines that hardly touch the manifold, see above; solids need none.

    ``a`` float or (q,) or (q, d, d) float64: the diffusivity at the samples: numbers, or symmetric tensors whose
        tangential part is used.
    ``c`` float or (q,) float64: the coefficient of u v at the samples; None where there is no such term.
    ``scale`` (q,): the coefficient at the samples to which stabilisation and floor are proportional; by default ``a``.
    """
    data = energy_data(space, a, c, stabilisation, scale)
    diagonal = space.matrix(data).diagonal()
    scale_or_a: Floats | float = a if scale is None else scale
    add_ghosts(space, scale_or_a, stabilisation, data)
    if space.samples.codim:  # on solids the ghost penalty suffices, and the floor would double the largest errors
        add_floor(space, scale_or_a, diagonal, data)
    return space.matrix(data)


def mass(space: SplineSpace, c: Floats | float) -> SparseMatrix:
    """Return the mass matrix (n, n), the sum of w c u v over the samples; ``c`` is a number or (q,) at the samples."""
    return space.matrix(energy_data(space, None, c, Stabilisation(0.0, 0.0, 0.0)))


def load(space: SplineSpace, f: Floats, some: slice = EVERY_SAMPLE) -> Floats:
    """Return the load (n, channels), the sum of w f v over the samples ``some`` for each spline v.

    ``f`` is (q, channels) at these samples, or (1, channels) where it is constant.
    """
    dof_map, samples = space.dof_map, space.samples
    loads = np.zeros((dof_map.size, f.shape[1]))
    f = np.ascontiguousarray(f, dtype=np.float64)
    sample_arrays = dof_map.patch[some], *_spline_count_tuples(space), samples.places[some], samples.weights[some]
    add_load(dof_map.unknowns, *sample_arrays, f, loads)
    return loads


def gradient_load(space: SplineSpace, field: Floats) -> Floats:
    """Return the load (n,), the sum of w field . grad v over the first p samples for each spline v.

    Only the tangential part of ``field`` (p, d) at these samples is used.
    """
    dof_map, samples, loads = space.dof_map, space.samples, np.zeros(space.dof_map.size)
    sample_arrays = dof_map.patch, *_spline_count_tuples(space), samples.places, samples.directions, samples.weights
    field = np.ascontiguousarray(field, dtype=np.float64)
    add_gradient_load(dof_map.unknowns, dof_map.spacing, *sample_arrays, field, loads)
    return loads


def values_at_samples(space: SplineSpace, u: Floats, some: slice | Ints = EVERY_SAMPLE) -> Floats:
    """Return the values (q, channels) at the samples ``some`` of the splines with coefficients ``u`` (n, channels)."""
    dof_map, places = space.dof_map, space.samples.places[some]
    values = np.empty((len(places), u.shape[1]))
    fill_values(
        dof_map.unknowns, dof_map.patch[some], *_spline_count_tuples(space), places, np.ascontiguousarray(u), values
    )
    return values


def gradients_at_samples(space: SplineSpace, u: Floats, some: slice = EVERY_SAMPLE) -> Floats:
    """Return the tangential gradients (q, channels, d) at samples ``some`` for the coefficients ``u`` (n, channels)."""
    dof_map, samples, patch = space.dof_map, space.samples, space.dof_map.patch[some]
    gradients = np.empty((len(patch), u.shape[1], dof_map.dim))
    sample_arrays = patch, *_spline_count_tuples(space), samples.places[some], samples.directions[some]
    fill_gradients(dof_map.unknowns, dof_map.spacing, *sample_arrays, np.ascontiguousarray(u), gradients)
    magnification = dof_map.magnification(patch)
    if len(magnification) > 1:  # lengths on magnified lattices are enlarged
        gradients *= magnification[:, None, None]
    return gradients


def energy_data(
    space: SplineSpace,
    a: Floats | float | None,
    c: Floats | float | None,
    stabilisation: Stabilisation,
    scale: Floats | None = None,
) -> Floats:
    """Return the entries (z,) of the matrix of energy, mass and derivatives along normals, summed over the samples.

    They are in the sparsity pattern of ``space``, without ghost penalty and floor. The arguments are those of
    `stiffness_with_floor`; ``a`` or ``c`` is None where there is no such term.
    """
    d, dof_map = space.samples.places.shape[1], space.dof_map
    scalars, tensors = np.zeros(0), np.zeros((0, d, d))
    if a is not None:
        squares = dof_map.magnification(dof_map.patch) ** 2
        if len(squares) > 1:  # on magnified lattices slopes are smaller, while the weights of samples are unchanged
            a = np.asarray(a) * squares.reshape(-1, *(1,) * (np.ndim(a) - 1))
        if scale is not None and np.ndim(a) < 3:
            a = np.multiply.outer(np.broadcast_to(a, len(space.samples)), np.eye(d))
        scalars = scalar_coefficient(space, a) if scale is None else scale
        tensors = np.ascontiguousarray(a, dtype=np.float64) if np.ndim(a) == 3 else tensors
    return _sum_energy(space, scalars, tensors, np.zeros(0) if c is None else _as_array(c), stabilisation)


def stabilisation_data(space: SplineSpace, a: Floats | float, stabilisation: Stabilisation) -> Floats:
    """Return the entries (z,) of the penalty on derivatives along normals alone, with ``a``, (q,) or a number."""
    d = space.samples.places.shape[1]
    return _sum_energy(space, _as_array(a), np.zeros((1, d, d)), np.zeros(0), stabilisation)


def _sum_energy(
    space: SplineSpace, scalars: Floats, tensors: Floats, masses: Floats, stabilisation: Stabilisation
) -> Floats:
    """Return the entries (z,) that `add_energy` sums for a = ``scalars``, A = ``tensors`` and c = ``masses``."""
    from cpmkit.forms.galerkin.space.energy_kernels import add_energy

    samples, data = space.samples, np.zeros(len(space.indices))
    arrays = (samples.places, samples.weights, samples.directions, scalars, tensors, masses)
    factors = stabilisation.e1, stabilisation.e2, stabilisation.e3
    add_energy(*kernel_arguments(space), *arrays, *factors, (space.indptr, space.indices, data))
    return data


def add_ghosts(space: SplineSpace, a: Floats | float, stabilisation: Stabilisation, data: Floats) -> None:
    """Add the ghost penalty, with the :func:`scalar_coefficient` of ``a``, to the entries ``data`` (z,), in place.

    The penalty is g a h^(m - 2) times the sum of squared differences, of order degree + 1 along the runs of the space
    and of order degree along its short runs (sequences of neighbouring unknowns along an axis); m is the dimension of
    the manifold. In thin parts of a solid it is multiplied by :func:`thickness_of_patches`, as the energy is in effect,
    and `THIN_FLOOR` times the full penalty of order degree is added along all lines.
    """
    means = space.means_at_unknowns(scalar_coefficient(space, a))
    scale = stabilisation.g * space.dof_map.spacing ** (space.manifold_dim - 2)
    if not space.samples.codim:
        share = np.zeros(space.dof_map.size)
        np.maximum.at(share, space.dof_map.unknowns, thickness_of_patches(space)[:, None])
        lines = lines_through(space.dof_map, space.heaviest[share < 1])
        lines = lines[lines[:, 0] != lines[:, 1]]  # isolated pieces have one unknown all along
        add_differences(space, lines, THIN_FLOOR * scale * means[lines].mean(axis=1), data)
        means = means * np.minimum(share, 1.0)
    add_differences(space, space.runs, scale * means[space.runs].mean(axis=1), data)
    add_differences(space, space.short_runs, scale * means[space.short_runs].mean(axis=1), data)


def thickness_of_patches(space: SplineSpace) -> Floats:
    """Return for each patch (p,) of a solid the largest integral of a spline that it reads, over `THIN_SHARE` cells.

    The result is below 1 on thin patches; in a slab it is proportional to the thickness.
    """
    integrals = load(space, np.ones((1, 1)))[:, 0] / space.dof_map.spacing**space.dof_map.dim
    return np.asarray(integrals[space.dof_map.unknowns].max(axis=1) / THIN_SHARE)


def add_floor(space: SplineSpace, a: Floats | float, diagonal: Floats, data: Floats) -> None:
    """Add the floor, a penalty on differences of unknowns with little energy, to the entries ``data`` (z,), in place.

    The floor is proportional to the :func:`scalar_coefficient` of ``a``. ``diagonal`` (n,) is that of the energy,
    without ghost penalty and conditions. Differences are taken along the lines through these unknowns inside a patch.
    For degree 1 such differences would penalise slopes: then the floor has second differences along runs, beside
    boundaries only, since elsewhere it would only cost iterations.
    """
    means = space.means_at_unknowns(scalar_coefficient(space, a))
    ratio = diagonal / means
    median = float(np.median(ratio))
    light = ratio < LIGHT_SHARE * median
    if space.dof_map.degree == 1:
        beside = np.zeros(space.dof_map.size, dtype=bool)  # unknowns of patches with a sample of weight zero
        beside[space.dof_map.unknowns[space.dof_map.patch[space.samples.weights == 0]]] = True
        runs = space.runs[(light & beside)[space.runs].any(axis=1)]
        factors = LINEAR_FLOOR_SHARE * median * means[runs].mean(axis=1)
        add_differences(space, runs, factors, data)
        return
    lines = lines_through(space.dof_map, space.heaviest[light])
    factors = np.tile(FLOOR_SHARE * median * means[light], space.dof_map.dim)
    add_differences(space, lines, factors, data)


def add_differences(space: SplineSpace, runs: Ints, factors: Floats, data: Floats) -> None:
    """Add squared differences of order k - 1 along ``runs`` (r, k), times ``factors`` (r,), to a matrix of the space.

    Each run is k unknowns along an axis; ``data`` (z,), the entries of the matrix, are changed in place.
    """
    by_unknown = inverse_index(runs.ravel(), space.dof_map.size)
    matrix = space.indptr, space.indices, data
    add_squared_differences(runs, *by_unknown, differences(runs.shape[1] - 1), factors, matrix)


def scalar_coefficient(space: SplineSpace, a: Floats | float) -> Floats:
    """Return ``a`` at samples as scalars (q,), or (1,) for a number; tensors (q, d, d) become means over tangents."""
    return _as_array(a) if np.ndim(a) < 3 else mean_over_tangents(np.asarray(a), space.samples.normals)


def mean_over_tangents(tensors: Floats, normals: Floats) -> Floats:
    """Return the means (q,) of t . A t over the unit tangents t, for tensors A (q, d, d) and normals (q, c, d)."""
    normal = np.einsum("qci,qij,qcj->q", normals, tensors, normals)
    tangents = normals.shape[2] - normals.shape[1]
    return np.asarray((np.trace(tensors, axis1=1, axis2=2) - normal) / tangents)


def _as_array(values: Floats | float) -> Floats:
    """Return ``values`` as a contiguous array (q,), or (1,) for a number."""
    return np.ascontiguousarray(np.atleast_1d(values), dtype=np.float64)


def _spline_count_tuples(space: SplineSpace) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return two tuples whose lengths are the numbers of splines that a patch reads along an axis.

    The first is for the first two axes, the second for the third axis, of length 1 in the plane. Their entries are
    unused: a compiled kernel knows the length of a tuple when it is compiled.
    """
    along = SPLINES[space.dof_map.degree]
    return along, along if space.dof_map.dim == 3 else (0,)


def kernel_arguments(space: SplineSpace) -> tuple[Ints, float, tuple[int, ...], Any, Ints]:
    """Return the first arguments of `add_energy`: unknowns, spacing, splines, and the samples sorted by patch.

    The last two are the numbers (q,) of the samples sorted by patch, and the first sample (p + 1,) of each patch. They
    are computed at each call, in a thirtieth of an assembly: stored, they would add a tenth to the samples' memory.
    """
    dof_map = space.dof_map
    start, order = inverse_index(dof_map.patch, len(dof_map.cells))
    return dof_map.unknowns, dof_map.spacing, SPLINES[dof_map.degree], order, start
