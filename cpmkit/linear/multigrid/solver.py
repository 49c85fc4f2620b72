"""Conjugate gradients with a multigrid cycle over a form's coarser levels; GMRES where operators are not symmetric.

Systems that are not positive, or complex, go by minimal residuals (:mod:`cpmkit.linear.multigrid.solver`).

The iterations do not grow when the spacing falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.csr_matrices import UnsignedCsr, halved
from cpmkit.linear.direct import Indefinite
from cpmkit.linear.krylov import minimal_residuals
from cpmkit.linear.multigrid.cycle import Cycle, Level, cycle_of
from cpmkit.linear.multigrid.schwarz import PreconditionedUnsymmetric, prepare_unsymmetric
from cpmkit.linear.operators import Bordered, ComplexShift, CsrOperator, has_symmetric_pattern
from cpmkit.linear.preconditioned import Preconditioned, indefinite
from cpmkit.linear.solve_report import SolveReport, judge
from cpmkit.protocols import Floats, Operator, Progress, no_progress

#: The most unknowns of a coarsest level, which is factorised, and of one that has to resolve waves.
MOST_FACTORISED, MOST_FACTORISED_WAVES = 20_000, 100_000


@dataclass(frozen=True)
class Multigrid:
    """Conjugate gradients with a symmetric V cycle.

    Attributes
    ----------
    max_iterations : int
        At most; some 20 are usual, 30 with conditions inside the manifold.
    """

    max_iterations: int = 300

    def prepare(
        self, operator: Operator, levels: Sequence[Any] = ()
    ) -> Preconditioned | PreconditionedUnsymmetric | Minimised:
        """Return the iteration, with the operators of all levels, their smoothers and factors.

        Raises
        ------
        SceneError
            If the operator is not symmetric, or large and the form has no levels for it.
        ConvergenceError
            If the operator turns out to have an eigenvalue of the wrong sign.
        """
        bordered = operator if isinstance(operator, Bordered) else None
        inner = operator if bordered is None else bordered.operator
        waves = isinstance(inner, CsrOperator) and inner.indefinite
        if not has_symmetric_pattern(inner) or (waves and bordered is not None):
            raise SceneError("solver 'multigrid' solves systems of a form that has levels; use solver='direct'.")
        _check_coarsest(levels[-1].prolongation.shape[1] if levels else inner.size, inner.size, waves)
        if not inner.symmetric:
            return _unsymmetric(operator, levels, self.max_iterations)
        try:
            if waves or isinstance(inner, ComplexShift):
                return minimised(inner, levels, self.max_iterations)
            piece = np.full(inner.size, -1)
            if bordered is not None:
                members = bordered.border.indicator.tocoo()
                piece[members.row] = members.col
            matrix = inner.to_csr()
            half = halved(matrix)
            cycle = cycle_of(matrix, levels, piece, half=half)
            more_exact = partial(cycle_of, matrix, levels, piece, is_rounded=False) if cycle.is_rounded else None
        except Indefinite as error:
            raise indefinite("multigrid", error, 0, np.nan) from error
        rows = UnsignedCsr.of(matrix) if half is None else half
        steps = self.max_iterations
        return Preconditioned(operator, rows, bordered, cycle, steps, "multigrid", more_exact=more_exact)


def _unsymmetric(operator: Operator, levels: Sequence[Any], max_iterations: int) -> PreconditionedUnsymmetric:
    try:
        return prepare_unsymmetric(operator, levels, max_iterations)
    except RuntimeError as error:
        raise SceneError(
            f"The linear system is singular in a part of the manifold ({error}): nothing fixes the solution there."
        ) from error


def _check_coarsest(unknowns: int, size: int, waves: bool) -> None:
    """Refuse a coarsest level of so many unknowns, of ``size`` on the finest, that is too large to be factorised.

    Raises
    ------
    SceneError
        If so.
    """
    if waves and unknowns > MOST_FACTORISED_WAVES:
        raise SceneError(
            f"solver 'multigrid' factorises the coarsest level that resolves the waves, and it has {unknowns:,} of the "
            f"{size:,} unknowns, where up to {MOST_FACTORISED_WAVES:,} are accepted; use solver='direct', or a larger "
            "spacing."
        )
    if not waves and unknowns > MOST_FACTORISED:
        raise SceneError(
            f"solver 'multigrid' needs coarser levels, which the form has none of for {size} unknowns; use "
            "solver='direct'."
        )


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
