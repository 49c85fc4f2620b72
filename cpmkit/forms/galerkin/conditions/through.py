"""What flows through boundaries, by the residual of the weak form: what is left of it for v = 1 on one side alone.

With Nitsche's terms that is the sum over samples of ``a du/db - B a (u - g) / w``, of couplings and fluxes likewise:
as many orders better than du/db read at the boundary as the energy is better than the gradient, and over all that
bounds a piece equal to what f brings in there, to the tolerance of the solver.
"""

from __future__ import annotations

from dataclasses import replace
from math import fsum

import numpy as np

from cpmkit.forms.galerkin.conditions.terms import ConditionTerms
from cpmkit.protocols import Bools, Floats
from cpmkit.scene.laws import Nonlinear, Spectral


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
