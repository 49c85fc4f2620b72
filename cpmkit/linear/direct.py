"""Factors of an operator; a border is an update of low rank, because its dense rows would fill sparse factors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.operators import Border, Bordered, has_symmetric_pattern, placing
from cpmkit.linear.solve_report import SolveReport, judge
from cpmkit.protocols import Floats, Operator, Progress, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Up to so many unknowns a dense matrix is factorised (of surfaces in .8 ms for 3.7 of SuperLU with 342 unknowns, 4 for
#: 17 with 630, 11 for 19 with 990). Beyond, each solve with the factors would read more than caches hold.
DENSE_UNKNOWNS = 640
#: Where fewer entries than this share are not zero, as of curves, sparse factors are quicker.
DENSE_SHARE = 0.08


@dataclass(frozen=True, eq=False)
class Cholesky:
    """The factor L (n, n) of A = L L', whose upper triangle is not read."""

    lower: Floats

    def solve(self, b: Floats) -> Floats:
        """Return u (n, channels), or (n,), with ``A u = b``."""
        from cpmkit.linear.dense_kernels import solved

        if np.iscomplexobj(b):
            return np.asarray(self.solve(b.real) + 1j * self.solve(b.imag))
        u = np.array(b.T, dtype=np.float64, order="C", ndmin=2)
        solved(self.lower, u)
        return np.ascontiguousarray(u.T).reshape(b.shape)


def cholesky(matrix: csr_array) -> Cholesky | None:
    """Return the factor of a symmetric matrix; None where it is large, sparse, or has an eigenvalue not above zero.

    Nor where it is complex: symmetric, of shifts, and not Hermitian.
    """
    n = matrix.shape[0]
    if n > DENSE_UNKNOWNS or matrix.nnz < DENSE_SHARE * n * n or np.iscomplexobj(matrix.data):
        return None
    from cpmkit.linear.dense_kernels import factorized

    lower = np.ascontiguousarray(matrix.toarray(), dtype=np.float64)
    return Cholesky(lower) if factorized(lower) else None


#: Of a symmetric matrix the pivot is the diagonal entry, unless it is below this share of the largest in its column: a
#: matrix with eigenvalues of both signs, of waves or shifted between eigenvalues, may have pivots near zero.
PIVOT = 1e-3


@dataclass(frozen=True, eq=False)
class Update:
    """What ``U V`` adds to a factorised matrix P: ``(P + U V)^-1 = P^-1 - (P^-1 U) (1 + V P^-1 U)^-1 V P^-1``.

    Attributes
    ----------
    solved : (n, r) float64
        ``P^-1 U``.
    rows : csr_array (r, n)
        V.
    inverse : (r, r) float64
        ``(1 + V P^-1 U)^-1``.
    """

    solved: Floats
    rows: csr_array
    inverse: Floats

    def apply(self, u: Floats) -> Floats:
        """Return ``(P + U V)^-1 b`` from ``u = P^-1 b`` (n, channels)."""
        return np.asarray(u - self.solved @ (self.inverse @ (self.rows @ u)))


@dataclass(frozen=True, eq=False)
class Factors:
    """Factors of an operator, its border included.

    Attributes
    ----------
    lu : SuperLU or Cholesky
        Of A; where there is a border, of A with one node of each piece held.
    update : Update or None
        From there to ``A + s F W``.
    """

    lu: Any
    update: Update | None

    def solve(self, b: Floats) -> Floats:
        """Return u with ``A u = b``, or ``(A + s F W) u = b``, for b of shape (n, channels)."""
        u: Floats = self.lu.solve(b)
        return u if self.update is None else self.update.apply(u)


def factorize(operator: Operator) -> Factors:
    """Return the factors of an operator.

    Raises
    ------
    RuntimeError
        If the matrix is singular.
    """
    if not isinstance(operator, Bordered):
        return Factors(_quicker(operator.to_csr(), operator), None)
    lu = _quicker(held_matrix(operator), operator.operator)
    return Factors(lu, _update(lu, operator.border, _heaviest(operator.border), operator.shift))


def _quicker(matrix: csr_array, operator: Operator) -> Any:
    """Return dense factors of a small symmetric positive matrix, SuperLU's of others."""
    dense = cholesky(matrix) if operator.symmetric else None
    return factors_of(matrix, has_symmetric_pattern(operator)) if dense is None else dense


def held_matrix(operator: Bordered) -> csr_array:
    """Return A with one node of each piece held where a constant is free: regular, as ``A + s F W`` is."""
    held = _heaviest(operator.border)
    return (operator.to_csr() + operator.shift * (held @ held.T)).tocsr()


