"""Exact solves on the coarsest level and beside conditions, and the exception that says that a matrix is indefinite."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from cpmkit.linear.dense import cholesky
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Of a matrix with eigenvalues of both signs the pivot is the diagonal entry, unless it is below this share of the
#: largest in its column.
PIVOT = 1e-3


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
