"""The estimated error of a solution: its size, where it is largest, and the coarser solutions that it comes from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import place
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.solution.display_mesh import DisplayMesh, evaluate_on_sides
from cpmkit.solution.modes import EigenRecord
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats

#: Ratio of the bound of an error to its estimate.
ERROR_SAFETY_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """An estimate of the error of a solution, or of its eigenvalues.

    Attributes
    ----------
    rms, largest : (channels,) float64
        Root mean square of the error over the manifold, and largest error, as shares of the solution's range; for an
        eigenvalue problem both are the relative error of each eigenvalue, infinite where a coarser lattice has no
        matching mode.
    unit : (channels,) float64
        The range of the solution, its size where it is constant, or each eigenvalue.
    in_time : float
        The part of both that is due to the steps in time.
    floor : (channels,) float64
        The error due to the representation of the manifold, at any spacing, as a share; zero (unknown) for eigenvalues.
    at : (d,) float64
        The point where the solutions differ most, in the scene's coordinates.
    slow : str
        Why the error may fall slowly with the spacing; empty without a reason.
    solution : SolutionRecord
        The solution.
    coarse_solutions : tuple of Solution
        Solutions at larger spacings with which it was compared, the coarsest last.
    order : float
        The order at which errors are assumed to fall from the coarsest solution on.
    factor : (channels,) float64
        Factor of errors at points: the largest error over the largest error estimated from the coarse solutions alone.
    """

    rms: Floats
    largest: Floats
    unit: Floats
    in_time: float
    floor: Floats
    at: Floats
    slow: str
    solution: SolutionRecord
    coarse_solutions: tuple[SolutionRecord, ...]
    order: float
    factor: Floats

    companions = DeprecatedMember("coarse_solutions")

    @property
    def error(self) -> Floats:
        """The largest error (channels,), in the solution's unit."""
        return np.asarray(self.largest * self.unit)

    @property
    def bound(self) -> Floats:
        """Twice the largest error plus that due to the source (channels,), in the solution's unit; rarely exceeded."""
        return np.asarray(ERROR_SAFETY_FACTOR * self.error + self.floor * self.unit)

    @property
    def coarse(self) -> SolutionRecord:
        """The coarsest solution used for the estimate."""
        return self.coarse_solutions[-1]

    def of(self, norm: str) -> float:
        """Return the error in the norm ``"rms"`` or ``"max"``, as a share of the range; the largest of the channels."""
        return float(np.max(self.rms if norm == "rms" else self.largest))

    def at_points(self, points: Any) -> Floats:
        """Return the estimated error (n,) or (n, channels) at points (n, d) of the manifold, in the solution's unit."""
        pair = (self.solution, self.coarse)
        errors = self._pointwise(*(solution.evaluate(points).reshape(len(points), -1) for solution in pair))
        return np.asarray(errors[:, 0] if errors.shape[1] == 1 else errors)

    def on_mesh(self, mesh: DisplayMesh) -> Floats:
        """Return the estimated error (v, channels) at the vertices of a mesh, each on the side of its cells."""
        sides = np.zeros((len(mesh.points), 0), dtype=np.int64) if mesh.sides is None else mesh.sides
        pair = (self.solution, self.coarse)
        return self._pointwise(*(evaluate_on_sides(solution, mesh.points, sides) for solution in pair))

    def _pointwise(self, fine: Floats, coarse: Floats) -> Floats:
        """Return the error (n, channels) from the values (n, channels) of the fine and the coarsest solution."""
        if isinstance(self.solution, EigenRecord):  # eigenfunctions of a multiplet are an arbitrary basis
            coarse = coarse @ np.linalg.lstsq(coarse, fine, rcond=None)[0]
        ratio = self.coarse.spacing / self.solution.spacing
        return np.asarray(self.factor * np.abs(fine - coarse) / (ratio**self.order - 1))

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate as numbers, lists and strings."""
        arrays = {name: getattr(self, name).tolist() for name in ("rms", "largest", "unit", "floor", "at")}
        spacings = [solution.spacing for solution in self.coarse_solutions]
        return {**arrays, "in_time": self.in_time, "slow": self.slow, "held_against_spacings": spacings}

    def __str__(self) -> str:
        """Return the error, its bound and its place in one sentence."""
        errors = ", ".join(f"{error:.2g}" for error in self.error)
        rms = ", ".join(f"{100 * share:.2g}" for share in self.rms)
        return (
            f"error about {errors} at spacing {self.solution.spacing:g}, at most {float(self.bound.max()):.2g}, "
            f"largest near {place(self.at)}; rms {rms} percent of the range{'; ' if self.slow else ''}{self.slow}"
        )
