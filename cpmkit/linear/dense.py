"""Dense Cholesky factors of small symmetric positive matrices: up to some hundred unknowns quicker than sparse ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.protocols import Floats

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
