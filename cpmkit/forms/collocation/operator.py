"""The operator of the collocation form: A = c I - M with M = diag(L) + (L - diag L) E.

King et al. (2024), eq. 3 and section 5.3; in its section 5.4, a screened problem needs n = -1, not 1.

L is the cross Laplacian, of second or fourth order, or its like with a variable diffusivity and a velocity:
``A u = diagonal u - W (E u + g)`` with the weights W of the difference neighbours. The ghosts' rows are rows of the PDE
like all others (Krylov methods stagnate on purely algebraic ghost rows).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.operators import ThreadedProduct, connected_unknowns
from cpmkit.protocols import Floats, Ints, Operator

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class ExtensionOperator:
    """A, with E and the difference table kept apart: ``A u = diagonal u - scale W E u``.

    Attributes
    ----------
    extension : csr_array (rows, n)
        E.
    differences : csr_array (n, rows)
        W: the weights of the difference neighbours.
    diagonal : float or (n, 1) float64
        Of c I - diag(L).
    scale : float
        Factor of W, often ``1 / spacing^2``.
    """

    extension: csr_array
    differences: csr_array
    diagonal: float | Floats
    scale: float

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.extension.shape[1])

    @property
    def nonzeros(self) -> int:
        """Entries stored in E and W."""
        return int(self.extension.nnz + self.differences.nnz)

    @property
    def symmetric(self) -> bool:
        """False: a stencil that reads a node is not read by it."""
        return False

    def apply(self, u: Floats) -> Floats:
        """Return A u for u of shape (n,) or (n, channels)."""
        varies = isinstance(self.diagonal, np.ndarray)

        def finish(start: int, stop: int, rows: Floats) -> Floats:
            diagonal: Any = self.diagonal
            if varies:
                diagonal = diagonal[start:stop, 0] if u.ndim == 1 else diagonal[start:stop]
            return np.asarray(diagonal * u[start:stop] - self.scale * rows)

        return self._differences.product(self._extension @ u, finish)

    def apply_rows(self, u: Floats, rows: Ints) -> Floats:
        """Return the entries ``rows`` of A u; only what they read is computed."""
        diagonal: Any = self.diagonal
        if isinstance(diagonal, np.ndarray):
            diagonal = diagonal[rows, 0] if u.ndim == 1 else diagonal[rows]
        read = self.differences[rows]
        columns = np.unique(read.indices)
        product = read[:, columns] @ (self.extension[columns] @ u)
        return np.asarray(diagonal * u[rows] - self.scale * product)

    @cached_property
    def _extension(self) -> ThreadedProduct:
        return ThreadedProduct(self.extension)

    @cached_property
    def _differences(self) -> ThreadedProduct:
        return ThreadedProduct(self.differences)

    def spread(self, datum: Floats) -> Floats:
        """Return what data (rows, channels), added to E u, add to b: ``scale W datum``."""
        return np.asarray(self.scale * (self.differences @ datum))

    def to_csr(self) -> csr_array:
        """Return A as one sparse matrix."""
        from scipy.sparse import diags_array, eye_array

        product = (self.differences @ self.extension) * self.scale
        if isinstance(self.diagonal, np.ndarray):
            matrix: csr_array = (diags_array(self.diagonal[:, 0]) - product).tocsr()
        else:
            matrix = (self.diagonal * eye_array(self.size) - product).tocsr()
        return matrix

    def pieces(self) -> tuple[int, Ints]:
        """Return how many sets of unknowns it couples among themselves alone, and the set of each unknown (n,)."""
        count, n = sum(self.differences.shape), self.size
        _, label = connected_unknowns(count, [(self.differences, 0, n), (self.extension, n, 0)])
        return int(label[:n].max(initial=-1)) + 1, label[:n]

    def scaled_plus_mass(self, factor: float, mass: Operator | None = None) -> ExtensionOperator:
        """Return ``I + factor A``; the mass of this form is the identity."""
        assert mass is None
        return replace(self, diagonal=1.0 + factor * self.diagonal, scale=factor * self.scale)

    def minus_shifted_mass(self, shift: float, mass: Operator | None = None) -> ExtensionOperator:
        """Return ``A - shift M``, M the identity or what conditions of Steklov read."""
        if mass is None:
            return replace(self, diagonal=self.diagonal - shift)
        assert isinstance(mass, BoundaryMass)
        return replace(self, extension=(self.extension + shift * mass.reads).tocsr())


@dataclass(frozen=True, eq=False)
class BoundaryMass:
    """B of ``A u = lambda B u`` where du/db = lambda u at boundaries: ``scale W S``.

    With ``u(ghost) = u(mirror) + s lambda u(y)``, y the foot on the boundary, E u becomes ``E u + lambda S u``.

    Attributes
    ----------
    operator : ExtensionOperator
        A, with its W.
    reads : csr_array (rows, n)
        S: reads u at y, times the ghost's factor s.
    """

    operator: ExtensionOperator
    reads: csr_array

    @cached_property
    def matrix(self) -> csr_array:
        """B as one sparse matrix (n, n)."""
        made: csr_array = (self.operator.scale * (self.operator.differences @ self.reads)).tocsr()
        return made

    def apply(self, u: Floats) -> Floats:
        """Return B u for u of shape (n,) or (n, channels)."""
        return np.asarray(self.matrix @ u)
