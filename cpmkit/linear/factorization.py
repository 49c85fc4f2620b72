"""Factors of an operator; a border is an update of low rank, because its dense rows would fill sparse factors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.dense import cholesky
from cpmkit.linear.operators import Border, Bordered, has_symmetric_pattern
from cpmkit.linear.products import placing
from cpmkit.protocols import Floats, Operator

if TYPE_CHECKING:
    from scipy.sparse import csr_array


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
