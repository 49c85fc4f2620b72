"""Smoothers of a level: iterations with an exact solve on the strip near conditions, and, for advection, blocks.

Penalties and couplings of conditions cause large eigenvalues of D^-1 A whose eigenvectors are zero outside the strip.
The strip is solved exactly, or in overlapping blocks if it is wide, and Gauss-Seidel's or Chebyshev's iteration runs on
the other unknowns, whose eigenvalues the conditions do not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr
from cpmkit.linear.direct import factorize_matrix, factorize_symmetric
from cpmkit.types import Floats, Ints, SparseMatrix

#: Chebyshev's iteration damps eigenvalues of D^-1 A above this share of the largest; coarser levels damp the others.
#: Spheres take 19 to 21 iterations with 1/8 and 16 to 19 with 1/16; with conditions smaller shares save no iterations.
SMOOTHED_SHARE = 1 / 16
#: Most unknowns of a block without its overlap: with half as many a cycle takes a third more time, as more unknowns are
#: solved twice; with twice as many the factors have a third more entries.
MAX_BLOCK_UNKNOWNS = 1500


class Smoother(Protocol):
    """Some steps towards the solution of ``A x = b``, before and after the correction from the next coarser level."""

    @property
    def products(self) -> int:
        """The number of products with A before and after the coarser level together."""

    def presmooth(self, b: Floats, /) -> tuple[Floats, Floats]:
        """Return x and ``b - A x``, both (n, channels), after steps from zero."""

    def postsmooth(self, x: Floats, b: Floats, /) -> Floats:
        """Return x (n, channels) after further steps for ``A x = b``; x may be overwritten.

        In a symmetric cycle these steps are the adjoint of :meth:`presmooth`.
        """


@dataclass(frozen=True, eq=False)
class Chebyshev:
    """Chebyshev's iteration with D^-1 A on the unknowns where ``inverse`` (n,), the diagonal of D^-1, is not zero.

    It is used for waves, for which Gauss-Seidel sweeps diverge at few nodes a wavelength, and for large levels, whose
    products use all threads (Saad, *Iterative methods for sparse linear systems*, 2003).
    """

    matrix: UnsignedCsr  #: A.
    inverse: Floats  #: (n,): the diagonal of D^-1.
    largest: float  #: Upper end of the interval of damped eigenvalues, an upper bound of all eigenvalues.
    products: int = 6

    def presmooth(self, b: Floats) -> tuple[Floats, Floats]:
        """Return x and ``b - A x``, both (n, channels), after three steps from zero (Saad 2003, algorithm 12.1)."""
        centre, radius = self.largest * (1 + SMOOTHED_SHARE) / 2, self.largest * (1 - SMOOTHED_SHARE) / 2
        rho = radius / centre
        move = b * (self.inverse / centre)[:, None]
        x = move.copy()
        for _ in range(2):
            after = 1 / (2 * centre / radius - rho)
            x = self.matrix.momentum_step(x, b, self.inverse, after * rho, 2 * after / radius, move)
            rho = after
        return x, self.matrix.residual(x, b)

    def postsmooth(self, x: Floats, b: Floats) -> Floats:
        """Return a new x (n, channels) after three steps for ``A x = b`` from x; they are their own adjoint."""
        return x + self.presmooth(self.matrix.residual(x, b))[0]


@dataclass(frozen=True, eq=False)
class GaussSeidel:
    """Gauss-Seidel sweeps on the unknowns where ``inverse`` (n,), that of A's diagonal, is not zero; on one thread.

    Two sweeps reduce the error as much as three steps of Chebyshev's iteration, and update the residual as well: an
    iteration reads the finest matrix five times instead of seven, and needs no eigenvalue. One sweep on the finest
    level takes one and a half to two times as many iterations.
    """

    matrix: SymmetricCsr  #: A.
    inverse: Floats  #: (n,): inverse of its diagonal.
    sweeps: int  #: Number of sweeps before, and after, a coarser level.

    @property
    def products(self) -> int:
        """The number of products with A that take as much time as all sweeps."""
        return 2 * self.sweeps

    def presmooth(self, b: Floats) -> tuple[Floats, Floats]:
        """Return x and ``b - A x``, both (n, channels), after backward sweeps (last equation first) from zero."""
        from cpmkit.linear.csr_kernels import sweep_backward

        rest, A = np.array(b.T, order="C"), self.matrix
        u = np.zeros_like(rest)
        for _ in range(self.sweeps):
            sweep_backward(A.pointers, A.columns, A.entries, self.inverse, rest, u)
        return np.ascontiguousarray(u.T), np.ascontiguousarray(rest.T)

    def postsmooth(self, x: Floats, b: Floats) -> Floats:
        """Return x (n, channels) after forward sweeps for ``A x = b``, the adjoint of :meth:`presmooth`."""
        from cpmkit.linear.csr_kernels import sweep_forward

        u, A = np.array(x.T, order="C"), self.matrix
        for _ in range(self.sweeps):
            sweep_forward(A.pointers, A.columns, A.entries, self.inverse, np.array(b.T, order="C"), u)
        return np.ascontiguousarray(u.T)


@dataclass(frozen=True, eq=False)
class WithStrip:
    """A smoother combined with exact solves for the unknowns near conditions, before and after the coarser level."""

    iteration: Smoother  #: The smoother of the other unknowns.
    unknowns: Ints  #: (k,): the unknowns near conditions, the strip.
    #: The rows of A (k, n) of the strip, rounded like the level's matrix, so that ``postsmooth`` is the adjoint of
    #: ``presmooth``.
    rows: UnsignedCsr
    factors: Any  #: object with a method ``solve``: factors of A restricted to the strip.

    @property
    def products(self) -> int:
        """The number of products with A."""
        return self.iteration.products

    def presmooth(self, b: Floats) -> tuple[Floats, Floats]:
        """Return x and ``b - A x``, both (n, channels), after the solve on the strip from zero and the iteration."""
        on_strip = np.ascontiguousarray(self.factors.solve(b[self.unknowns]))
        x, residual = self.iteration.presmooth(b - self.rows.apply_transposed(on_strip))
        x[self.unknowns] += on_strip
        return x, residual

    def postsmooth(self, x: Floats, b: Floats) -> Floats:
        """Return x (n, channels) after the iteration for ``A x = b`` and a solve for the strip, the others fixed."""
        x = self.iteration.postsmooth(x, b)
        x[self.unknowns] += self.factors.solve(self.rows.residual(x, b[self.unknowns]))
        return x


@dataclass(frozen=True, eq=False)
class Blocks:
    """A sweep of exact solves over overlapping blocks of unknowns, and one back: a symmetric approximate inverse."""

    #: sequence of (unknowns, rows, factors): for each block its unknowns (m,), their rows of A (m, n), and factors.
    blocks: Sequence[tuple[Ints, SparseMatrix, Any]]

    @classmethod
    def from_matrix(cls, matrix: SparseMatrix, where: str, positive: bool = True) -> Blocks:
        """Return the sweeps for a symmetric matrix; the other arguments are those of :func:`factorize_symmetric`."""
        blocks = []
        for own in bisect_unknowns(matrix):
            unknowns = np.unique(matrix[own].indices).astype(np.int64)
            rows = matrix[unknowns]
            blocks.append((unknowns, rows, factorize_symmetric(rows[:, unknowns].tocsr(), where, positive)))
        return cls(blocks)

    def solve(self, b: Floats) -> Floats:
        """Return x (n, channels), close to ``A^-1 b``."""
        x = np.zeros_like(b)
        for unknowns, rows, factors in (*self.blocks, *self.blocks[-2::-1]):
            x[unknowns] += factors.solve(b[unknowns] - rows @ x)
        return x


@dataclass(frozen=True, eq=False)
class Schwarz:
    """Exact solves on overlapping blocks of unknowns, after the coarser level only.

    An exact solve on a block damps in one step what a velocity transports through the block; smoothers by single
    unknowns need as many steps as the block is wide, or diverge. A block is extended by the neighbours of its unknowns,
    and only its own unknowns are corrected (restricted additive Schwarz: Cai and Sarkis, SIAM J. Sci. Comput. 21,
    1999).
    """

    matrix: SparseMatrix  #: (n, n): A, whose sparsity pattern is symmetric.
    #: sequence of (own, unknowns, factors): for each block its own unknowns (m,), these and their neighbours (k,), both
    #: ascending, and SuperLU's factors of the rows and columns of ``unknowns``. Each unknown is an own unknown of one
    #: block.
    blocks: Sequence[tuple[Ints, Ints, Any]]
    products: int = 1

    @classmethod
    def from_matrix(cls, matrix: SparseMatrix) -> Schwarz:
        """Return the smoother of a matrix with symmetric sparsity; RuntimeError if a block is singular."""
        blocks = []
        for own in bisect_unknowns(matrix):
            unknowns = np.unique(matrix[own].indices).astype(np.int64)
            blocks.append((own, unknowns, factorize_matrix(matrix[unknowns][:, unknowns], symmetric_pattern=True)))
        return cls(matrix, blocks)

    def presmooth(self, b: Floats) -> tuple[Floats, Floats]:
        """Return zeros and b, both (n, channels)."""
        return np.zeros_like(b), b

    def postsmooth(self, x: Floats, b: Floats) -> Floats:
        """Return x (n, channels), changed in place, after a solve on each block, all with the first ``b - A x``."""
        residual = b - self.matrix @ x
        for own, unknowns, factors in self.blocks:
            x[own] += factors.solve(residual[unknowns])[np.searchsorted(unknowns, own)]
        return x


def bisect_unknowns(matrix: SparseMatrix) -> list[Ints]:
    """Return the unknowns of ``matrix`` in compact, ascending parts (m,) of at most :data:`MAX_BLOCK_UNKNOWNS` each.

    A part is bisected into the first and the second half of a breadth-first search in the graph of the matrix, from an
    unknown at the end of each connected component.
    """
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    open_parts, parts = [np.arange(matrix.shape[0])], []
    while open_parts:
        part = open_parts.pop()
        if len(part) <= MAX_BLOCK_UNKNOWNS:
            parts.append(np.sort(part))
            continue
        inner, orders = matrix[part][:, part], []
        for start in np.unique(connected_components(inner, directed=False)[1], return_index=True)[1]:
            far = breadth_first_order(inner, start, return_predecessors=False)[-1]
            orders.append(breadth_first_order(inner, far, return_predecessors=False))
        order = part[np.concatenate(orders).astype(np.int64)]
        open_parts += [order[: len(order) // 2], order[len(order) // 2 :]]
    return parts
