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


@dataclass(frozen=True, eq=False)
class Cholesky:
    """The factor L (n, n) of A = L L', whose upper triangle is not read."""

    lower: Floats

    def solve(self, b: Floats) -> Floats:
        """Return u (n, channels) with ``A u = b``."""
        from scipy.linalg import cho_solve

        u: Floats = cho_solve((self.lower, True), b, check_finite=False)
        return u


def cholesky(matrix: csr_array) -> Cholesky | None:
    """Return the factor of a symmetric matrix; None where it is large, or has an eigenvalue that is not positive."""
    if matrix.shape[0] > DENSE_UNKNOWNS:
        return None
    from scipy.linalg import cho_factor

    try:
        lower, _ = cho_factor(matrix.toarray(order="F"), lower=True, overwrite_a=True, check_finite=False)
    except np.linalg.LinAlgError:
        return None
    return Cholesky(lower) if (lower.diagonal() > 0).all() else None  # of what is not a number neither holds
