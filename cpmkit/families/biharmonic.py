"""The biharmonic equation c u + Lap^2 u = f as two equations of second order on the same unknowns.

With ``v = -Lap u``, K the operator of -Lap and M the mass matrix, ``K u - M v = r`` and ``c M u + K v = q``, where r
and q come from the data of u and of v (Ciarlet and Raviart, 1974). For ``w = v + i s u``, ``s^2 = c``, both are the one
complex system ``(K - i s M) w = q + i s r``. It has the size of K, and not the condition number of its square.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.families.context import SolveContext
from cpmkit.forms.contract import Discretized, require
from cpmkit.forms.free_constants import Imbalance, balanced_solution
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.operators import Bordered, ComplexShift
from cpmkit.linear.protocols import Operator, PreparedSolver, Stiffness
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.compound_equations import Biharmonic
from cpmkit.scene.equations import Terms
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Sides

#: The linear solvers that solve complex systems.
COMPLEX_SOLVERS = ("direct", "multigrid", "reference")


@dataclass(frozen=True, eq=False, repr=False)
class BiharmonicRecord(SolutionRecord):
    """The solution of a biharmonic problem, with its Laplacian.

    Attributes
    ----------
    second : (unknowns, channels) float64
        Lap u at the unknowns.
    """

    second: Floats

    def laplacian(self, points: Any, side: Sides = None) -> Floats:
        """Return Lap u at ``points``; parameters and shape as for :meth:`cpmkit.Solution.evaluate`."""
        values: Floats = replace(self, values=self.second).evaluate(points, side)
        return values

    def arrays(self) -> dict[str, Any]:
        """Return the lattice, the nodes, the values and the Laplacian as plain arrays, by name."""
        return {**super().arrays(), "laplacian": self.second}


def solve_biharmonic(context: SolveContext) -> BiharmonicRecord:
    """Assemble and solve the system of a biharmonic problem, and return its solution.

    Where c is zero and a constant is free on a piece of the manifold, the solution has mean zero there.

    Raises
    ------
    InputError
        If c is not zero and the linear solver does not solve complex systems.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    problem, form = context.scene.problem, context.discretized
    assert isinstance(problem, Biharmonic)
    require(form, "second Laplacian")
    form.check(context.solver_name)
    if problem.c and context.solver_name not in COMPLEX_SOLVERS:
        raise InputError(
            f"a biharmonic problem with c takes solver={', '.join(map(repr, COMPLEX_SOLVERS[:-1]))} or "
            f"{COMPLEX_SOLVERS[-1]!r}, got {context.solver_name!r}: its system is complex."
        )
    stiffness = form.stiffness(Terms())
    r = form.condition_load(stiffness)
    q = form.load(problem.f) + form.condition_load(stiffness, of="laplacian")
    built = time.perf_counter()
    solve_pair = _solve_coupled if problem.c else _solve_in_turn
    u, v, report, imbalances = solve_pair(context, stiffness, problem.c, r, q)
    seconds = {"build": built - context.started, "solve": time.perf_counter() - built}
    work = form.work(stiffness, report)
    warnings = (*form.warnings(), *(text for defect in imbalances for text in defect.warnings))
    return BiharmonicRecord(form, u, report, work, seconds, -v, warnings=warnings, imbalances=imbalances)


#: u (n, channels), v (n, channels), the report, and the imbalances: the parts of f for which there is no solution.
_Pair = tuple[Floats, Floats, SolveReport, tuple[Imbalance, ...]]


def _solve_coupled(context: SolveContext, stiffness: Stiffness, c: float, r: Floats, q: Floats) -> _Pair:
    """Solve ``K u - M v = r`` and ``c M u + K v = q`` as one complex system; return u, v and the report.

    ``stiffness`` is K; M is the mass matrix of equations in time, since for large c the consistent mass matrix leaves
    some unknowns undetermined.
    """
    s, mass = float(np.sqrt(c)), context.discretized.mass_in_time
    prepared, constants = context.cache.get(("complex", s), _prepare, context, ComplexShift(stiffness, s, mass))
    b: Any = q + 1j * s * r
    w, report = constants.solve(prepared, b, context.tolerance, progress=context.progress)
    report = replace(report, operator_applications=2 * report.operator_applications)  # products with the real A
    return np.ascontiguousarray(w.imag / s), np.ascontiguousarray(w.real), report, ()


def _solve_in_turn(context: SolveContext, stiffness: Stiffness, c: float, r: Floats, q: Floats) -> _Pair:
    """Solve ``K v = q``, then ``K u = r + M v``, for c = 0; return u, v, the report and the imbalances of f.

    On pieces where a constant is free, u has mean zero.
    """
    del c  # is zero
    form = context.discretized
    operator, (prepared, constants) = context.cache.get(("pair", 0.0), _prepared_laplacian, context, stiffness)
    v, first = constants.solve(prepared, q, context.tolerance, progress=context.progress)
    imbalances: tuple[Imbalance, ...] = ()
    if isinstance(operator, Bordered):
        v, imbalances = balanced_solution(operator, q, v, form)
    u, second = constants.solve(prepared, r + _times_mass(form, v), context.tolerance, progress=context.progress)
    if isinstance(operator, Bordered):
        u, v = _with_mean_of_laplacian(operator, form, u, v)
    return u, v, _combined_report(first, second), imbalances


def _prepared_laplacian(
    context: SolveContext, stiffness: Stiffness
) -> tuple[Operator, tuple[PreparedSolver, ConstantFunctions]]:
    """Return K, bordered on pieces where a constant is free, and its prepared solver with the constant functions."""
    free = context.discretized.free_constants(stiffness)
    operator: Operator = stiffness if free is None else Bordered(stiffness, free)
    return operator, _prepare(context, operator)


def _prepare(context: SolveContext, operator: Operator) -> tuple[PreparedSolver, ConstantFunctions]:
    """Return the prepared solver of systems with ``operator``, and the constant functions taken out of them."""
    return context.prepare(operator), context.constants(operator)


def _with_mean_of_laplacian(operator: Bordered, form: Discretized, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Return u with mean zero on free pieces, and v with the mean there that balances the fluxes of u at the edge.

    ``K v = q`` leaves the mean of v free, and ``K u = r + M v`` has a solution for only one mean, which is computed
    from the imbalance of the second system. A piece is free if no condition or term fixes a constant on it.
    """
    border = operator.border
    u, means = border.remove_means(u)
    indicator = border.indicator.toarray()
    measure = (indicator * _times_mass(form, indicator)).sum(axis=0)
    excess = operator.shift * means * ((indicator * border.constant_load.toarray()).sum(axis=0) / measure)[:, None]
    return u, np.asarray(v - indicator @ excess)


def _times_mass(form: Discretized, u: Floats) -> Floats:
    """Return M u for u (n, k), with the mass matrix M of the form; u itself if the form has none."""
    return u if form.mass is None else form.mass.apply(u)


def _combined_report(first: SolveReport, second: SolveReport) -> SolveReport:
    """Return the report of two successive solves: counts added, all else from the solve with the larger residual."""
    worse = max(first, second, key=lambda report: report.residual)
    return replace(
        worse,
        iterations=first.iterations + second.iterations,
        operator_applications=first.operator_applications + second.operator_applications,
    )
