"""Sparse matrices as compiled kernels take them, cut into parcels of rows for all threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.products import PARCEL_ENTRIES
from cpmkit.protocols import Bools, Floats
from cpmkit.runtime.threads import run_parcels

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
        from cpmkit.linear.multigrid_kernels import multiply

        wanted = np.ones(len(self), dtype=bool) if wanted is None else wanted
        one, two = ((own.pointers, own.columns, own.entries) for own in (self, other))
        room = int(max(len(self.entries), len(other.entries)) * wanted.mean()) if len(wanted) else 0
        pointers, columns, entries = multiply(wanted, *one, *two, other.width, room, upper, first)
        return UnsignedCsr(pointers, columns, entries, other.width)

    def __len__(self) -> int:
        return len(self.pointers) - 1

    def residual(self, x: Floats, b: Floats) -> Floats:
        """Return ``b - A x``."""
        from cpmkit.linear.multigrid_kernels import subtract

        out = np.empty_like(b)
        self._parcels(subtract, x, b, out)
        return out

    def apply(self, x: Floats) -> Floats:
        """Return ``A x``."""
        out = self.residual(x, np.zeros((len(self), x.shape[1])))
        return np.negative(out, out=out)

    def step(self, x: Floats, b: Floats, inverse: Floats, kept: float, added: float, move: Floats) -> Floats:
        """Return ``x + move`` with the new ``move``, ``kept move + added D^-1 (b - A x)``; ``inverse`` (n,) is D^-1."""
        from cpmkit.linear.multigrid_kernels import step

        out = np.empty_like(x)
        self._parcels(step, x, b, inverse, kept, added, move, out)
        return out

    def add_to(self, fine: Floats, coarse: Floats) -> None:
        """Add ``A coarse`` to ``fine``."""
        from cpmkit.linear.multigrid_kernels import prolong

        self._parcels(prolong, coarse, fine)

    def transposed(self, fine: Floats) -> Floats:
        """Return ``A' fine``."""
        from cpmkit.linear.multigrid_kernels import restrict

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
