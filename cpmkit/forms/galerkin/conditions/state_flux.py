"""Fluxes through a boundary that depend on the solution there, and the linear conditions at their tangents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.protocols import Floats
from cpmkit.scene.laws import Flux, Mixed, Nonlinear

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: A flux fixes no constant if its slope is below this share of what it is, by the size of u.
LEAST_SLOPE_SHARE = 1e-9


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
    """

    law: Nonlinear
    points: Floats
    values: csr_array

    @property
    def guess(self) -> float:
        """Value of u at which Newton's method starts."""
        return self.law.guess

    def read(self, u: Floats) -> Floats:
        """Return u (k,) there, from the unknowns (n, 1)."""
        return np.asarray((self.values @ u)[:, 0])

    def grows(self, seen: Floats) -> bool:
        """Tell whether the flux changes with u, beyond rounding, where u is ``seen``."""
        return _grows(self.law, seen, self.points)


@dataclass(frozen=True, eq=False)
class KnownValues:
    """Data whose values (k,) are known at the samples that they belong to, and only there."""

    values: Floats

    def __call__(self, _points: Floats) -> Floats:
        """Return the values."""
        return self.values


def tangent(law: Nonlinear, seen: Floats, points: Floats) -> Mixed | Flux:
    """Return ``du/db = j(v) + j'(v) (u - v)``, v being ``seen`` (k,) at ``points``; a flux where j does not change."""
    slope = law.slope_at(seen, points)
    datum = KnownValues(law.flux_at(seen, points) - slope * seen)
    return Mixed(1.0, KnownValues(-slope), datum) if _grows(law, seen, points) else Flux(datum)


def _grows(law: Nonlinear, seen: Floats, points: Floats) -> bool:
    slope, flux = law.slope_at(seen, points), law.flux_at(seen, points)
    size = np.abs(seen).max(initial=0.0) or 1.0
    return bool(np.any(np.abs(slope) * size > LEAST_SLOPE_SHARE * np.abs(flux).max(initial=0.0)))
