"""What a solver reached, judged by a residual that is recomputed after the solve.

A residual that rounding forbids to fall further is accepted: with entries of 64 bits, ``b - A u`` is known to about
``eps (|A| |u| + |b|)`` alone, the bound of the componentwise backward error (Oettli and Prager, Numer. Math. 6, 1964).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.linear.operators import Bordered
from cpmkit.protocols import Floats, Operator

#: Rounding leaves at most so many times ``eps (|A| |u| + |b|)`` of a residual: sums of some ten products, twice.
ROUNDING_FACTOR = 4.0
#: A residual above this share of b is never put down to rounding: so large is that of a matrix that is singular, where
#: u grows until its rounding is as large as b.
MOST_ROUNDING = 1e-6


@dataclass(frozen=True)
class SolveReport:
    """The outcome of a solve.

    Attributes
    ----------
    solver : str
        Which solver it was.
    converged : bool
        True if ``residual <= tolerance``, or if rounding forbids a smaller one; ``reason`` says which.
    iterations : int
        The most that any channel took; 0 for a direct solver.
    operator_applications : int
        Products with A, all channels together.
    residual : float
        The largest ``|b - A u| / |b|`` of a channel, in the Euclidean norm, recomputed from u; A has its border, where
        it needs one. Where b is mostly what a constant u brings in, that is left out of it in the denominator.
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
    return float(np.max(_relative_to(b, b - operator.apply(u)), initial=0.0))


def _relative_to(b: Floats, part: Floats) -> Floats:
    """Return the norm of each column of ``part`` over that of b (channels,); NaN counts as infinite."""
    defect, size = np.linalg.norm(part, axis=0), np.linalg.norm(b, axis=0)
    ratios = np.where(size > 0, defect / np.where(size > 0, size, 1.0), np.where(defect > 0, np.inf, 0.0))
    return np.where(np.isfinite(ratios), ratios, np.inf)


def rounding_of(operator: Operator, u: Floats) -> Floats:
    """Return ``|A| |u|`` (n, channels), entry by entry: times the machine's epsilon, what rounding leaves of A u."""
    rounding = abs(operator.to_csr()) @ np.abs(u)
    if isinstance(operator, Bordered):
        rounding = rounding + operator.shift * (abs(operator.border.carried) @ (abs(operator.border.mean) @ np.abs(u)))
    return np.asarray(rounding)


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
        If the recomputed residual is above the tolerance, and above what rounding leaves; the message carries
        ``remedy``.
    """
    residuals = _relative_to(b, b - operator.apply(u))
    residual = float(np.max(residuals, initial=0.0))
    converged = residual <= tolerance
    reason = f"relative residual {residual:.2e} after {iterations} iterations, {tolerance:.2e} asked for"
    if not converged and residual <= MOST_ROUNDING:
        eps = ROUNDING_FACTOR * float(np.finfo(float).eps)
        limits = eps * _relative_to(b, rounding_of(operator, u) + np.abs(b))
        converged = bool((residuals <= np.maximum(tolerance, limits)).all())
        reason += f", {float(limits.max()):.2e} left by rounding"
    report = SolveReport(solver, converged, iterations, applications, residual, tolerance, reason)
    if not converged:
        raise ConvergenceError(f"The solver {solver!r} did not converge: {reason}; {remedy}.", report)
    return report
