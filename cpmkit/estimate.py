"""How large the error of a solution is: solved again at twice the spacing, by Richardson's extrapolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.choice import FORMS
from cpmkit.forms.options import Options
from cpmkit.linear.choice import SolverOptions
from cpmkit.protocols import Floats
from cpmkit.runtime.declared import showing
from cpmkit.runtime.warn import collected_warnings, warn_each
from cpmkit.scene.scene import Scene
from cpmkit.solution.matched_modes import compare_modes, with_further_modes
from cpmkit.solution.modes import EigenSolution
from cpmkit.solution.solution import Solution
from cpmkit.solving import solve

#: At about so many feet of nodes the two solutions are compared.
COMPARED_FEET = 4000
#: What a cautious user multiplies the estimate by.
ERROR_SAFETY_FACTOR = 2.0


@dataclass(frozen=True, eq=False)
class ErrorEstimate:
    """An estimate of the largest error of a solution, or of its eigenvalues.

    Attributes
    ----------
    error : (channels,) float64
        ``max |u - u_coarse|`` over the form's divisor, which for an order k is 2^k - 1, at the spacing asked for. Of an
        eigenvalue problem the same of each eigenvalue; infinite where at twice the spacing no mode is like its own.
    floor : (channels,) float64
        What the source alone leaves, whatever the spacing; of eigenvalues not known, and zero.
    at : (d,) float64
        Where the two solutions differ most, in the scene's coordinates.
    solution, coarse : Solution
        At the spacing, and at twice it.
    """

    error: Floats
    floor: Floats
    at: Floats
    solution: Solution
    coarse: Solution

    @property
    def bound(self) -> Floats:
        """Twice the estimate and the source's floor: what the error hardly exceeds, (channels,)."""
        return np.asarray(ERROR_SAFETY_FACTOR * self.error + self.floor)

    def __str__(self) -> str:
        errors = ", ".join(f"{error:.2g}" for error in self.error)
        return (
            f"error about {errors} at spacing {self.solution.spacing:g}, at most {float(self.bound.max()):.2g}, "
            f"largest near {place(self.at)}"
        )


@showing(Options, *FORMS.values(), SolverOptions)
def estimate_error(scene: Scene, spacing: float, **options: Any) -> ErrorEstimate:
    """Solve a scene at ``spacing`` and at twice it, and estimate the error of the finer solution.

    On a single position of the lattice the estimate is within a factor of two or three of the true error; where the
    coarse grid does not see the scene (thin parts, boundaries near each other) it is larger than that. Eigenvalues are
    matched by their functions, multiplets as a whole.

    Parameters
    ----------
    scene : Scene
        What is solved.
    spacing : float
        Of the finer solution.
    **options
        As for :func:`cpmkit.solve`. The error is taken to fall with the power ``order`` of the spacing, 3 counting as
        2.

    Returns
    -------
    ErrorEstimate

    Raises
    ------
    CpmkitError
        As ``solve`` does, at either spacing.

    Examples
    --------
    >>> import cpmkit as ck
    >>> f = ck.ScreenedPoisson(lambda points: 2 * points[:, 0], c=1.0)  # u = x
    >>> circle = ck.source("analytic.circle")
    >>> estimate = ck.estimate_error(ck.Scene(circle, f), spacing=0.05)
    >>> points = circle.mesh(0.01)[0]
    >>> bool(1 < estimate.error[0] / abs(estimate.solution.evaluate(points) - points[:, 0]).max() < 5)
    True
    """
    with collected_warnings():
        solution = solve(scene, spacing, **options)
        coarser = with_further_modes(scene) if isinstance(solution, EigenSolution) else scene
        coarse = solve(coarser, 2 * spacing, **options)
    warn_each(solution.warnings)
    form = solution.discretized
    points = form.points
    points = points[np.linspace(0, len(points) - 1, min(COMPARED_FEET, len(points))).astype(np.int64)]
    if isinstance(solution, EigenSolution) and isinstance(coarse, EigenSolution):
        differences, apart = compare_modes(solution, coarse, points)
        divisor = form.eigenvalue_divisor()
        floor = np.zeros(len(differences))
    else:
        fine = solution.evaluate(points).reshape(len(points), -1)
        apart = np.abs(fine - coarse.evaluate(points).reshape(len(points), -1))
        differences, divisor = apart.max(axis=0), form.error_divisor()
        floor = form.source_error() * (fine.max(axis=0) - fine.min(axis=0))
    at = points[int(apart.max(axis=1).argmax())]
    return ErrorEstimate(differences / divisor, floor, at, solution, coarse)
