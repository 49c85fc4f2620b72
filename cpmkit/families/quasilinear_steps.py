"""Steps towards A(u) u = b(u): with the diffusivity of the step before, or by Newton's method.

Of Newton's tangent the symmetric part is solved with, the rest by GMRES over that.
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
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.diffusivities import StateDiffusivity
from cpmkit.scene.equations import Terms
from cpmkit.types import Floats

#: Relative residual to which a step is solved: the next one puts right what is left.
STEP_TOLERANCE = 1e-6
#: A step is halved until the residual falls by at least this share of the step.
LEAST_FALL = 0.1
#: The shortest step.
SHORTEST_STEP = 2.0**-12
#: GMRES is started anew after so many products.
RESTART = 40


@dataclass(frozen=True, eq=False)
class State:
    """u, and what is left of A(u) u = b(u).

    Attributes
    ----------
    u : (n, 1) float64
        The unknowns.
    stiffness : Stiffness
        A(u).
    b : (n, 1) float64
        b(u).
    residual : (n, 1) float64
        b - A u, less what has no solution on pieces where a constant is free.
    border : Border or None
        These pieces.
    """

    u: Floats
    stiffness: Stiffness
    b: Floats
    residual: Floats
    border: Border | None


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps on a form, for the terms of an equation whose diffusivity depends on u.

    Attributes
    ----------
    context : SolveContext
        With the form, and how linear systems are solved.
    terms : Terms
        Of the equation.
    law : StateDiffusivity
        Their diffusivity.
    loads : (n, 1) float64
        What f adds to b.
    held : float, optional
        What terms of the form's own are in units of; the diffusivity unless given.
    """

    context: SolveContext
    terms: Terms
    law: StateDiffusivity
    loads: Floats
    held: float | None = None

    def frozen(self, u: Floats) -> Terms:
        """Return the terms with the diffusivity at u."""
        held = None if self.held is None else self._number
        return replace(self.terms, diffusivity=StateDependentCoefficient(self.law.at, u, held))

    def _number(self, u: Floats, slopes: Floats, points: Floats) -> Floats:
        del slopes, points
        assert self.held is not None
        return np.full(len(u), self.held)

    def state(self, u: Floats) -> State:
        """Return what is left at u."""
        form = self.context.discretized
        stiffness = form.stiffness(self.frozen(u))
        b = self.loads + form.condition_load(stiffness)
        residual = b - stiffness.apply(u)
        border = form.free_constants(stiffness)
        if border is not None:
            excess = np.linalg.solve(
                (border.indicator.T @ border.constant_load).toarray(), border.indicator.T @ residual
            )
            residual = residual - border.constant_load @ excess
        return State(u, stiffness, b, residual, border)

    def lagged(self, state: State) -> tuple[State, SolveReport]:
        """Return the state at the solution with the diffusivity of this one."""
        change, report = self._solved(state.stiffness, state)
        return self.state(state.u + change), report

    def newton(self, state: State) -> tuple[State, SolveReport]:
        """Return the next state of Newton's method: as far along the tangent's solution as the residual falls.

        Raises
        ------
        ConvergenceError
            If it falls nowhere.
        """
        form = self.context.discretized
        held = self.law.at if self.held is None else self._number
        tangent = form.stiffness(
            replace(self.terms, diffusivity=StateDependentCoefficient(self.law.tangent, state.u, held))
        )
        drift = (
            form.advection(StateDependentCoefficient(self.law.drift, state.u)) if self.law.depends_on_value else None
        )
        change, report = self._solved(tangent, state, drift)
        weights = 1 / np.abs(tangent.diagonal)
        before, length, why = _size(state.residual, weights), 1.0, None
        while length >= SHORTEST_STEP:
            try:
                found = self.state(state.u + length * change)
            except InputError as error:  # a is not positive there
                found, why = None, error
            if found is not None and _size(found.residual, weights) <= (1 - LEAST_FALL * length) * before:
                return found, report
            if found is not None and float(np.abs(change).max()) <= 1e-11 * float(np.abs(state.u).max()):
                return found, report  # rounding is all that is left
            length /= 2
        raise ConvergenceError(
            "Newton's method found no step that lessens what is left of the equation"
            + (f", and of longer ones {why}" if why else "")
            + "; use method='lagged', another start (guess), a larger regularization or a smaller spacing.",
            report,
        ) from why

    def _solved(self, tangent: Stiffness, state: State, drift: Operator | None = None) -> tuple[Floats, SolveReport]:
        """Return the solution (n, 1) of the linear system of a step, ``tangent + drift``."""
        context, border = self.context, state.border
        operator: Operator = tangent if border is None else Bordered(tangent, border)
        prepared = context.prepare(operator)
        tolerance = max(context.tolerance, STEP_TOLERANCE)

        def inverse(b: Floats) -> Floats:
            found = prepared.solve(b, tolerance)[0]
            return found if border is None else border.remove_means(found)[0]

        if drift is None:
            found, report = prepared.solve(state.residual, tolerance, progress=context.progress)
            return found if border is None else border.remove_means(found)[0], report
        from scipy.sparse.linalg import LinearOperator, gmres

        carried = drift

        def product(v: Any) -> Any:
            return v.ravel() + inverse(np.asarray(carried.apply(v.reshape(-1, 1)))).ravel()

        start, report = prepared.solve(state.residual, tolerance, progress=context.progress)
        start = start if border is None else border.remove_means(start)[0]
        n = len(start)
        found, info = gmres(
            LinearOperator((n, n), matvec=product), start.ravel(), rtol=100 * tolerance, restart=RESTART, maxiter=2
        )
        return (start if info else found.reshape(-1, 1)), report


def _size(residual: Floats, weights: Any) -> float:
    return float(np.sqrt(np.sum(weights * residual**2)))
