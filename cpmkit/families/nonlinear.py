"""Nonlinear fluxes ``du/db = j(u)`` by Newton's method, all steps on the same tables.

A step takes ``du/db = j(v) + j'(v) (u - v)``, v the last solution, a Robin condition. The form is asked for its tangent
at v; no closest point is asked for again.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError, SceneError, place
from cpmkit.families.context import Kept, SolveContext
from cpmkit.solution.record import SolutionRecord

#: At most this many steps.
MOST_NEWTON_STEPS = 30
#: Newton's method has converged when u changes by less than this share, on the boundaries: below it a linear solve
#: to the default tolerance may not agree with itself.
CONVERGED_CHANGE_SHARE = 1e-8


def solve_nonlinear(context: SolveContext, solve_linear: Callable[[SolveContext], SolutionRecord]) -> SolutionRecord:
    """Solve a scene with nonlinear fluxes.

    Parameters
    ----------
    context : SolveContext
        With the discretised scene.
    solve_linear : callable
        Solves one whose conditions are linear.

    Raises
    ------
    SceneError
        If the scene has several channels, or a flux fixes no constant that is free.
    ResolutionError
        If a flux grows with u more strongly than the spacing can follow.
    ConvergenceError
        If Newton's method does not settle.
    """
    scene, form = context.scene, context.discretized
    if scene.channels > 1:
        raise SceneError(f"a nonlinear flux takes one channel, the scene has {scene.channels}; solve them one by one.")
    fluxes = form.state_fluxes
    boundary_values = [np.full(len(flux.points), flux.guess) for flux in fluxes]
    applications = iterations = 0
    for step in range(1, MOST_NEWTON_STEPS + 1):
        solution = solve_linear(
            replace(context, discretized=form.linearise(boundary_values), kept=Kept(), by_default=False)
        )
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
                reason=f"{solution.report.reason}; Newton's method settled in {step} steps",
            )
            work: Any = solution.work
            work = replace(work, operator_applications=applications)
            seconds = {**solution.seconds, "solve": time.perf_counter() - context.started - solution.seconds["build"]}
            return replace(solution, discretized=form, report=report, work=work, seconds=seconds)
    raise ConvergenceError(
        f"Newton's method did not settle in {MOST_NEWTON_STEPS} steps: u still changes by {change:.2g} on the "
        "boundaries; give a guess nearer to the solution, or check that the flux does not grow with u.",
        solution.report,
    )


def _check_balance(solution: SolutionRecord) -> None:
    """Refuse to go on from a solution whose data were changed because a flux fixed no constant.

    Raises
    ------
    SceneError
        Naming a point of the piece.
    """
    for one in solution.imbalances:
        if one.of == "data" and one.relative > one.explained:
            near = place(one.near)
            raise SceneError(
                f"Nothing fixes the solution near {near}: the nonlinear flux does not change with u at the values "
                "that Newton's method has, and the data do not balance without it; give another guess, or use Neumann."
            )
