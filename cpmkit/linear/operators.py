"""The linear system of a scene: A = c I - M with M = diag(L) + (L - diag L) E, and its right-hand side.

L is the cross Laplacian, of second or fourth order, or its like with a variable diffusivity and a velocity:
``A u = diagonal u - W (E u + g)`` with the weights W of the difference neighbours. The ghosts' rows are rows of the PDE
like all others (Krylov methods stagnate on purely algebraic ghost rows).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.factorization import Factors, factorize
from cpmkit.linear.products import ThreadedProduct
from cpmkit.protocols import Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array


#: Share of the largest diagonal entry by which a border moves the constants.
LIFT = 0.1


@dataclass(frozen=True, eq=False)
class Border:
    """What makes a system regular whose solution is fixed up to a constant only, on some pieces of the manifold.

    With the means W u of the pieces and their indicators B, ``A u + B lambda = b``, ``W u = 0``; lambda is the part
    of b that has no solution. As A B = 0 and W B = 1, the solution of ``(A + s B W) u = b`` is the same but for its
    means ``lambda / s``.

    Attributes
    ----------
    indicator : csr_array (n, k)
        B: ones at the unknowns of each piece.
    mean : csr_array (k, n)
        W: the mean over each piece.
    """

    indicator: csr_array
    mean: csr_array

    def lift(self, u: Floats, scale: float) -> Floats:
        """Return ``scale B W u``, which moves the constants away from the kernel."""
        return np.asarray(scale * (self.indicator @ (self.mean @ u)))

    def centred(self, u: Floats) -> tuple[Floats, Floats]:
        """Return u less its mean on each piece, and the means (k, channels)."""
        means = self.mean @ u
        return np.asarray(u - self.indicator @ means), np.asarray(means)


@dataclass(frozen=True, eq=False)
class Operator:
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
    border : Border or None
        Where constants are in the kernel.
    """

    extension: csr_array
    differences: csr_array
    diagonal: float | Floats
    scale: float
    border: Border | None = None

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.extension.shape[1])

    @property
    def nonzeros(self) -> int:
        """Entries stored in E and W."""
        return int(self.extension.nnz + self.differences.nnz)

    @property
    def lift_scale(self) -> float:
        """How far from zero the border moves the constants: among the eigenvalues, a tenth of the largest.

        BiCGSTAB takes the same iterations at a tenth of it and up to twice as many far below; the rounding of the
        means, times this scale, limits the residual of a direct solve.
        """
        return LIFT * float(np.max(np.abs(self.diagonal)))

    def apply(self, u: Floats) -> Floats:
        """Return A u for u of shape (n,) or (n, channels); a border's constants count."""
        varies = isinstance(self.diagonal, np.ndarray)

        def finish(start: int, stop: int, rows: Floats) -> Floats:
            diagonal: Any = self.diagonal
            if varies:
                diagonal = diagonal[start:stop, 0] if u.ndim == 1 else diagonal[start:stop]
            return np.asarray(diagonal * u[start:stop] - self.scale * rows)

        image = self._differences.product(self._extension @ u, finish)
        return image if self.border is None else image + self.border.lift(u, self.lift_scale)

    @cached_property
    def _extension(self) -> ThreadedProduct:
        return ThreadedProduct(self.extension)

    @cached_property
    def _differences(self) -> ThreadedProduct:
        return ThreadedProduct(self.differences)

    def spread(self, datum: Floats) -> Floats:
        """Return what data (rows, channels), added to E u, add to b: ``scale W datum``."""
        return np.asarray(self.scale * (self.differences @ datum))

    def matrix(self) -> csr_array:
        """Return A as one sparse matrix, without a border: singular where there is one."""
        from scipy.sparse import diags_array, eye_array

        product = (self.differences @ self.extension) * self.scale
        if isinstance(self.diagonal, np.ndarray):
            matrix: csr_array = (diags_array(self.diagonal[:, 0]) - product).tocsr()
        else:
            matrix = (self.diagonal * eye_array(self.size) - product).tocsr()
        return matrix

    def shifted(self, factor: float) -> Operator:
        """Return ``I + factor A``."""
        return replace(self, diagonal=1.0 + factor * self.diagonal, scale=factor * self.scale)

    @cached_property
    def factors(self) -> Factors:
        """Sparse LU, a border included; a run of many steps makes it once."""
        return factorize(self)


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """A u = b for all channels.

    Attributes
    ----------
    operator : Operator
        A.
    right_side : (n, channels) float64
        b, boundary data included.
    guess : (n, channels) float64, optional
        Where an iterative solver starts; zero without it.
    """

    operator: Operator
    right_side: Floats
    guess: Floats | None = None

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.right_side)

    @property
    def nonzeros(self) -> int:
        """Entries stored in E and W."""
        return self.operator.nonzeros

    @property
    def diagonal(self) -> float | Floats:
        """Of c I - diag(L)."""
        return self.operator.diagonal

    def apply(self, u: Floats) -> Floats:
        """Return A u for u of shape (n,) or (n, channels); a border's constants count."""
        return self.operator.apply(u)

    def matrix(self) -> csr_array:
        """Return A as one sparse matrix, without a border: singular where there is one."""
        return self.operator.matrix()
