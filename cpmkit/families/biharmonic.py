"""The biharmonic equation c u + Lap^2 u = f, as two equations of second order over the same ghosts.

With ``v = -Lap u`` and K the operator of -Lap, ``K u - v = r`` and ``c u + K v = q``, r and q what the data of u and
of v add. For ``w = v + i s u``, ``s^2 = c``, these are one: ``(K - i s) w = q + i s r``. It has K's size and not its
square's condition number.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.errors import InputError, SceneError
from cpmkit.families.context import SolveContext
from cpmkit.linear.operators import ComplexShift
from cpmkit.linear.report import SolveReport
from cpmkit.protocols import Floats, Sides, Stiffness
from cpmkit.scene.compound_equations import Biharmonic
from cpmkit.scene.equations import Terms
from cpmkit.solution.solution import Solution


@dataclass(frozen=True, eq=False)
class BiharmonicSolution(Solution):
    """The solution of a biharmonic problem, with its Laplacian.

    Attributes
    ----------
    second : (unknowns, channels) float64
        Lap u at the unknowns.
    """

    second: Floats

    def laplacian(self, points: Any, side: Sides = None) -> Floats:
        """Return Lap u; the parameters are those of :meth:`cpmkit.Solution.evaluate`."""
        return replace(self, values=self.second).evaluate(points, side)

    def arrays(self) -> dict[str, Any]:
        """Return the lattice, the nodes, the values and the Laplacian as plain arrays."""
        return {**super().arrays(), "laplacian": self.second}


def solve_biharmonic(context: SolveContext) -> BiharmonicSolution:
    """Solve a biharmonic problem.

    Raises
    ------
    InputError
        If the solver is another than direct and reference.
    SceneError
        If nothing fixes the solution on a piece of the manifold.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    problem, form = context.scene.problem, context.discretized
    assert isinstance(problem, Biharmonic)
    form.require("second Laplacian")
    form.check()
    if problem.c and context.solver_name not in ("direct", "reference"):
        raise InputError(
            f"a biharmonic problem with c takes solver='direct' or 'reference', got {context.solver_name!r}: its "
            "system is complex."
        )
    stiffness = form.stiffness(Terms())
    if not problem.c and form.free_constants(stiffness) is not None:
        raise SceneError(
            "Nothing fixes the solution of the biharmonic problem on a piece of the manifold, where any constant may "
            "be added; give a SimplySupported condition there, or c above zero."
        )
    r, q = form.data(stiffness), form.load(problem.f) + form.data(stiffness, of="laplacian")
    built = time.perf_counter()
    u, v, report = _solve_pair(context, stiffness, problem.c, r, q)
    seconds = {"build": built - context.started, "solve": time.perf_counter() - built}
    work, told = form.work(stiffness, report), form.warnings()
    return BiharmonicSolution(form, u, report, work, seconds, -v, warnings=told)


def _solve_pair(
    context: SolveContext, stiffness: Stiffness, c: float, r: Floats, q: Floats
) -> tuple[Floats, Floats, SolveReport]:
    """Return u and v with ``K u - v = r`` and ``c u + K v = q``, and the report."""
    s = float(np.sqrt(c))
    if s:
        prepared = context.kept.get(("complex", s), context.prepare, ComplexShift(stiffness, s))
        b: Any = q + 1j * s * r
        w, report = prepared.solve(b, context.tolerance, progress=context.progress)
        report = replace(report, operator_applications=2 * report.operator_applications)  # of a real A
        return np.ascontiguousarray(w.imag / s), np.ascontiguousarray(w.real), report
    prepared = context.kept.get(("complex", 0.0), context.prepare, stiffness)
    v, first = prepared.solve(q, context.tolerance, progress=context.progress)
    u, second = prepared.solve(r + v, context.tolerance, progress=context.progress)
    return u, v, _together(first, second)


def _together(first: SolveReport, second: SolveReport) -> SolveReport:
    """Return the report of two solves one after the other."""
    worse = max(first, second, key=lambda one: one.residual)
    return replace(
        worse,
        iterations=first.iterations + second.iterations,
        operator_applications=first.operator_applications + second.operator_applications,
    )
