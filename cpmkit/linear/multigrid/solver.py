"""The solver ``multigrid``: Krylov iterations preconditioned by a cycle over a form's coarser levels.

Conjugate gradients solve symmetric positive systems. GMRES solves complex shifts ``A - i s M``, with the cycle of
``A + s M``; standing waves, with a cycle that is exact on the coarsest level that resolves them; and advection, with a
cycle of overlapping blocks. The number of iterations does not grow when the spacing falls.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.direct import pinned_matrix
from cpmkit.linear.krylov import indefinite_error
from cpmkit.linear.multigrid.cycle import Level, build_cycle, build_schwarz_cycle
from cpmkit.linear.operators import ComplexShift, as_bordered, has_symmetric_pattern, without_border
from cpmkit.linear.preconditioned import PreconditionedCG, PreconditionedGMRES
from cpmkit.linear.protocols import Operator
from cpmkit.linear.residuals import IndefiniteError

#: Most unknowns of a coarsest level, which is factorised, and most of a coarsest level that has to resolve waves.
MAX_FACTORISED, MAX_FACTORISED_WAVES = 20_000, 100_000


@dataclass(frozen=True)
class MultigridSolver:
    """Krylov iterations with a multigrid cycle."""

    max_iterations: int = 300  #: Most iterations; 20 are usual, 30 with conditions inside the manifold.

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> PreconditionedCG | PreconditionedGMRES:
        """Return the Krylov iteration with its cycle: matrices of all levels, their smoothers and the coarsest factors.

        ``levels`` are the form's coarser levels. Raises SceneError if the operator's sparsity pattern is not symmetric,
        it is indefinite with a border, its coarsest level is too large to be factorised, or a part of it is singular.
        Raises ConvergenceError if it turns out to have an eigenvalue of the wrong sign.
        """
        inner = without_border(operator)
        waves = bool(getattr(inner, "indefinite", False))
        if not has_symmetric_pattern(inner) or (waves and inner is not operator):
            raise SceneError("solver 'multigrid' solves systems of a form that has levels; use solver='direct'.")
        _check_coarsest(levels[-1].prolongation.shape[1] if levels else inner.size, inner.size, waves)
        try:
            return self._prepare(operator, inner, levels, waves)
        except IndefiniteError as error:
            raise indefinite_error("multigrid", error, 0, np.nan) from error
        except RuntimeError as error:
            raise SceneError(
                f"The linear system is singular in a part of the manifold ({error}): nothing fixes the solution there."
            ) from error

    def _prepare(
        self, operator: Operator, inner: Operator, levels: Sequence[Level], waves: bool
    ) -> PreconditionedCG | PreconditionedGMRES:
        """Return the iteration for an operator; ``inner`` is the operator without its border.

        ``waves`` is whether A has eigenvalues of both signs. The cycle is then that of A itself: smoothers damp
        components for which A is positive on all levels that resolve a wave, and the coarsest of these levels, on which
        A has negative eigenvalues, is factorised without change. Raises IndefiniteError if an eigenvalue has the wrong
        sign, RuntimeError if a block of unknowns is singular.
        """
        bordered = as_bordered(operator)
        if not inner.symmetric:
            matrix = operator.to_csr() if bordered is None else pinned_matrix(bordered)
            return PreconditionedGMRES(operator, build_schwarz_cycle(matrix, levels), self.max_iterations, "multigrid")
        piece = np.full(inner.size, -1)
        shift = inner if isinstance(inner, ComplexShift) else None
        if waves or shift is not None:
            matrix = inner.to_csr() if shift is None else shift.positive_matrix()
            cycle = build_cycle(matrix, levels, piece, waves=waves)
            return PreconditionedGMRES(operator, cycle, self.max_iterations, "multigrid")
        if bordered is not None:
            members = bordered.border.indicator.tocoo()
            piece[members.row] = members.col
        cycle = build_cycle(inner.to_csr(), levels, piece)
        prepared = PreconditionedCG(operator, cycle, self.max_iterations, "multigrid")
        if not cycle.is_rounded:
            return prepared
        in_float64 = partial(build_cycle, inner.to_csr(), levels, piece, is_rounded=False)
        return replace(prepared, fallback=lambda: replace(prepared, preconditioner=in_float64()))


def _check_coarsest(unknowns: int, size: int, waves: bool) -> None:
    """Raise SceneError if the coarsest level's ``unknowns`` are too many to be factorised; the finest has ``size``."""
    if waves and unknowns > MAX_FACTORISED_WAVES:
        raise SceneError(
            f"solver 'multigrid' factorises the coarsest level that resolves the waves, and it has {unknowns:,} of the "
            f"{size:,} unknowns, where up to {MAX_FACTORISED_WAVES:,} are accepted; use solver='direct', or a larger "
            "spacing."
        )
    if not waves and unknowns > MAX_FACTORISED:
        raise SceneError(
            f"solver 'multigrid' needs coarser levels, which the form has none of for {size} unknowns; use "
            "solver='direct'."
        )
