"""Nonlinear fluxes ``du/db = j(u)`` by Newton's method: every step is a linear scene with Robin conditions."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.conditions import Condition, Robin
from cpmkit.discretization import Discretization, discretize
from cpmkit.errors import ConvergenceError, InputError, SceneError
from cpmkit.job import Job
from cpmkit.protocols import SIDES, Floats, Side
from cpmkit.scene import Boundary, Scene
from cpmkit.solution import Solution
from cpmkit.special_conditions import NonlinearFlux

#: At most this many steps.
STEPS = 30
#: Newton's method has converged when u changes by less than this share, on the boundaries: below it a linear solve
#: to the default tolerance may not agree with itself.
CHANGE = 1e-8
#: Step of the differences that replace a slope, as a share of the value.
DIFFERENCE = 1e-6

#: What u is on a boundary, from the last step: a function of points.
Read = Callable[[Floats], Floats]


def _inside(scene: Scene) -> list[tuple[int, Side]]:
    """Return the boundaries, by number, and sides with a nonlinear flux."""
    return [
        (number, side)
        for number, boundary in enumerate(scene.boundaries)
        for side in SIDES
        if isinstance(boundary.condition(side), NonlinearFlux)
    ]


def solve_nonlinear(job: Job, solve_linear: Callable[[Job], Solution]) -> Solution:
    """Solve a scene with nonlinear fluxes.

    Parameters
    ----------
    job : Job
        With the scene and the lattice.
    solve_linear : callable
        Solves a job whose conditions are linear.

    Raises
    ------
    SceneError
        If the equation is not steady or the scene has several channels.
    ConvergenceError
        If Newton's method does not settle.
    """
    scene = job.scene
    if scene.problem.family != "steady":
        raise SceneError(f"a nonlinear flux needs a steady equation, got {scene.problem.kind}; use Robin instead.")
    if scene.channels > 1:
        raise SceneError(f"a nonlinear flux takes one channel, the scene has {scene.channels}; solve them one by one.")
    solution: Solution | None = None
    seen: Floats | None = None
    applications = iterations = 0
    for step in range(1, STEPS + 1):
        linear = linearized(scene, solution)
        solution = solve_linear(replace(job, scene=linear, tables=_tables(job, linear)))
        applications += solution.report.operator_applications
        iterations += solution.report.iterations
        before, seen = seen, _on_boundaries(solution)
        change = np.inf if before is None else float(np.abs(seen - before).max(initial=0.0))
        if change <= CHANGE * float(np.abs(seen).max(initial=0.0)) + np.finfo(float).tiny:
            report = replace(
                solution.report,
                iterations=iterations,
                operator_applications=applications,
                reason=f"{solution.report.reason}; Newton's method settled in {step} steps",
            )
            work = replace(solution.work, operator_applications=applications)
            seconds = {**solution.seconds, "solve": time.perf_counter() - job.started - solution.seconds["build"]}
            return replace(solution, scene=scene, report=report, work=work, seconds=seconds)
    assert solution is not None
    raise ConvergenceError(
        f"Newton's method did not settle in {STEPS} steps: u still changes by {change:.2g} on the boundaries; give a "
        "guess nearer to the solution, or check that the flux does not grow with u.",
        solution.report,
    )


def _tables(job: Job, scene: Scene) -> Discretization:
    """Return the tables of a linearised scene on the job's lattice."""
    return discretize(scene, **job.tables.layout.options)


def linearized(scene: Scene, solution: Solution | None) -> Scene:
    """Return the scene with ``du/db = j(v) + j'(v) (u - v)`` in place of the nonlinear fluxes, v the last solution."""
    boundaries = list(scene.boundaries)
    for number, side in _inside(scene):
        boundary, both = boundaries[number], scene.boundaries[number]
        conditions: dict[str, Any] = {one: boundary.condition(one) for one in SIDES}
        conditions[side] = _robin(both.condition(side), _reader(solution, both.name, side))
        boundaries[number] = Boundary(both.name, both.source, left_of=both.left_of, **conditions)
    edge = scene.edge
    if isinstance(edge, Mapping):
        edge = {loop: _on_edge(condition, solution) for loop, condition in edge.items()}
    else:
        edge = _on_edge(edge, solution)
    return replace(scene, boundaries=boundaries, edge=edge)


def _on_edge(condition: Condition, solution: Solution | None) -> Condition:
    if not isinstance(condition, NonlinearFlux):
        return condition
    return _robin(condition, None if solution is None else solution.evaluate)


def _reader(solution: Solution | None, name: str, side: Side) -> Read | None:
    return None if solution is None else lambda points: solution.evaluate(points, side={name: side})


def _robin(condition: Condition, read: Read | None) -> Robin:
    assert isinstance(condition, NonlinearFlux)

    def value(points: Floats) -> Floats:
        return np.full(len(points), float(condition.guess)) if read is None else read(points)

    def beta(points: Floats) -> Floats:
        return -_slope(condition, value(points), points)

    def gamma(points: Floats) -> Floats:
        v = value(points)
        return _flux(condition.flux, v, points) - _slope(condition, v, points) * v

    return Robin(1.0, beta, gamma, order=condition.order)


def _slope(condition: NonlinearFlux, values: Floats, points: Floats) -> Floats:
    if condition.slope is not None:
        return _flux(condition.slope, values, points)
    step = DIFFERENCE * np.maximum(np.abs(values), 1.0)
    ahead, behind = (_flux(condition.flux, values + sign * step, points) for sign in (1, -1))
    return np.asarray((ahead - behind) / (2 * step))


def _flux(function: Callable[..., object], values: Floats, points: Floats) -> Floats:
    """Return a flux or its slope (n,), of values alone or of values and points.

    Raises
    ------
    InputError
        If it returns anything but (n,) finite numbers.
    """
    parameters = inspect.signature(function).parameters.values()
    several = sum(one.default is one.empty for one in parameters) > 1
    found = np.asarray(function(values, points) if several else function(values), dtype=np.float64)
    found = np.broadcast_to(found, values.shape) if found.ndim == 0 else found
    if found.shape != values.shape or not np.isfinite(found).all():
        raise InputError(
            f"a nonlinear flux must return {len(values)} finite numbers for as many values, got shape {found.shape}"
            f"{'' if np.isfinite(found).all() else ' with NaN or infinity'}."
        )
    return found


def _on_boundaries(solution: Solution) -> Floats:
    """Return u at the feet of boundaries with a nonlinear flux, from that side, and at those of nodes past the edge."""
    layout, scene = solution.tables.layout, solution.scene
    read = []
    for boundary, frame in zip(scene.boundaries, layout.sight.frames, strict=True):
        for side in SIDES:
            if callable(boundary.condition(side).beta):
                read.append(solution.evaluate(layout.lattice.to_scene(frame.foot), side={boundary.name: side}))
    edge = layout.band.feet.points[layout.band.feet.edge >= 0]
    read.append(solution.evaluate(layout.lattice.to_scene(edge)))
    return np.concatenate(read)
