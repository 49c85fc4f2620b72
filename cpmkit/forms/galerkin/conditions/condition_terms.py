"""The terms that the conditions of a scene add to the matrix and to the load, and the flux through boundaries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import fsum
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.conditions.boundary_sides import OneSidedLimits, local_widths
from cpmkit.forms.galerkin.conditions.imposed_conditions import (
    ImposedCondition,
    StateFluxSamples,
    Tie,
    conditions_with_law,
    join_values,
)
from cpmkit.forms.galerkin.conditions.nitsche import (
    NITSCHE_PENALTY,
    SKIN_PENALTY,
    interface_products,
    linear_form_rows,
    one_sided_products,
    scaled_rows,
    side_factors,
    sum_of_symmetrised_products,
    tie_products,
    tie_upwinding,
)
from cpmkit.grid.lattice import Lattice
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.junction import JunctionLaw
from cpmkit.scene.laws import Flux, Interface, Mixed, Nonlinear, Spectral, Value, beta_at
from cpmkit.types import SIDES, Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Samples whose terms are summed together.
SAMPLES_AT_ONCE = 1 << 15


@dataclass(frozen=True, eq=False)
class AddedTerms:
    """Terms that several conditions add to the matrix and the load."""

    matrix: csr_array  #: (n, n): the sum of their terms in the matrix.
    load: csr_array  #: (n, k): maps the values of the data of all conditions, one after the other, to the load.
    #: list of (Data, (k_i, d) float64, str): the data of each condition, their points, and their label in errors.
    data: list[tuple[Data, Floats, str]]

    def loads(self, channels: int, time: float | None) -> Floats:
        """Return the load (n, channels) of these terms with data at ``time``, which is None in steady problems."""
        values = [evaluate_data(data, points, channels, label, time) for data, points, label in self.data]
        return np.asarray(self.load @ np.concatenate(values))


@dataclass(frozen=True, eq=False)
class ConditionTerms:
    """The conditions of a scene as terms in n unknowns."""

    conditions: tuple[ImposedCondition, ...]  #: The laws, each with the samples at which it is imposed.
    samples: BoundarySamples  #: The samples on boundaries and rims.
    #: values, slopes (b, n): evaluate u and du/db at the samples, with b the conormal out of the cell of each sample.
    values: csr_array
    slopes: csr_array
    #: (b,): the diffusivity on the side of each sample. For a tensor A it is b . A b, and ``slopes`` are derivatives
    #: along A b / (b . A b).
    a: Floats
    #: (b,): the local width w of the manifold between boundaries, at most h; penalties are proportional to 1 / w.
    widths: Floats
    lattice: Lattice  #: The coordinates of samples are relative to its origin.
    #: (b,): v . b with b out of the cell of each sample, if the equation has a velocity v.
    outward_speed: Floats | None = None

    @property
    def matrix(self) -> csr_array:
        """The matrix (n, n) that is added to the stiffness, symmetric to the last bit except for advection terms."""
        from scipy.sparse import csr_array

        n = self.values.shape[1]
        return sum((terms.matrix for terms in self._terms), csr_array((n, n))).tocsr()

    def load(self, channels: int, time: float | None = None) -> Floats:
        """Return the load (n, channels) of all conditions with data at ``time``, which is None in steady problems."""
        zero = np.zeros((self.values.shape[1], channels))
        return sum((terms.loads(channels, time) for terms in self._terms if terms.data), zero)

    @property
    def outflow_matrix(self) -> csr_array:
        """The integrals (n, n) of v . b u phi over all boundaries and rims, for a velocity v in conservative form."""
        assert self.outward_speed is not None
        return (self.values.T @ (self.values * (self.samples.weights * self.outward_speed)[:, None])).tocsr()

    @property
    def for_laplacian(self) -> ConditionTerms:
        """The laws for Lap u: 0 or a support's ``laplacian`` where u is given; continuity at ties; else zero flux."""
        conditions = [replace(condition, law=condition.law.of_laplacian) for condition in self.conditions]
        return replace(self, conditions=tuple(conditions))

    @property
    def boundary_mass(self) -> csr_array | None:
        """The matrix (n, n) that lambda multiplies in conditions ``du/db = lambda u``; None without such conditions."""
        rows = [condition.rows for condition in conditions_with_law(self.conditions, Spectral)]
        if not rows:
            return None
        chosen = np.concatenate(rows)
        values = self.values[chosen]
        return sum_of_symmetrised_products([(values, values * (0.5 * self.samples.weights * self.a)[chosen, None])])

    @property
    def state_fluxes(self) -> list[StateFluxSamples]:
        """The samples of each condition whose flux depends on u, in the order of :attr:`conditions`."""
        return [
            StateFluxSamples(
                condition, self._scene_points(condition), self.values[condition.rows], self.lattice.spacing
            )
            for condition in conditions_with_law(self.conditions, Nonlinear)
        ]

    def linearise(self, seen: Sequence[Floats]) -> ConditionTerms:
        """Return the terms with each flux that depends on u replaced by its linearisation at u = ``seen``.

        ``seen`` has an array (k,) of values at the samples for each of :attr:`state_fluxes`.
        """
        fluxes = self.state_fluxes
        tangents = {id(flux.condition): flux.linearise(values) for flux, values in zip(fluxes, seen, strict=True)}
        return replace(self, conditions=tuple(tangents.get(id(each), each) for each in self.conditions))

    def flux(self, u: Floats, chosen: Bools, time: float | None) -> Floats | None:
        """Return the integrals (channels,) of du/db over ``chosen`` samples, with b the conormal out of their cells.

        The integrals are residuals of the weak form for a test function that is 1 / a at these samples, 0 at the
        others, and has no slope: for Nitsche's terms the sum over samples of ``du/db - B (u - g) / w``, similarly for
        couplings and fluxes. They converge with the order of the energy, not that of the gradient. For a = 1 the sum
        over all boundaries of a connected piece balances the integral of f over the piece, to the solver's tolerance.

        ``u`` (n, channels) are the unknowns of the solution, ``chosen`` (b,) is whether a sample is included, as on one
        side of a boundary or on the rim, and data are evaluated at ``time``. None if a condition at these samples has
        the eigenvalue as a factor, which is not known here, or a junction cuts the manifold. Samples without a
        condition contribute nothing.
        """
        from scipy.sparse import csr_array, hstack

        conditions = [condition for condition in self.conditions if chosen[condition.all_rows].any()]
        cuts = [~self.samples.on_rim[each.all_rows] for each in conditions_with_law(conditions, JunctionLaw)]
        if conditions_with_law(conditions, Spectral) or any(cut.any() for cut in cuts):
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
        for condition in conditions_with_law(conditions, Nonlinear):
            part = replace(condition, sides=(condition.rows[chosen[condition.rows]],))
            values = np.asarray(self.values[part.rows] @ u)[:, 0]
            flux = flux + self.samples.weights[part.rows] @ part.law.flux_at(values, self._scene_points(part))
        return np.asarray(flux).reshape(u.shape[1])

    @cached_property
    def _terms(self) -> list[AddedTerms]:
        """The terms of each kind of condition, and of advection; spectral and nonlinear laws add nothing here."""
        kinds: list[tuple[Callable[..., AddedTerms], Any]] = [
            (self._one_sided_terms, conditions_with_law(self.conditions, Value, Flux, Mixed)),
            (self._interface_terms, conditions_with_law(self.conditions, Interface)),
            (self._tie_terms, conditions_with_law(self.conditions, Tie)),
        ]
        if self.outward_speed is not None:
            coupled = [each for each in conditions_with_law(self.conditions, Interface) if each.law.resistance == 0]
            kinds += [
                (self._upwinding_terms, conditions_with_law(self.conditions, Value)),
                (self._upwinding_terms, coupled),  # with a resistance u may jump, and nothing is added
            ]
        return [terms(conditions) for terms, conditions in kinds if conditions]

    def _one_sided_terms(self, conditions: Sequence[ImposedCondition]) -> AddedTerms:
        """Return the terms of ``conditions`` on one side of a boundary: values, fluxes and Robin conditions."""
        from scipy.sparse import hstack

        rows = np.concatenate([each.rows for each in conditions])
        alpha = join_values(conditions, lambda each: each.law.alpha)
        beta = join_values(conditions, lambda each: beta_at(each.law, self._scene_points(each), each.label))
        widths = np.where(self.samples.half[rows] >= 0, self.widths[rows], 1.0)  # no width at points
        penalty = NITSCHE_PENALTY if self.samples.normals.shape[1] else SKIN_PENALTY
        matrices, loads = [], []
        for some in np.array_split(np.arange(len(rows)), len(rows) // SAMPLES_AT_ONCE + 1):  # to save memory
            numbers = rows[some]
            coefficients = self.a[numbers], self.samples.weights[numbers], widths[some], penalty
            products, factors = one_sided_products(alpha[some], beta[some], *coefficients)
            matrices.append(self.sum_of_products(products, numbers))
            loads.append(self.linear_forms(factors, numbers).T.tocsr())
        return AddedTerms(sum(matrices[1:], matrices[0]), hstack(loads, format="csr"), self._data(conditions, "datum"))

    def _interface_terms(self, conditions: Sequence[ImposedCondition]) -> AddedTerms:
        """Return the terms of ``conditions`` that couple the two sides of a boundary; data: jumps, then fluxes."""
        from scipy.sparse import vstack

        left, right = rows = [np.concatenate([each.sides[k] for each in conditions]) for k in range(2)]
        a, widths = [self.a[side] for side in rows], [self.widths[side] for side in rows]
        resistance = join_values(conditions, lambda each: each.law.resistance)
        products, factors = interface_products(a, widths, resistance, self.samples.weights[left])
        matrix = self.sum_of_products(products, left, right)
        load = vstack([self.linear_forms(each, left, right) for each in factors]).T.tocsr()
        return AddedTerms(matrix, load, self._data(conditions, "jump") + self._data(conditions, "flux"))

    def _tie_terms(self, conditions: Sequence[ImposedCondition]) -> AddedTerms:
        """Return the terms of ``conditions`` of continuity, with upwinding where the equation has a velocity."""
        from scipy.sparse import csr_array

        n = self.values.shape[1]
        matrix = csr_array((n, n))
        for each in conditions:
            rows = np.stack(each.sides, axis=1)
            weights = self.samples.weights[each.rows]
            matrix += self.sum_of_products(tie_products(self.a[rows], self.widths[rows], weights), *each.sides)
            if self.outward_speed is not None:
                for tested, value in tie_upwinding(self.outward_speed[rows], weights):
                    matrix += self.linear_forms(tested, *each.sides).T.tocsr() @ self.linear_forms(value, *each.sides)
        return AddedTerms(matrix.tocsr(), csr_array((n, 0)), [])

    def _upwinding_terms(self, conditions: Sequence[ImposedCondition]) -> AddedTerms:
        """Return the terms of advection at inflow where values are given, or across boundaries where u has a jump.

        The ``conditions`` are all values or all couplings; the jump, u on the left less u on the right, may be zero.
        """
        assert self.outward_speed is not None
        couples = conditions[0].law.couples
        rows = [np.concatenate([each.sides[k] for each in conditions]) for k in range(2 if couples else 1)]
        zero, weights = np.zeros(len(rows[0])), self.samples.weights[rows[0]]
        inflow = [weights * np.maximum(-self.outward_speed[side], 0.0) for side in rows]
        signs = (1.0, -1.0)[: len(rows)]
        value = side_factors(*(factor for sign in signs for factor in (zero + sign, zero)))
        tested = side_factors(*(f for sign, flow in zip(signs, inflow, strict=True) for f in (sign * flow, zero)))
        load = self.linear_forms(tested, *rows).T.tocsr()
        data = self._data(conditions, "jump" if couples else "datum")
        return AddedTerms(load @ self.linear_forms(value, *rows), load, data)

    def sum_of_products(self, products: Sequence[tuple[Floats, Floats]], *rows: Ints) -> csr_array:
        """Return the sum (n, n) of ``x^T y + y^T x`` over ``products`` (x, y) of linear forms at samples ``rows``."""
        from scipy.sparse import csr_array

        forms = [
            (self.linear_forms(x, *rows), self.linear_forms(y, *rows))
            for x, y in products
            if y.any()  # half of the products of a value, and all of a flux, are zero
        ]
        return sum_of_symmetrised_products(forms) if forms else csr_array((self.values.shape[1],) * 2)

    def linear_forms(self, factors: Floats, *rows: Ints) -> csr_array:
        """Return the matrix (k, n) of the linear forms ``factors`` (k, s, 2) at the samples ``rows``, s times (k,)."""
        if len(rows) == 1:  # avoids the traces of all samples: a skin has many
            of_value, of_slope = factors[:, 0].T
            forms = scaled_rows(self.values[rows[0]], of_value)
            return forms + scaled_rows(self.slopes[rows[0]], of_slope) if of_slope.any() else forms
        return linear_form_rows(factors, np.stack(rows, axis=1), self._traces)

    @cached_property
    def _traces(self) -> csr_array:
        """The matrix (2 b, n) that evaluates u, then du/db, at all samples."""
        from scipy.sparse import vstack

        return vstack([self.values, self.slopes], format="csr")

    def _data(self, conditions: Sequence[ImposedCondition], name: str) -> list[tuple[Data, Floats, str]]:
        """Return the data called ``name`` of the laws of ``conditions``, with their points and labels."""
        label = "" if name == "datum" else f"the {name} of "
        return [(getattr(each.law, name), self._scene_points(each), f"{label}{each.label}") for each in conditions]

    def _scene_points(self, condition: ImposedCondition) -> Floats:
        """Return the points (k, d) of the samples ``condition.rows`` (k,) in the scene's coordinates."""
        return self.lattice.to_scene(self.samples.points[condition.rows])


def condition_terms(
    conditions: Sequence[ImposedCondition],
    samples: BoundarySamples,
    left: Bools,
    traces: tuple[csr_array, csr_array],
    integrals: Floats,
    diffusivity: Any,
    logarithms: Floats,
    lattice: Lattice,
    slopes_along: Callable[[Floats], csr_array] | None,
    spacings: Floats,
) -> ConditionTerms:
    """Return the terms that the conditions of a scene add to the matrix and the load.

    Raises InputError if the diffusivity or a conductivity is not positive everywhere. Raises SceneError if a condition
    gives a conductivity that differs from the problem's diffusivity, or where that is a tensor.

    ``conditions``, ``samples``, ``lattice``: the attributes of :class:`ConditionTerms`.
    ``left`` (b,): whether each sample is on the left of its boundary.
    ``traces`` two csr_array (b, n): evaluate u, and du/db along the conormals, at the samples.
    ``integrals``, ``logarithms`` (n,): the integral of each spline over the manifold, and of each spline times the
        logarithm of the diffusivity, or of a tensor's mean over tangents.
    ``diffusivity``, Data or tensor: the diffusivity of the equation.
    ``slopes_along``: maps directions (b, d) to the derivatives (b, n) along them at samples; None without a tensor.
    ``spacings`` (b,) or (1,): the spacing of the splines at the samples.
    """
    values, slopes = traces
    constrained = np.zeros(len(samples), dtype=bool)
    for condition in conditions:
        constrained[condition.all_rows] |= condition.law.involves_value or condition.law.couples
    spacing = np.broadcast_to(spacings, len(samples))
    widths = local_widths(values, integrals, samples, (left, ~left), spacing)
    limits = OneSidedLimits(samples, widths, (values @ logarithms) / (values @ integrals), lattice)
    if slopes_along is None:
        a = limits.value(diffusivity, "the diffusivity")
    else:
        a, directions = limits.conormal_flux_factors(diffusivity)
        slopes = slopes_along(directions)
    for condition in conditions_with_law(conditions, Interface):
        for numbers, side in zip(condition.sides, SIDES, strict=True):
            conductivity = getattr(condition.law, side)
            if conductivity is None:
                continue
            if slopes_along is not None:
                raise SceneError(
                    f"{condition.label} gives conductivities where the problem's diffusivity is a tensor, which no "
                    "number is; leave `left` and `right` out."
                )
            on_side = OneSidedLimits(samples.take(numbers), widths[numbers], np.log(a[numbers]), lattice)
            a[numbers] = on_side.conductivity(conductivity, condition.label, side)
    if not constrained.all():
        between = local_widths(values, integrals, samples, (left & constrained, ~left & constrained), spacing)
        widths = np.where(constrained, between, widths)
    return ConditionTerms(tuple(conditions), samples, values, slopes, a, widths, lattice)
