"""The terms that the conditions of a scene add to the matrix and to the load, and the flux through boundaries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import fsum
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.galerkin.conditions.boundary_coefficients import (
    conormal_flux,
    local_widths,
    one_sided_value,
    prescribed_conductivity,
)
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.conditions.imposed_conditions import (
    ImposedCondition,
    StateFluxSamples,
    conditions_with_law,
    linearised_flux,
)
from cpmkit.forms.galerkin.conditions.nitsche import (
    COUPLING_PENALTY,
    TIP_PENALTY,
    advection_jump_terms,
    inflow_terms,
    interface_products,
    one_sided_products,
    scale_rows,
    side_factors,
)
from cpmkit.forms.galerkin.conditions.sample_products import LoadRows, SampleRows, sample_rows, symmetric_sum
from cpmkit.grid.lattice import Lattice
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.laws import Flux, Interface, Mixed, Nonlinear, Spectral, Value, beta_at
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class AddedTerms:
    """Terms that several conditions add to the matrix and the load.

    Attributes
    ----------
    matrix : csr_array (n, n)
        The sum of their terms in the matrix.
    load : csr_array (n, k) or LoadRows
        The matrix that maps the values of the data of all conditions, one after the other, to the load.
    data : tuple of (Data, (k_i, d) float64, str)
        For each condition the data, the points at which they are evaluated, and their label in error messages.
    """

    matrix: csr_array
    load: csr_array | LoadRows
    data: tuple[tuple[Data, Floats, str], ...]

    def loads(self, channels: int, time: float | None) -> Floats:
        """Return the load (n, channels) of these terms, with data at ``time``."""
        values = [evaluate_data(data, points, channels, label, time) for data, points, label in self.data]
        return np.asarray(self.load @ np.concatenate([np.zeros((0, channels)), *values]))


@dataclass(frozen=True, eq=False)
class ConditionTerms:
    """The conditions of a scene as terms in n unknowns.

    Attributes
    ----------
    conditions : tuple of ImposedCondition
        The laws, each with the samples at which it is imposed.
    samples : BoundarySamples
        The samples on boundaries and rims.
    values, slopes : csr_array (b, n)
        Evaluate u and du/db at the samples, with b the conormal out of the cell of each sample.
    a : (b,) float64
        The diffusivity on the side of each sample. For a tensor A it is b . A b, and ``slopes`` are derivatives along
        A b / (b . A b).
    widths : (b,) float64
        The local width w of the manifold between boundaries, at most h; penalties are proportional to 1 / w.
    lattice : Lattice
        The coordinates of samples are relative to its origin.
    outward_speed : (b,) float64, optional
        v . b with b out of the cell of each sample, if the equation has a velocity v.
    """

    conditions: tuple[ImposedCondition, ...]
    samples: BoundarySamples
    values: csr_array
    slopes: csr_array
    a: Floats
    widths: Floats
    lattice: Lattice
    outward_speed: Floats | None = None

    @property
    def matrix(self) -> csr_array:
        """The matrix (n, n) that is added to the stiffness, symmetric to the last bit except for advection terms."""
        matrix = self._one_sided.matrix
        for terms in (self._interface, *([] if self.outward_speed is None else [self._inflow])):
            if terms.matrix.nnz:
                matrix = matrix + terms.matrix if matrix.nnz else terms.matrix
        return matrix.tocsr()

    def load(self, channels: int, time: float | None = None) -> Floats:
        """Return the load (n, channels) of all conditions, with data at ``time``."""
        loads = self._one_sided.loads(channels, time) + self._interface.loads(channels, time)
        return loads if self.outward_speed is None else loads + self._inflow.loads(channels, time)

    @property
    def outflow_matrix(self) -> csr_array:
        """The integrals (n, n) of v . b u phi over all boundaries and rims, for a velocity v in conservative form."""
        assert self.outward_speed is not None
        return (self.values.T @ scale_rows(self.samples.weights * self.outward_speed, self.values)).tocsr()

    @property
    def for_laplacian(self) -> ConditionTerms:
        """The conditions on Lap u: of the same kinds, with the data of supports for Lap u, and zero data elsewhere."""
        laws = [replace(condition, law=condition.law.of_laplacian) for condition in self.conditions]
        return replace(self, conditions=tuple(laws))

    @property
    def boundary_mass(self) -> csr_array | None:
        """The matrix (n, n) that lambda multiplies in conditions ``du/db = lambda u``; None without such conditions."""
        rows = [condition.rows for _, condition in conditions_with_law(self.conditions, Spectral)]
        if not rows:
            return None
        chosen = np.concatenate(rows)
        zero, weighted = np.zeros(len(chosen)), 0.5 * self.samples.weights[chosen] * self.a[chosen]
        product = side_factors(zero + 1, zero), side_factors(weighted, zero)
        return symmetric_sum(self._sample_rows, chosen[:, None], [product])

    @property
    def state_fluxes(self) -> list[StateFluxSamples]:
        """The samples of each condition whose flux depends on u."""
        return [
            StateFluxSamples(law, self._scene_points(condition.rows), self.values[condition.rows], self.lattice.spacing)
            for law, condition in conditions_with_law(self.conditions, Nonlinear)
        ]

    def linearise(self, seen: Sequence[Floats]) -> ConditionTerms:
        """Return the terms with each flux that depends on u replaced by its linearisation at u = ``seen``.

        ``seen`` has an array (k,) of values at the samples for each of :attr:`state_fluxes`.
        """
        values, conditions = iter(seen), list(self.conditions)
        for law, condition in conditions_with_law(self.conditions, Nonlinear):
            points = self._scene_points(condition.rows)
            tangent = linearised_flux(law, next(values), points, self.lattice.spacing)
            conditions[conditions.index(condition)] = replace(condition, law=tangent)
        return replace(self, conditions=tuple(conditions))

    def flux(self, u: Floats, chosen: Bools, time: float | None) -> Floats | None:
        """Return the integrals (channels,) of du/db over ``chosen`` samples, with b the conormal out of their cells.

        They are computed from the residual of the weak form for a test function that is 1 on this side and 0 on the
        other: for Nitsche's terms the sum over samples of ``a du/db - B a (u - g) / w``, similarly for couplings and
        fluxes. This converges with the order of the energy, not that of the gradient. Summed over all boundaries of a
        connected piece it balances the integral of f over the piece, to the tolerance of the solver.

        Parameters
        ----------
        u : (n, channels) float64
            The unknowns of the solution.
        chosen : (b,) bool
            Which samples: those on one side of a boundary, or on the rim.
        time : float, optional
            The time at which data are evaluated.

        Returns
        -------
        (channels,) float64 or None
            None if a condition at these samples has the eigenvalue as a factor, which is not known here. Samples
            without a condition contribute nothing.
        """
        from scipy.sparse import csr_array, hstack

        conditions = [condition for condition in self.conditions if chosen[condition.all_rows].any()]
        if conditions_with_law(conditions, Spectral):
            return None
        n, weight = self.values.shape[1], np.where(chosen, 1 / self.a, 0.0)
        column, zero = csr_array(weight[:, None]), csr_array((len(weight), 1))
        with_test_function = replace(
            self,
            conditions=tuple(conditions),
            values=hstack([self.values, column], format="csr"),
            slopes=hstack([self.slopes, zero], format="csr"),
        )
        row = with_test_function.matrix[[n], :n].tocoo()
        # exact sums: the penalty makes matrix product and load a thousand times larger than their difference
        product = [fsum(row.data * u[row.coords[1], channel]) for channel in range(u.shape[1])]
        flux = with_test_function.load(u.shape[1], time)[n] - product
        for law, condition in conditions_with_law(conditions, Nonlinear):
            rows = condition.rows[chosen[condition.rows]]
            values = np.asarray(self.values[rows] @ u)[:, 0]
            flux = flux + self.samples.weights[rows] @ law.flux_at(values, self._scene_points(rows))
        return np.asarray(flux).reshape(u.shape[1])

    @cached_property
    def _one_sided(self) -> AddedTerms:
        """The terms of conditions on one side of a boundary: values, fluxes and Robin conditions."""
        laws = conditions_with_law(self.conditions, Value, Flux, Mixed)
        if not laws:
            return self._no_terms
        rows = concatenate([condition.rows for _, condition in laws], np.int64)
        points = [self._scene_points(condition.rows) for _, condition in laws]
        labels = [condition.label for _, condition in laws]
        alpha = concatenate([np.full(len(condition.rows), float(law.alpha)) for law, condition in laws])
        beta = concatenate([beta_at(law, at, label) for (law, _), at, label in zip(laws, points, labels, strict=True)])
        widths = np.where(self.samples.half[rows] >= 0, self.widths[rows], 1.0)  # no width at points
        products, factors = one_sided_products(alpha, beta, self.a[rows], self.samples.weights[rows], widths)
        data = tuple((law.datum, at, label) for (law, _), at, label in zip(laws, points, labels, strict=True))
        load = LoadRows(self._sample_rows, rows[:, None], factors[None])
        return AddedTerms(symmetric_sum(self._sample_rows, rows[:, None], products), load, data)

    @cached_property
    def _interface(self) -> AddedTerms:
        """The terms of conditions that couple the two sides of a boundary."""
        laws = conditions_with_law(self.conditions, Interface)
        if not laws:
            return self._no_terms
        left = concatenate([condition.rows for _, condition in laws], np.int64)
        right = concatenate([condition.across for _, condition in laws], np.int64)
        a, widths = [self.a[left], self.a[right]], [self.widths[left], self.widths[right]]
        resistance = concatenate([np.full(len(condition.rows), law.resistance) for law, condition in laws])
        penalty = concatenate(
            [
                np.full(len(condition.rows), TIP_PENALTY if condition.beyond_tip else COUPLING_PENALTY)
                for _, condition in laws
            ]
        )
        products, factors = interface_products(a, widths, resistance, self.samples.weights[left], penalty)
        jumps, fluxes = [], []
        for law, condition in laws:
            points = self._scene_points(condition.rows)
            jumps.append((law.jump, points, f"the jump of {condition.label}"))
            fluxes.append((law.flux, points, f"the flux of {condition.label}"))
        sides = np.stack([left, right], axis=1)
        load = LoadRows(self._sample_rows, sides, np.stack(factors))
        return AddedTerms(symmetric_sum(self._sample_rows, sides, products), load, (*jumps, *fluxes))

    @cached_property
    def _inflow(self) -> AddedTerms:
        """The terms of advection at boundaries: inflow where values are prescribed, upwinding across couplings.

        Couplings with a resistance, across which u may jump, have no such term.
        """
        from scipy.sparse import hstack

        assert self.outward_speed is not None
        prescribed = conditions_with_law(self.conditions, Value)
        coupled = [pair for pair in conditions_with_law(self.conditions, Interface) if pair[0].resistance == 0]
        rows = concatenate([condition.rows for _, condition in prescribed], np.int64)
        left = concatenate([condition.rows for _, condition in coupled], np.int64)
        right = concatenate([condition.across for _, condition in coupled], np.int64)
        speed, weights = self.outward_speed, self.samples.weights
        inflow, by_value = inflow_terms(speed[rows], weights[rows], self.values[rows])
        speeds = speed[left], speed[right]
        passing, by_jump = advection_jump_terms(speeds, weights[left], self.values[left], self.values[right])
        values = [(law.datum, self._scene_points(condition.rows), condition.label) for law, condition in prescribed]
        jumps = [
            (law.jump, self._scene_points(condition.rows), f"the jump of {condition.label}")
            for law, condition in coupled
        ]
        return AddedTerms((inflow + passing).tocsr(), hstack([by_value, by_jump], format="csr"), (*values, *jumps))

    @cached_property
    def _sample_rows(self) -> SampleRows:
        """The rows of ``values`` and ``slopes`` as dense entries in common columns."""
        return sample_rows(self.values, self.slopes)

    @property
    def _no_terms(self) -> AddedTerms:
        """Terms without conditions: a zero matrix (n, n), and no data."""
        from scipy.sparse import csr_array

        n = self.values.shape[1]
        return AddedTerms(csr_array((n, n)), csr_array((n, 0)), ())

    def _scene_points(self, rows: Ints) -> Floats:
        """Return the points (k, d) of the samples ``rows`` (k,) in the scene's coordinates."""
        return self.lattice.to_scene(self.samples.points[rows])


