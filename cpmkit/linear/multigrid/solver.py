"""The solver ``multigrid``: Krylov iterations preconditioned by a cycle over a form's coarser levels.

Conjugate gradients solve symmetric positive systems. GMRES solves complex shifts ``A - i s M``, with the cycle of
``A + s M``; standing waves, with a cycle that is exact on the coarsest level that resolves them; and advection
(:mod:`cpmkit.linear.multigrid.schwarz`). The number of iterations does not grow when the spacing falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.csr_matrices import UnsignedCsr, as_symmetric_csr
from cpmkit.linear.direct import IndefiniteError
from cpmkit.linear.krylov import REMEDY, gmres, solve_by_corrections
from cpmkit.linear.multigrid.cycle import Cycle, Level, build_cycle
from cpmkit.linear.multigrid.schwarz import PreconditionedAdvection, prepare_advection
from cpmkit.linear.operators import Bordered, ComplexShift, CsrOperator, has_symmetric_pattern
from cpmkit.linear.preconditioned import PreconditionedCG, indefinite_error
from cpmkit.linear.protocols import Operator
from cpmkit.linear.residuals import judge
from cpmkit.linear.solve_report import SolveReport
from cpmkit.types import Floats, Progress, no_progress

#: Most unknowns of a coarsest level, which is factorised, and most of a coarsest level that has to resolve waves.
MAX_FACTORISED, MAX_FACTORISED_WAVES = 20_000, 100_000


@dataclass(frozen=True)
class MultigridSolver:
    """Krylov iterations with a multigrid cycle.

    Attributes
    ----------
    max_iterations : int
        Most iterations; 20 are usual, 30 with conditions inside the manifold.
    """

    max_iterations: int = 300

    def prepare(
        self, operator: Operator, levels: Sequence[Any] = ()
    ) -> PreconditionedCG | PreconditionedAdvection | PreconditionedGMRES:
        """Return the Krylov iteration with its cycle: matrices of all levels, their smoothers and the coarsest factors.

        Raises
        ------
        SceneError
            If the pattern of the operator is not symmetric, or it is large and there are no ``levels`` for it.
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
            return _prepare_advection(operator, levels, self.max_iterations)
        try:
            if waves or isinstance(inner, ComplexShift):
                return prepare_indefinite(inner, levels, self.max_iterations)
            piece = np.full(inner.size, -1)
            if bordered is not None:
                members = bordered.border.indicator.tocoo()
                piece[members.row] = members.col
            matrix = inner.to_csr()
            half = as_symmetric_csr(matrix)
            cycle = build_cycle(matrix, levels, piece, half=half)
            more_exact = partial(build_cycle, matrix, levels, piece, is_rounded=False) if cycle.is_rounded else None
        except IndefiniteError as error:
            raise indefinite_error("multigrid", error, 0, np.nan) from error
        rows = UnsignedCsr.of(matrix) if half is None else half
        steps = self.max_iterations
        return PreconditionedCG(operator, rows, bordered, cycle, steps, "multigrid", more_exact=more_exact)


def _prepare_advection(operator: Operator, levels: Sequence[Any], max_iterations: int) -> PreconditionedAdvection:
    """Return the iteration for an operator with advection; raise a SceneError if a block is singular."""
    try:
        return prepare_advection(operator, levels, max_iterations)
    except RuntimeError as error:
        raise SceneError(
            f"The linear system is singular in a part of the manifold ({error}): nothing fixes the solution there."
        ) from error


def _check_coarsest(unknowns: int, size: int, waves: bool) -> None:
    """Raise if the coarsest level is too large to be factorised.

    Raises
    ------
    SceneError
        If its ``unknowns``, of ``size`` on the finest level, are too many.
    """
    if waves and unknowns > MAX_FACTORISED_WAVES:
        raise SceneError(
            f"solver 'multigrid' factorises the coarsest level that resolves the waves, and it has {unknowns:,} of the "
            f"{size:,} unknowns, where up to {MAX_FACTORISED_WAVES:,} are accepted; use solver='direct', or a larger "
            "spacing."
        )
    if not waves and unknowns > MAX_FACTORISED:
        raise SceneError(
            f"solver 'multigrid' needs coarser levels, which the form has none of for {size} unknowns; use "
            "solver='direct'."
        )


@dataclass(frozen=True, eq=False)
class PreconditionedGMRES:
    """A symmetric operator, real or complex, that is not positive definite, with the cycle that preconditions GMRES.

    Attributes
    ----------
    operator : Operator
        The operator.
    cycle : Cycle
        Its preconditioner.
    max_iterations : int
        Most iterations.
    """

    operator: Operator
    cycle: Cycle
    max_iterations: int

    def solve(
        self, b: Any, tolerance: float, guess: Any = None, progress: Progress = no_progress
    ) -> tuple[Any, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance.
        """

        def correct(residual: Any, target: Floats, most: int) -> tuple[Any, int, int]:
            """Return a correction of u, the iterations and the products with A, as a :data:`Correction`."""
            step, taken = gmres(self.operator.apply, self._precondition, residual, target, most, progress)
            return step, taken, taken * (1 + self.cycle.products) * residual.shape[1]

        u, iterations, products = solve_by_corrections(
            lambda u: b - self.operator.apply(u),
            b,
            guess,
            tolerance,
            correct,
            max_iterations=self.max_iterations,
            target_share=0.9,
            round_iterations=60,  # a vector is stored for each
            stops_when_stalled=True,  # rounding limits the residual
        )
        progress("solve", 1.0)
        return u, judge(self.operator, b, u, "multigrid", tolerance, iterations, products, REMEDY)

    def _precondition(self, residual: Any) -> Any:
        """Return the cycle applied to a real or complex ``residual`` (n, channels)."""
        if not np.iscomplexobj(residual):
            return self.cycle.apply(residual)
        parts = np.split(self.cycle.apply(np.concatenate([residual.real, residual.imag], axis=1)), 2, axis=1)
        return parts[0] + 1j * parts[1]


def prepare_indefinite(operator: Operator, levels: Sequence[Level], max_iterations: int) -> PreconditionedGMRES:
    """Return the iteration for ``A - i s M``, or for standing waves, with levels that resolve them.

    The cycle of waves is that of A: smoothers damp components for which A is positive on all levels that resolve a
    wave, and the coarsest of these levels, on which A has negative eigenvalues, is factorised without change.

    Raises
    ------
    IndefiniteError
        If ``A + s M`` has an eigenvalue of the wrong sign.
    """
    shifted, piece = isinstance(operator, ComplexShift), np.full(operator.size, -1)
    matrix = operator.positive_matrix() if isinstance(operator, ComplexShift) else operator.to_csr()
    return PreconditionedGMRES(operator, build_cycle(matrix, levels, piece, waves=not shifted), max_iterations)
