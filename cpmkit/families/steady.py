"""Steady problems: one linear system, A u = b."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from cpmkit.families.context import SolveContext
from cpmkit.families.eigen.resonance import near_resonance, unresolved_waves
from cpmkit.forms.contract import Discretized
from cpmkit.linear.operators import Bordered, LinearSystem
from cpmkit.solution.solution import Solution


def assemble(form: Discretized) -> LinearSystem:
    """Return the linear system A u = b of a steady problem, constants moved out of the kernel where they are free.

    Parameters
    ----------
    form : Discretized
        The discretised scene.
    """
    terms = form.scene.problem.terms()
    stiffness = form.stiffness(terms)
    free = form.free_constants(stiffness)
    operator = stiffness if free is None else Bordered(stiffness, free)
    return LinearSystem(operator, form.load(terms.f) + form.data(stiffness))


def solve_steady(context: SolveContext) -> Solution:
    """Assemble and solve the linear system of a steady problem.

    Raises
    ------
    ResolutionError
        If the spacing is too coarse for waves or a velocity, or gives the operator an eigenvalue of the wrong sign.
    ConvergenceError
        If the solver does not reach the tolerance.
    """
    form, terms = context.discretized, context.scene.problem.terms()
    poor = unresolved_waves(form.spacing, terms)
    form.check()
    system = assemble(form)
    operator, b = system.operator, system.right_side
    wrong, looked = form.indefinite(operator)
    built = time.perf_counter()
    prepared = context.prepare(operator)
    values, report = prepared.solve(b, context.tolerance, progress=context.progress)
    report = replace(report, operator_applications=report.operator_applications + looked)
    work: Any = form.work(operator, report)
    settled = form.settle(operator, b, values)
    if settled.queries:
        work = replace(work, closest_point_queries=work.closest_point_queries + settled.queries)
    poor += near_resonance(context, prepared, settled.values)
    seconds = {"build": built - context.started, "solve": time.perf_counter() - built, **settled.seconds}
    found = form.warnings(settled.missed)
    return Solution(
        form,
        settled.values,
        report,
        work,
        seconds,
        warnings=(*found, *([wrong] if wrong else []), *poor, *settled.warnings),
        defects=settled.defects,
        leaks=settled.leaks,
        balance=settled.balance,
    )
