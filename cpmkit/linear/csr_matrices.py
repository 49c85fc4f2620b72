"""Sparse matrices as compiled kernels take them, cut into parcels of rows for all threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.operators import PARCEL_ENTRIES
from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.runtime.threads import run_parcels, thread_count

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Matrices with fewer entries are multiplied by one thread: handing out parcels takes as long as one or two of them.
LEAST_SHARED_ENTRIES = 1 << 22


@dataclass(frozen=True, eq=False)
class UnsignedCsr:
    """A sparse matrix (n, m) by rows, with unsigned indices; vectors are (n, channels) and contiguous.

    Attributes
    ----------
    pointers, columns, entries : (n + 1,) uint64, (z,) uint32, (z,) float64 or float32
        As SciPy's; the columns are shared with it where it has 32 bits for them, the entries always.
    width : int
        Number of columns, m.
    """

    pointers: Any
    columns: Any
    entries: Any
    width: int

    @classmethod
    def of(cls, matrix: csr_array) -> UnsignedCsr:
        """Return the same matrix."""
        indices = matrix.indices
        columns = indices.view(np.uint32) if indices.dtype == np.int32 else indices.astype(np.uint32)
        return cls(matrix.indptr.astype(np.uint64), columns, matrix.data, int(matrix.shape[1]))

    def rounded(self, most: int | None = None) -> UnsignedCsr:
        """Return the same matrix with entries of 32 bits, whose products take less time; itself beyond ``most``."""
        if most is not None and len(self.entries) > most:
            return self
        return replace(self, entries=self.entries.astype(np.float32, copy=False))

    def to_csr(self) -> csr_array:
        """Return the same matrix as SciPy has it; rows are not sorted."""
        from scipy.sparse import csr_array

        kind = np.int32 if len(self.entries) < 2**31 else np.int64
        columns = self.columns.view(np.int32) if kind is np.int32 else self.columns.astype(kind)
        return csr_array((self.entries, columns, self.pointers.astype(kind)), shape=(len(self), self.width))

    def __matmul__(self, other: UnsignedCsr) -> UnsignedCsr:
        """Return the product ``A B`` with another matrix."""
        return self.times(other)

    def times(
        self, other: UnsignedCsr, wanted: Bools | None = None, upper: bool = False, first: float = 1.0
    ) -> UnsignedCsr:
        """Return ``A B`` with the ``wanted`` (n,) rows, all unless given, and nothing in others.

        ``upper``: only what is on the diagonal, which comes first in each row, and right of it. The ``first`` entries
        of A's rows count so much.
        """
        from cpmkit.linear.csr_kernels import multiply

        wanted = np.ones(len(self), dtype=bool) if wanted is None else wanted
        one, two = ((own.pointers, own.columns, own.entries) for own in (self, other))
        room = int(max(len(self.entries), len(other.entries)) * wanted.mean()) if len(wanted) else 0
        pointers, columns, entries = multiply(wanted, *one, *two, other.width, room, upper, first)
        return UnsignedCsr(pointers, columns, entries, other.width)

    def __len__(self) -> int:
        return len(self.pointers) - 1

    def residual(self, x: Floats, b: Floats) -> Floats:
        """Return ``b - A x``."""
        from cpmkit.linear.csr_kernels import subtract

        out = np.empty_like(b)
        self._parcels(subtract, x, b, out)
        return out

    def apply(self, x: Floats) -> Floats:
        """Return ``A x``."""
        out = self.residual(x, np.zeros((len(self), x.shape[1])))
        return np.negative(out, out=out)

    def step(self, x: Floats, b: Floats, inverse: Floats, kept: float, added: float, move: Floats) -> Floats:
        """Return ``x + move`` with the new ``move``, ``kept move + added D^-1 (b - A x)``; ``inverse`` (n,) is D^-1."""
        from cpmkit.linear.csr_kernels import step

        out = np.empty_like(x)
        self._parcels(step, x, b, inverse, kept, added, move, out)
        return out

    def add_to(self, fine: Floats, coarse: Floats) -> None:
        """Add ``A coarse`` to ``fine``."""
        from cpmkit.linear.csr_kernels import prolong

        self._parcels(prolong, coarse, fine)

    def transposed(self, fine: Floats) -> Floats:
        """Return ``A' fine``."""
        from cpmkit.linear.csr_kernels import restrict

        coarse = np.zeros((self.width, fine.shape[1]))
        restrict(self.pointers, self.columns, self.entries, fine, coarse)
        return coarse

    def _parcels(self, kernel: Callable[..., Any], *arguments: Any) -> None:
        rows = max(PARCEL_ENTRIES * len(self) // max(len(self.entries), 1), 1)

        def work(start: int, stop: int) -> None:
            kernel(start, stop, self.pointers, self.columns, self.entries, *arguments)

        if len(self.entries) < LEAST_SHARED_ENTRIES:
            work(0, len(self))
        else:
            run_parcels(work, len(self), rows)


#: Coarser matrices are made in so many parts, of so many rows at least: what is made twice is a tenth of the work.
COARSE_PARTS, LEAST_COARSE_ROWS = 16, 1 << 12


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
    def of(cls, matrix: csr_array, kind: Any = np.float64) -> SymmetricCsr:
        """Return the same matrix, with entries of this ``kind``."""
        from cpmkit.linear.csr_kernels import upper_half

        return cls(*upper_half(matrix.indptr, matrix.indices, matrix.data, np.empty(0, dtype=kind)))

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
        return np.ascontiguousarray(self._rest(x, b).T)

    def _rest(self, x: Floats, b: Floats) -> Floats:
        """Return ``b - A x``, (channels, n)."""
        from cpmkit.linear.csr_kernels import subtract_product

        rest = np.array(b.T, order="C")
        subtract_product(self.pointers, self.columns, self.entries, np.ascontiguousarray(x.T), rest)
        return rest

    def apply(self, x: Floats) -> Floats:
        """Return ``A x``."""
        out = self.residual(x, np.zeros_like(x))
        return np.negative(out, out=out)

    def step(self, x: Floats, b: Floats, inverse: Floats, kept: float, added: float, move: Floats) -> Floats:
        """Return ``x + move`` with the new ``move``, ``kept move + added D^-1 (b - A x)``; ``inverse`` (n,) is D^-1."""
        from cpmkit.linear.csr_kernels import move_by

        out = self.residual(x, b)
        move_by(out, inverse, kept, added, x, move)
        return out

    def solved_upwards(self, x: Floats | None, b: Floats, inverse: Floats, sweeps: int) -> tuple[Floats, Floats]:
        """Return x, from zero where it is None, and ``b - A x``, after ``sweeps`` through the equations from the last.

        Each is solved in its turn where ``inverse`` (n,), of the diagonal, is not zero (Gauss and Seidel).
        """
        from cpmkit.linear.csr_kernels import sweep_up

        rest = np.array(b.T, order="C") if x is None else self._rest(x, b)
        found = np.zeros_like(rest) if x is None else np.array(x.T, order="C")
        for _ in range(sweeps):
            sweep_up(self.pointers, self.columns, self.entries, inverse, rest, found)
        return np.ascontiguousarray(found.T), np.ascontiguousarray(rest.T)

    def solved_downwards(self, x: Floats, b: Floats, inverse: Floats, sweeps: int) -> Floats:
        """Return x after as many sweeps from the first equation on: the adjoint of `solved_upwards`."""
        from cpmkit.linear.csr_kernels import sweep_down

        found = np.array(x.T, order="C")
        for _ in range(sweeps):
            sweep_down(self.pointers, self.columns, self.entries, inverse, np.array(b.T, order="C"), found)
        return np.ascontiguousarray(found.T)

    def coarser(self, prolongation: csr_array) -> SymmetricCsr:
        """Return P' A P: as A = U + U', with half of the diagonal in each, it is T + T' of T = P' U P."""
        from cpmkit.linear.csr_kernels import folded

        upper = UnsignedCsr(self.pointers, self.columns, self.entries, len(self))
        T = UnsignedCsr.of(prolongation.T.tocsr()) @ upper.times(UnsignedCsr.of(prolongation), first=0.5)
        return SymmetricCsr(*folded(T.pointers, T.columns, T.entries))

    def whole(self) -> UnsignedCsr:
        """Return the same matrix with all of its entries."""
        from cpmkit.linear.csr_kernels import unfolded

        return UnsignedCsr(*unfolded(self.pointers, self.columns, self.entries), len(self))

    def shared(self) -> SymmetricCsr | UnsignedCsr:
        """Return the whole matrix where all threads have a share in its products, and itself where not."""
        shared = 2 * len(self.entries) - len(self) >= LEAST_SHARED_ENTRIES and thread_count() > 1
        return self.whole() if shared else self

    def rows_of(self, unknowns: Ints) -> csr_array:
        """Return some rows of the matrix, (k, n)."""
        from scipy.sparse import csr_array

        upper = UnsignedCsr(self.pointers, self.columns, self.entries, len(self)).to_csr()
        left = csr_array(upper[:, unknowns].T)
        diagonal = csr_array((self.diagonal[unknowns], (np.arange(len(unknowns)), unknowns)), shape=left.shape)
        return (upper[unknowns] + left - diagonal).tocsr()


def halved(matrix: csr_array) -> SymmetricCsr | None:
    """Return a symmetric matrix by its upper half; None where all threads have a share in its products."""
    return SymmetricCsr.of(matrix) if matrix.nnz < LEAST_SHARED_ENTRIES else None


def rounded(matrix: csr_array, most: int) -> SymmetricCsr | UnsignedCsr:
    """Return a large symmetric matrix with entries of 32 bits, by its upper half if one thread works.

    Beyond ``most`` entries it is whole, and has 64.
    """
    if matrix.nnz > most or thread_count() > 1:
        return UnsignedCsr.of(matrix).rounded(most)
    return SymmetricCsr.of(matrix, np.float32)


def coarse_operator(matrix: csr_array, prolongation: csr_array) -> SymmetricCsr:
    """Return P' A P of a large symmetric matrix, by its upper half.

    Some rows at a time: of A P only what these need is made, and let go. The rows of a lattice's unknowns that follow
    each other lie in a slab, so that little of A P is made twice.
    """
    fine, P, back = UnsignedCsr.of(matrix), UnsignedCsr.of(prolongation), UnsignedCsr.of(prolongation.T.tocsr())
    size = len(back)
    at_once = max(LEAST_COARSE_ROWS, -(-size // COARSE_PARTS))
    pointers, room = np.zeros(size + 1, dtype=np.uint64), len(fine.entries) // 4  # what is not written to takes none
    columns, entries, used = np.empty(room, dtype=np.uint32), np.empty(room), 0
    for start in range(0, size, at_once):
        stop = min(start + at_once, size)
        target, wanted = np.zeros(len(fine), dtype=bool), np.zeros(size, dtype=bool)
        target[back.columns[back.pointers[start] : back.pointers[stop]]] = True
        wanted[start:stop] = True
        some = back.times(fine.times(P, target), wanted, upper=True)
        pointers[start + 1 : stop + 1] = some.pointers[start + 1 : stop + 1] + np.uint64(used)
        before, used = used, used + len(some.entries)
        for whole, part in ((columns, some.columns), (entries, some.entries)):
            if used > len(whole):
                whole.resize(2 * used, refcheck=False)  # no view of it is anywhere
            whole[before:used] = part
        del some, part
    for whole in (columns, entries):
        whole.resize(used, refcheck=False)
    return SymmetricCsr(pointers, columns, entries)