def factors_of(matrix: csr_array, symmetric_pattern: bool) -> Any:
    """Return SuperLU's factors, in the order that suits the matrix.

    Where the pattern is symmetric and the diagonal carries pivots, as of a positive symmetric part, the order is that
    of a symmetric matrix: half the entries.
    """
    from scipy.sparse.linalg import splu

    if not symmetric_pattern:
        return splu(matrix.tocsc())
    return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=PIVOT, options={"SymmetricMode": True})


def _heaviest(border: Border) -> csr_array:
    """Return the unit vectors (n, k) of one node on each piece, that with the largest weight in its mean."""
    return placing(np.asarray(border.mean.argmax(axis=1)).ravel(), border.mean.shape[1])


def _update(lu: Any, border: Border, held: csr_array, scale: float) -> Update:
    """Return the update by ``s F W - s H H'``, which lets the ``held`` nodes H go and lifts the constants."""
    from scipy.sparse import hstack, vstack

    columns = scale * hstack([border.carried, -held]).toarray()
    stacked: Any = vstack([border.mean, held.T])
    rows = stacked.tocsr()
    solved = lu.solve(columns)
    return Update(solved, rows, np.linalg.inv(np.eye(len(columns[0])) + rows @ solved))


class Indefinite(ArithmeticError):
    """A symmetric system, or what preconditions it, has an eigenvalue that is not positive; says where that showed."""


@dataclass(frozen=True, eq=False)
class SymmetricFactors:
    """Factors of a symmetric matrix, with eigenvalues of either sign.

    Attributes
    ----------
    lu : SuperLU or Cholesky
        They.
    """

    lu: Any

    @classmethod
    def of(cls, matrix: csr_array, where: str) -> Self:
        """Factorise.

        Raises
        ------
        Indefinite
            If the matrix is singular; the message says ``where``.
        """
        return cls(_factors(matrix, where, PIVOT))

    def solve(self, b: Floats) -> Floats:
        """Return u (n, channels) with ``A u = b``."""
        return np.ascontiguousarray(self.lu.solve(b))


class PositiveFactors(SymmetricFactors):
    """Factors of a symmetric positive definite matrix, with pivots from the diagonal."""

    @classmethod
    def of(cls, matrix: csr_array, where: str) -> Self:
        """Factorise.

        Raises
        ------
        Indefinite
            If a pivot is not positive; the message says ``where``.
        """
        dense = cholesky(matrix)
        if dense is not None:
            return cls(dense)
        lu = _factors(matrix, where, 0.0)
        negative = int(np.count_nonzero(~(lu.U.diagonal() > 0)))
        if negative or (lu.perm_r != lu.perm_c).any():
            raise Indefinite(f"it has {max(negative, 1)} eigenvalues of the wrong sign {where}")
        return cls(lu)


def _factors(matrix: csr_array, where: str, pivot: float) -> Any:
    from scipy.sparse.linalg import splu

    options = {"SymmetricMode": True}
    try:
        return splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=pivot, options=options)
    except RuntimeError as error:  # an exactly zero pivot
        raise Indefinite(f"it is singular {where}") from error


#: A residual below this share of the tolerance is not refined: by default one of 1e-14, where nothing is to be won.
REFINED_SHARE = 1e-4


@dataclass(frozen=True)
class Direct:
    """SuperLU, or dense Cholesky factors of what is small, symmetric and positive."""

    takes_levels: ClassVar[bool] = False

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> Factorized:
        """Factorise.

        Raises
        ------
        SceneError
            If the matrix is singular.
        """
        del levels
        try:
            return Factorized(operator, factorize(operator))
        except RuntimeError as error:
            raise SceneError(
                f"The linear system is singular ({error}): nothing fixes the solution somewhere."
            ) from error


@dataclass(frozen=True, eq=False)
class Factorized:
    """An operator with its factors."""

    operator: Operator
    factors: Factors

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Solve for all channels.

        Raises
        ------
        ConvergenceError
            If the residual is above the tolerance.
        """
        del guess
        progress("solve", 0.0)
        u = self.factors.solve(b)
        rest = b - self.operator.apply(u)
        if np.linalg.norm(rest) > REFINED_SHARE * tolerance * np.linalg.norm(b):
            u += self.factors.solve(rest)
        progress("solve", 1.0)
        remedy = "ask for a larger solver_tolerance: rounding limits a direct solve"
        return u, judge(self.operator, b, u, "direct", tolerance, 0, 1, remedy)
