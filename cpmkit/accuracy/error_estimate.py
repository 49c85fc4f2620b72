"""An estimate of a solution's error: how large it is, where, and what it was held against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import place
from cpmkit.protocols import Floats
from cpmkit.solution.display_mesh import DisplayMesh, evaluate_on_sides
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord

#: What a cautious user multiplies the estimate by.
ERROR_SAFETY_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """An estimate of the error of a solution, or of its eigenvalues.

    Attributes
    ----------
    rms, largest : (channels,) float64
        Root mean square over the manifold, and the largest, as shares of the solution's range; of an eigenvalue problem
        both are the relative error of each eigenvalue, infinite where a coarser lattice has no mode like its own.
    unit : (channels,) float64
        What they are shares of: the range, the size where a solution is constant, each eigenvalue.
    in_time : float
        What of both is due to the steps in time; 0 where there are none.
    floor : (channels,) float64
        What the source alone leaves, whatever the spacing, as a share; of eigenvalues not known, and zero.
    at : (d,) float64
        Where the solutions differ most, in the scene's coordinates.
    slow : str
        Why the error may fall slowly with the spacing; empty where nothing says so.
    solution : Solution
        Whose error it is.
    companions : tuple of Solution
        That it was held against, the coarsest last.
    order : float
        At which errors are taken to fall from the last companion on: the form's, or one that is given.
    factor : (channels,) float64
        By what errors point by point, which follow the difference from the last companion, are multiplied: the largest
        error over what companions alone let estimate.
    """

    rms: Floats
    largest: Floats
    unit: Floats
    in_time: float
    floor: Floats
    at: Floats
    slow: str
    solution: SolutionRecord
    companions: tuple[SolutionRecord, ...]
    order: float
    factor: Floats

    @property
    def error(self) -> Floats:
        """The largest error in the solution's own unit, (channels,)."""
        return np.asarray(self.largest * self.unit)

    @property
    def bound(self) -> Floats:
        """Twice the largest error and the source's floor, in the solution's unit: what is hardly exceeded."""
        return np.asarray(ERROR_SAFETY_FACTOR * self.error + self.floor * self.unit)

    @property
    def coarse(self) -> SolutionRecord:
        """The last companion."""
        return self.companions[-1]

    def of(self, norm: str) -> float:
        """Return the error in a norm, ``"rms"`` or ``"max"``, of the channel where it is greatest, as a share."""
        return float(np.max(self.rms if norm == "rms" else self.largest))

    def at_points(self, points: Any) -> Floats:
        """Return the estimated error (n,) or (n, channels) at points of the manifold, in the solution's own unit."""
        found = self._apart(*(one.evaluate(points).reshape(len(points), -1) for one in (self.solution, self.coarse)))
        return np.asarray(found[:, 0] if found.shape[1] == 1 else found)

    def on_mesh(self, mesh: DisplayMesh) -> Floats:
        """Return the estimated error (v, channels) at a mesh's vertices, each on the side that its cells lie on."""
        sides = np.zeros((len(mesh.points), 0), dtype=np.int64) if mesh.sides is None else mesh.sides
        return self._apart(*(evaluate_on_sides(one, mesh.points, sides) for one in (self.solution, self.coarse)))

    def _apart(self, ours: Floats, theirs: Floats) -> Floats:
        if isinstance(self.solution, EigenRecord):  # a multiplet's functions are any basis of it
            theirs = theirs @ np.linalg.lstsq(theirs, ours, rcond=None)[0]
        ratio = self.coarse.spacing / self.solution.spacing
        return np.asarray(self.factor * np.abs(ours - theirs) / (ratio**self.order - 1))

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate as plain values."""
        arrays = {name: getattr(self, name).tolist() for name in ("rms", "largest", "unit", "floor", "at")}
        spacings = [one.spacing for one in self.companions]
        return {**arrays, "in_time": self.in_time, "slow": self.slow, "held_against_spacings": spacings}

    def __str__(self) -> str:
        errors = ", ".join(f"{error:.2g}" for error in self.error)
        rms = ", ".join(f"{100 * one:.2g}" for one in self.rms)
        return (
            f"error about {errors} at spacing {self.solution.spacing:g}, at most {float(self.bound.max()):.2g}, "
            f"largest near {place(self.at)}; rms {rms} percent of the range{'; ' if self.slow else ''}{self.slow}"
        )
