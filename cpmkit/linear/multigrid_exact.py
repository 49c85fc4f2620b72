"""Exact solves with symmetric positive definite matrices, and the exception that says that one is not."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


class Indefinite(ArithmeticError):
    """A symmetric system, or what preconditions it, has an eigenvalue that is not positive; says where that showed."""


@dataclass(frozen=True, eq=False)
class PositiveFactors:
    """Factors of a symmetric positive definite matrix, with pivots from the diagonal.

    Attributes
    ----------
    lu : SuperLU
        They.
    """

    lu: Any

    @classmethod
    def of(cls, matrix: csr_array, where: str) -> PositiveFactors:
        """Factorise.

        Raises
        ------
        Indefinite
            If a pivot is not positive; the message says ``where``.
        """
        from scipy.sparse.linalg import splu

        try:
            lu = splu(
                matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
            )
        except RuntimeError as error:  # an exactly zero pivot
            raise Indefinite(f"it is singular {where}") from error
        negative = int(np.count_nonzero(~(lu.U.diagonal() > 0)))
        if negative or (lu.perm_r != lu.perm_c).any():
            raise Indefinite(f"it has {max(negative, 1)} eigenvalues of the wrong sign {where}")
        return cls(lu)

    def solve(self, b: Floats) -> Floats:
        """Return u (n, channels) with ``A u = b``."""
        return np.ascontiguousarray(self.lu.solve(b))
