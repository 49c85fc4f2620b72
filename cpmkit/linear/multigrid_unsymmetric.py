"""GMRES with a multigrid cycle whose smoother solves blocks exactly: for operators with a velocity.

Coarser operators are P' A P and what a form adds to them: upwinding as their spacing needs it. From the coarsest level
on a correction is brought to the next finer one and followed by a step of overlapping Schwarz there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.factorization import factors_of, held_matrix
from cpmkit.linear.levels import Level
from cpmkit.linear.operators import Bordered
from cpmkit.linear.report import SolveReport, judge
from cpmkit.linear.schwarz import MOST_IN_BLOCK, Schwarz, schwarz
from cpmkit.protocols import Floats, Operator, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: So many vectors are kept before GMRES starts afresh.
KEPT_VECTORS = 50
#: The residual that GMRES keeps is driven this much below the tolerance.
RECURSION_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class SchwarzCycle:
    """The cycle.

    Attributes
    ----------
    matrices : sequence of csr_array
        Of all levels but the coarsest, from the finest on.
    prolongations : sequence of csr_array
        From each level to the next finer one.
    smoothers : sequence of Schwarz
        Of the ``matrices``.
    coarsest : SuperLU
        Factors of the coarsest matrix.
    """

    matrices: Sequence[csr_array]
    prolongations: Sequence[csr_array]
    smoothers: Sequence[Schwarz]
    coarsest: Any

    def apply(self, residual: Floats) -> Floats:
        """Return one cycle from a residual (n, channels)."""
        down = [residual]
        for prolongation in self.prolongations:
            down.append(prolongation.T @ down[-1])
        u: Floats = self.coarsest.solve(down.pop())
        for matrix, prolongation, smoother in reversed(
            list(zip(self.matrices, self.prolongations, self.smoothers, strict=True))
        ):
            u = prolongation @ u
            u += smoother.apply(down.pop() - matrix @ u)
        return u


def schwarz_cycle(matrix: csr_array, levels: Sequence[Level]) -> SchwarzCycle:
    """Return the cycle of a matrix, down to a level that one block would hold.

    Raises
    ------
    RuntimeError
        If a block is singular.
    """
    matrices, prolongations = [matrix], []
    for level in levels:
        if matrices[-1].shape[0] <= MOST_IN_BLOCK:
            break
        coarser = level.prolongation.T @ matrices[-1] @ level.prolongation
        matrices.append((coarser if level.added is None else coarser + level.added).tocsr())
        prolongations.append(level.prolongation)
    coarsest = factors_of(matrices.pop(), symmetric_pattern=True)
    return SchwarzCycle(matrices, prolongations, [schwarz(one) for one in matrices], coarsest)


@dataclass(frozen=True, eq=False)
class PreconditionedUnsymmetric:
    """An operator with its cycle.

    Attributes
    ----------
    operator : Operator
        What is solved with.
    cycle : SchwarzCycle
        Of A; where constants are free, of A with one unknown of each piece held.
    max_iterations : int
        At most.
    """

    operator: Operator
    cycle: SchwarzCycle
    max_iterations: int

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Solve channel by channel.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance.
        """
        u, taken = np.zeros_like(b), []
        for channel in range(b.shape[1]):
            start = None if guess is None else guess[:, channel]
            progress("solve", channel / b.shape[1])
            u[:, channel], steps = self._solve_one(b[:, channel], tolerance, start)
            taken.append(steps)
        progress("solve", 1.0)
        products = sum((steps + 1) * (1 + self.step_products) for steps in taken)
        remedy = "ask for a larger solver_tolerance or more max_iterations, or use solver='direct' or a smaller spacing"
        return u, judge(self.operator, b, u, "multigrid", tolerance, max(taken, default=0), products, remedy)

    def _solve_one(self, b: Floats, tolerance: float, start: Floats | None) -> tuple[Floats, int]:
        from scipy.sparse.linalg import LinearOperator, gmres

        if not b.any():
            return np.zeros_like(b), 0
        shape = (len(b), len(b))
        steps: list[float] = []
        product = LinearOperator(shape, matvec=self.operator.apply, dtype=np.float64)
        cycle = LinearOperator(shape, matvec=lambda r: self.cycle.apply(r.reshape(-1, 1))[:, 0], dtype=np.float64)
        restarts = -(-self.max_iterations // KEPT_VECTORS)
        u, _ = gmres(
            product,
            b,
            x0=start,
            rtol=RECURSION_SHARE * tolerance,
            restart=min(KEPT_VECTORS, self.max_iterations),
            maxiter=restarts,
            M=cycle,
            callback=steps.append,
            callback_type="pr_norm",
        )
        return np.asarray(u), len(steps)

    def for_operator(self, operator: Operator) -> PreconditionedUnsymmetric:
        """Return the iteration for another operator with the same cycle."""
        return replace(self, operator=operator)

    @property
    def step_products(self) -> int:
        """How many products with A a cycle takes, a channel."""
        return 1


def prepare_unsymmetric(operator: Operator, levels: Sequence[Level], max_iterations: int) -> PreconditionedUnsymmetric:
    """Return the iteration for an operator that is not symmetric.

    Raises
    ------
    RuntimeError
        If a block is singular.
    """
    matrix = held_matrix(operator) if isinstance(operator, Bordered) else operator.to_csr()
    return PreconditionedUnsymmetric(operator, schwarz_cycle(matrix, levels), max_iterations)
