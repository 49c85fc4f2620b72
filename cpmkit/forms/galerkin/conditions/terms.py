"""What the conditions of a scene add to the Galerkin form's matrix and loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.conditions.coefficients import beside, local_widths
from cpmkit.forms.galerkin.conditions.held import Held
from cpmkit.forms.galerkin.conditions.interface import SEAM_PENALTY, OneSideRows, interface
from cpmkit.forms.galerkin.conditions.one_side import PENALTY, doubled, one_side, scaled
from cpmkit.forms.galerkin.conditions.state_flux import BoundaryFlux, tangent
from cpmkit.grid.lattice import Lattice
from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.scene.data import Data, evaluate_data
from cpmkit.scene.laws import Interface, Nonlinear, OneSided, Spectral, beta_at

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Part:
    """What one law adds: a matrix (n, n), and to b the products of loads (n, k) with data at points (k, d)."""

    matrix: csr_array
    points: Floats
    loads: tuple[tuple[csr_array, Data, str], ...]


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
    diffusivity : Data
        Of the equation.
    widths, depths : (b,) float64
        How wide the manifold is there: between what ties u, and between boundaries of any kind.
    lattice : Lattice
        That coordinates are relative to.
    """

    held: tuple[Held, ...]
    samples: BoundarySamples
    values: csr_array
    slopes: csr_array
    diffusivity: Data
    widths: Floats
    depths: Floats
    lattice: Lattice

    @property
    def matrix(self) -> csr_array:
        """(n, n) to be added to the stiffness, symmetric to the last bit."""
        from scipy.sparse import csr_array as csr

        n = self.values.shape[1]
        return sum((part.matrix for part in self._parts), start=csr((n, n))).tocsr()

    def load(self, channels: int, time: float | None = None) -> Floats:
        """Return what the data at ``time`` add to b, (n, channels)."""
        b = np.zeros((self.values.shape[1], channels))
        for part in self._parts:
            for load, data, what in part.loads:
                b += load @ evaluate_data(data, part.points, channels, what, time)
        return b

    @property
    def boundary_mass(self) -> csr_array | None:
        """The matrix (n, n) beside lambda of the conditions ``du/db = lambda u``; None where there are none."""
        rows = [one.rows for one in self.held if isinstance(one.law, Spectral)]
        if not rows:
            return None
        chosen = np.concatenate(rows)
        read = self.values[chosen]
        return doubled(read.T @ scaled(0.5 * self.samples.weights[chosen] * self._a(chosen), read))

    @property
    def strip(self) -> Ints:
        """The unknowns (k,) that samples read where u itself is held or coupled."""
        rows = np.concatenate([np.zeros(0, dtype=np.int64), *(one.all_rows for one in self.held if one.ties)])
        return np.unique(self.values[rows].indices).astype(np.int64)

    @property
    def state_fluxes(self) -> list[BoundaryFlux]:
        """Where fluxes depend on u."""
        return [
            BoundaryFlux(one.law, self._where(one.rows), self.values[one.rows])
            for one in self.held
            if isinstance(one.law, Nonlinear)
        ]

    def linearized(self, seen: Sequence[Floats]) -> ConditionTerms:
        """Return these with fluxes that depend on u replaced by their tangents where u is ``seen`` (k,)."""
        left = iter(seen)
        return replace(
            self,
            held=tuple(
                replace(one, law=tangent(one.law, next(left), self._where(one.rows)))
                if isinstance(one.law, Nonlinear)
                else one
                for one in self.held
            ),
        )

    @cached_property
    def _parts(self) -> list[Part]:
        parts = []
        for one in self.held:
            if one.law is None or isinstance(one.law, Interface):
                parts.append(self._coupled(one.law, one))
            elif len(one.rows) and not isinstance(one.law, (Spectral, Nonlinear)):
                parts.append(self._one_sided(one.law, one))
        return parts

    def _one_sided(self, law: OneSided, one: Held) -> Part:
        rows, where = one.rows, self._where(one.rows)
        alpha, beta, data = float(law.alpha), beta_at(law, where, one.what), law.datum
        widths = np.where(self.samples.half[rows] >= 0, self.widths[rows], 1.0)  # at a point the penalty has no unit
        matrix, load = one_side(
            alpha,
            beta,
            self._a(rows),
            self.samples.weights[rows],
            widths,
            self.values[rows],
            self.slopes[rows],
        )
        return Part(matrix, where, ((load, data, one.what),))

    def _coupled(self, law: Interface | None, one: Held) -> Part:
        given = (None, None) if law is None else (law.left, law.right)
        sides = [
            OneSideRows(self._a(rows, own), self.widths[rows], self.values[rows], self.slopes[rows])
            for rows, own in zip((one.rows, one.across), given, strict=True)
        ]
        resistance, penalty = (0.0, SEAM_PENALTY) if law is None else (law.resistance, PENALTY)
        matrix, by_jump, by_flux = interface(sides[0], sides[1], resistance, self.samples.weights[one.rows], penalty)
        if law is None:
            return Part(matrix, self._where(one.rows), ())
        loads = (by_jump, law.jump, f"the jump of {one.what}"), (by_flux, law.flux, f"the flux of {one.what}")
        return Part(matrix, self._where(one.rows), loads)

    def _a(self, rows: Ints, own: Data | None = None) -> Floats:
        """Return the diffusivity (k,) at samples, on their own side; ``own`` where a condition gives it."""
        data, what = (self.diffusivity, "the diffusivity") if own is None else (own, "a conductivity of Transmission")
        return beside(data, self.samples.take(rows), self.depths[rows], self.lattice, what)

    def _where(self, rows: Ints) -> Floats:
        return self.lattice.to_scene(self.samples.points[rows])


def condition_terms(
    held: Sequence[Held],
    samples: BoundarySamples,
    left: Bools,
    rows: tuple[csr_array, csr_array],
    areas: Floats,
    diffusivity: Data,
    lattice: Lattice,
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
    rows : two csr_array (b, n)
        Reading u, and du/db along the samples' conormals.
    areas : (n,) float64
        The integral of each spline over the manifold.
    diffusivity : Data
        Of the equation.
    lattice : Lattice
        That coordinates are relative to.
    """
    values, slopes = rows
    ties = np.concatenate([np.zeros(0, dtype=np.int64), *(one.all_rows for one in held if one.ties)])
    depths = local_widths(values, areas, samples, left, lattice.spacing)
    widths = depths.copy()
    widths[ties] = local_widths(values[ties], areas, samples.take(ties), left[ties], lattice.spacing)
    return ConditionTerms(tuple(held), samples, values, slopes, diffusivity, widths, depths, lattice)
