"""Sparse matrices for compiled kernels: full, with products on all threads, or symmetric, stored as upper halves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.runtime.compilation import run_parcels, thread_count
from cpmkit.types import Floats, SparseMatrix

#: Least entries of a matrix whose products use all threads: starting them takes as long as one or two such products.
MIN_SHARED_ENTRIES = 1 << 22
#: Number of entries of a matrix in a parcel of rows: a few milliseconds of work for a thread.
PARCEL_ENTRIES = 1 << 19


def uses_threads(entries: int) -> bool:
    """Return whether products with a matrix of ``entries`` stored entries are faster on all threads than on one."""
    return entries >= MIN_SHARED_ENTRIES and thread_count() > 1


@dataclass(frozen=True, eq=False)
class UnsignedCsr:
    """A sparse matrix (n, m) by rows, with unsigned indices; vectors are (n, channels) and contiguous."""

    #: pointers, columns, entries (n + 1,) uint64, (z,) uint32, (z,) float64 or float32: as SciPy's ``indptr``,
    #: ``indices`` and ``data``; the entries, and columns of 32 bits, are the same memory.
    pointers: Any
    columns: Any
    entries: Any
    width: int  #: Number of columns, m.

    @classmethod
    def from_matrix(cls, matrix: SparseMatrix, kind: Any = np.float64) -> UnsignedCsr:
        """Return the SciPy ``matrix`` in this form, with entries of the type ``kind``."""
        indices = matrix.indices
        columns = indices.view(np.uint32) if indices.dtype == np.int32 else indices.astype(np.uint32)
        entries = matrix.data.astype(kind, copy=False)
        return cls(matrix.indptr.astype(np.uint64), columns, entries, int(matrix.shape[1]))

    def __len__(self) -> int:
        return len(self.pointers) - 1

    def residual(self, x: Floats, b: Floats) -> Floats:
        """Return ``b - A x`` (n, channels) for x (m, channels) and b (n, channels)."""
        return b - self.apply(x)

    def apply(self, x: Floats) -> Floats:
        """Return ``A x`` (n, channels) for x (m, channels)."""
        out = np.zeros((len(self), x.shape[1]))
        self.add_product(out, x)
        return out

    def momentum_step(
        self, x: Floats, b: Floats, inverse: Floats, momentum: float, factor: float, move: Floats
    ) -> Floats:
        """Return a new x, x plus the new ``move``, all (n, channels); the given x is unchanged.

        ``move`` is overwritten by ``momentum move + factor D^-1 (b - A x)``. ``inverse`` (n,) is the diagonal of D^-1.
        """
        from cpmkit.linear.csr_kernels import momentum_step

        out = np.empty_like(x)
        self._run_on_parcels(momentum_step, x, b, inverse, momentum, factor, move, out)
        return out

    def add_product(self, fine: Floats, coarse: Floats) -> None:
        """Add ``A coarse`` to ``fine`` (n, channels) in place, for ``coarse`` (m, channels)."""
        from cpmkit.linear.csr_kernels import add_product

        self._run_on_parcels(add_product, coarse, fine)

    def apply_transposed(self, fine: Floats) -> Floats:
        """Return ``A' fine`` (m, channels) for ``fine`` (n, channels)."""
        from cpmkit.linear.csr_kernels import add_transposed

        coarse = np.zeros((self.width, fine.shape[1]))
        add_transposed(self.pointers, self.columns, self.entries, fine, coarse)
        return coarse

    def _run_on_parcels(self, kernel: Callable[..., Any], *arguments: Any) -> None:
        """Call ``kernel(start, stop, pointers, columns, entries, *arguments)`` for parcels that make up all rows."""
        entries = max(len(self.entries), 1)
        rows = PARCEL_ENTRIES * len(self) // entries if uses_threads(entries) else len(self)

        def work(start: int, stop: int) -> None:
            kernel(start, stop, self.pointers, self.columns, self.entries, *arguments)

        run_parcels(work, len(self), max(rows, 1))


@dataclass(frozen=True, eq=False)
class SymmetricCsr:
    """A symmetric matrix (n, n) stored as the upper halves of its rows, for products and sweeps on one thread."""

    #: pointers, columns, entries (n + 1,) uint64, (z,) uint32, (z,) float64 or float32: CSR arrays of the upper half;
    #: each row begins with the entry on the diagonal.
    pointers: Any
    columns: Any
    entries: Any

    @classmethod
    def from_matrix(cls, matrix: SparseMatrix, kind: Any = np.float64) -> SymmetricCsr:
        """Return the SciPy ``matrix`` in this form, with entries of the type ``kind``."""
        from cpmkit.linear.csr_kernels import upper_half

        return cls(*upper_half(matrix.indptr, matrix.indices, matrix.data, np.empty(0, dtype=kind)))

    def apply(self, x: Floats) -> Floats:
        """Return ``A x`` (n, channels) for x (n, channels)."""
        from cpmkit.linear.csr_kernels import subtract_product

        out = np.zeros(x.T.shape)
        subtract_product(self.pointers, self.columns, self.entries, np.ascontiguousarray(x.T), out)
        return np.ascontiguousarray(np.negative(out, out=out).T)
