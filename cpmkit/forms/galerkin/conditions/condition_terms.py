"""What the conditions of a scene add to the Galerkin form's matrix and loads."""

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
from cpmkit.forms.galerkin.conditions.imposed_conditions import ImposedCondition, StateFluxSamples, linearised_flux
from cpmkit.forms.galerkin.conditions.nitsche import (
    COUPLING_PENALTY,
    SEAM_PENALTY,
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
from cpmkit.scene.laws import Flux, Interface, Mixed, Nonlinear, Spectral, Value, beta_at, law_of_laplacian
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class AddedTerms:
    """What laws add together: a matrix (n, n), and to b the product of ``load`` (n, k) with the data of all in turn."""

    matrix: csr_array
    load: csr_array | LoadRows
    data: tuple[tuple[Data, Floats, str], ...]

    def loads(self, channels: int, time: float | None) -> Floats:
        """Return what the data at ``time`` add to b, (n, channels)."""
        values = [evaluate_data(data, points, channels, what, time) for data, points, what in self.data]
        return np.asarray(self.load @ np.concatenate([np.zeros((0, channels)), *values]))


@dataclass(frozen=True, eq=False)
class ConditionTerms:
    """The conditions of a scene on the unknowns of the Galerkin form.

    Attributes
    ----------
    held : tuple of Held
        The laws, and the samples at which each holds.
    samples : BoundarySamples
        Where they are read.
    values, slopes : csr_array (b, n)
        Rows that read u, and du/db with b out of the samples' own cells.
    a : (b,) float64
        The diffusivity on their side, of a tensor A that along the conormal, b . A b; ``slopes`` then are along
        A b / (b . A b).
    widths : (b,) float64
        How wide the manifold is there between what ties u, h at most.
    lattice : Lattice
        That coordinates are relative to.
    speed_out : (b,) float64, optional
        v . b, b out of the samples' own cells, where the equation has a velocity v.
    """

    held: tuple[ImposedCondition, ...]
    samples: BoundarySamples
    values: csr_array
    slopes: csr_array
    a: Floats
    widths: Floats
    lattice: Lattice
    speed_out: Floats | None = None

    @property
    def matrix(self) -> csr_array:
        """(n, n) to be added to the stiffness, symmetric to the last bit but for what a velocity carries."""
        carried = [] if self.speed_out is None else [self._carried]
        matrix = self._one_sided.matrix
        for one in (self._coupled, *carried):
            if one.matrix.nnz:
                matrix = matrix + one.matrix if matrix.nnz else one.matrix
        return matrix.tocsr()

    def load(self, channels: int, time: float | None = None) -> Floats:
        """Return what the data at ``time`` add to b, (n, channels)."""
        loads = self._one_sided.loads(channels, time) + self._coupled.loads(channels, time)
        return loads if self.speed_out is None else loads + self._carried.loads(channels, time)

    @property
    def carried_out(self) -> csr_array:
        """The matrix (n, n) of the integrals of v . b u phi over all that bounds zones: of a conservative velocity."""
        assert self.speed_out is not None
        return (self.values.T @ scale_rows(self.samples.weights * self.speed_out, self.values)).tocsr()

    @property
    def of_laplacian(self) -> ConditionTerms:
        """The same conditions with the data of Lap u: those of supports, and zero elsewhere."""
        return replace(self, held=tuple(replace(one, law=law_of_laplacian(one.law)) for one in self.held))

    @property
    def boundary_mass(self) -> csr_array | None:
        """The matrix (n, n) beside lambda of the conditions ``du/db = lambda u``; None where there are none."""
        rows = [one.rows for one in self.held if isinstance(one.law, Spectral)]
        if not rows:
            return None
        chosen = np.concatenate(rows)
        none, weighted = np.zeros(len(chosen)), 0.5 * self.samples.weights[chosen] * self.a[chosen]
        product = side_factors(none + 1, none), side_factors(weighted, none)
        return symmetric_sum(self._readings, chosen[:, None], [product])

    @property
    def strip(self) -> Ints:
        """The unknowns (k,) that samples read where u itself is held or coupled."""
        rows = concatenate([one.all_rows for one in self.held if one.ties], np.int64)
        return np.unique(self.values[rows].indices).astype(np.int64)

    @property
    def state_fluxes(self) -> list[StateFluxSamples]:
        """Where fluxes depend on u."""
        return [
            StateFluxSamples(one.law, self._where(one.rows), self.values[one.rows], self.lattice.spacing)
            for one in self.held
            if isinstance(one.law, Nonlinear)
        ]

    def linearise(self, seen: Sequence[Floats]) -> ConditionTerms:
        """Return these with fluxes that depend on u replaced by their tangents where u is ``seen`` (k,)."""
        left = iter(seen)
        return replace(
            self,
            held=tuple(
                replace(one, law=linearised_flux(one.law, next(left), self._where(one.rows), self.lattice.spacing))
                if isinstance(one.law, Nonlinear)
                else one
                for one in self.held
            ),
        )

    @cached_property
    def _one_sided(self) -> AddedTerms:
        laws = [(one.law, one) for one in self.held if isinstance(one.law, (Value, Flux, Mixed))]
        if not laws:
            return self._nothing
        rows = concatenate([one.rows for _, one in laws], np.int64)
        alpha = concatenate([np.full(len(one.rows), float(law.alpha)) for law, one in laws])
        beta = concatenate([beta_at(law, self._where(one.rows), one.what) for law, one in laws])
        widths = np.where(self.samples.half[rows] >= 0, self.widths[rows], 1.0)  # at a point the penalty has no unit
        products, by = one_sided_products(alpha, beta, self.a[rows], self.samples.weights[rows], widths)
        data = tuple((law.datum, self._where(one.rows), one.what) for law, one in laws)
        load = LoadRows(self._readings, rows[:, None], by[None])
        return AddedTerms(symmetric_sum(self._readings, rows[:, None], products), load, data)

    @cached_property
    def _coupled(self) -> AddedTerms:
        laws = [(one.law, one) for one in self.held if isinstance(one.law, Interface)]
        if not laws:
            return self._nothing
        rows = (
            concatenate([one.rows for _, one in laws], np.int64),
            concatenate([one.across for _, one in laws], np.int64),
        )
        a, widths = [self.a[side] for side in rows], [self.widths[side] for side in rows]
        resistance = concatenate([np.full(len(one.rows), law.resistance) for law, one in laws])
        penalty = concatenate(
            [np.full(len(one.rows), SEAM_PENALTY if one.seam else COUPLING_PENALTY) for _, one in laws]
        )
        products, by = interface_products(a, widths, resistance, self.samples.weights[rows[0]], penalty)
        where = [self._where(one.rows) for _, one in laws]
        jumps = [(law.jump, at, f"the jump of {one.what}") for (law, one), at in zip(laws, where, strict=True)]
        fluxes = [(law.flux, at, f"the flux of {one.what}") for (law, one), at in zip(laws, where, strict=True)]
        both = np.stack(rows, axis=1)
        load = LoadRows(self._readings, both, np.stack(by))
        return AddedTerms(symmetric_sum(self._readings, both, products), load, (*jumps, *fluxes))

    @cached_property
    def _carried(self) -> AddedTerms:
        """What a velocity carries in; where a resistance lets u jump by itself, nothing goes on."""
        from scipy.sparse import hstack

        assert self.speed_out is not None
        given = [one for one in self.held if isinstance(one.law, Value)]
        coupled = [one for one in self.held if isinstance(one.law, Interface) and one.law.resistance == 0]
        rows = concatenate([one.rows for one in given], np.int64)
        left, right = (concatenate([getattr(one, of) for one in coupled], np.int64) for of in ("rows", "across"))
        out, weights = self.speed_out, self.samples.weights
        inflow, by_value = inflow_terms(out[rows], weights[rows], self.values[rows])
        passing, by_jump = advection_jump_terms(
            (out[left], out[right]), weights[left], self.values[left], self.values[right]
        )
        values = [(one.law.datum, self._where(one.rows), one.what) for one in given if isinstance(one.law, Value)]
        laws = [(one.law, one) for one in coupled if isinstance(one.law, Interface)]
        jumps = [(law.jump, self._where(one.rows), f"the jump of {one.what}") for law, one in laws]
        return AddedTerms((inflow + passing).tocsr(), hstack([by_value, by_jump], format="csr"), (*values, *jumps))

    @cached_property
    def _readings(self) -> SampleRows:
        return sample_rows(self.values, self.slopes)

    @property
    def _nothing(self) -> AddedTerms:
        from scipy.sparse import csr_array

        n = self.values.shape[1]
        return AddedTerms(csr_array((n, n)), csr_array((n, 0)), ())

    def _where(self, rows: Ints) -> Floats:
        return self.lattice.to_scene(self.samples.points[rows])


def condition_terms(
    held: Sequence[ImposedCondition],
    samples: BoundarySamples,
    left: Bools,
    read: tuple[csr_array, csr_array],
    areas: Floats,
    diffusivity: Any,
    logarithms: Floats,
    lattice: Lattice,
    slopes_along: Callable[[Floats], csr_array] | None = None,
    spacings: Floats | None = None,
) -> ConditionTerms:
    """Return the conditions on the unknowns.

    Parameters
    ----------
    held : sequence of Held
        Which law holds where.
    samples : BoundarySamples
        Where they are read.
    left : (b,) bool
        Which of these are on the left.
    read : two csr_array (b, n)
        Reading u, and du/db along the samples' conormals.
    areas : (n,) float64
        The integral of each spline over the manifold.
    diffusivity : Data or tensor
        Of the equation.
    logarithms : (n,) float64
        The integral of each spline times the diffusivity's logarithm, of a tensor that of its mean over tangents.
    lattice : Lattice
        That coordinates are relative to.
    slopes_along : callable, optional
        Returns the rows that read the derivative of u along directions (b, d) at the samples; given where the
        diffusivity is a tensor.
    spacings : (b,) float64, optional
        Of the splines at the samples, (1,) for all of them; the lattice's unless given.

    Raises
    ------
    InputError
        If the diffusivity is not above zero somewhere.
    SceneError
        If a condition gives a conductivity that is not the problem's.
    """
    values, slopes = read
    ties = np.zeros(len(samples), dtype=bool)
    ties[concatenate([one.all_rows for one in held if one.ties], np.int64)] = True
    spacing = np.broadcast_to(lattice.spacing if spacings is None else spacings, len(samples))
    widths = local_widths(values, areas, samples, (left, ~left), spacing)
    around = (values @ logarithms) / (values @ areas)
    if slopes_along is None:
        a = one_sided_value(diffusivity, samples, widths, around, lattice, "the diffusivity")
    else:
        slanted = conormal_flux(diffusivity, samples, widths, around, lattice)
        a, slopes = slanted.a, slopes_along(slanted.directions)
    for one in held:
        if isinstance(one.law, Interface):
            if slopes_along is not None and not (one.law.left is None and one.law.right is None):
                raise SceneError(
                    f"{one.what} gives conductivities where the problem's diffusivity is a tensor, which no number "
                    "is; leave `left` and `right` out."
                )
            for rows, own, side in ((one.rows, one.law.left, "left"), (one.across, one.law.right, "right")):
                beside_it = samples.take(rows)
                a[rows] = prescribed_conductivity(own, a[rows], beside_it, widths[rows], lattice, one.what, side)
    if not ties.all():
        widths = np.where(ties, local_widths(values, areas, samples, (left & ties, ~left & ties), spacing), widths)
    return ConditionTerms(tuple(held), samples, values, slopes, a, widths, lattice)


def concatenate(parts: Sequence[Any], dtype: Any = np.float64) -> Any:
    """Return arrays (k,) one after the other, of which there may be none."""
    return np.concatenate([np.zeros(0, dtype=dtype), *parts])


def flux_through(terms: ConditionTerms, u: Floats, chosen: Bools, time: float | None) -> Floats | None:
    """Return the integrals (channels,) of du/db over the samples ``chosen`` (b,), b out of their cells.

    None where a condition has an eigenvalue for a factor, which is not known here. Where nothing is held, nothing flows
    out.

    Parameters
    ----------
    terms : ConditionTerms
        The conditions of the scene that u solves.
    u : (n, channels) float64
        The unknowns.
    chosen : (b,) bool
        The samples on one side of a boundary, or on the rim.
    time : float, optional
        At which data are read.
    """
    from scipy.sparse import csr_array, hstack

    held = [one for one in terms.held if chosen[one.all_rows].any()]
    if any(isinstance(one.law, Spectral) for one in held):
        return None
    n, weight = terms.values.shape[1], np.where(chosen, 1 / terms.a, 0.0)
    column, none = csr_array(weight[:, None]), csr_array((len(weight), 1))
    tested = replace(
        terms,
        held=tuple(held),
        values=hstack([terms.values, column], format="csr"),
        slopes=hstack([terms.slopes, none], format="csr"),
    )
    row = tested.matrix[[n], :n].tocoo()
    # exact sums: what a penalty adds to each is a thousand times what is left of both
    taken = [fsum(row.data * u[row.coords[1], channel]) for channel in range(u.shape[1])]
    flux = tested.load(u.shape[1], time)[n] - taken
    for one in held:
        if isinstance(one.law, Nonlinear):
            rows = one.rows[chosen[one.rows]]
            seen = np.asarray(terms.values[rows] @ u)[:, 0]
            points = terms.lattice.to_scene(terms.samples.points[rows])
            flux = flux + terms.samples.weights[rows] @ one.law.flux_at(seen, points)
    return np.asarray(flux).reshape(u.shape[1])