def condition_terms(
    conditions: Sequence[ImposedCondition],
    samples: BoundarySamples,
    left: Bools,
    rows: tuple[csr_array, csr_array],
    areas: Floats,
    diffusivity: Any,
    logarithms: Floats,
    lattice: Lattice,
    slopes_along: Callable[[Floats], csr_array] | None = None,
    spacings: Floats | None = None,
) -> ConditionTerms:
    """Return the terms that the conditions of a scene add to the matrix and the load.

    Parameters
    ----------
    conditions : sequence of ImposedCondition
        The laws, each with the samples at which it is imposed.
    samples : BoundarySamples
        The samples on boundaries and rims.
    left : (b,) bool
        Whether each sample is on the left of its boundary.
    rows : two csr_array (b, n)
        Evaluate u, and du/db along the conormals, at the samples.
    areas : (n,) float64
        The integral of each spline over the manifold.
    diffusivity : Data or tensor
        The diffusivity of the equation.
    logarithms : (n,) float64
        The integral of each spline times the logarithm of the diffusivity, or of a tensor's mean over tangents.
    lattice : Lattice
        The coordinates of samples are relative to its origin.
    slopes_along : callable, optional
        Maps directions (b, d) to the matrix (b, n) of derivatives along them at the samples; given if the diffusivity
        is a tensor.
    spacings : (b,) or (1,) float64, optional
        The spacing of the splines at the samples; by default that of the lattice.

    Raises
    ------
    InputError
        If the diffusivity is not positive everywhere.
    SceneError
        If a condition gives a conductivity that differs from the problem's diffusivity, or any if that is a tensor.
    """
    values, slopes = rows
    constrained = np.zeros(len(samples), dtype=bool)
    constrained[
        concatenate([condition.all_rows for condition in conditions if condition.constrains_value], np.int64)
    ] = True
    spacing = np.broadcast_to(lattice.spacing if spacings is None else spacings, len(samples))
    widths = local_widths(values, areas, samples, (left, ~left), spacing)
    around = (values @ logarithms) / (values @ areas)
    if slopes_along is None:
        a = one_sided_value(diffusivity, samples, widths, around, lattice, "the diffusivity")
    else:
        flux = conormal_flux(diffusivity, samples, widths, around, lattice)
        a, slopes = flux.a, slopes_along(flux.directions)
    for law, condition in conditions_with_law(conditions, Interface):
        if slopes_along is not None and not (law.left is None and law.right is None):
            raise SceneError(
                f"{condition.label} gives conductivities where the problem's diffusivity is a tensor, which no number "
                "is; leave `left` and `right` out."
            )
        for numbers, data, side in ((condition.rows, law.left, "left"), (condition.across, law.right, "right")):
            on_side = samples.take(numbers), widths[numbers]
            a[numbers] = prescribed_conductivity(data, a[numbers], *on_side, lattice, condition.label, side)
    if not constrained.all():
        between = local_widths(values, areas, samples, (left & constrained, ~left & constrained), spacing)
        widths = np.where(constrained, between, widths)
    return ConditionTerms(tuple(conditions), samples, values, slopes, a, widths, lattice)


def concatenate(parts: Sequence[Any], dtype: Any = np.float64) -> Any:
    """Return the arrays ``parts`` (k_i,) joined to one; an empty array of ``dtype`` if there are none."""
    return np.concatenate([np.zeros(0, dtype=dtype), *parts])
