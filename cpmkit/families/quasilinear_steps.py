"""Steps for A(u) u = b(u): with the diffusivity of the last iterate, or by Newton's method.

A Newton tangent is symmetric except for the derivative of the diffusivity with respect to u. Systems with the symmetric
part are solved by the linear solver, systems with the whole tangent by GMRES, preconditioned with the symmetric part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError, InputError
from cpmkit.families.context import SolveContext
from cpmkit.forms.form_records import StateDependentCoefficient
from cpmkit.linear.operators import Border, Bordered
from cpmkit.linear.protocols import Operator, Stiffness
from cpmkit.linear.residuals import SolveReport
from cpmkit.scene.diffusivities import StateDiffusivity, zero_derivative
from cpmkit.scene.equations import Terms
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class State:
    """An iterate u, and the residual of A(u) u = b(u) there."""

    u: Floats  #: (n, 1): the unknowns.
    stiffness: Stiffness  #: The operator A(u).
    b: Floats  #: (n, 1): the right-hand side b(u).
    #: (n, 1): b - A u, without the part for which there is no solution on pieces where a constant is free.
    residual: Floats
    border: Border | None  #: The pieces where no condition or term fixes a constant; None without any.


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps of an iteration for an equation whose diffusivity depends on u, on a form."""

    context: SolveContext  #: The form, and the solver of linear systems.
    terms: Terms  #: Terms of the equation.
    law: StateDiffusivity  #: The diffusivity of the equation.
    loads: Floats  #: (n, 1): the load vector of f.
    #: The diffusivity by which penalties and stabilisation are scaled; by default the diffusivity of the equation.
    penalty_scale: float | None = None

    def frozen_terms(self, u: Floats) -> Terms:
        """Return the terms with the diffusivity evaluated at u (n, 1), independent of the solution."""
        scale = None if self.penalty_scale is None else self._scale_at
        return replace(self.terms, diffusivity=StateDependentCoefficient(self.law.evaluate, u, scale))

    def _scale_at(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        """Return the penalty scale (k,) at k points; u (k,) gives k, and ``slopes`` and ``points`` are not used."""
        del slopes, points
        assert self.penalty_scale is not None
        return np.full(len(u), self.penalty_scale)

    def state(self, u: Floats) -> State:
        """Return the state at u (n, 1), with the operator, the right-hand side and the residual there."""
        form = self.context.discretized
        stiffness = form.stiffness(self.frozen_terms(u))
        b = self.loads + form.condition_load(stiffness)
        residual = b - stiffness.apply(u)
        border = form.free_constants(stiffness)
        if border is not None:
            residual, _ = border.balance(residual)
        return State(u, stiffness, b, residual, border)

    def lagged_step(self, state: State) -> tuple[State, SolveReport]:
        """Return the state after a linear solve with the diffusivity at ``state``, and the report of this solve."""
        change, report = self._solve(state.stiffness, state)
        return self.state(state.u + change), report

    def newton_step(self, state: State) -> tuple[State, SolveReport]:
        """Return the state after a step of Newton's method with a line search, and the report of its linear solve.

        Raises ConvergenceError if no step length reduces the residual enough, or a linear solve fails.
        """
        form = self.context.discretized
        scale = self.law.evaluate if self.penalty_scale is None else self._scale_at
        coefficient = StateDependentCoefficient(self.law.flux_by_gradient, state.u, scale)
        tangent = form.stiffness(replace(self.terms, diffusivity=coefficient))
        drift = None
        if self.law.by_value is not zero_derivative:
            drift = form.advection(StateDependentCoefficient(self.law.flux_by_value, state.u))
        change, report = self._solve(tangent, state, drift)
        weights = 1 / np.abs(tangent.diagonal)
        before, length = _size(state.residual, weights), 1.0
        refusal: InputError | None = None
        while length >= 2.0**-12:  # it is halved until the residual falls by at least a tenth of that share
            try:
                trial = self.state(state.u + length * change)
            except InputError as error:  # the diffusivity is not positive there
                refusal, length = error, length / 2
                continue
            falls = _size(trial.residual, weights) <= (1 - 0.1 * length) * before
            if falls or float(np.abs(change).max()) <= 1e-11 * float(np.abs(state.u).max()):  # rounding
                return trial, report
            length /= 2
        raise ConvergenceError(
            "Newton's method found no step that lessens the residual of the equation"
            + (f", and of longer ones {refusal}" if refusal else "")
            + "; use method='lagged', another start (guess), a larger regularization or a smaller spacing.",
            report,
        ) from refusal

    def _solve(self, tangent: Stiffness, state: State, drift: Operator | None = None) -> tuple[Floats, SolveReport]:
        """Return the change of u (n, 1) in a step, and the report of the linear solve with ``tangent`` alone.

        The system has the matrix ``tangent + drift``, and as right-hand side the residual of ``state``. The change has
        mean zero where no condition fixes a constant. If GMRES does not converge, ``drift`` is left out. Raises
        ConvergenceError if the solve with ``tangent`` fails.
        """
        context, border = self.context, state.border
        operator: Operator = tangent if border is None else Bordered(tangent, border)
        prepared = context.prepare(operator)
        tolerance = max(context.tolerance, 1e-6)  # the next step corrects the error

        def without_means(u: Floats) -> Floats:
            return u if border is None else border.remove_means(u)[0]

        start, report = prepared.solve(state.residual, tolerance, progress=context.progress)
        start = without_means(start)
        if drift is None:
            return start, report
        from scipy.sparse.linalg import LinearOperator, gmres

        advection = drift

        def product(v: Any) -> Any:
            image = np.asarray(advection.apply(v.reshape(-1, 1)))
            return v.ravel() + without_means(prepared.solve(image, tolerance)[0]).ravel()

        n = len(start)
        solution, failed = gmres(
            LinearOperator((n, n), matvec=product), start.ravel(), rtol=100 * tolerance, restart=40, maxiter=2
        )
        return (start if failed else solution.reshape(-1, 1)), report


def _size(residual: Floats, weights: Any) -> float:
    """Return the Euclidean norm of a residual (n, 1) whose squares are multiplied by ``weights`` (n, 1)."""
    return float(np.sqrt(np.sum(weights * residual**2)))
