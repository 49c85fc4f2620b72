"""Operators, the interfaces of linear solvers, and matrices that gather and scatter rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from cpmkit.types import Floats, Ints, Progress, SparseMatrix, no_progress

if TYPE_CHECKING:
    from cpmkit.linear.residuals import SolveReport


class Operator(Protocol):
    """A square linear map of n unknowns, in any storage, with all that solvers need."""

    @property
    def size(self) -> int:
        """The number n of unknowns."""

    @property
    def nonzeros(self) -> int:
        """The number of stored entries."""

    @property
    def symmetric(self) -> bool:
        """Whether the operator is known to be symmetric."""

    @property
    def diagonal(self) -> float | Floats:
        """The diagonal, a number if it is constant, else (n, 1)."""

    def apply(self, u: Floats, /) -> Floats:
        """Return A u for u (n,) or (n, channels)."""

    def apply_rows(self, u: Floats, rows: Ints, /) -> Floats:
        """Return the entries ``rows`` (r,) of A u, (r,) or (r, channels)."""

    def to_csr(self) -> SparseMatrix:
        """Return the operator as one sparse matrix (n, n)."""

    def pieces(self) -> tuple[int, Ints]:
        """Return the number of sets of unknowns that the operator does not couple, and the set (n,) of each unknown."""


class Stiffness(Operator, Protocol):
    """The operator A of an equation's terms in a form, to which time steps and eigenvalue iterations add a mass."""

    def scaled_plus_mass(self, factor: float, mass: Any = None, /) -> Operator:
        """Return the operator ``M + factor A``; M is the form's mass matrix, None for the identity."""

    def minus_shifted_mass(self, shift: float, mass: Any = None, /) -> Operator:
        """Return the operator ``A - shift M``; M is the eigenvalue problem's mass matrix, None for the identity."""


class PreparedSolver(Protocol):
    """A solver that has factorised one operator, or built its coarser levels."""

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Return u (n, channels) with A u = b, and a report; iterations start from ``guess``, zero if None.

        Raises ConvergenceError if the relative residual, recomputed, is above ``tolerance`` and what rounding leaves.
        """


class LinearSolver(Protocol):
    """A linear solver in two phases, preparation and solves; a plugin's factory in ``cpmkit_solvers`` returns one.

    The prepared solver is reused for all channels, time steps, Newton steps and eigenvalue iterations. A solver whose
    attribute ``takes_levels`` is false gets no levels, and the form builds none.
    """

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreparedSolver:
        """Return the prepared solver for ``operator``; ``levels`` are the form's coarser levels, if it has any."""


@dataclass(frozen=True, eq=False)
class CsrOperator:
    """A sparse matrix as an operator, such as the stiffness or mass matrix of a form."""

    matrix: SparseMatrix  #: (n, n).
    symmetric: bool = False  #: Whether the matrix is known to be symmetric.
    indefinite: bool = False  #: Whether eigenvalues of both signs are expected, as for standing waves.
    #: Whether an unsymmetric matrix has a symmetric sparsity pattern, and a symmetric part positive but for constants.
    symmetric_pattern: bool = False

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return int(self.matrix.shape[0])

    @property
    def nonzeros(self) -> int:
        """The number of stored entries."""
        return int(self.matrix.nnz)

    @cached_property
    def diagonal(self) -> Floats:
        """(n, 1) the diagonal of the matrix."""
        return np.asarray(self.matrix.diagonal()[:, None])

    def apply(self, u: Floats) -> Floats:
        """Return A u for u (n,) or (n, channels)."""
        return np.asarray(self.matrix @ u)

    def apply_rows(self, u: Floats, rows: Ints) -> Floats:
        """Return the entries ``rows`` (r,) of A u for u (n,) or (n, channels): (r,) or (r, channels)."""
        return np.asarray(self.matrix[rows] @ u)

    def to_csr(self) -> SparseMatrix:
        """Return the matrix itself, not a copy."""
        return self.matrix

    def pieces(self) -> tuple[int, Ints]:
        """Return the number of connected components of the matrix, and the component (n,) of each unknown."""
        return connected_unknowns(self.size, [(self.matrix, 0, 0)])

    def scaled_plus_mass(self, factor: float, mass: Operator | None = None) -> CsrOperator:
        """Return the operator ``M + factor A``; M is the identity if ``mass`` is None."""
        return _weighted_sum(1.0, mass, factor, self)

    def minus_shifted_mass(self, shift: float, mass: Operator | None = None) -> CsrOperator:
        """Return the operator ``A - shift M``; M is the identity if ``mass`` is None."""
        return _weighted_sum(-shift, mass, 1.0, self)


