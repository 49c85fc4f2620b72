"""Constants taken out of a linear system: a relative residual then compares to what varies, wherever zero lies.

With K the functions that are constant and c the least squares solution of ``A K c = b``, ``A v = b - A K c`` is solved
and ``u = v + K c``. Where u is a large constant and a small variation, b is nearly ``A K c``; a residual relative to b
would be as large as the variation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.linear.operators import Bordered
from cpmkit.linear.report import SolveReport
from cpmkit.protocols import Floats, Operator, PreparedSolver, Progress, no_progress

#: Constants are taken out where that leaves at most this share of b; else a relative residual means nearly the same.
MOST_LEFT = 0.5
#: Where b sums to less than this share of its size, quadrature may have made all of the sum.
CANCELLING_SHARE = 1e-6
#: Where ``K' A K`` is less than this share of its parts, rounding is much of it.
CANCELLED_SHARE = 1e-12
#: Exponents by which b is scaled lie between plus and minus this: powers of two that are neither zero nor infinite.
MOST_EXPONENT = 1000
#: A part of b below this share of it is rounding: no solver is to resolve it.
ROUNDING_SHARE = 4 * np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Constants:
    """The constants of an operator's unknowns.

    Attributes
    ----------
    functions : (n, k) float64
        K, functions that are constant, or constant on some pieces and zero on others.
    images : (n, k)
        A K.
    sizes : (k,) float64
        ``K' |diag A| K``: what ``K' A K`` would be, were its entries not to cancel.
    """

    functions: Floats
    images: Any
    sizes: Floats

    @classmethod
    def of(cls, operator: Operator, functions: Floats) -> Constants:
        """Return those of an operator; pieces on which a constant is free are apart from all others."""
        if isinstance(operator, Bordered):
            free = np.asarray(operator.border.indicator.sum(axis=1)).reshape(-1, 1)
            functions = np.concatenate([functions * (1 - free), functions * free], axis=1)
            functions = np.ascontiguousarray(functions[:, functions.any(axis=0)])
        return cls(functions, operator.apply(functions), np.sum(np.abs(operator.diagonal) * functions**2, axis=0))

    def solve(
        self,
        prepared: PreparedSolver,
        b: Any,
        tolerance: float,
        guess: Any = None,
        progress: Progress = no_progress,
    ) -> tuple[Any, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report whose residual is relative to ``b - A K c``.

        Where that is so small that rounding of b is more than ``tolerance`` of it, the residual is relative to what
        makes this rounding ``tolerance``.

        Parameters
        ----------
        prepared : PreparedSolver
            Solves with A.
        b, tolerance, guess, progress
            As for ``prepared.solve``. Of b what rounding has left is not solved for.

        Raises
        ------
        ConvergenceError
            As ``prepared.solve`` does.
        """
        exponent = _exponent(b)  # scaled by powers of two, squares of b neither overflow nor vanish
        unit = _powers(exponent)
        b = b * unit
        size = np.linalg.norm(b, axis=0)
        shares = np.linalg.lstsq(self.images, b, rcond=None)[0]
        rest = b - self.images @ shares
        left = np.linalg.norm(rest, axis=0)
        kept = left > MOST_LEFT * size
        shares[:, kept] = 0.0
        rest = np.where(kept, b, rest)
        left = np.where(kept, size, left)
        noise = ROUNDING_SHARE * size
        rest[:, left <= noise] = 0.0
        todo = left > noise
        reached = max(tolerance, float(np.min(noise[todo] / left[todo], initial=1.0))) if todo.any() else tolerance
        start = None if guess is None else guess * unit - self.functions @ shares
        v, report = prepared.solve(rest, reached, start, progress)
        report = replace(report, residual=report.residual * (tolerance / reached), tolerance=tolerance)
        return (v + self.functions @ shares) * _powers(-exponent), report

    def chance(self, b: Floats, u: Floats) -> tuple[str, ...]:
        """Return a warning where the mean of u (n, channels) is a sum of b that cancels, over what is hardly known.

        That is where the mean is larger than the range, or where rounding is much of ``K' A K``.
        """
        sums, sizes = np.abs(self.functions.T @ b), np.abs(self.functions).T @ np.abs(b)
        own = np.einsum("nk,nk->k", self.functions, self.images)[:, None]
        shift = np.divide(sums, np.abs(own), out=np.zeros_like(sums), where=own != 0)
        unknown = (np.abs(own) <= CANCELLED_SHARE * self.sizes[:, None]) | (shift > np.ptp(u, axis=0))
        felt = unknown & (sums <= CANCELLING_SHARE * sizes) & (sizes > 0)
        if not felt.any():
            return ()
        share = float((sums[felt] / sizes[felt]).max())
        return (
            f"The mean of the solution follows from a sum of f and the fluxes that cancels to {share:.1g} of their "
            "size, divided by a small c: quadrature and rounding decide it, and the rest of the solution alone is "
            "right; use c=0, for a mean of zero, or a larger c.",
        )


def _exponent(b: Any) -> Any:
    """Return for each column the exponent of the power of two that is about its largest entry, 0 where that is zero."""
    return np.clip(np.frexp(np.abs(b).max(axis=0, initial=0.0))[1], -MOST_EXPONENT, MOST_EXPONENT)


def _powers(exponent: Any) -> Floats:
    return np.asarray(np.ldexp(1.0, -exponent))
