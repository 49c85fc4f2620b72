"""The linear system of a scene: A = c I - M with M = diag(L) + (L - diag L) E, and its right-hand side.

``L = (N - 2 d I) / spacing^2`` is the second-order cross Laplacian, so that
``A u = (c + 2 d / spacing^2) u - N (E u + g) / spacing^2``; the ghosts' rows are rows of the PDE like all
others (Krylov methods stagnate on purely algebraic ghost rows).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.conditions import evaluate_data
from cpmkit.discretization import Discretization
from cpmkit.problems import Problem
from cpmkit.products import ThreadedProduct
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """A u = b for all channels, with E and the difference table kept apart.

    Attributes
    ----------
    extension : csr_array (rows, n)
        E.
    neighbours : csr_array (n, rows)
        N.
    diagonal : float
        ``c + 2 d / spacing^2``: the diagonal of c I - diag(L), the same in every row.
    scale : float
        ``1 / spacing^2``.
    right_side : (n, channels) float64
        b, boundary data included.
    """

    extension: csr_array
    neighbours: csr_array
    diagonal: float
    scale: float
    right_side: Floats

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.right_side)

    @property
    def nonzeros(self) -> int:
        """Entries stored in E and N."""
        return int(self.extension.nnz + self.neighbours.nnz)

    def apply(self, u: Floats) -> Floats:
        """Return A u for u of shape (n,) or (n, channels)."""

        def finish(start: int, stop: int, rows: Floats) -> Floats:
            return self.diagonal * u[start:stop] - self.scale * rows

        return self._neighbours.product(self._extension @ u, finish)

    @cached_property
    def _extension(self) -> ThreadedProduct:
        return ThreadedProduct(self.extension)

    @cached_property
    def _neighbours(self) -> ThreadedProduct:
        return ThreadedProduct(self.neighbours)

    def matrix(self) -> csr_array:
        """Return A as one sparse matrix."""
        from scipy.sparse import eye_array

        product = (self.neighbours @ self.extension) * self.scale
        matrix: csr_array = (self.diagonal * eye_array(self.size) - product).tocsr()
        return matrix


def assemble(tables: Discretization, problem: Problem) -> LinearSystem:
    """Return the linear system of ``problem`` on ``tables``."""
    layout = tables.layout
    spacing, dim = layout.lattice.spacing, layout.lattice.dim
    scale = 1.0 / spacing**2
    inner = layout.band.feet.points[: layout.band.inner]
    where = [inner, *(ghosts.inside[: ghosts.unknowns] for ghosts in layout.ghosts)]
    points = layout.lattice.to_scene(np.concatenate(where))
    f = evaluate_data(problem.f, points, layout.channels, "the right-hand side f")
    right_side = f + scale * (tables.neighbours @ tables.datum)
    return LinearSystem(tables.extension, tables.neighbours, problem.c + 2 * dim * scale, scale, right_side)
