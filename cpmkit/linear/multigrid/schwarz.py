"""Overlapping Schwarz: blocks of unknowns that hang together, each solved for exactly, all from one residual.

It damps what a velocity carries through a block in one step, where smoothers that know neighbours alone need as many
steps as the block is wide, or grow. Blocks overlap by the neighbours of their unknowns, of which each block keeps
those that are its own (restricted additive Schwarz: Cai and Sarkis, SIAM J. Sci. Comput. 21, 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.direct import factors_of, held_matrix
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.linear.operators import Bordered
from cpmkit.linear.solve_report import SolveReport, judge
from cpmkit.protocols import Floats, Ints, Operator, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Blocks hold so many unknowns at most, their overlap not counted: at half of it a cycle is a third dearer, as more
#: unknowns are solved for twice; at twice of it factors hold a third more.
MOST_IN_BLOCK = 1500


@dataclass(frozen=True, eq=False)
class Block:
    """Some unknowns with the factors of their part of a matrix.

    Attributes
    ----------
    unknowns : (k,) int64
        Own ones and their neighbours.
    own : (m,) int64
        Where the own ones stand among these.
    factors : SuperLU
        Of the rows and columns of these unknowns.
    """

    unknowns: Ints
    own: Ints
    factors: Any


@dataclass(frozen=True, eq=False)
class Schwarz:
    """Blocks that hold every unknown once."""

    blocks: Sequence[Block]

    def apply(self, residual: Floats) -> Floats:
        """Return the corrections (n, channels) for a residual."""
        found = np.empty_like(residual)
        for block in self.blocks:
            found[block.unknowns[block.own]] = block.factors.solve(residual[block.unknowns])[block.own]
        return found


def schwarz(matrix: csr_array) -> Schwarz:
    """Return overlapping blocks of a matrix whose pattern is symmetric."""
    blocks = []
    for own in bisected(matrix):
        unknowns = np.unique(matrix[own].indices).astype(np.int64)
        part = matrix[unknowns][:, unknowns]
        blocks.append(Block(unknowns, np.searchsorted(unknowns, own), factors_of(part, symmetric_pattern=True)))
    return Schwarz(blocks)


def bisected(matrix: csr_array, most: int = MOST_IN_BLOCK) -> list[Ints]:
    """Return the unknowns in compact parts of at most ``most``, each ascending.

    A part is halved where a search in breadth, from an unknown at its end, has seen half of it.
    """
    waiting, done = [np.arange(matrix.shape[0])], []
    while waiting:
        part = waiting.pop()
        if len(part) <= most:
            done.append(np.sort(part))
            continue
        order = part[_in_breadth(matrix if len(part) == matrix.shape[0] else matrix[part][:, part])]
        waiting += [order[: len(order) // 2], order[len(order) // 2 :]]
    return done


def _in_breadth(matrix: csr_array) -> Ints:
    """Return all unknowns, piece by piece, each searched in breadth from one that is far from another."""
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    count, piece = connected_components(matrix, directed=False)
    first = np.unique(piece, return_index=True)[1] if count > 1 else np.zeros(1, dtype=np.int64)
    found = []
    for start in first.tolist():
        far = breadth_first_order(matrix, start, directed=True, return_predecessors=False)[-1]
        found.append(breadth_first_order(matrix, far, directed=True, return_predecessors=False))
    return np.concatenate(found).astype(np.int64)


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
