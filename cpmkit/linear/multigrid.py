"""Conjugate gradients with a multigrid cycle over a form's coarser levels, for symmetric operators.

The iterations do not grow when the spacing falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.multigrid_cycle import cycle_of
from cpmkit.linear.multigrid_exact import Indefinite
from cpmkit.linear.multigrid_matrix import UnsignedCsr
from cpmkit.linear.preconditioned import Preconditioned, indefinite, without_border
from cpmkit.protocols import Operator

#: The most unknowns of a coarsest level, which is factorised.
MOST_FACTORISED = 20_000


@dataclass(frozen=True)
class Multigrid:
    """Conjugate gradients with a symmetric V cycle.

    Attributes
    ----------
    max_iterations : int
        At most; some 20 are usual, 30 with conditions inside the manifold.
    """

    max_iterations: int = 300

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> Preconditioned:
        """Return the iteration, with the operators of all levels, their smoothers and factors.

        Raises
        ------
        SceneError
            If the operator is not symmetric, or large and the form has no levels for it.
        ConvergenceError
            If the operator turns out to have an eigenvalue of the wrong sign.
        """
        inner, bordered = without_border(operator, "multigrid")
        if (levels[-1].prolongation.shape[1] if levels else inner.size) > MOST_FACTORISED:
            raise SceneError(
                f"solver 'multigrid' needs coarser levels, which the form has none of for {inner.size} unknowns; use "
                "solver='direct'."
            )
        piece = np.full(inner.size, -1)
        if bordered is not None:
            members = bordered.border.indicator.tocoo()
            piece[members.row] = members.col
        matrix = inner.to_csr()
        try:
            cycle = cycle_of(matrix, levels, piece)
        except Indefinite as error:
            raise indefinite("multigrid", error, 0, np.nan) from error
        return Preconditioned(operator, UnsignedCsr.of(matrix), bordered, cycle, self.max_iterations, "multigrid")
