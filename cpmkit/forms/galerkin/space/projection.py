"""Projection of values at samples onto the functions of a space: the solution of ``(M + h^2 S) u = loads``.

The mass matrix M alone is singular, for some splines are zero at all samples; the stabilisation S determines them. The
condition number stays below about 200 at any spacing, so that conjugate gradients preconditioned by the diagonal are
faster than a factorisation on all but the smallest scenes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.csr_matrices import UnsignedCsr
from cpmkit.linear.direct import factorize_matrix
from cpmkit.linear.krylov import conjugate_gradients
from cpmkit.runtime.memory import state_without_cached
from cpmkit.types import Floats, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Up to so many unknowns the matrix is factorised.
MOST_FACTORISED_PROJECTION = 1_500
#: Relative residual of the iteration, and the largest number of its steps: 130 to 190 are usual.
PROJECTION_TOLERANCE, MOST_PROJECTION_STEPS = 1e-13, 1_000


@dataclass(frozen=True, eq=False)
class Projection:
    """Solver of systems with M + h^2 S.

    Attributes
    ----------
    matrix : csr_array (n, n)
        M + h^2 S, symmetric and positive definite.
    """

    matrix: csr_array

    __getstate__ = state_without_cached

    def solve(self, loads: Floats) -> Floats:
        """Return the solutions u (n, k) of (M + h^2 S) u = ``loads``.

        The ``loads`` (n, k) are integrals of k functions times each function of the space.
        """
        u = np.zeros_like(loads)
        nonzero = np.flatnonzero(np.any(loads != 0, axis=0))
        if len(loads) <= MOST_FACTORISED_PROJECTION:
            u[:, nonzero] = self._factors.solve(np.ascontiguousarray(loads[:, nonzero]))
        elif len(nonzero):
            u[:, nonzero] = self._iterate(np.ascontiguousarray(loads[:, nonzero]))
        return u

    def _iterate(self, loads: Floats) -> Floats:
        """Return the solutions (n, k) for nonzero ``loads`` (n, k) by preconditioned conjugate gradients.

        The preconditioner is the diagonal. If the iteration does not converge the matrix is factorised.
        """
        target = PROJECTION_TOLERANCE * np.linalg.norm(loads, axis=0)
        apply, inverse_diagonal = self._compiled.apply, 1 / self.matrix.diagonal()[:, None]
        most = MOST_PROJECTION_STEPS
        u, steps = conjugate_gradients(apply, lambda r: inverse_diagonal * r, loads, target, most, no_progress)
        return u if steps < most else np.asarray(self._factors.solve(loads))

    @cached_property
    def _compiled(self) -> UnsignedCsr:
        """The matrix in the format whose product with vectors is compiled."""
        return UnsignedCsr.of(self.matrix)

    @cached_property
    def _factors(self) -> Any:
        """The factorisation of the matrix, with a method ``solve``."""
        return factorize_matrix(self.matrix, symmetric_pattern=True)
