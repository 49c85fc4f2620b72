"""Steady problems with fluxes that depend on the solution, ``du/db = j(u)``, by Newton's method on the same tables.

A step replaces the flux by its linearisation at the last solution v, ``du/db = j(v) + j'(v) (u - v)``: a Robin
condition. No closest point is queried again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError, SceneError, place
from cpmkit.families.context import OperatorCache, SolveContext
from cpmkit.solution.record import SolutionRecord

MOST_NEWTON_STEPS = 30
#: Newton's method has converged when u on the boundaries changes by less than this share of its size: linear solves to
#: the default tolerance vary by about as much.
CONVERGED_CHANGE_SHARE = 1e-8


def solve_nonlinear(context: SolveContext, solve_linear: Callable[[SolveContext], SolutionRecord]) -> SolutionRecord:
    """Solve a steady scene with fluxes that depend on the solution, and return the solution.

    Parameters
    ----------
    context : SolveContext
        The context, with the discretised scene.
    solve_linear : callable
        Solves a scene whose conditions are linear.

    Raises
    ------
    SceneError
        If the scene has several channels, or the fluxes do not fix a free constant.
    ResolutionError
        If a flux grows with u faster than the spacing resolves.
    ConvergenceError
        If Newton's method does not converge.
    """
    scene, form = context.scene, context.discretized
    if scene.channels > 1:
        raise SceneError(f"a nonlinear flux takes one channel, the scene has {scene.channels}; solve them one by one.")
    fluxes = form.state_fluxes
    boundary_values = [np.full(len(flux.points), flux.guess) for flux in fluxes]
    applications = iterations = 0
    for step in range(1, MOST_NEWTON_STEPS + 1):
        tangent = form.linearise(boundary_values)
        solution = solve_linear(replace(context, discretized=tangent, cache=OperatorCache(), default_tolerance=False))
        if not all(flux.grows(v) for flux, v in zip(fluxes, boundary_values, strict=True)):
            _check_balance(solution)
        applications += solution.report.operator_applications
        iterations += solution.report.iterations
        before, boundary_values = boundary_values, [flux.read(solution.values) for flux in fluxes]
        now, then = (np.concatenate([np.zeros(0), *values]) for values in (boundary_values, before))
        change, size = (float(np.abs(values).max(initial=0.0)) for values in (now - then, now))
        if step > 1 and change <= CONVERGED_CHANGE_SHARE * size + np.finfo(float).tiny:
            report = replace(
                solution.report,
                iterations=iterations,
                operator_applications=applications,
                reason=f"{solution.report.reason}; Newton's method converged in {step} steps",
            )
            work: Any = solution.work
            work = replace(work, operator_applications=applications)
            seconds = {**solution.seconds, "solve": time.perf_counter() - context.started - solution.seconds["build"]}
            return replace(solution, discretized=form, report=report, work=work, seconds=seconds)
    raise ConvergenceError(
        f"Newton's method did not converge in {MOST_NEWTON_STEPS} steps: u still changes by {change:.2g} on the "
        "boundaries; give a guess nearer to the solution, or check that the flux does not grow with u.",
        solution.report,
    )


def _check_balance(solution: SolutionRecord) -> None:
    """Raise if the data of a solution had to be changed because the fluxes do not fix a free constant.

    Raises
    ------
    SceneError
        In this case, with a point of the piece on which the constant is free.
    """
    for defect in solution.imbalances:
        if defect.of == "data" and defect.relative > defect.explained:
            near = place(defect.near)
            raise SceneError(
                f"Nothing fixes the solution near {near}: the nonlinear flux does not change with u at the values "
                "that Newton's method has, and the data do not balance without it; give another guess, or use Neumann."
            )
