"""Symmetric sparse matrices by the upper halves of their rows: half of the entries to read, for one thread.

A product writes to rows that others write to as well, so that threads cannot share one: larger matrices are kept whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.multigrid_matrix import LEAST_SHARED_ENTRIES, UnsignedCsr
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class SymmetricCsr:
    """A symmetric matrix (n, n), with the methods of :class:`UnsignedCsr` that a smoother asks for.

    Attributes
    ----------
    pointers, columns, entries : (n + 1,) uint64, (z,) uint32, (z,) float64 or float32
        Of each row the entry on the diagonal, and behind it those right of it.
    """

    pointers: Any
    columns: Any
    entries: Any

    @classmethod
    def of(cls, matrix: csr_array) -> SymmetricCsr:
        """Return the same matrix."""
        from cpmkit.linear.multigrid_symmetric_kernels import upper_half

        return cls(*upper_half(matrix.indptr, matrix.indices, matrix.data))

    def rounded(self) -> SymmetricCsr:
        """Return the same matrix with entries of 32 bits, whose products take less time."""
        return replace(self, entries=self.entries.astype(np.float32, copy=False))

    def __len__(self) -> int:
        return len(self.pointers) - 1

    @property
    def diagonal(self) -> Floats:
        """(n,) that of the matrix."""
        return np.asarray(self.entries[self.pointers[:-1]], dtype=np.float64)

    def residual(self, x: Floats, b: Floats) -> Floats:
        """Return ``b - A x``."""
        from cpmkit.linear.multigrid_symmetric_kernels import subtract_product

        rest = np.array(b.T, order="C")
        subtract_product(self.pointers, self.columns, self.entries, np.ascontiguousarray(x.T), rest)
        return np.ascontiguousarray(rest.T)

    def apply(self, x: Floats) -> Floats:
        """Return ``A x``."""
        out = self.residual(x, np.zeros_like(x))
        return np.negative(out, out=out)

    def step(self, x: Floats, b: Floats, inverse: Floats, kept: float, added: float, move: Floats) -> Floats:
        """Return ``x + move`` with the new ``move``, ``kept move + added D^-1 (b - A x)``; ``inverse`` (n,) is D^-1."""
        from cpmkit.linear.multigrid_symmetric_kernels import move_by

        out = self.residual(x, b)
        move_by(out, inverse, kept, added, x, move)
        return out

    def coarser(self, prolongation: csr_array) -> csr_array:
        """Return P' A P: as A = U + U', with half of the diagonal in each, it is T + T' of T = P' U P."""
        from cpmkit.linear.multigrid_symmetric_kernels import with_transposed

        entries = self.entries.copy()
        entries[self.pointers[:-1]] *= 0.5
        upper = UnsignedCsr(self.pointers, self.columns, entries, len(self))
        T = UnsignedCsr.of(prolongation.T.tocsr()) @ (upper @ UnsignedCsr.of(prolongation))
        return UnsignedCsr(*with_transposed(T.pointers, T.columns, T.entries), T.width).to_csr()


def halved(matrix: csr_array) -> SymmetricCsr | None:
    """Return a symmetric matrix by its upper half; None where all threads have a share in its products."""
    return SymmetricCsr.of(matrix) if matrix.nnz < LEAST_SHARED_ENTRIES else None
