"""The matrices and loads of the Galerkin form: energies over samples, and what makes them independent of position.

The energy of u is sum w a |tangential part of grad u|^2. It says nothing of how the spline goes on off the manifold;
there it is held by e1 a |normal part|^2, e2 h^2 a (n' H n)^2, of cubic splines e3 h^4 a times the square of the third
derivative along normals, and the ghost penalty, squares of differences of coefficients along the axes, of one order
more than the degree. All vanish where u is constant along normals or, the ghosts, a polynomial of the splines' degree.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.space.spline_space import SplineSpace, lines_through
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Samples are gone through from the first to the last.
EVERY_SAMPLE = slice(None)


@dataclass(frozen=True)
class Stabilisation:
    """How strongly u is held off the manifold: constants without units.

    Attributes
    ----------
    e1, e2 : float
        Of the slope along normals, and of the second derivative.
    g : float
        Of the ghost penalty.
    e3 : float
        Of the third derivative, of cubic splines.
    """

    e1: float
    e2: float
    g: float
    e3: float = 0.0


#: Half the error and twice the iterations go from the first to the second.
STABILISATIONS = {"default": Stabilisation(1e-2, 1e-2, 1e-4), "accurate": Stabilisation(1e-3, 1e-3, 1e-4)}
#: The same of the degrees 1 and 3.
STABILISATIONS_OF_DEGREE = {
    1: {"default": Stabilisation(1e-1, 1e-2, 1e-4), "accurate": Stabilisation(1e-2, 1e-2, 1e-4)},
    2: STABILISATIONS,
    3: {"default": Stabilisation(1e-2, 1e-2, 1e-4, 1e-2), "accurate": Stabilisation(1e-3, 1e-3, 1e-5, 1e-3)},
}


def differences(order: int) -> Floats:
    """Return (order + 1,) the factors of a difference of neighbouring values: 1, -2, 1 of order 2."""
    return np.array([(-1.0) ** (order - k) * comb(order, k) for k in range(order + 1)])


def stiffness(space: SplineSpace, a: Floats | float, strength: Stabilisation) -> csr_array:
    """Return K + S (n, n), symmetric to the last bit: the energy and what holds u off the manifold.

    Parameters
    ----------
    space : Space
        The splines and their samples.
    a : float or (q,) or (q, d, d) float64
        The coefficient at the samples; of a tensor, which is symmetric, the tangential part counts.
    strength : Strength
        Of what holds u off the manifold; ``Strength(0, 0, 0)`` leaves K.
    """
    data = energy_data(space, a, None, strength)
    add_ghosts(space, a, strength, data)
    return space.matrix(data)


def mass(space: SplineSpace, c: Floats | float) -> csr_array:
    """Return the matrix (n, n) of sum w c u v, with ``c`` a number or (q,) at the samples."""
    return space.matrix(energy_data(space, None, c, Stabilisation(0.0, 0.0, 0.0)))


def convection_matrix(space: SplineSpace, field: Floats) -> csr_array:
    """Return the matrix (n, n) of sum w u (field . grad v), ``field`` (p, d) at the first samples, zero at others."""
    from cpmkit.forms.galerkin.advection import CONSERVATIVE, add_transport

    samples, data, none = space.samples, np.zeros(len(space.indices)), np.zeros(1)
    velocity = np.zeros(samples.places.shape)
    velocity[: len(field)] = field
    of_samples = (
        samples.places,
        samples.weights,
        samples.directions,
        velocity,
        np.zeros(len(velocity)),
    )
    matrix = space.indptr, space.indices, data
    add_transport(*kernel_arguments(space), *of_samples, none, velocity[:0], none, CONSERVATIVE, matrix)
    return space.matrix(-data)


def load(space: SplineSpace, f: Floats, some: slice = EVERY_SAMPLE) -> Floats:
    """Return (n, channels) sum w f v over ``some`` samples, with ``f`` (q, channels) at them, or (1, channels)."""
    from cpmkit.forms.galerkin.space.sample_kernels import add_load

    dof_map, samples = space.dof_map, space.samples
    loads = np.zeros((dof_map.size, f.shape[1]))
    f = np.ascontiguousarray(f, dtype=np.float64)
    of_samples = dof_map.patch[some], *_spline_counts(space), samples.places[some], samples.weights[some]
    add_load(dof_map.unknowns, *of_samples, f, loads)
    return loads


def values_at_samples(space: SplineSpace, u: Floats, some: slice | Ints = EVERY_SAMPLE) -> Floats:
    """Return (q, channels) the values at ``some`` samples of the splines with coefficients ``u`` (n, channels)."""
    from cpmkit.forms.galerkin.space.sample_kernels import read_values

    dof_map, places = space.dof_map, space.samples.places[some]
    values = np.empty((len(places), u.shape[1]))
    read_values(dof_map.unknowns, dof_map.patch[some], *_spline_counts(space), places, np.ascontiguousarray(u), values)
    return values


def gradients_at(space: SplineSpace, patch: Ints, points: Floats, normals: Floats, u: Floats) -> Floats:
    """Return (k, channels, d) the tangential gradients of the splines with coefficients ``u`` (n, channels).

    At ``points`` (k, d) in the patches ``patch`` (k,), where ``normals`` (k, c, d) are normal to the manifold.
    """
    from cpmkit.forms.galerkin.space.sample_kernels import read_slopes

    dof_map = space.dof_map
    slopes = np.empty((len(points), u.shape[1], points.shape[1]))
    arrays = (np.ascontiguousarray(points), np.ascontiguousarray(normals), np.ascontiguousarray(u))
    read_slopes(dof_map.unknowns, dof_map.cells, dof_map.spacing, patch, *arrays, slopes)
    return slopes


def gradients_at_samples(space: SplineSpace, count: int, u: Floats) -> Floats:
    """Return (count, channels, d) the same at the first ``count`` samples."""
    from cpmkit.forms.galerkin.space.sample_kernels import read_slopes_at_samples

    dof_map, samples = space.dof_map, space.samples
    slopes = np.empty((count, u.shape[1], dof_map.dim))
    of_samples = dof_map.patch, *_spline_counts(space), samples.places, samples.directions
    read_slopes_at_samples(dof_map.unknowns, dof_map.spacing, *of_samples, np.ascontiguousarray(u), slopes)
    return slopes


def load_against_slopes(space: SplineSpace, field: Floats) -> Floats:
    """Return (n,) sum w field . grad v, ``field`` (p, d) at the first samples, of which the tangential part counts."""
    from cpmkit.forms.galerkin.space.sample_kernels import add_slope_load_of_samples

    dof_map, samples, loads = space.dof_map, space.samples, np.zeros(space.dof_map.size)
    of_samples = dof_map.patch, *_spline_counts(space), samples.places, samples.directions, samples.weights
    field = np.ascontiguousarray(field, dtype=np.float64)
    add_slope_load_of_samples(dof_map.unknowns, dof_map.spacing, *of_samples, field, loads)
    return loads


def _spline_counts(space: SplineSpace) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return tuples as long as there are splines along the first axes and along the third, one in the plane."""
    from cpmkit.forms.galerkin.space.energy_kernels import SPLINES

    along = SPLINES[space.dof_map.degree]
    return along, along if space.dof_map.dim == 3 else (0,)


