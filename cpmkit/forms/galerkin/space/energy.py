"""Matrices and loads of the splines: energies summed over samples, and the stabilisation that completes them.

The energy of u is sum w a |tangential part of grad u|^2. It does not determine the spline off the manifold. The
stabilisation does: e1 a |normal derivative|^2, e2 h^2 a (n' H n)^2 and, of cubic splines, e3 h^4 a times the square of
the third derivative along normals, summed over the same samples; and the ghost penalty, squares of differences of
coefficients along the axes of an order one above the degree. The derivatives along normals vanish where u is constant
along normals, the ghost penalty where u is a polynomial of the degree of the splines.

Unknowns whose splines the manifold only grazes have almost no energy. A floor holds their differences along the axes,
so that no boundary term outweighs the energy; it vanishes on polynomials of a lower degree than the splines', where a
penalty on the coefficients themselves would leave an error that grows with refinement and with contrasts of a.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.dof_map import lines_through
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from cpmkit.forms.galerkin.space.spline_space import SplineSpace

#: The slice of all samples.
EVERY_SAMPLE = slice(None)


@dataclass(frozen=True)
class Stabilisation:
    """Factors of the stabilisation, numbers without unit.

    Attributes
    ----------
    e1, e2 : float
        Of the first and second derivative along normals.
    g : float
        Of the ghost penalty.
    e3 : float
        Of the third derivative along normals, of cubic splines.
    """

    e1: float
    e2: float
    g: float
    e3: float = 0.0


#: No stabilisation.
NO_STABILISATION = Stabilisation(0.0, 0.0, 0.0)
#: Stabilisation by degree and name: "accurate" has half the error of "default" and twice the iterations.
STABILISATIONS_OF_DEGREE = {
    1: {"default": Stabilisation(1e-1, 1e-2, 1e-4), "accurate": Stabilisation(1e-2, 1e-2, 1e-4)},
    2: {"default": Stabilisation(1e-2, 1e-2, 1e-4), "accurate": Stabilisation(1e-3, 1e-3, 1e-4)},
    3: {"default": Stabilisation(1e-2, 1e-2, 1e-4, 1e-2), "accurate": Stabilisation(1e-3, 1e-3, 1e-5, 1e-3)},
}
#: Those of degree 2.
STABILISATIONS = STABILISATIONS_OF_DEGREE[2]
#: The floor acts where the diagonal over the coefficient is below this share of its median.
LIGHT_SHARE = 1e-4
#: The floor as a share of that median. For splines of degree 1: with half of it a circle in a knot plane is still
#: definite, with a tenth it is not.
FLOOR_SHARE, LINEAR_FLOOR_SHARE = 1e-3, 0.2


def differences(order: int) -> Floats:
    """Return (order + 1,) the factors of a difference of neighbouring values: 1, -2, 1 for order 2."""
    return np.array([(-1.0) ** (order - k) * comb(order, k) for k in range(order + 1)])


def stiffness(space: SplineSpace, a: Floats | float, stabilisation: Stabilisation) -> csr_array:
    """Return K + S (n, n), symmetric to the last bit: the energy and the stabilisation.

    Parameters
    ----------
    space : SplineSpace
        The splines and their samples.
    a : float or (q,) or (q, d, d) float64
        The coefficient at the samples; of symmetric tensors, of which the tangential part counts.
    stabilisation : Stabilisation
        `NO_STABILISATION` leaves K.
    """
    data = energy_data(space, a, None, stabilisation)
    add_ghosts(space, a, stabilisation, data)
    return space.matrix(data)


def stiffness_with_floor(
    space: SplineSpace,
    a: Floats | float,
    stabilisation: Stabilisation,
    c: Floats | float | None = None,
    scale: Floats | None = None,
) -> csr_array:
    """Return the stiffness of ``a`` plus the mass of ``c``, with stabilisation and floor.

    Parameters
    ----------
    space, a, stabilisation
        As of `stiffness`.
    c : float or (q,) float64, optional
        The coefficient of u v at the samples; None for no such term.
    scale : (q,) float64, optional
        The coefficient that stabilisation and floor are proportional to; by default ``a``.
    """
    data = energy_data(space, a, c, stabilisation, scale)
    diagonal = space.matrix(data).diagonal()
    scale_or_a: Floats | float = a if scale is None else scale
    add_ghosts(space, scale_or_a, stabilisation, data)
    add_floor(space, scale_or_a, diagonal, data)
    return space.matrix(data)


def mass(space: SplineSpace, c: Floats | float) -> csr_array:
    """Return the matrix (n, n) of sum w c u v, with ``c`` a number or (q,) at the samples."""
    return space.matrix(energy_data(space, None, c, NO_STABILISATION))


def load(space: SplineSpace, f: Floats, some: slice = EVERY_SAMPLE) -> Floats:
    """Return (n, channels) sum w f v over ``some`` samples, with ``f`` (q, channels) at them, or (1, channels)."""
    from cpmkit.forms.galerkin.space.sample_kernels import add_load

    dof_map, samples = space.dof_map, space.samples
    loads = np.zeros((dof_map.size, f.shape[1]))
    f = np.ascontiguousarray(f, dtype=np.float64)
    sample_arrays = dof_map.patch[some], *_spline_counts(space), samples.places[some], samples.weights[some]
    add_load(dof_map.unknowns, *sample_arrays, f, loads)
    return loads


def gradient_load(space: SplineSpace, field: Floats) -> Floats:
    """Return (n,) sum w field . grad v, ``field`` (p, d) at the first samples, of which the tangential part counts."""
    from cpmkit.forms.galerkin.space.sample_kernels import add_slope_load_of_samples

    dof_map, samples, loads = space.dof_map, space.samples, np.zeros(space.dof_map.size)
    sample_arrays = dof_map.patch, *_spline_counts(space), samples.places, samples.directions, samples.weights
    field = np.ascontiguousarray(field, dtype=np.float64)
    add_slope_load_of_samples(dof_map.unknowns, dof_map.spacing, *sample_arrays, field, loads)
    return loads


def values_at_samples(space: SplineSpace, u: Floats, some: slice | Ints = EVERY_SAMPLE) -> Floats:
    """Return (q, channels) the values of u at ``some`` samples, from coefficients ``u`` (n, channels)."""
    from cpmkit.forms.galerkin.space.sample_kernels import read_values

    dof_map, places = space.dof_map, space.samples.places[some]
    values = np.empty((len(places), u.shape[1]))
    read_values(dof_map.unknowns, dof_map.patch[some], *_spline_counts(space), places, np.ascontiguousarray(u), values)
    return values


def gradients_at_samples(space: SplineSpace, count: int, u: Floats) -> Floats:
    """Return (count, channels, d) the tangential gradients of u at the first ``count`` samples."""
    from cpmkit.forms.galerkin.space.sample_kernels import read_slopes_at_samples

    dof_map, samples = space.dof_map, space.samples
    gradients = np.empty((count, u.shape[1], dof_map.dim))
    sample_arrays = dof_map.patch, *_spline_counts(space), samples.places, samples.directions
    read_slopes_at_samples(dof_map.unknowns, dof_map.spacing, *sample_arrays, np.ascontiguousarray(u), gradients)
    return _with_true_lengths(gradients, dof_map.magnification(dof_map.patch[:count]))


def gradients_at(space: SplineSpace, patch: Ints, points: Floats, normals: Floats, u: Floats) -> Floats:
    """Return (k, channels, d) the tangential gradients of u at ``points`` (k, d) in the patches ``patch`` (k,).

    ``normals`` (k, c, d) are orthonormal and normal to the manifold there.
    """
    from cpmkit.forms.galerkin.space.sample_kernels import read_slopes

    dof_map = space.dof_map
    gradients = np.empty((len(points), u.shape[1], points.shape[1]))
    at = np.ascontiguousarray(dof_map.magnify(patch, points))
    arrays = (at, np.ascontiguousarray(normals), np.ascontiguousarray(u))
    read_slopes(dof_map.unknowns, dof_map.cells, dof_map.spacing, patch, *arrays, gradients)
    return _with_true_lengths(gradients, dof_map.magnification(patch))


def _with_true_lengths(gradients: Floats, magnification: Floats) -> Floats:
    """Return gradients (k, channels, d) of magnified splines as gradients of the splines themselves, in place."""
    if len(magnification) > 1:
        gradients *= magnification[:, None, None]
    return gradients


def energy_data(
    space: SplineSpace,
    a: Floats | float | None,
    c: Floats | float | None,
    stabilisation: Stabilisation,
    scale: Floats | None = None,
) -> Floats:
    """Return the entries (z,) of the sums over samples, in the pattern of ``space``: neither ghost penalty nor floor.

    ``a`` or ``c`` may be None for no such term; ``scale`` as of `stiffness_with_floor`.
    """
    d = space.samples.places.shape[1]
    scalars, tensors = np.zeros(0), np.zeros((0, d, d))
    if a is not None:
        if scale is not None and np.ndim(a) < 3:
            a = np.multiply.outer(np.broadcast_to(a, len(space.samples)), np.eye(d))
        scalars = mean_coefficient(space, a) if scale is None else scale
        tensors = np.ascontiguousarray(a, dtype=np.float64) if np.ndim(a) == 3 else tensors
    return _summed_energy(space, scalars, tensors, np.zeros(0) if c is None else _at_each(c), stabilisation)


def stabilisation_data(space: SplineSpace, a: Floats | float, stabilisation: Stabilisation) -> Floats:
    """Return the entries (z,) of the derivatives along normals alone, without the energy, in proportion to ``a``."""
    d = space.samples.places.shape[1]
    return _summed_energy(space, _at_each(a), np.zeros((1, d, d)), np.zeros(0), stabilisation)


def _summed_energy(
    space: SplineSpace, scalars: Floats, tensors: Floats, masses: Floats, stabilisation: Stabilisation
) -> Floats:
    from cpmkit.forms.galerkin.space.energy_kernels import add_energy

    samples, data = space.samples, np.zeros(len(space.indices))
    arrays = (samples.places, samples.weights, samples.directions, scalars, tensors, masses)
    factors = stabilisation.e1, stabilisation.e2, stabilisation.e3
    add_energy(*kernel_arguments(space), *arrays, *factors, (space.indptr, space.indices, data))
    return data


def add_ghosts(space: SplineSpace, a: Floats | float, stabilisation: Stabilisation, data: Floats) -> None:
    """Add the ghost penalty g a h^(m - 2) sum (differences of order degree + 1)^2 to the entries ``data``."""
    means = space.means(mean_coefficient(space, a))
    scale = stabilisation.g * space.dof_map.spacing ** (space.manifold_dim - 2)
    add_differences(space, space.runs, scale * means[space.runs].mean(axis=1), data)
    add_differences(space, space.short_runs, scale * means[space.short_runs].mean(axis=1), data)


def add_floor(space: SplineSpace, a: Floats | float, diagonal: Floats, data: Floats) -> None:
    """Add the floor to the entries ``data``; ``diagonal`` (n,) is that of the energy, before ghosts and conditions.

    For splines of degree 1 differences along lines would penalise slopes. There the floor is on second differences
    along runs, and only beside boundaries, for elsewhere it would cost iterations and is of no use.
    """
    means = space.means(mean_coefficient(space, a))
    ratio = diagonal / means
    median = float(np.median(ratio))
    light = ratio < LIGHT_SHARE * median
    if space.dof_map.degree == 1:
        runs = space.runs[(light & _read_by_boundary_patches(space))[space.runs].any(axis=1)]
        factors = LINEAR_FLOOR_SHARE * median * means[runs].mean(axis=1)
        add_differences(space, runs, factors, data)
        return
    lines = lines_through(space.dof_map, space.heaviest[light])
    factors = np.tile(FLOOR_SHARE * median * means[light], space.dof_map.dim)
    add_differences(space, lines, factors, data)


def _read_by_boundary_patches(space: SplineSpace) -> Bools:
    """Return (n,) which unknowns are read by patches with samples on boundaries, which have weight zero."""
    is_read = np.zeros(space.dof_map.size, dtype=bool)
    is_read[space.dof_map.unknowns[space.dof_map.patch[space.samples.weights == 0]]] = True
    return is_read


def add_differences(space: SplineSpace, runs: Ints, factors: Floats, data: Floats) -> None:
    """Add to the entries ``data`` squared differences of order k - 1 along ``runs`` (r, k), times ``factors`` (r,)."""
    from cpmkit.forms.galerkin.space.pattern_kernels import add_squares
    from cpmkit.runtime.inverse_index import inverse_index

    by_unknown = inverse_index(runs.ravel(), space.dof_map.size)
    add_squares(runs, *by_unknown, differences(runs.shape[1] - 1), factors, (space.indptr, space.indices, data))


def mean_coefficient(space: SplineSpace, a: Floats | float) -> Floats:
    """Return (q,), or (1,) for all, a coefficient at the samples as a number: of a tensor the mean over tangents."""
    return _at_each(a) if np.ndim(a) < 3 else mean_over_tangents(np.asarray(a), space.samples.normals)


def mean_over_tangents(tensors: Floats, normals: Floats) -> Floats:
    """Return (q,) the means of t . A t over unit tangents t of tensors A (q, d, d), with normals (q, c, d)."""
    normal = np.einsum("qci,qij,qcj->q", normals, tensors, normals)
    tangents = normals.shape[2] - normals.shape[1]
    return np.asarray((np.trace(tensors, axis1=1, axis2=2) - normal) / tangents)


def _at_each(values: Floats | float) -> Floats:
    return np.ascontiguousarray(np.atleast_1d(values), dtype=np.float64)


def _spline_counts(space: SplineSpace) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return tuples as long as there are splines along the first axes and along the third, one in the plane."""
    from cpmkit.forms.galerkin.space.energy_kernels import SPLINES

    along = SPLINES[space.dof_map.degree]
    return along, along if space.dof_map.dim == 3 else (0,)


def kernel_arguments(space: SplineSpace) -> tuple[Ints, float, tuple[int, ...], Any, Ints]:
    """Return the first arguments of the kernels that sum over samples: of patches, splines and their samples."""
    from cpmkit.forms.galerkin.space.energy_kernels import SPLINES

    dof_map = space.dof_map
    return dof_map.unknowns, dof_map.spacing, SPLINES[dof_map.degree], *space.samples_by_patch()
