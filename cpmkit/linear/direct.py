"""Direct solvers: sparse and dense factors of matrices, factors of operators with a border, the solver ``direct``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.operators import Border, Bordered, Operator, as_bordered, has_symmetric_pattern, scatter_matrix
from cpmkit.linear.residuals import IndefiniteError, SolveReport, judge
from cpmkit.types import Floats, Progress, SparseMatrix, no_progress

#: The diagonal entry of a symmetric matrix is the pivot unless it is below this share of the largest entry of its
#: column: an indefinite matrix, of waves or shifted between eigenvalues, may have pivots near zero.
PIVOT_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Cholesky:
    """The Cholesky factor L (n, n) of A = L L'; the upper triangle of ``lower`` is not used."""

    lower: Floats

    def solve(self, b: Floats) -> Floats:
        """Return u with ``A u = b``, for real or complex b (n,) or (n, channels)."""
        from cpmkit.linear.csr_kernels import solve_cholesky

        if np.iscomplexobj(b):
            return np.asarray(self.solve(b.real) + 1j * self.solve(b.imag))
        u = np.array(b.T, dtype=np.float64, order="C", ndmin=2)
        solve_cholesky(self.lower, u)
        return np.ascontiguousarray(u.T).reshape(b.shape)


def dense_cholesky(matrix: SparseMatrix) -> Cholesky | None:
    """Return the dense Cholesky factor of a symmetric matrix; None if there is none or it would be slow.

    There is none if the matrix is not positive definite, or complex (complex shifts are symmetric, not Hermitian).
    Sparse factors are faster for over 640 unknowns, and for matrices with less than 8 percent of nonzero entries.
    """
    n = matrix.shape[0]
    sparse = matrix.nnz < 0.08 * n * n  # as of curves
    # For surfaces it takes 0.8 ms where SuperLU takes 3.7 with 342 unknowns, 4 and 17 with 630, 11 and 19 with 990. A
    # larger factor would not fit the cache in each solve.
    if n > 640 or sparse or np.iscomplexobj(matrix.data):
        return None
    from cpmkit.linear.csr_kernels import factorize_cholesky

    lower = np.ascontiguousarray(matrix.toarray(), dtype=np.float64)
    return Cholesky(lower) if factorize_cholesky(lower) else None


def factorize_matrix(matrix: SparseMatrix, symmetric_pattern: bool, pivot_share: float = PIVOT_SHARE) -> Any:
    """Return SuperLU's factors of a sparse matrix.

    ``symmetric_pattern`` is for a symmetric sparsity pattern and a positive symmetric part, whose diagonal entries can
    be pivots: the elimination order is that of a symmetric matrix, the factors have half as many entries, and a
    diagonal entry is the pivot from ``pivot_share`` of its column's largest on. Raises RuntimeError if a pivot is zero.
    """
    from scipy.sparse.linalg import splu

    if not symmetric_pattern:
        return splu(matrix.tocsc())
    options = {"SymmetricMode": True}
    return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=pivot_share, options=options)


def factorize_symmetric(matrix: SparseMatrix, where: str, positive: bool = True) -> Any:
    """Return the factors, with a method ``solve``, of a symmetric matrix: a dense :class:`Cholesky` or SuperLU's.

    Raises IndefiniteError if the matrix is singular, or not positive definite although it is to be ``positive``; the
    message ends with ``where``, the part of the system that it belongs to.
    """
    dense = dense_cholesky(matrix) if positive else None
    if dense is not None:
        return dense
    try:
        lu = factorize_matrix(matrix, True, 0.0 if positive else PIVOT_SHARE)
    except RuntimeError as error:  # a pivot is exactly zero
        raise IndefiniteError(f"it is singular {where}") from error
    if not positive:
        return lu
    negative = int(np.count_nonzero(~(lu.U.diagonal() > 0)))
    if negative or (lu.perm_r != lu.perm_c).any():
        raise IndefiniteError(f"it has {max(negative, 1)} eigenvalues of the wrong sign {where}")
    return lu


