"""Fluxes through a boundary that depend on the solution there, and the linear conditions at their tangents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.scene.laws import Flux, Mixed, Nonlinear

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: A flux fixes no constant if u changes it by less than this share of u over a spacing: rounding, or differences.
LEAST_SLOPE = 1e-9


@dataclass(frozen=True, eq=False)
class BoundaryFlux:
    """Samples at which du/db = j(u).

    Attributes
    ----------
    law : Nonlinear
        With j, its slope and the value at which Newton's method starts.
    points : (k, d) float64
        In the scene's coordinates.
    values : csr_array (k, n)
        Rows that read u there.
    spacing : float
        h, of the lattice.
    """

    law: Nonlinear
    points: Floats
    values: csr_array
    spacing: float

    @property
    def guess(self) -> float:
        """Value of u at which Newton's method starts."""
        return self.law.guess

    def read(self, u: Floats) -> Floats:
        """Return u (k,) there, from the unknowns (n, 1)."""
        return np.asarray((self.values @ u)[:, 0])

    def grows(self, seen: Floats) -> bool:
        """Tell whether the flux changes with u, beyond rounding, where u is ``seen``."""
        return _grows(self.law, seen, self.points, self.spacing)


@dataclass(frozen=True, eq=False)
class KnownValues:
    """Data whose values (k,) are known at the samples that they belong to, and only there."""

    values: Floats

    def __call__(self, _points: Floats) -> Floats:
        """Return the values."""
        return self.values


def tangent(law: Nonlinear, seen: Floats, points: Floats, spacing: float) -> Mixed | Flux:
    """Return ``du/db = j(v) + j'(v) (u - v)``, v being ``seen`` (k,) at ``points``; a flux where j does not change."""
    slope = law.slope_at(seen, points)
    datum = KnownValues(law.flux_at(seen, points) - slope * seen)
    return Mixed(1.0, KnownValues(-slope), datum) if _grows(law, seen, points, spacing) else Flux(datum)


def _grows(law: Nonlinear, seen: Floats, points: Floats, spacing: float) -> bool:
    return bool(np.any(np.abs(law.slope_at(seen, points)) * spacing > LEAST_SLOPE))
