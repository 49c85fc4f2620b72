"""Multigrid for advection: GMRES with a cycle whose smoother solves overlapping blocks of unknowns exactly (Schwarz).

An exact solve on a block damps in one step what a velocity transports through the block; smoothers by single unknowns
need as many steps as the block is wide, or diverge. A block is extended by the neighbours of its unknowns, and only its
own unknowns are corrected (restricted additive Schwarz: Cai and Sarkis, SIAM J. Sci. Comput. 21, 1999). Coarser
operators are P' A P, with the upwinding that a form adds for their spacing. From the coarsest level on, a correction is
prolonged to the next finer level and followed by a smoothing step there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.direct import factorize_matrix, pinned_matrix
from cpmkit.linear.krylov import REMEDY
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.linear.operators import Bordered
from cpmkit.linear.protocols import Operator
from cpmkit.linear.residuals import judge
from cpmkit.linear.solve_report import SolveReport
from cpmkit.types import Floats, Ints, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Most unknowns of a block without its overlap: with half as many a cycle takes a third more time, as more unknowns are
#: solved twice; with twice as many the factors have a third more entries.
MAX_BLOCK_UNKNOWNS = 1500
#: Iterations after which GMRES restarts: it stores a vector for each.
RESTART_ITERATIONS = 50


@dataclass(frozen=True, eq=False)
class Block:
    """Some unknowns, with the factors of the matrix restricted to them.

    Attributes
    ----------
    unknowns : (k,) int64
        The block's own unknowns and their neighbours.
    own : (m,) int64
        Positions of its own unknowns among these.
    factors : SuperLU
        Factors of the rows and columns of ``unknowns``.
    """

    unknowns: Ints
    own: Ints
    factors: Any


@dataclass(frozen=True, eq=False)
class Schwarz:
    """A smoother of overlapping blocks; each unknown is an own unknown of one block."""

    blocks: Sequence[Block]

    def apply(self, residual: Floats) -> Floats:
        """Return the corrections (n, channels) for a residual (n, channels)."""
        corrections = np.empty_like(residual)
        for block in self.blocks:
            corrections[block.unknowns[block.own]] = block.factors.solve(residual[block.unknowns])[block.own]
        return corrections


def build_schwarz(matrix: csr_array) -> Schwarz:
    """Return the smoother of a matrix whose pattern is symmetric.

    Raises
    ------
    RuntimeError
        If a block is singular.
    """
    blocks = []
    for own in bisect_unknowns(matrix):
        unknowns = np.unique(matrix[own].indices).astype(np.int64)
        part = matrix[unknowns][:, unknowns]
        blocks.append(Block(unknowns, np.searchsorted(unknowns, own), factorize_matrix(part, symmetric_pattern=True)))
    return Schwarz(blocks)


def bisect_unknowns(matrix: csr_array, most: int = MAX_BLOCK_UNKNOWNS) -> list[Ints]:
    """Return compact parts of at most ``most`` unknowns each, in ascending order.

    A part is bisected into the first and the second half of a breadth-first search from an unknown at its end.
    """
    open_parts, parts = [np.arange(matrix.shape[0])], []
    while open_parts:
        part = open_parts.pop()
        if len(part) <= most:
            parts.append(np.sort(part))
            continue
        order = part[_breadth_first(matrix if len(part) == matrix.shape[0] else matrix[part][:, part])]
        open_parts += [order[: len(order) // 2], order[len(order) // 2 :]]
    return parts


def _breadth_first(matrix: csr_array) -> Ints:
    """Return all unknowns in breadth-first order, piece by piece, each from an unknown at the end of its piece."""
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    count, piece = connected_components(matrix, directed=False)
    first = np.unique(piece, return_index=True)[1] if count > 1 else np.zeros(1, dtype=np.int64)
    orders = []
    for start in first.tolist():
        far = breadth_first_order(matrix, start, directed=True, return_predecessors=False)[-1]
        orders.append(breadth_first_order(matrix, far, directed=True, return_predecessors=False))
    return np.concatenate(orders).astype(np.int64)


@dataclass(frozen=True, eq=False)
class SchwarzCycle:
    """A cycle from the coarsest to the finest level, with a Schwarz step on each finer level.

    Attributes
    ----------
    matrices : sequence of csr_array
        Matrices of all levels but the coarsest, from the finest on.
    prolongations : sequence of csr_array
        From each level to the next finer one.
    smoothers : sequence of Schwarz
        Smoothers of the ``matrices``.
    coarsest : SuperLU
        Factors of the coarsest matrix.
    """

    matrices: Sequence[csr_array]
    prolongations: Sequence[csr_array]
    smoothers: Sequence[Schwarz]
    coarsest: Any

    def apply(self, residual: Floats) -> Floats:
        """Return the correction (n, channels) of one cycle for a residual (n, channels)."""
        residuals = [residual]
        for prolongation in self.prolongations:
            residuals.append(prolongation.T @ residuals[-1])
        u: Floats = self.coarsest.solve(residuals.pop())
        for matrix, prolongation, smoother in reversed(
            list(zip(self.matrices, self.prolongations, self.smoothers, strict=True))
        ):
            u = prolongation @ u
            u += smoother.apply(residuals.pop() - matrix @ u)
        return u


def build_schwarz_cycle(matrix: csr_array, levels: Sequence[Level]) -> SchwarzCycle:
    """Return the cycle of a matrix, down to a level that fits into one block.

    Raises
    ------
    RuntimeError
        If a block is singular.
    """
    matrices, prolongations = [matrix], []
    for level in levels:
        if matrices[-1].shape[0] <= MAX_BLOCK_UNKNOWNS:
            break
        coarser = level.prolongation.T @ matrices[-1] @ level.prolongation
        matrices.append((coarser if level.added is None else coarser + level.added).tocsr())
        prolongations.append(level.prolongation)
    coarsest = factorize_matrix(matrices.pop(), symmetric_pattern=True)
    return SchwarzCycle(matrices, prolongations, [build_schwarz(matrix) for matrix in matrices], coarsest)


@dataclass(frozen=True, eq=False)
class PreconditionedAdvection:
    """An operator with advection, and the cycle that preconditions GMRES.

    Attributes
    ----------
    operator : Operator
        The operator.
    cycle : SchwarzCycle
        The cycle of A; where constants are free, of A with one unknown of each piece pinned.
    max_iterations : int
        Most iterations.
    """

    operator: Operator
    cycle: SchwarzCycle
    max_iterations: int

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with ``A u = b``, channel by channel, and a report.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance.
        """
        u, taken = np.zeros_like(b), []
        for channel in range(b.shape[1]):
            start = None if guess is None else guess[:, channel]
            progress("solve", channel / b.shape[1])
            u[:, channel], steps = self._solve_channel(b[:, channel], tolerance, start)
            taken.append(steps)
        progress("solve", 1.0)
        products = sum((steps + 1) * (1 + self.step_products) for steps in taken)
        remedy = f"{REMEDY} or a smaller spacing"
        return u, judge(self.operator, b, u, "multigrid", tolerance, max(taken, default=0), products, remedy)

    def _solve_channel(self, b: Floats, tolerance: float, start: Floats | None) -> tuple[Floats, int]:
        """Return u (n,) with ``A u = b`` for one channel b (n,), and the iterations from ``start``, zero if None."""
        from scipy.sparse.linalg import LinearOperator, gmres

        if not b.any():
            return np.zeros_like(b), 0
        shape = (len(b), len(b))
        steps: list[float] = []
        product = LinearOperator(shape, matvec=self.operator.apply, dtype=np.float64)
        cycle = LinearOperator(shape, matvec=lambda r: self.cycle.apply(r.reshape(-1, 1))[:, 0], dtype=np.float64)
        restarts = -(-self.max_iterations // RESTART_ITERATIONS)
        u, _ = gmres(
            product,
            b,
            x0=start,
            rtol=0.5 * tolerance,
            restart=min(RESTART_ITERATIONS, self.max_iterations),
            maxiter=restarts,
            M=cycle,
            callback=steps.append,
            callback_type="pr_norm",
        )
        return np.asarray(u), len(steps)

    def for_operator(self, operator: Operator) -> PreconditionedAdvection:
        """Return the iteration with the same cycle for another operator."""
        return replace(self, operator=operator)

    @property
    def step_products(self) -> int:
        """The number of products with A in one cycle, for each channel."""
        return 1


def prepare_advection(operator: Operator, levels: Sequence[Level], max_iterations: int) -> PreconditionedAdvection:
    """Return the iteration for an operator with advection, which is not symmetric.

    Raises
    ------
    RuntimeError
        If a block is singular.
    """
    matrix = pinned_matrix(operator) if isinstance(operator, Bordered) else operator.to_csr()
    return PreconditionedAdvection(operator, build_schwarz_cycle(matrix, levels), max_iterations)
