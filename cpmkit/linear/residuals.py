"""Residuals that are recomputed after a solve, and the decision whether the solve converged.

A residual that rounding keeps from falling further is accepted: in float64, ``b - A u`` is known to about
``eps (|A| |u| + |b|)``, the bound of the componentwise backward error (Oettli and Prager, Numer. Math. 6, 1964).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError
from cpmkit.linear.operators import Operator, as_bordered
from cpmkit.types import Floats


@dataclass(frozen=True)
class SolveReport:
    """The outcome of a linear solve."""

    solver: str  #: Name of the solver.
    #: True if ``residual <= tolerance``, or if rounding forbids a smaller residual, as ``reason`` then states.
    converged: bool
    iterations: int  #: Largest number of iterations of a channel; 0 for a direct solver.
    operator_applications: int  #: Number of products with A, of all channels together.
    #: The largest ``|b - A u| / |b|`` of a channel, in the Euclidean norm, recomputed from u; A includes its border, if
    #: it has one. Where most of b is the image of a constant u, the denominator is the norm of the rest.
    residual: float
    tolerance: float  #: The relative residual that was requested.
    reason: str  #: The residual, the iterations and the tolerance in words.

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a dictionary of plain values."""
        return asdict(self)


#: Rounding leaves a residual of at most this many times ``eps (|A| |u| + |b|)``: sums of about ten products, twice.
ROUNDING_FACTOR = 4.0
#: A larger residual, relative to b, is never attributed to rounding: for a singular matrix u grows until the rounding
#: of A u is as large as b.
MAX_ROUNDING_SHARE = 1e-6


def rounding_bound(operator: Operator, u: Floats) -> Floats:
    """Return ``|A| |u|`` (n, channels) for u (n, channels): times machine epsilon it bounds the rounding of ``A u``."""
    rounding = abs(operator.to_csr()) @ np.abs(u)
    bordered = as_bordered(operator)
    if bordered is not None:
        border = bordered.border
        rounding = rounding + bordered.shift * (abs(border.constant_load) @ (abs(border.mean) @ np.abs(u)))
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
    """Return the report of a solve of ``A u = b`` for b (n, channels), whose residual is recomputed here.

    ``solver``, ``iterations`` and ``applications`` of A go into the report. Raises ConvergenceError if a relative
    residual is above the ``tolerance`` and above what rounding leaves, 1e-6 at most; the message ends with ``remedy``.
    """
    residuals = _relative_norms(b, b - operator.apply(u))
    residual = float(np.max(residuals, initial=0.0))
    converged = residual <= tolerance
    reason = f"relative residual {residual:.2e} after {iterations} iterations, tolerance {tolerance:.2e}"
    if not converged and residual <= MAX_ROUNDING_SHARE:
        eps = ROUNDING_FACTOR * float(np.finfo(float).eps)
        limits = eps * _relative_norms(b, rounding_bound(operator, u) + np.abs(b))
        converged = bool((residuals <= np.maximum(tolerance, limits)).all())
        reason += f", {float(limits.max()):.2e} left by rounding"
    report = SolveReport(solver, converged, iterations, applications, residual, tolerance, reason)
    if not converged:
        raise ConvergenceError(f"The solver {solver!r} did not converge: {reason}; {remedy}.", report)
    return report


def _relative_norms(b: Floats, part: Floats) -> Floats:
    """Return norms (channels,) of columns of ``part`` over those of b, both (n, channels); 0 / 0 is 0, x / 0 inf."""
    defect, size = np.linalg.norm(part, axis=0), np.linalg.norm(b, axis=0)
    return np.asarray(np.divide(defect, size, out=np.where(defect == 0, 0.0, np.inf), where=size > 0))


class IndefiniteError(ArithmeticError):
    """A symmetric matrix or preconditioner has an eigenvalue that is not positive; the message names the place."""