def connected_unknowns(count: int, matrices: Iterable[tuple[SparseMatrix, int, int]]) -> tuple[int, Ints]:
    """Return the number of connected components of ``count`` unknowns, and the component (count,) of each unknown.

    Each of ``matrices``, (matrix, first_row, first_column), connects the unknown ``first_row + i`` with the unknown
    ``first_column + j`` where it has an entry (i, j).
    """
    from cpmkit.runtime.index_sets import label_sets, unite_rows

    parent = np.arange(count)
    for matrix, first_row, first_column in matrices:
        unite_rows(parent, matrix.indptr, matrix.indices, first_row, first_column)
    return label_sets(parent)


def _weighted_sum(weight: float, mass: Operator | None, factor: float, operator: CsrOperator) -> CsrOperator:
    """Return the operator ``factor A + weight M``, not marked as ``indefinite``; M is the identity without ``mass``."""
    symmetric = operator.symmetric and (mass is None or mass.symmetric)
    pattern = operator.symmetric_pattern
    return CsrOperator(_matrix_sum(factor, operator, weight, mass), symmetric, symmetric_pattern=pattern)


def _matrix_sum(factor: Any, operator: Operator, weight: Any, mass: Operator | None) -> SparseMatrix:
    """Return the matrix ``factor A + weight M``; M is the identity if no mass is given."""
    from scipy.sparse import eye_array

    matrix = eye_array(operator.size, format="csr") if mass is None else mass.to_csr()
    return (weight * matrix + factor * operator.to_csr()).tocsr()


def as_bordered(operator: Operator) -> Bordered | None:
    """Return ``operator`` itself if it has a border, else None."""
    return operator if isinstance(operator, Bordered) else None


def without_border(operator: Operator) -> Operator:
    """Return the operator A of a bordered ``operator``; an operator without a border itself."""
    bordered = as_bordered(operator)
    return operator if bordered is None else bordered.operator


def plus_diagonal(matrix: SparseMatrix, added: Floats) -> SparseMatrix:
    """Return ``matrix`` (n, n) with ``added`` (n,) added to its diagonal."""
    from scipy.sparse import diags_array

    return (matrix + diags_array(added)).tocsr()


def has_symmetric_pattern(operator: Operator) -> bool:
    """Return whether an operator is symmetric, or has a symmetric sparsity pattern and a positive symmetric part."""
    return operator.symmetric or bool(getattr(operator, "symmetric_pattern", False))


@dataclass(frozen=True, eq=False)
class Border:
    """The border of a system whose solution is determined only up to constants on k pieces of the manifold.

    With the means W u over the pieces, their indicators B, and the load F of a constant f = 1 on each, the bordered
    system is ``A u + F lambda = b``, ``W u = 0``; lambda is the part of b for which there is no solution. As A B = 0
    and W B = 1, the solution of ``(A + s F W) u = b`` is the same up to its means ``lambda / s``.
    """

    indicator: SparseMatrix  #: (n, k): B, one at the unknowns of each piece.
    mean: SparseMatrix  #: (k, n): W, the mean over each piece.
    #: (n, k): F, in any scale; B if None, as for a form whose mass matrix is the identity.
    load: SparseMatrix | None = None

    @property
    def constant_load(self) -> SparseMatrix:
        """F (n, k), the load of a constant on each piece."""
        return self.indicator if self.load is None else self.load

    def balance(self, b: Floats) -> tuple[Floats, Floats]:
        """Return ``b - F lambda`` (n, channels), for which there is a solution, and lambda (k, channels)."""
        excess = np.linalg.solve((self.indicator.T @ self.constant_load).toarray(), self.indicator.T @ b)
        return np.asarray(b - self.constant_load @ excess), np.asarray(excess)

    def remove_means(self, u: Floats) -> tuple[Floats, Floats]:
        """Return u (n, channels) minus its mean on each piece, and the means (k, channels)."""
        means = self.mean @ u
        return np.asarray(u - self.indicator @ means), np.asarray(means)


@dataclass(frozen=True, eq=False)
class _DerivedOperator:
    """Base class of operators that are derived from another ``operator`` A."""

    operator: Operator

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return self.operator.size

    @property
    def nonzeros(self) -> int:
        """The number of stored entries of A."""
        return self.operator.nonzeros

    def pieces(self) -> tuple[int, Ints]:
        """Return the number of connected components of A, and the component (n,) of each unknown."""
        return self.operator.pieces()


