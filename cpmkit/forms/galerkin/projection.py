"""Splines nearest to given values: ``(M + h^2 S) u = V' w values``.

M alone is singular, for splines that no sample sees have none; S is what holds them. The condition stays below some
200, whatever the spacing, so that conjugate gradients with the diagonal are quicker than factors on all but the
smallest scenes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.csr_matrices import UnsignedCsr
from cpmkit.linear.direct import factorize_matrix
from cpmkit.linear.krylov import conjugate_gradients
from cpmkit.runtime.caches import state_without_cached
from cpmkit.types import Floats, no_progress

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Up to this many unknowns the matrix is factorised.
MOST_FACTORISED_PROJECTION = 1_500
#: Relative residual of the iteration, and how many steps it may take: 130 to 190 are usual.
PROJECTION_TOLERANCE, MOST_PROJECTION_STEPS = 1e-13, 1_000


@dataclass(frozen=True, eq=False)
class Projection:
    """What solves with M + h^2 S.

    Attributes
    ----------
    matrix : csr_array (n, n)
        M + h^2 S, symmetric and positive definite.
    """

    matrix: csr_array

    __getstate__ = state_without_cached

    def solve(self, integrals: Floats) -> Floats:
        """Return the splines (n, k) of the ``integrals`` (n, k) of values times each spline."""
        found = np.zeros_like(integrals)
        some = np.flatnonzero(np.any(integrals != 0, axis=0))
        if len(integrals) <= MOST_FACTORISED_PROJECTION:
            found[:, some] = self._factors.solve(np.ascontiguousarray(integrals[:, some]))
        elif len(some):
            found[:, some] = self._iterated(np.ascontiguousarray(integrals[:, some]))
        return found

    def _iterated(self, integrals: Floats) -> Floats:
        target = PROJECTION_TOLERANCE * np.linalg.norm(integrals, axis=0)
        apply, scale = self._compiled.apply, 1 / self.matrix.diagonal()[:, None]
        most = MOST_PROJECTION_STEPS
        found, steps = conjugate_gradients(apply, lambda r: scale * r, integrals, target, most, no_progress)
        return found if steps < most else np.asarray(self._factors.solve(integrals))

    @cached_property
    def _compiled(self) -> UnsignedCsr:
        return UnsignedCsr.of(self.matrix)

    @cached_property
    def _factors(self) -> Any:
        return factorize_matrix(self.matrix, symmetric_pattern=True)
