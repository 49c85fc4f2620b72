"""What a solver reached, judged by a residual that is recomputed after the solve."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.protocols import Floats, Operator


@dataclass(frozen=True)
class SolveReport:
    """The outcome of a solve.

    Attributes
    ----------
    solver : str
        Which solver it was.
    converged : bool
        True if ``residual <= tolerance``.
    iterations : int
        The most that any channel took; 0 for a direct solver.
    operator_applications : int
        Products with A, all channels together.
    residual : float
        The largest ``|b - A u| / |b|`` of a channel, in the Euclidean norm, recomputed from u; A has its border, where
        it needs one.
    tolerance : float
        What was asked for.
    reason : str
        One sentence.
    """

    solver: str
    converged: bool
    iterations: int
    operator_applications: int
    residual: float
    tolerance: float
    reason: str

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values."""
        return asdict(self)


def relative_residual(operator: Operator, b: Floats, u: Floats) -> float:
    """Return the largest relative residual of a channel; NaN counts as infinite."""
    defect = np.linalg.norm(b - operator.apply(u), axis=0)
    size = np.linalg.norm(b, axis=0)
    ratios = np.where(size > 0, defect / np.where(size > 0, size, 1.0), np.where(defect > 0, np.inf, 0.0))
    worst = float(np.max(ratios, initial=0.0))
    return worst if np.isfinite(worst) else np.inf


def judge(
    operator: Operator,
    b: Floats,
    u: Floats,
    solver: str,
    tolerance: float,
    iterations: int,
    applications: int,
    remedy: str,
) -> SolveReport:
    """Return the report of a solve.

    Raises
    ------
    ConvergenceError
        If the recomputed residual is above the tolerance; the message carries ``remedy``.
    """
    residual = relative_residual(operator, b, u)
    converged = residual <= tolerance
    reason = f"relative residual {residual:.2e} after {iterations} iterations, {tolerance:.2e} asked for"
    report = SolveReport(solver, converged, iterations, applications, residual, tolerance, reason)
    if not converged:
        raise ConvergenceError(f"The solver {solver!r} did not converge: {reason}; {remedy}.", report)
    return report