def energy_data(
    space: SplineSpace,
    a: Floats | float | None,
    c: Floats | float | None,
    strength: Stabilisation,
    holding: Floats | None = None,
) -> Floats:
    """Return the entries of the sums over samples, in the pattern of ``space``: no ghosts, no floor.

    ``holding`` (q,): what holds u off the manifold is in units of it, of ``a`` itself unless given.
    """
    from cpmkit.forms.galerkin.space.energy_kernels import add_energy

    samples = space.samples
    d = samples.places.shape[1]
    scalars, tensors, masses = np.zeros(0), np.zeros((0, d, d)), np.zeros(0)
    if a is not None:
        if holding is not None and np.ndim(a) < 3:
            a = np.multiply.outer(np.broadcast_to(a, len(samples)), np.eye(d))
        scalars = conductivity(space, a) if holding is None else holding
        tensors = np.ascontiguousarray(a, dtype=np.float64) if np.ndim(a) == 3 else tensors
    if c is not None:
        masses = _at_each(c)
    data = np.zeros(len(space.indices))
    arrays = (samples.places, samples.weights, samples.directions, scalars, tensors, masses)
    matrix = (space.indptr, space.indices, data)
    add_energy(*kernel_arguments(space), *arrays, strength.e1, strength.e2, strength.e3, matrix)
    return data


