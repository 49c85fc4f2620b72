"""Sparse matrices for compiled kernels: full, with products on all threads, or symmetric, stored as upper halves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.operators import PARCEL_ENTRIES
from cpmkit.runtime.threads import run_parcels, thread_count
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Least entries of a matrix whose products use all threads: starting them takes as long as one or two such products.
MIN_SHARED_ENTRIES = 1 << 22


@dataclass(frozen=True, eq=False)
class UnsignedCsr:
    """A sparse matrix (n, m) by rows, with unsigned indices; vectors are (n, channels) and contiguous.

    Attributes
    ----------
    pointers, columns, entries : (n + 1,) uint64, (z,) uint32, (z,) float64 or float32
        As SciPy's ``indptr``, ``indices`` and ``data``; the entries, and columns of 32 bits, are the same memory.
    width : int
        Number of columns, m.
    """

    pointers: Any
    columns: Any
    entries: Any
    width: int

    @classmethod
    def of(cls, matrix: csr_array) -> UnsignedCsr:
        """Return the SciPy ``matrix`` in this form."""
        indices = matrix.indices
        columns = indices.view(np.uint32) if indices.dtype == np.int32 else indices.astype(np.uint32)
        return cls(matrix.indptr.astype(np.uint64), columns, matrix.data, int(matrix.shape[1]))

    def in_float32(self, most: int | None = None) -> UnsignedCsr:
        """Return the matrix with entries in float32, for faster products; itself if it has more than ``most``."""
        if most is not None and len(self.entries) > most:
            return self
        return replace(self, entries=self.entries.astype(np.float32, copy=False))

    def to_csr(self) -> csr_array:
        """Return the matrix in SciPy's form; the entries of a row are unsorted."""
        from scipy.sparse import csr_array

        kind = np.int32 if len(self.entries) < 2**31 else np.int64
        columns = self.columns.view(np.int32) if kind is np.int32 else self.columns.astype(kind)
        return csr_array((self.entries, columns, self.pointers.astype(kind)), shape=(len(self), self.width))

    def __matmul__(self, other: UnsignedCsr) -> UnsignedCsr:
        """Return the product ``A B`` with another matrix."""
        return self.times(other)

    def times(
        self, other: UnsignedCsr, needed: Bools | None = None, upper: bool = False, first: float = 1.0
    ) -> UnsignedCsr:
        """Return ``A B``, with all rows empty that are not ``needed`` (n,).

        With ``upper`` only the entries on the diagonal, first in each row, and right of it are computed. The first
        entry of each row of A is multiplied by ``first``.
        """
        from cpmkit.linear.csr_kernels import multiply

        needed = np.ones(len(self), dtype=bool) if needed is None else needed
        left, right = ((factor.pointers, factor.columns, factor.entries) for factor in (self, other))
        room = int(max(len(self.entries), len(other.entries)) * needed.mean()) if len(needed) else 0
        pointers, columns, entries = multiply(needed, *left, *right, other.width, room, upper, first)
        return UnsignedCsr(pointers, columns, entries, other.width)

    def __len__(self) -> int:
        return len(self.pointers) - 1

    def residual(self, x: Floats, b: Floats) -> Floats:
        """Return ``b - A x`` (n, channels)."""
        from cpmkit.linear.csr_kernels import fill_residual

        out = np.empty_like(b)
        self._run_on_parcels(fill_residual, x, b, out)
        return out

    def apply(self, x: Floats) -> Floats:
        """Return ``A x`` (n, channels)."""
        out = self.residual(x, np.zeros((len(self), x.shape[1])))
        return np.negative(out, out=out)

    def step(self, x: Floats, b: Floats, inverse: Floats, momentum: float, factor: float, move: Floats) -> Floats:
        """Return ``x + move`` after ``move`` is set to ``momentum move + factor D^-1 (b - A x)``, all (n, channels).

        ``inverse`` (n,) is the diagonal of D^-1.
        """
        from cpmkit.linear.csr_kernels import step

        out = np.empty_like(x)
        self._run_on_parcels(step, x, b, inverse, momentum, factor, move, out)
        return out

    def add_product(self, fine: Floats, coarse: Floats) -> None:
        """Add ``A coarse`` to ``fine`` (n, channels)."""
        from cpmkit.linear.csr_kernels import prolong

        self._run_on_parcels(prolong, coarse, fine)

    def apply_transposed(self, fine: Floats) -> Floats:
        """Return ``A' fine`` (m, channels)."""
        from cpmkit.linear.csr_kernels import restrict

        coarse = np.zeros((self.width, fine.shape[1]))
        restrict(self.pointers, self.columns, self.entries, fine, coarse)
        return coarse

    def _run_on_parcels(self, kernel: Callable[..., Any], *arguments: Any) -> None:
        """Call ``kernel(start, stop, pointers, columns, entries, *arguments)`` for parcels that make up all rows."""
        rows = max(PARCEL_ENTRIES * len(self) // max(len(self.entries), 1), 1)

        def work(start: int, stop: int) -> None:
            kernel(start, stop, self.pointers, self.columns, self.entries, *arguments)

        if len(self.entries) < MIN_SHARED_ENTRIES:
            work(0, len(self))
        else:
            run_parcels(work, len(self), rows)


#: Parts in which a large coarser matrix is computed, and least rows of each: a tenth of A P is computed twice.
COARSE_PARTS, MIN_COARSE_ROWS = 16, 1 << 12


@dataclass(frozen=True, eq=False)
class SymmetricCsr:
    """A symmetric matrix (n, n) stored as the upper halves of its rows, with the methods of :class:`UnsignedCsr`.

    A product reads half as many entries, but each row writes to others: it runs on one thread.

    Attributes
    ----------
    pointers, columns, entries : (n + 1,) uint64, (z,) uint32, (z,) float64 or float32
        CSR arrays of the upper half; each row begins with the entry on the diagonal.
    """

    pointers: Any
    columns: Any
    entries: Any

    @classmethod
    def of(cls, matrix: csr_array, kind: Any = np.float64) -> SymmetricCsr:
        """Return the SciPy ``matrix`` in this form, with entries of the type ``kind``."""
        from cpmkit.linear.csr_kernels import upper_half

        return cls(*upper_half(matrix.indptr, matrix.indices, matrix.data, np.empty(0, dtype=kind)))

    def in_float32(self) -> SymmetricCsr:
        """Return the matrix with entries in float32, for faster products."""
        return replace(self, entries=self.entries.astype(np.float32, copy=False))

    def __len__(self) -> int:
        return len(self.pointers) - 1

    @property
    def diagonal(self) -> Floats:
        """(n,) the diagonal."""
        return np.asarray(self.entries[self.pointers[:-1]], dtype=np.float64)

    def residual(self, x: Floats, b: Floats) -> Floats:
        """Return ``b - A x`` (n, channels)."""
        return np.ascontiguousarray(self._transposed_residual(x, b).T)

    def _transposed_residual(self, x: Floats, b: Floats) -> Floats:
        """Return ``b - A x`` as (channels, n), from x and b (n, channels)."""
        from cpmkit.linear.csr_kernels import subtract_product

        rest = np.array(b.T, order="C")
        subtract_product(self.pointers, self.columns, self.entries, np.ascontiguousarray(x.T), rest)
        return rest

    def apply(self, x: Floats) -> Floats:
        """Return ``A x`` (n, channels)."""
        out = self.residual(x, np.zeros_like(x))
        return np.negative(out, out=out)

    def step(self, x: Floats, b: Floats, inverse: Floats, momentum: float, factor: float, move: Floats) -> Floats:
        """Return ``x + move`` after ``move`` is set to ``momentum move + factor D^-1 (b - A x)``, all (n, channels).

        ``inverse`` (n,) is the diagonal of D^-1.
        """
        from cpmkit.linear.csr_kernels import move_by

        out = self.residual(x, b)
        move_by(out, inverse, momentum, factor, x, move)
        return out

    def sweep_backward(self, x: Floats | None, b: Floats, inverse: Floats, sweeps: int) -> tuple[Floats, Floats]:
        """Return x and ``b - A x``, both (n, channels), after backward Gauss-Seidel ``sweeps`` from x, zero if None.

        Equations are solved from the last to the first, where ``inverse`` (n,), of the diagonal, is not zero.
        """
        from cpmkit.linear.csr_kernels import sweep_up

        rest = np.array(b.T, order="C") if x is None else self._transposed_residual(x, b)
        u = np.zeros_like(rest) if x is None else np.array(x.T, order="C")
        for _ in range(sweeps):
            sweep_up(self.pointers, self.columns, self.entries, inverse, rest, u)
        return np.ascontiguousarray(u.T), np.ascontiguousarray(rest.T)

    def sweep_forward(self, x: Floats, b: Floats, inverse: Floats, sweeps: int) -> Floats:
        """Return x (n, channels) after forward Gauss-Seidel ``sweeps``: the adjoint of :meth:`sweep_backward`."""
        from cpmkit.linear.csr_kernels import sweep_down

        u = np.array(x.T, order="C")
        for _ in range(sweeps):
            sweep_down(self.pointers, self.columns, self.entries, inverse, np.array(b.T, order="C"), u)
        return np.ascontiguousarray(u.T)

    def galerkin_product(self, prolongation: csr_array) -> SymmetricCsr:
        """Return P' A P, computed as T + T' with T = P' U P, where A = U + U' and U has half of the diagonal."""
        from cpmkit.linear.csr_kernels import symmetric_sum

        upper = UnsignedCsr(self.pointers, self.columns, self.entries, len(self))
        T = UnsignedCsr.of(prolongation.T.tocsr()) @ upper.times(UnsignedCsr.of(prolongation), first=0.5)
        return SymmetricCsr(*symmetric_sum(T.pointers, T.columns, T.entries))

    def full(self) -> UnsignedCsr:
        """Return the full matrix, with the entries of both halves."""
        from cpmkit.linear.csr_kernels import full_matrix

        return UnsignedCsr(*full_matrix(self.pointers, self.columns, self.entries), len(self))

    def for_threads(self) -> SymmetricCsr | UnsignedCsr:
        """Return the full matrix if its products would use all threads, else the matrix itself."""
        shared = 2 * len(self.entries) - len(self) >= MIN_SHARED_ENTRIES and thread_count() > 1
        return self.full() if shared else self

    def rows_of(self, unknowns: Ints) -> csr_array:
        """Return the full rows (k, n) of ``unknowns`` (k,)."""
        from scipy.sparse import csr_array

        upper = UnsignedCsr(self.pointers, self.columns, self.entries, len(self)).to_csr()
        left = csr_array(upper[:, unknowns].T)
        diagonal = csr_array((self.diagonal[unknowns], (np.arange(len(unknowns)), unknowns)), shape=left.shape)
        return (upper[unknowns] + left - diagonal).tocsr()


def as_symmetric_csr(matrix: csr_array) -> SymmetricCsr | None:
    """Return a symmetric matrix stored as its upper half; None if its products are to use all threads."""
    return SymmetricCsr.of(matrix) if matrix.nnz < MIN_SHARED_ENTRIES else None


def in_float32(matrix: csr_array, most: int) -> SymmetricCsr | UnsignedCsr:
    """Return a large symmetric matrix in float32, stored as its upper half if there is one thread.

    With more than ``most`` entries it is stored in full, and in float64.
    """
    if matrix.nnz > most or thread_count() > 1:
        return UnsignedCsr.of(matrix).in_float32(most)
    return SymmetricCsr.of(matrix, np.float32)


def coarse_operator(matrix: csr_array, prolongation: csr_array) -> SymmetricCsr:
    """Return P' A P of a large symmetric matrix, stored as its upper half.

    It is computed in parts, each from the rows of A P that it needs. Consecutive unknowns of a lattice are in a slab,
    so that few rows of A P are computed twice.
    """
    fine, P, back = UnsignedCsr.of(matrix), UnsignedCsr.of(prolongation), UnsignedCsr.of(prolongation.T.tocsr())
    size = len(back)
    at_once = max(MIN_COARSE_ROWS, -(-size // COARSE_PARTS))
    pointers, room = (
        np.zeros(size + 1, dtype=np.uint64),
        len(fine.entries) // 4,
    )  # memory is taken where it is written to
    columns, entries, used = np.empty(room, dtype=np.uint32), np.empty(room), 0
    for start in range(0, size, at_once):
        stop = min(start + at_once, size)
        fine_rows, rows = np.zeros(len(fine), dtype=bool), np.zeros(size, dtype=bool)
        fine_rows[back.columns[back.pointers[start] : back.pointers[stop]]] = True
        rows[start:stop] = True
        some = back.times(fine.times(P, fine_rows), rows, upper=True)
        pointers[start + 1 : stop + 1] = some.pointers[start + 1 : stop + 1] + np.uint64(used)
        before, used = used, used + len(some.entries)
        for whole, part in ((columns, some.columns), (entries, some.entries)):
            if used > len(whole):
                whole.resize(2 * used, refcheck=False)  # there is no view of it
            whole[before:used] = part
        del some, part
    for whole in (columns, entries):
        whole.resize(used, refcheck=False)
    return SymmetricCsr(pointers, columns, entries)
