"""Conjugate gradients with a multigrid cycle over a form's coarser levels; GMRES where operators are not symmetric.

Systems that are not positive, or complex, go by minimal residuals (:mod:`cpmkit.linear.multigrid_indefinite`).

The iterations do not grow when the spacing falls. Where constants are free on pieces of the manifold, the iteration
runs in the complement of the pieces' indicators, and what the border adds is added after.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError, SceneError
from cpmkit.linear.conjugate_gradients import conjugate_gradients
from cpmkit.linear.multigrid_cycle import Cycle, cycle_of
from cpmkit.linear.multigrid_exact import Indefinite
from cpmkit.linear.multigrid_indefinite import Minimised, minimised
from cpmkit.linear.multigrid_matrix import UnsignedCsr
from cpmkit.linear.multigrid_unsymmetric import PreconditionedUnsymmetric, prepare_unsymmetric
from cpmkit.linear.operators import Bordered, ComplexShift, CsrOperator, has_symmetric_pattern
from cpmkit.linear.report import SolveReport, judge
from cpmkit.protocols import Floats, Operator, Progress, no_progress

#: The recursive residual is driven this much below the tolerance, because it drifts from the true one, a little.
RECURSION_SHARE = 0.9
#: At most this many fresh starts from the true residual.
FRESH_STARTS = 3
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
            cycle = cycle_of(matrix, levels, piece)
        except Indefinite as error:
            raise _indefinite(error, 0, np.nan) from error
        return Preconditioned(operator, UnsignedCsr.of(matrix), bordered, cycle, self.max_iterations)


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


@dataclass(frozen=True, eq=False)
class Preconditioned:
    """An operator with its cycle.

    Attributes
    ----------
    operator : Operator
        What is solved with.
    matrix : UnsignedCsr
        A.
    bordered : Bordered, optional
        ``A + s F W`` where constants are free.
    cycle : Cycle
        Of A.
    max_iterations : int
        At most.
    """

    operator: Operator
    matrix: UnsignedCsr
    bordered: Bordered | None
    cycle: Cycle
    max_iterations: int

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Solve for all channels.

        Raises
        ------
        ConvergenceError
            If a channel's recomputed residual is above the tolerance, or the system turns out to be indefinite.
        """
        size = np.linalg.norm(b, axis=0)
        u = np.zeros_like(b) if guess is None else guess.copy()
        u[:, size == 0] = 0.0  # the solution there; no guess gets nearer, and there is no relative residual to aim at
        compatible, means = self._compatible(b)
        iterations = products = 0
        for _ in range(FRESH_STARTS):
            residual = self.matrix.residual(u, compatible)
            products += b.shape[1]
            open_ = np.flatnonzero(np.linalg.norm(residual, axis=0) > tolerance * size)
            if not len(open_) or iterations >= self.max_iterations:
                break
            start, target = np.ascontiguousarray(residual[:, open_]), RECURSION_SHARE * tolerance * size[open_]
            left = self.max_iterations - iterations
            try:
                step, taken = conjugate_gradients(self.matrix.apply, self.precondition, start, target, left, progress)
            except Indefinite as error:
                raise _indefinite(error, iterations, tolerance) from error
            u[:, open_] += step
            iterations += taken
            products += (taken + (taken + 1) * self.cycle.products) * len(open_)
        if self.bordered is not None:
            border = self.bordered.border
            u += border.indicator @ (means - border.mean @ u)
        progress("solve", 1.0)
        remedy = "ask for a larger tolerance or more max_iterations, or use solver='direct'"
        return u, judge(self.operator, b, u, "multigrid", tolerance, iterations, products, remedy)

    def _compatible(self, b: Floats) -> tuple[Floats, Floats]:
        """Return b less what has no solution on free pieces, and the means (k, channels) that this is moved to."""
        if self.bordered is None:
            return b, np.zeros((0, b.shape[1]))
        indicator, carried = self.bordered.border.indicator, self.bordered.border.carried
        excess = np.linalg.solve((indicator.T @ carried).toarray(), indicator.T @ b)
        return b - carried @ excess, excess / self.bordered.shift

    @property
    def step_products(self) -> int:
        """How many products with A a cycle takes, a channel."""
        return self.cycle.products

    def precondition(self, residual: Floats) -> Floats:
        """Return one cycle from a residual (n, channels)."""
        return self._centred(self.cycle.apply(self._centred(residual)))

    def _centred(self, vector: Floats) -> Floats:
        """Return the part of a vector that is orthogonal to the free pieces' indicators."""
        if self.bordered is None:
            return vector
        indicator = self.bordered.border.indicator
        sums, members = indicator.T @ vector, indicator.sum(axis=0)
        return np.asarray(vector - indicator @ (sums / members[:, None]))


def _indefinite(error: Indefinite, iterations: int, tolerance: float) -> ConvergenceError:
    report = SolveReport("multigrid", False, iterations, 0, np.inf, tolerance, str(error))
    return ConvergenceError(
        f"The system is indefinite, and solver 'multigrid' stopped after {iterations} iterations: {error}; use "
        "solver='direct', or a smaller spacing.",
        report,
    )