def stabilisation_data(space: SplineSpace, a: Floats | float, strength: Stabilisation) -> Floats:
    """Return the entries of what holds u off the manifold at the samples, in units of ``a``, without an energy."""
    from cpmkit.forms.galerkin.space.energy_kernels import add_energy

    samples, data = space.samples, np.zeros(len(space.indices))
    d = samples.places.shape[1]
    arrays = (
        samples.places,
        samples.weights,
        samples.directions,
        _at_each(a),
        np.zeros((1, d, d)),
        np.zeros(0),
    )
    matrix = space.indptr, space.indices, data
    add_energy(*kernel_arguments(space), *arrays, strength.e1, strength.e2, strength.e3, matrix)
    return data


def add_ghosts(space: SplineSpace, a: Floats | float, strength: Stabilisation, data: Floats) -> None:
    """Add the ghost penalty g a h^(m - 2) sum (differences of order degree + 1)^2 to the entries ``data``."""
    means = space.means(conductivity(space, a))
    scale = strength.g * space.dof_map.spacing ** (space.manifold_dim - 2)
    add_differences(space, space.runs, scale * means[space.runs].mean(axis=1), data)
    add_differences(space, space.short_runs, scale * means[space.short_runs].mean(axis=1), data)


def add_differences(space: SplineSpace, runs: Ints, factors: Floats, data: Floats) -> None:
    """Add ``factors`` (r,) times the squares of the differences of all of ``runs`` (r, k) to the entries ``data``."""
    from cpmkit.forms.galerkin.space.pattern_kernels import add_squares
    from cpmkit.runtime.inverse_index import inverse_index

    found = inverse_index(runs.ravel(), space.dof_map.size)
    add_squares(runs, *found, differences(runs.shape[1] - 1), factors, (space.indptr, space.indices, data))


def conductivity(space: SplineSpace, a: Floats | float) -> Floats:
    """Return (q,), or (1,) for all, the coefficient at the samples as a number: of a tensor the mean over tangents."""
    return _at_each(a) if np.ndim(a) < 3 else mean_over_tangents(np.asarray(a), space.samples.normals)


def mean_over_tangents(tensors: Floats, normals: Floats) -> Floats:
    """Return (q,) the mean over tangents of tensors (q, d, d), ``normals`` (q, c, d) orthonormal."""
    normal = np.einsum("qci,qij,qcj->q", normals, tensors, normals)
    tangents = normals.shape[2] - normals.shape[1]
    return np.asarray((np.trace(tensors, axis1=1, axis2=2) - normal) / tangents)


def _at_each(values: Floats | float) -> Floats:
    return np.ascontiguousarray(np.atleast_1d(values), dtype=np.float64)


def kernel_arguments(space: SplineSpace) -> tuple[Ints, float, tuple[int, ...], Any, Ints]:
    """Return what kernels take of a space first: the unknowns of patches, the spacing, the splines, their samples."""
    from cpmkit.forms.galerkin.space.energy_kernels import SPLINES

    dof_map = space.dof_map
    return dof_map.unknowns, dof_map.spacing, SPLINES[dof_map.degree], *space.by_patch()


#: Diagonals over coefficients that are below this share of their median are floored.
LIGHT_SHARE = 1e-4
#: The floor, as a share of that median.
FLOOR_SHARE = 1e-3
#: The same of splines of degree 1: with half of it a circle in a knot plane is still definite, with a tenth it is not.
LINEAR_FLOOR_SHARE = 0.2


def stiffness_with_floor(
    space: SplineSpace,
    a: Floats | float,
    strength: Stabilisation,
    c: Floats | float | None = None,
    holding: Floats | None = None,
) -> csr_array:
    """Return the stiffness of ``a`` plus the mass of ``c``, with the floor under the unknowns that are light.

    Parameters
    ----------
    space, a, strength
        As of `stiffness`.
    c : float or (q,) float64, optional
        The coefficient of u v at the samples; None for none.
    holding : (q,) float64, optional
        What holds u off the manifold is in units of it; of ``a`` itself unless given.
    """
    data = energy_data(space, a, c, strength, holding)
    diagonal = space.matrix(data).diagonal()
    held: Floats | float = a if holding is None else holding
    add_ghosts(space, held, strength, data)
    add_floor(space, held, diagonal, data)
    return space.matrix(data)


def add_floor(space: SplineSpace, a: Floats | float, diagonal: Floats, data: Floats) -> None:
    """Add the floor to the entries ``data``; ``diagonal`` (n,) is that of the energy, before ghosts and conditions."""
    means = space.means(conductivity(space, a))
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
    """Return (n,) which unknowns patches read that hold samples of boundaries, those without weight."""
    found = np.zeros(space.dof_map.size, dtype=bool)
    found[space.dof_map.unknowns[space.dof_map.patch[space.samples.weights == 0]]] = True
    return found