@dataclass(frozen=True, eq=False)
class BorderedFactors:
    """The factors of a bordered matrix ``A + s F W``, whose dense rows would fill sparse factors.

    With P the :func:`pinned_matrix` and ``A + s F W = P + U V``, the inverse is ``P^-1 - (P^-1 U) (1 + V P^-1 U)^-1 V
    P^-1`` (Woodbury).
    """

    pinned: Any  #: SuperLU or Cholesky: factors of P.
    solved_columns: Floats  #: (n, r): ``P^-1 U``.
    rows: SparseMatrix  #: (r, n): V.
    inverse: Floats  #: (r, r): ``(1 + V P^-1 U)^-1``.

    def solve(self, b: Floats) -> Floats:
        """Return u (n, channels) with ``(A + s F W) u = b`` for b (n, channels)."""
        u = self.pinned.solve(b)
        return np.asarray(u - self.solved_columns @ (self.inverse @ (self.rows @ u)))


def factorize_operator(operator: Operator) -> Any:
    """Return the factors, with a method ``solve``, of an operator and its border, if it has one.

    Raises RuntimeError if a pivot is zero, LinAlgError if the update for the border is singular.
    """
    bordered = as_bordered(operator)
    if bordered is None:
        return _dense_or_sparse_factors(operator.to_csr(), operator)
    from scipy.sparse import hstack, vstack

    lu = _dense_or_sparse_factors(pinned_matrix(bordered), bordered.operator)
    border, pinned = bordered.border, _pinned_unknowns(bordered.border)
    columns = bordered.shift * hstack([border.constant_load, -pinned]).toarray()
    rows = vstack([border.mean, pinned.T]).tocsr()
    solved = lu.solve(columns)
    return BorderedFactors(lu, solved, rows, np.linalg.inv(np.eye(len(columns[0])) + rows @ solved))


def _dense_or_sparse_factors(matrix: SparseMatrix, operator: Operator) -> Any:
    """Return dense factors of an operator's ``matrix`` if it is small, symmetric and positive, else SuperLU's."""
    dense = dense_cholesky(matrix) if operator.symmetric else None
    return factorize_matrix(matrix, has_symmetric_pattern(operator)) if dense is None else dense


def pinned_matrix(operator: Bordered) -> SparseMatrix:
    """Return A of a bordered operator plus s on the diagonal at one unknown of each piece with a free constant.

    This matrix is regular, as ``A + s F W`` is, and sparse.
    """
    pinned = _pinned_unknowns(operator.border)
    return (operator.to_csr() + operator.shift * (pinned @ pinned.T)).tocsr()


def _pinned_unknowns(border: Border) -> SparseMatrix:
    """Return the unit vectors (n, k) of one unknown of each piece: that with the largest weight in the piece's mean."""
    return scatter_matrix(np.asarray(border.mean.argmax(axis=1)).ravel(), border.mean.shape[1])


@dataclass(frozen=True)
class DirectSolver:
    """The solver ``direct``: SuperLU, or dense Cholesky factors of small symmetric positive matrices."""

    takes_levels: ClassVar[bool] = False

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedDirect:
        """Return the operator with its factors, without ``levels``; raise SceneError if the matrix is singular."""
        del levels
        try:
            return PreparedDirect(operator, factorize_operator(operator))
        except (RuntimeError, np.linalg.LinAlgError) as error:
            raise SceneError(
                f"The linear system is singular ({error}): nothing fixes the solution somewhere."
            ) from error


@dataclass(frozen=True, eq=False)
class PreparedDirect:
    """An operator with its factors, ready to solve."""

    operator: Operator
    factors: Any

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with ``A u = b``, and a report; a large residual is reduced by one step of refinement.

        ``guess`` is not used. Raises ConvergenceError if the residual is above the tolerance and what rounding leaves.
        """
        del guess
        progress("solve", 0.0)
        u = self.factors.solve(b)
        residual = b - self.operator.apply(u)
        if np.linalg.norm(residual) > 1e-4 * tolerance * np.linalg.norm(b):  # else it is rounding
            u += self.factors.solve(residual)
        progress("solve", 1.0)
        remedy = "ask for a larger solver_tolerance: rounding limits a direct solve"
        return u, judge(self.operator, b, u, "direct", tolerance, 0, 1, remedy)
