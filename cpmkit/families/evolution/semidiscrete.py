"""A problem in time, discretised in space: u' = -A u + b(t), or u'' for waves, and where it starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.assembly import build_operator
from cpmkit.forms.collocation.boundary.reading import Datum, sum_of_data
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.linear.operators import Operator
from cpmkit.protocols import Floats, Ints
from cpmkit.scene.data import Data, takes_time
from cpmkit.scene.equations_in_time import Evolution

F = "the right-hand side f"
#: So often are ghosts read at the start: each reads a mirror point, near the boundary through other ghosts.
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class SemiDiscrete:
    """A and b(t).

    Attributes
    ----------
    tables : Discretization
        Of the scene.
    operator : Operator
        A.
    f : Data
        Right-hand side.
    steady : (n, channels) float64
        What in b does not depend on the time.
    moving : sequence of Datum
        Boundary data that do.
    """

    tables: Discretization
    operator: Operator
    f: Data
    steady: Floats
    moving: Sequence[Datum]

    @property
    def largest_eigenvalue(self) -> float:
        """A bound of A's eigenvalues where the diffusivity is constant: that of a solid's Laplacian."""
        return 4 * self.tables.layout.lattice.dim * self.operator.scale

    def forcing(self, time: float) -> Floats:
        """Return b(time), (n, channels)."""
        if not self.moving and not takes_time(self.f):
            return self.steady
        b = self.steady.copy()
        if takes_time(self.f):
            b += self.tables.read_sources(self.f, F, time)
        if self.moving:
            b += self.operator.spread(self._moved(time))
        return b

    def derivative(self, u: Floats, time: float) -> Floats:
        """Return -A u + b(time)."""
        return np.asarray(self.forcing(time) - self.operator.apply(u))

    def start(self, initial: Data, what: str) -> Floats:
        """Return the unknowns (n, channels) at time 0: ``initial``, continued across boundaries by their conditions.

        Where the ghosts would start with the values at their feet, they would be off by the order of the spacing
        until diffusion over one spacing has put that right: the whole of a run with very short steps.
        """
        return self._continued(self.tables.read_sources(initial, what, 0.0), self.tables.datum(0.0))

    def start_rate(self, rate: Data, what: str, step: float) -> Floats:
        """Return the rates (n, channels) at time 0, continued by the conditions' rates over the first step."""
        datum = (self._moved(step) - self._moved(0.0)) / step
        return self._continued(self.tables.read_sources(rate, what, 0.0), datum)

    def _continued(self, u: Floats, datum: Floats) -> Floats:
        """Return u (n, channels) with what the conditions make of it at ghosts and nodes past an edge."""
        unknowns = continued_unknowns(self.tables)
        rows = self.tables.unknown_rows[unknowns]
        continued, extension = u.copy(), self.tables.extension[rows]
        for _ in range(ROUNDS):
            continued[unknowns] = extension @ continued + datum[rows]
        return continued

    def _moved(self, time: float) -> Floats:
        """Return what the boundary data that depend on the time add to E u."""
        return sum_of_data(self.moving, self.tables.extension.shape[0], self.tables.layout.channels, time)


def semidiscretize(tables: Discretization, problem: Evolution) -> SemiDiscrete:
    """Return the problem in time on ``tables``; data that do not depend on the time are read once."""
    terms = problem.terms()
    operator = build_operator(tables, terms)
    still = [datum for datum in tables.data if not datum.takes_time]
    moving = [datum for datum in tables.data if datum.takes_time]
    steady = operator.spread(sum_of_data(still, tables.extension.shape[0], tables.layout.channels))
    if not takes_time(terms.f):
        steady += tables.read_sources(terms.f, F, 0.0)
    return SemiDiscrete(tables, operator, terms.f, steady, moving)


def continued_unknowns(tables: Discretization) -> Ints:
    """Return the unknowns that a condition continues past a boundary or an edge: ghosts, and nodes past an edge."""
    inner = tables.layout.band.inner
    past = np.flatnonzero(tables.layout.band.feet.edge[:inner] >= 0)
    return np.concatenate([past, np.arange(inner, tables.unknowns.count)])
