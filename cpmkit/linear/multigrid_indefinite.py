"""Minimal residuals with a multigrid cycle, for symmetric systems that are not positive.

Two kinds come here. Of ``A - i s M`` the cycle is that of ``A + s M``. Of standing waves it is that of A itself: all
levels on which a wave is resolved smooth as ever, because what a smoother damps is positive there, and the coarsest of
them, which knows all that is negative, is factorised as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.linear.levels import Level
from cpmkit.linear.minimal_residuals import minimal_residuals
from cpmkit.linear.multigrid_cycle import Cycle, cycle_of
from cpmkit.linear.operators import ComplexShift
from cpmkit.linear.report import SolveReport, judge
from cpmkit.protocols import Floats, Operator, Progress, no_progress

#: The residual of the recursion is driven this much below the tolerance, because it drifts from the true one, a little.
RECURSION_SHARE = 0.9
#: After so many iterations the true residual is computed, and the recursion starts afresh: each keeps a vector.
KEPT_VECTORS = 60


@dataclass(frozen=True, eq=False)
class Minimised:
    """An operator with its cycle.

    Attributes
    ----------
    operator : Operator
        What is solved with, real or complex.
    cycle : Cycle
        What preconditions it.
    max_iterations : int
        At most.
    """

    operator: Operator
    cycle: Cycle
    max_iterations: int

    def solve(
        self, b: Any, tolerance: float, guess: Any = None, progress: Progress = no_progress
    ) -> tuple[Any, SolveReport]:
        """Solve for all channels.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance.
        """
        size = np.linalg.norm(b, axis=0)
        u = np.zeros_like(b) if guess is None else guess.copy()
        u[:, size == 0] = 0.0  # the solution there; no guess gets nearer, and there is no relative residual to aim at
        iterations = products = 0
        while True:
            residual = b - self.operator.apply(u)
            products += b.shape[1]
            now = np.linalg.norm(residual, axis=0)
            open_ = np.flatnonzero(now > tolerance * size)
            left = min(self.max_iterations - iterations, KEPT_VECTORS)
            if not len(open_) or not left:
                break
            target, start = RECURSION_SHARE * tolerance * size[open_], np.ascontiguousarray(residual[:, open_])
            step, taken = minimal_residuals(self.operator.apply, self._precondition, start, target, left, progress)
            u[:, open_] += step
            iterations += taken
            products += taken * (1 + self.cycle.products) * len(open_)
            if taken < left and not self._fell(u, b, now):  # rounding, and no more of the same, limits it
                break
        progress("solve", 1.0)
        remedy = "ask for a larger solver_tolerance or more max_iterations, or use solver='direct'"
        return u, judge(self.operator, b, u, "multigrid", tolerance, iterations, products, remedy)

    def _fell(self, u: Any, b: Any, before: Floats) -> bool:
        """Tell whether the residual of some channel is less than half of what it was."""
        return bool(np.any(np.linalg.norm(b - self.operator.apply(u), axis=0) < 0.5 * before))

    def _precondition(self, residual: Any) -> Any:
        if not np.iscomplexobj(residual):
            return self.cycle.apply(residual)
        parts = np.split(self.cycle.apply(np.concatenate([residual.real, residual.imag], axis=1)), 2, axis=1)
        return parts[0] + 1j * parts[1]


def minimised(operator: Operator, levels: Sequence[Level], max_iterations: int) -> Minimised:
    """Return the iteration for ``A - i s M``, or for waves on the levels that resolve them.

    Raises
    ------
    Indefinite
        If an eigenvalue of the wrong sign shows where there should be none.
    """
    shifted, piece = isinstance(operator, ComplexShift), np.full(operator.size, -1)
    matrix = operator.companion() if isinstance(operator, ComplexShift) else operator.to_csr()
    return Minimised(operator, cycle_of(matrix, levels, piece, waves=not shifted), max_iterations)
