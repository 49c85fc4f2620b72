"""The solver ``multigrid``: Krylov iterations preconditioned by a cycle over a form's coarser levels.

Conjugate gradients solve symmetric positive systems. GMRES solves complex shifts ``A - i s M``, with the cycle of
``A + s M``; standing waves, with a cycle that is exact on the coarsest level that resolves them; and advection, with a
cycle of overlapping blocks. The number of iterations does not grow when the spacing falls.
A cycle is a V cycle with coarser operators P' A P.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import comb
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.csr_matrices import SymmetricCsr, UnsignedCsr, uses_threads
from cpmkit.linear.direct import factorize_matrix, factorize_symmetric, pinned_matrix
from cpmkit.linear.krylov import column_products, indefinite_error
from cpmkit.linear.multigrid.smoothers import (
    MAX_BLOCK_UNKNOWNS,
    Blocks,
    Chebyshev,
    GaussSeidel,
    Schwarz,
    Smoother,
    WithStrip,
)
from cpmkit.linear.operators import Operator, as_bordered, has_symmetric_pattern, plus_diagonal, without_border
from cpmkit.linear.preconditioned import PreconditionedCG, PreconditionedGMRES
from cpmkit.linear.residuals import IndefiniteError
from cpmkit.runtime.memory import release_memory
from cpmkit.types import Floats, Ints, SparseMatrix

#: Factor of the estimate of the largest eigenvalue, which is a lower bound.
EIGENVALUE_MARGIN = 1.1
#: A diagonal entry below this share of the largest counts as zero: a piece of one unknown whose constant is free.
ZERO_DIAGONAL_SHARE = 1e-14
#: Most unknowns of a coarsest level, which is factorised, and most of a coarsest level that has to resolve waves.
MAX_FACTORISED, MAX_FACTORISED_WAVES = 20_000, 100_000


@dataclass(frozen=True, eq=False)
class Level:
    """One step from a finer level to the next coarser level; a form returns them from the finest on."""

    #: (n, m): P, from m coarser unknowns to the n finer unknowns; coarser operators are P' A P + ``added``.
    prolongation: SparseMatrix
    strip: Ints  #: (k,): the finer level's unknowns near conditions, which a smoother solves for exactly.
    #: csr_array (m, m): a further part of the coarser operator, such as the upwinding that its spacing needs.
    added: SparseMatrix | None = None
    #: (r, k): lines of coarser unknowns whose differences of order k - 1 are stabilised: splines that hardly touch the
    #: manifold have entries so small that rounding determines their sign.
    lines: Ints | None = None
    in_blocks: bool = False  #: Whether the strip is solved in overlapping blocks, since its factors would be large.


@dataclass(frozen=True, eq=False)
class Cycle:
    """A V cycle, symmetric if its smoothers are.

    Entries are in float32, except where the diagonal's entries differ too much. That changes the cycle by about 1e-7,
    and not the solution, whose equations are in float64.
    """

    #: Smoothers of all levels but the coarsest, from the finest on; none where the matrix is small.
    smoothers: Sequence[Smoother]
    prolongations: Sequence[UnsignedCsr]  #: To each of these levels from the next coarser one.
    coarsest: Any  #: object with a method ``solve``: factors of the coarsest matrix.
    is_rounded: bool = True  #: Whether entries are in float32.

    @property
    def products(self) -> int:
        """The number of products with the finest matrix in one cycle."""
        return self.smoothers[0].products if self.smoothers else 0

    def apply(self, b: Floats, depth: int = 0) -> Floats:
        """Return an approximate solution x (n, channels) of ``A x = b`` on level ``depth``, 0 being the finest."""
        if depth == len(self.smoothers):
            return np.ascontiguousarray(self.coarsest.solve(b))
        smoother, prolongation = self.smoothers[depth], self.prolongations[depth]
        x, residual = smoother.presmooth(b)
        prolongation.add_product(x, self.apply(prolongation.apply_transposed(residual), depth + 1))
        return smoother.postsmooth(x, b)


def build_cycle(
    matrix: SparseMatrix, levels: Sequence[Level], piece: Ints, waves: bool = False, is_rounded: bool = True
) -> Cycle:
    """Return the V cycle of a symmetric matrix. Raises IndefiniteError if an eigenvalue has the wrong sign.

    ``matrix`` csr_array (n, n): A, positive definite, except for constants on a ``piece`` and for ``waves``.
    ``levels``: the steps to coarser levels, from the finest on.
    ``piece`` (n,): for each unknown, the number of the piece of the manifold that it is on, if A fixes no constant
        there, else -1.
    ``waves``: whether A has negative eigenvalues, with eigenfunctions that all levels resolve.
    ``is_rounded``: whether entries are rounded to float32 where the diagonal allows it.
    """
    diagonal = matrix.diagonal()
    diagonal = diagonal[diagonal > ZERO_DIAGONAL_SHARE * diagonal.max(initial=0.0)]
    # In float32 the cycle would be indefinite: penalties on slivers between close curves are so large that the
    # stiffness next to them is lost by rounding.
    differ = len(diagonal) > 0 and diagonal.max() > 1e6 * diagonal.min()
    kind = np.float32 if is_rounded and not differ else np.float64
    matrices, strips = [matrix], []
    for level in levels:  # all coarser matrices first: temporary tables are not in memory together with smoothers
        strips.append(_regular_strip(level.strip, piece))
        coarser = level.prolongation.T.tocsr() @ (matrices[-1] @ level.prolongation)
        matrices.append(coarser if level.lines is None else stabilise_lines(coarser, level.lines))
        release_memory()
        coarse_piece = np.full(len(coarser.indptr) - 1, -1)
        coarse_piece[level.prolongation.indices] = np.repeat(piece, np.diff(level.prolongation.indptr))
        piece = coarse_piece
    pinned = matrices.pop()
    smoothers = [
        _smoother(each, strip, waves, kind, 1 if number else 2, level.in_blocks)
        for number, (each, strip, level) in enumerate(zip(matrices, strips, levels, strict=True))
    ]
    labels, first = np.unique(piece, return_index=True)
    added = np.zeros(len(piece))  # is not zero at one unknown of each free piece, which fixes its constant
    added[first[labels >= 0]] = pinned.diagonal().max() or 1.0
    coarsest = factorize_symmetric(plus_diagonal(pinned, added), "on the coarsest level", positive=not waves)
    prolongations = [UnsignedCsr.from_matrix(level.prolongation, kind) for level in levels]
    return Cycle(smoothers, prolongations, coarsest, kind is np.float32)


def build_schwarz_cycle(matrix: SparseMatrix, levels: Sequence[Level]) -> Cycle:
    """Return the cycle of a matrix with advection, down to a level that fits into one block, or to the last level.

    From the coarsest level on, a correction is prolonged to the next finer level and followed by a step there.
    ``levels`` are the steps to coarser levels, from the finest on. Raises RuntimeError if a block or the coarsest
    matrix is singular.
    """
    matrices, prolongations = [matrix], []
    for level in levels:
        if matrices[-1].shape[0] <= MAX_BLOCK_UNKNOWNS:
            break
        coarser = level.prolongation.T @ matrices[-1] @ level.prolongation
        matrices.append((coarser if level.added is None else coarser + level.added).tocsr())
        prolongations.append(UnsignedCsr.from_matrix(level.prolongation))
    coarsest = factorize_matrix(matrices.pop(), symmetric_pattern=True)
    return Cycle([Schwarz.from_matrix(each) for each in matrices], prolongations, coarsest, False)


def stabilise_lines(matrix: SparseMatrix, lines: Ints) -> SparseMatrix:
    """Return ``matrix`` with a penalty, 1e-6 of its diagonal, on differences of order k - 1 along ``lines`` (r, k)."""
    from scipy.sparse import csr_array

    r, k = lines.shape
    scale = 1e-6 * matrix.diagonal()[lines].max(axis=1)  # above rounding of float32
    stencil = np.array([(-1.0) ** place * comb(k - 1, place) for place in range(k)])
    entries = np.sqrt(scale)[:, None] * stencil
    rows = csr_array((entries.ravel(), lines.ravel(), np.arange(0, r * k + 1, k)), shape=(r, matrix.shape[0]))
    return (matrix + rows.T @ rows).tocsr()


def _smoother(
    matrix: SparseMatrix, strip: Ints, waves: bool, kind: Any, sweeps: int, in_blocks: bool = False
) -> Smoother:
    """Return the smoother of a level, with entries of the type ``kind``, which solves exactly for the ``strip`` (k,).

    ``sweeps`` is the number of Gauss-Seidel sweeps; for ``waves``, or where products use all threads, it is Chebyshev's
    iteration. A strip ``in_blocks`` is solved by a sweep over overlapping blocks, and one back. Raises IndefiniteError
    if an entry of the diagonal or an eigenvalue of the strip has the wrong sign.
    """
    diagonal = matrix.diagonal()
    swept = abs(diagonal) > ZERO_DIAGONAL_SHARE * diagonal.max()
    swept[strip] = False
    if (diagonal[swept] < 0).any():
        raise IndefiniteError("it has entries below zero on the diagonal")
    inverse = np.zeros(len(diagonal))
    inverse[swept] = 1 / diagonal[swept]
    if waves or uses_threads(matrix.nnz):
        compiled = UnsignedCsr.from_matrix(matrix, kind)
        largest = EIGENVALUE_MARGIN * largest_eigenvalue(compiled, inverse)
        smoother: Smoother = Chebyshev(compiled, inverse, largest)
    else:
        smoother = GaussSeidel(SymmetricCsr.from_matrix(matrix, kind), inverse, sweeps)
    if not len(strip):
        return smoother
    rows = matrix[strip].tocsr()
    factorize = Blocks.from_matrix if in_blocks and not waves else factorize_symmetric
    factors = factorize(rows[:, strip].tocsr(), "beside boundaries", positive=not waves)
    return WithStrip(smoother, strip, UnsignedCsr.from_matrix(rows, kind), factors)


def _regular_strip(strip: Ints, piece: Ints) -> Ints:
    """Return the strip (k,) without one unknown of each piece that lies entirely in it, where A would be singular.

    ``piece`` (n,) is the number of each unknown's piece of the manifold where A fixes no constant, else -1.
    """
    count = piece.max(initial=-1) + 1
    inside = np.bincount(piece[strip] + 1, minlength=count + 1) == np.bincount(piece + 1, minlength=count + 1)
    inside[0] = False
    labels, first = np.unique(piece[strip], return_index=True)
    return np.delete(strip, first[inside[labels + 1]])


def largest_eigenvalue(matrix: UnsignedCsr, inverse: Floats) -> float:
    """Return an estimate, from below, of the largest eigenvalue of ``D^-1 A`` by twelve steps of Lanczos' method.

    A is restricted to the unknowns where ``inverse`` (n,), the diagonal of D^-1, is not zero; the result is 1 if none.
    """
    root = np.sqrt(inverse)[:, None]
    v = np.random.default_rng(0).standard_normal(root.shape) * (root > 0)
    before, beta = np.zeros_like(v), column_products(v, v)[0] ** 0.5
    diagonal: list[float] = []
    off_diagonal: list[float] = []
    while beta > 0 and len(diagonal) < 12:
        v, before = v / beta, -beta * before
        w = root * matrix.apply(root * v) + before
        diagonal.append(column_products(v, w)[0])
        w -= diagonal[-1] * v
        before, v, beta = v, w, column_products(w, w)[0] ** 0.5
        off_diagonal.append(beta)
    upper = np.diag(diagonal) + np.diag(off_diagonal[:-1], 1)
    return float(np.linalg.eigvalsh(upper, UPLO="U")[-1]) if diagonal else 1.0


@dataclass(frozen=True)
class MultigridSolver:
    """Krylov iterations with a multigrid cycle."""

    max_iterations: int = 300  #: Most iterations; 20 are usual, 30 with conditions inside the manifold.

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreconditionedCG | PreconditionedGMRES:
        """Return the Krylov iteration with its cycle: matrices of all levels, their smoothers and the coarsest factors.

        Raises SceneError if the operator's sparsity pattern is not symmetric, it is indefinite with a border, its
        coarsest level is too large to be factorised, or a part of it is singular. Raises ConvergenceError if an
        eigenvalue turns out to have the wrong sign.
        """
        inner = without_border(operator)
        waves = bool(getattr(inner, "indefinite", False))
        if not has_symmetric_pattern(inner) or (waves and inner is not operator):
            raise SceneError("solver 'multigrid' solves systems of a form that has levels; use solver='direct'.")
        _check_coarsest(levels[-1].prolongation.shape[1] if levels else inner.size, inner.size, waves)
        try:
            return self._prepare(operator, inner, levels, waves)
        except IndefiniteError as error:
            raise indefinite_error("multigrid", error, 0, np.nan) from error
        except RuntimeError as error:
            raise SceneError(
                f"The linear system is singular in a part of the manifold ({error}): nothing fixes the solution there."
            ) from error

    def _prepare(
        self, operator: Operator, inner: Operator, levels: Sequence[Level], waves: bool
    ) -> PreconditionedCG | PreconditionedGMRES:
        """Return the iteration for an operator; ``inner`` is the operator without its border.

        ``waves`` is whether A has eigenvalues of both signs. The cycle is then that of A itself: smoothers damp
        components for which A is positive on all levels that resolve a wave, and the coarsest of these levels, on which
        A has negative eigenvalues, is factorised without change. Raises IndefiniteError if an eigenvalue has the wrong
        sign, RuntimeError if a block of unknowns is singular.
        """
        bordered = as_bordered(operator)
        if not inner.symmetric:
            matrix = operator.to_csr() if bordered is None else pinned_matrix(bordered)
            return PreconditionedGMRES(operator, build_schwarz_cycle(matrix, levels), self.max_iterations, "multigrid")
        piece = np.full(inner.size, -1)
        positive_matrix = getattr(inner, "positive_matrix", None)  # of a complex shift
        if waves or positive_matrix is not None:
            cycle = build_cycle((positive_matrix or inner.to_csr)(), levels, piece, waves=waves)
            return PreconditionedGMRES(operator, cycle, self.max_iterations, "multigrid")
        if bordered is not None:
            members = bordered.border.indicator.tocoo()
            piece[members.row] = members.col
        cycle = build_cycle(inner.to_csr(), levels, piece)
        prepared = PreconditionedCG(operator, cycle, self.max_iterations, "multigrid")
        if not cycle.is_rounded:
            return prepared
        in_float64 = partial(build_cycle, inner.to_csr(), levels, piece, is_rounded=False)
        return replace(prepared, fallback=lambda: replace(prepared, preconditioner=in_float64()))


def _check_coarsest(unknowns: int, size: int, waves: bool) -> None:
    """Raise SceneError if the coarsest level's ``unknowns`` are too many to be factorised; the finest has ``size``."""
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
