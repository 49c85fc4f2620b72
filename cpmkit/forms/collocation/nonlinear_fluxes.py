"""Linearised nonlinear fluxes: rows of a Neumann condition in the tables are made those of a Robin condition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.errors import ResolutionError, place
from cpmkit.forms.collocation.discretization import Discretization, make_read_only
from cpmkit.forms.collocation.row_formula import BoundaryData
from cpmkit.scene.laws import Nonlinear
from cpmkit.types import Floats, SparseMatrix

#: A flux fixes no constant if its slope times the row's factor is below this.
LEAST_FLUX_SLOPE = 1e-9


@dataclass(frozen=True, eq=False)
class FluxRows:
    """Rows of E whose datum is a nonlinear flux, and the matrices that read u at the boundary.

    With F the datum's factor, such a row is ``R u + F du/db``, and u at the boundary is ``R u + F0 du/db``. With
    ``du/db = gamma - beta u`` at the boundary the row becomes the formula of a Robin condition.
    """

    law: Nonlinear  #: The law of the flux.
    datum: BoundaryData  #: The rows, their factors F, and the points where u is read.
    reads: SparseMatrix  #: (rows, unknowns): interpolates u at the boundary, on the side that each row continues.
    rest: SparseMatrix  #: (rows, unknowns): R; in rows that read several points, equal to ``reads``.
    half: Floats  #: (k,): F0 / F: 1/2 at order 2, 1 at order 1, and 0 for rows that read several points.

    @property
    def points(self) -> Floats:
        """(k, d) the points where the flux is evaluated."""
        return self.datum.points

    @property
    def guess(self) -> float:
        """The value of u from which Newton's method starts."""
        return self.law.guess

    def read(self, values: Floats) -> Floats:
        """Return u (k,) at :attr:`points`, interpolated from its ``values`` (unknowns, 1) at the unknowns."""
        return np.asarray((self.reads @ values)[self.datum.rows, 0])

    def grows(self, values: Floats) -> bool:
        """Return whether the flux depends on u, beyond rounding, at u = ``values`` (k,)."""
        return bool(np.any(np.abs(self.datum.factor * self.slope(values)) > LEAST_FLUX_SLOPE))

    def slope(self, values: Floats) -> Floats:
        """Return the derivative j'(u) (k,) of the flux where u is ``values`` (k,)."""
        return self.law.slope_at(values, self.datum.points)


def find_flux_rows(tables: Discretization) -> list[FluxRows]:
    """Return a record for each datum of the tables that is a nonlinear flux, in the order of the data."""
    return [_flux_rows(datum.law, datum, tables) for datum in tables.data if isinstance(datum.law, Nonlinear)]


def _flux_rows(law: Nonlinear, datum: BoundaryData, tables: Discretization) -> FluxRows:
    """Return the rows of E with the data ``datum`` of a nonlinear flux ``law``, and the matrices that read u there."""
    from scipy.sparse import diags_array

    layout, rows = tables.layout, datum.rows
    coefficient = np.concatenate([layout.formula.coefficient, *(group.formula.coefficient for group in layout.ghosts)])
    at_foot = (layout.formula.points == layout.band.feet.points).all(axis=1)  # past an edge, at first order
    first_order = np.concatenate([at_foot, *(group.orders == 1 for group in layout.ghosts)])[rows]
    others = np.concatenate([np.zeros(0, dtype=np.int64), *(one.rows for one in tables.data if one is not datum)])
    at_one_point = (coefficient[rows] == 1) & ~np.isin(rows, others)
    reads = tables.reading_matrix_of_datum(datum)
    chosen = np.zeros(len(coefficient))
    chosen[rows[at_one_point]] = 1.0
    rest = diags_array(chosen) @ tables.extension + diags_array(1.0 - chosen) @ reads
    half = np.where(at_one_point, np.where(first_order, 1.0, 0.5), 0.0)
    return FluxRows(law, datum, reads, rest.tocsr(), half)


def linearise_fluxes(tables: Discretization, fluxes: Sequence[FluxRows], seen: Sequence[Floats]) -> Discretization:
    """Return the tables with each flux replaced by its tangent ``du/db = j(v) + j'(v) (u - v)``.

    ``seen`` has for each flux v (k,), u at its points. A flux whose j'(v) is zero becomes a Neumann law, else a Robin
    law. Raises ResolutionError if a flux grows with u so strongly that the spacing is too coarse.
    """
    from scipy.sparse import diags_array

    nonlinear = {id(flux.datum) for flux in fluxes}
    data = [datum for datum in tables.data if id(datum) not in nonlinear]
    extension = tables.extension
    for flux, v in zip(fluxes, seen, strict=True):
        datum = flux.datum
        slope = flux.slope(v)
        factor = datum.factor / _divisor(flux, slope, tables.layout.lattice.spacing)
        added = np.zeros(extension.shape[0])
        added[datum.rows] = factor * slope
        extension = (extension + diags_array(added) @ flux.rest).tocsr()
        law = flux.law.tangent(v, flux.points, flux.grows(v))
        data.append(replace(datum, factor=factor, data=law.datum, law=law))
    return replace(tables, extension=make_read_only(extension), data=data)


def _divisor(flux: FluxRows, slope: Floats, spacing: float) -> Floats:
    """Return ``1 - F0 slope`` (k,), the divisors of a linearised flux's rows; raise ResolutionError if any is <= 0."""
    growth = flux.half * flux.datum.factor * slope
    worst = int(growth.argmax()) if len(growth) else -1
    if worst >= 0 and growth[worst] >= 1:
        where = place(flux.datum.points[worst])
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the nonlinear flux of {flux.datum.label}, which near {where} "
            f"grows by {slope[worst]:.3g} for each unit of u and feeds the solution; use "
            f"{spacing / growth[worst]:.2g} or less, or a guess nearer to the solution."
        )
    return np.asarray(1.0 - growth)