@dataclass(frozen=True, eq=False)
class Bordered(_DerivedOperator):
    """The operator ``A + s F W``, which is regular where the kernel of A consists of constants on some pieces."""

    border: Border  #: F and W.
    symmetric: bool = False  # F W is symmetric only where W is proportional to F'

    @property
    def diagonal(self) -> float | Floats:
        """The diagonal of A."""
        return self.operator.diagonal

    @cached_property
    def shift(self) -> float:
        """The factor s of F W: a tenth of the largest diagonal entry of A.

        BiCGSTAB takes as many iterations with a tenth of that, and up to twice as many with a much smaller s; the
        rounding of the means, times s, limits the residual of a direct solve.
        """
        return 0.1 * float(np.max(np.abs(self.diagonal)))

    def apply(self, u: Floats) -> Floats:
        """Return ``(A + s F W) u`` for u (n,) or (n, channels)."""
        return np.asarray(self.operator.apply(u) + self.shift * (self.border.constant_load @ (self.border.mean @ u)))

    def apply_rows(self, u: Floats, rows: Ints) -> Floats:
        """Return the entries ``rows`` (r,) of ``(A + s F W) u``: (r,) for u (n,), (r, channels) for (n, channels)."""
        of_means = self.border.constant_load[rows] @ (self.border.mean @ u)
        return np.asarray(self.operator.apply_rows(u, rows) + self.shift * of_means)

    def to_csr(self) -> SparseMatrix:
        """Return A alone, which is singular: F W has full rows, and would fill the matrix."""
        return self.operator.to_csr()


@dataclass(frozen=True, eq=False)
class ComplexShift(_DerivedOperator):
    """The operator ``A - i s M`` for complex vectors, A real; real and imaginary parts share products with A and M."""

    s: float  #: The shift.
    mass: Operator | None = None  #: M; the identity if None.

    @property
    def symmetric(self) -> bool:
        """Whether A and M, and with them the complex matrix (which is not Hermitian), are symmetric."""
        return self.operator.symmetric and (self.mass is None or self.mass.symmetric)

    @property
    def diagonal(self) -> Any:
        """The complex diagonal, a number or (n, 1)."""
        return self.operator.diagonal - 1j * self.s * (1.0 if self.mass is None else self.mass.diagonal)

    def apply(self, u: Any) -> Any:
        """Return ``(A - i s M) u`` for complex u (n,) or (n, channels)."""
        columns = u.reshape(len(u), -1)
        parts = np.concatenate([columns.real, columns.imag], axis=1)
        masses = parts if self.mass is None else self.mass.apply(parts)
        real, imaginary = np.split(self.operator.apply(parts), 2, axis=1)
        shifted = self.s * masses
        real, imaginary = real + shifted[:, columns.shape[1] :], imaginary - shifted[:, : columns.shape[1]]
        return (real + 1j * imaginary).reshape(u.shape)

    def apply_rows(self, u: Any, rows: Ints) -> Any:
        """Return the entries ``rows`` (r,) of :meth:`apply`: (r,) or (r, channels)."""
        return self.apply(u)[rows]

    def to_csr(self) -> SparseMatrix:
        """Return the complex matrix ``A - i s M``."""
        return _matrix_sum(1.0, self.operator, -1j * self.s, self.mass)

    def positive_matrix(self) -> SparseMatrix:
        """Return the real matrix ``A + s M``; preconditioned by it, ``A - i s M`` has eigenvalues between 1 and -i."""
        return _matrix_sum(1.0, self.operator, self.s, self.mass)


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """The linear system ``A u = b`` with a right-hand side for each channel."""

    operator: Operator  #: A.
    right_side: Floats  #: (n, channels): b, boundary data included.

    @property
    def size(self) -> int:
        """The number of unknowns."""
        return len(self.right_side)


def matrix_of_rows(weights: Floats, columns: Ints, count: int) -> SparseMatrix:
    """Return the matrix (n, count) whose row k has ``weights[k]`` (w,) in ``columns[k]`` (w,), equal columns summed."""
    from scipy.sparse import csr_array

    n, width = columns.shape
    starts = np.arange(n + 1, dtype=np.int32 if columns.size < 2**31 else np.int64) * width
    return csr_array((weights.ravel(), columns.ravel(), starts), shape=(n, count))


def scatter_matrix(rows: Ints, count: int) -> SparseMatrix:
    """Return the matrix (count, k) that adds the entries of a vector (k,) to the ``rows`` (k,) of a vector (count,)."""
    from scipy.sparse import csr_array

    return csr_array((np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(count, len(rows)))
