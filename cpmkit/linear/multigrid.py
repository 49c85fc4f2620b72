"""Conjugate gradients with a multigrid cycle over a form's coarser levels; GMRES where operators are not symmetric.

Systems that are not positive, or complex, go by minimal residuals (:mod:`cpmkit.linear.multigrid_indefinite`).

The iterations do not grow when the spacing falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.multigrid_cycle import cycle_of
from cpmkit.linear.multigrid_exact import Indefinite
from cpmkit.linear.multigrid_indefinite import Minimised, minimised
from cpmkit.linear.multigrid_matrix import UnsignedCsr
from cpmkit.linear.multigrid_symmetric import halved
from cpmkit.linear.multigrid_unsymmetric import PreconditionedUnsymmetric, prepare_unsymmetric
from cpmkit.linear.operators import Bordered, ComplexShift, CsrOperator, has_symmetric_pattern
from cpmkit.linear.preconditioned import Preconditioned, indefinite
from cpmkit.protocols import Operator

#: The most unknowns of a coarsest level, which is factorised, and of one that has to resolve waves.
MOST_FACTORISED, MOST_FACTORISED_WAVES = 20_000, 100_000


@dataclass(frozen=True)
class Multigrid:
    """Conjugate gradients with a symmetric V cycle.

    Attributes
    ----------
    max_iterations : int
        At most; some 20 are usual, 30 with conditions inside the manifold.
    """

    max_iterations: int = 300

    def prepare(
        self, operator: Operator, levels: Sequence[Any] = ()
    ) -> Preconditioned | PreconditionedUnsymmetric | Minimised:
        """Return the iteration, with the operators of all levels, their smoothers and factors.

        Raises
        ------
        SceneError
            If the operator is not symmetric, or large and the form has no levels for it.
        ConvergenceError
            If the operator turns out to have an eigenvalue of the wrong sign.
        """
        bordered = operator if isinstance(operator, Bordered) else None
        inner = operator if bordered is None else bordered.operator
        waves = isinstance(inner, CsrOperator) and inner.indefinite
        if not has_symmetric_pattern(inner) or (waves and bordered is not None):
            raise SceneError("solver 'multigrid' solves systems of a form that has levels; use solver='direct'.")
        _check_coarsest(levels[-1].prolongation.shape[1] if levels else inner.size, inner.size, waves)
        if not inner.symmetric:
            return _unsymmetric(operator, levels, self.max_iterations)
        try:
            if waves or isinstance(inner, ComplexShift):
                return minimised(inner, levels, self.max_iterations)
            piece = np.full(inner.size, -1)
            if bordered is not None:
                members = bordered.border.indicator.tocoo()
                piece[members.row] = members.col
            matrix = inner.to_csr()
            half = halved(matrix)
            cycle = cycle_of(matrix, levels, piece, half=half)
            more_exact = partial(cycle_of, matrix, levels, piece, is_rounded=False) if cycle.is_rounded else None
        except Indefinite as error:
            raise indefinite("multigrid", error, 0, np.nan) from error
        rows = UnsignedCsr.of(matrix) if half is None else half
        steps = self.max_iterations
        return Preconditioned(operator, rows, bordered, cycle, steps, "multigrid", more_exact=more_exact)


def _unsymmetric(operator: Operator, levels: Sequence[Any], max_iterations: int) -> PreconditionedUnsymmetric:
    try:
        return prepare_unsymmetric(operator, levels, max_iterations)
    except RuntimeError as error:
        raise SceneError(
            f"The linear system is singular in a part of the manifold ({error}): nothing fixes the solution there."
        ) from error


def _check_coarsest(unknowns: int, size: int, waves: bool) -> None:
    """Refuse a coarsest level of so many unknowns, of ``size`` on the finest, that is too large to be factorised.

    Raises
    ------
    SceneError
        If so.
    """
    if waves and unknowns > MOST_FACTORISED_WAVES:
        raise SceneError(
            f"solver 'multigrid' factorises the coarsest level that resolves the waves, and it has {unknowns:,} of the "
            f"{size:,} unknowns, where up to {MOST_FACTORISED_WAVES:,} are accepted; use solver='direct', or a larger "
            "spacing."
        )
    if not waves and unknowns > MOST_FACTORISED:
        raise SceneError(
            f"solver 'multigrid' needs coarser levels, which the form has none of for {size} unknowns; use "
            "solver='direct'."
        )
