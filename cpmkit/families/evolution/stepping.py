"""Solution of equations in time: the loop over the steps, with frames and checkpoints."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError, ResolutionError
from cpmkit.families.context import SolveContext
from cpmkit.families.evolution.checkpoints import read_checkpoint, write_checkpoint
from cpmkit.families.evolution.run_state import RunPlan, RunState, after_step, rate_of_change, rest_warning
from cpmkit.families.evolution.run_warnings import (
    GrowthBound,
    growth_bound,
    heat_drift_warning,
    run_warnings,
    wave_energy,
)
from cpmkit.families.evolution.schedule import REMEMBERED_MOMENTS, Moment, Step, schedule
from cpmkit.families.evolution.schemes import (
    Scheme,
    backward_euler,
    bdf2,
    crank_nicolson,
    damped_crank_nicolson,
    implicit_wave,
    leapfrog,
    newmark,
)
from cpmkit.families.evolution.semidiscrete import ChannelGroup, SemiDiscrete, ShiftedSolver, SolveTally
from cpmkit.forms.contract import Discretized, require
from cpmkit.scene.compound_equations import ReactionDiffusion
from cpmkit.scene.equations_in_time import Evolution, Heat, Wave
from cpmkit.solution.frames import EvolvedRecord, check_frames_fit

SCHEMES: dict[str, Scheme] = {
    "backward-euler": backward_euler,
    "bdf2": bdf2,
    "crank-nicolson": damped_crank_nicolson,
    "leapfrog": leapfrog,
    "implicit": implicit_wave,
    "newmark": newmark,
    "sbdf2": bdf2,
    "euler": backward_euler,
}
#: The ability of a form that each scheme needs.
NEEDED_ABILITIES = {"leapfrog": "explicit steps", "newmark": "undamped steps"}


def solve_in_time(context: SolveContext) -> EvolvedRecord:
    """Solve an equation in time up to its end, and return the solution there with its frames.

    Raises
    ------
    ResolutionError, SceneError
        If the scheme would be unstable, or the solution grows without a cause.
    ConvergenceError
        If a step does not reach the tolerance; the message contains the time.
    InputError
        If a checkpoint is of another run.
    """
    form, target = context.discretized, context.scene.problem
    assert isinstance(target, Evolution)
    evolution = target.with_scheme("explicit steps" not in form.cannot)
    form.check(context.solver_name)
    if evolution.scheme in NEEDED_ABILITIES:
        require(form, NEEDED_ABILITIES[evolution.scheme])
    problem = semidiscrete(form, evolution)
    check_frames_fit(len(evolution.frame_times), form.size, form.scene.channels)
    steps = schedule(evolution.until, evolution.step, evolution.frame_times, evolution.t0)
    plan = RunPlan(problem, evolution, steps, _start_moment(form, evolution, steps[0]))
    solver = ShiftedSolver(problem, context)
    built = time.perf_counter()
    state = _run(context, plan, solver)
    seconds = {"build": built - context.started, "solve": time.perf_counter() - built}
    return _solution_at_end(context, plan, state, solver.tally, seconds)


def semidiscrete(form: Discretized, evolution: Evolution) -> SemiDiscrete:
    """Return an equation in time discretised in space, with one operator for all channels whose terms are equal."""
    groups_of_channels = [(tuple(range(form.scene.channels)), evolution.terms())]
    reaction: Any = None
    if isinstance(evolution, ReactionDiffusion):
        groups_of_channels, reaction = evolution.terms_of_channels(form.scene.channels), evolution.reaction
    groups = tuple(ChannelGroup(channels, terms, form.stiffness(terms)) for channels, terms in groups_of_channels)
    return SemiDiscrete(form, groups, evolution.terms().f, reaction)


def _start_moment(form: Discretized, evolution: Evolution, first: Step) -> Moment:
    """Return the moment at the start, from the initial data; ``first`` is the first step."""
    t0 = evolution.t0
    if not isinstance(evolution, Wave):
        assert isinstance(evolution, (Heat, ReactionDiffusion))
        u = form.interpolate(evolution.initial, "the initial data", t0, in_range=True)
        return Moment(u, None, 0.0, time=t0)
    u = form.interpolate(evolution.initial, "the initial data", t0)
    rate = form.interpolate(evolution.initial_rate, "the initial rate", t0, step=first.length)
    return Moment(u, rate, 0.0, time=t0)


def _run(context: SolveContext, plan: RunPlan, solver: ShiftedSolver) -> RunState:
    """Take all steps, from the start or from a checkpoint, and return the state at the end."""
    target, total, scheme = context.checkpointing, len(plan.steps), scheme_of(plan.evolution)
    growth = growth_bound(plan.problem, context.scene, plan.start)
    state = RunState(0, (plan.start,))
    if plan.start.time in plan.evolution.frame_times:
        state = state.with_frame(plan.start.u, wave_energy(plan.problem, plan.start, plan.start.time))
    if target.resume is not None:
        state, tally = read_checkpoint(target.resume, plan)
        solver.tally.add(tally)
    at_rest = _is_at_rest(plan, state)
    while state.done < total and not at_rest:
        state = _take_step(state, plan, solver, scheme, growth)
        context.progress("steps", state.done / total)
        at_rest = _is_at_rest(plan, state)
        ended = at_rest or state.done == total
        if target.checkpoint is not None and (ended or state.done % target.checkpoint_every == 0):
            write_checkpoint(target.checkpoint, plan, state, solver.tally)
    return state


def _is_at_rest(plan: RunPlan, state: RunState) -> bool:
    """Return True if the run has come to rest and is to end then."""
    rest = plan.evolution.rest
    return rest is not None and rate_of_change(plan.problem.form, plan.start, state.history) < rest


def scheme_of(evolution: Evolution) -> Scheme:
    """Return the function that takes a step of the equation's scheme."""
    plain = isinstance(evolution, Heat) and evolution.start == "plain"
    return crank_nicolson if plain and evolution.scheme == "crank-nicolson" else SCHEMES[evolution.scheme]


def _take_step(
    state: RunState, plan: RunPlan, solver: ShiftedSolver, scheme: Scheme, growth: GrowthBound | None
) -> RunState:
    """Return the state after one more step.

    Raises
    ------
    ConvergenceError
        If the linear solver does not reach the tolerance.
    ResolutionError
        If the solution is not finite, or exceeds the bound ``growth``.
    """
    step = plan.steps[state.done]
    try:
        moment = scheme(plan.problem, solver, state.history, step)
    except ConvergenceError as error:
        where = f"At time {step.end:g}, step {state.done + 1} of {len(plan.steps)}: "
        raise ConvergenceError(f"{where}{error}", error.report) from error
    if not np.isfinite(moment.u).all():
        raise ResolutionError(
            f"The solution ceased to be finite at time {step.end:g}, step {state.done + 1} of {len(plan.steps)}; use a "
            f"shorter step{'' if plan.problem.reaction else ', or another scheme'}."
        )
    if growth is not None:
        growth.check(moment.u, step.end)
    moment = after_step(plan.problem.form, plan.evolution, replace(moment, time=step.end))
    history = (*state.history, moment)[-REMEMBERED_MOMENTS:]
    later = replace(state, done=state.done + 1, history=history)
    return later.with_frame(moment.u, wave_energy(plan.problem, moment, step.end)) if step.is_frame else later


def _solution_at_end(
    context: SolveContext, plan: RunPlan, state: RunState, tally: SolveTally, seconds: Mapping[str, float]
) -> EvolvedRecord:
    """Return the solution at the end of the run, with its frames."""
    u, total, end = state.history[-1].u, state.done, state.history[-1].time
    reason = (
        f"relative residual {tally.residual:.2e} at most in {total} steps with {tally.iterations} iterations, "
        f"{context.tolerance:.2e} asked for"
    )
    report = context.report(True, tally.iterations, tally.operator_applications, tally.residual, reason)
    report = replace(report, solver=tally.solver or report.solver)  # the solver of the last step
    form = context.discretized
    work = form.work(plan.problem.stiffness, report)
    warnings = (
        *form.warnings(),
        *run_warnings(plan.problem, plan.evolution, plan.start, state.history),
        *heat_drift_warning(plan.problem, context.scene, plan.start.u, u, end - plan.start.time),
        *rest_warning(form, plan.evolution, plan.start, state.history),
    )
    energy = wave_energy(plan.problem, state.history[-1], end)
    last = EvolvedRecord(form, u, report, work, seconds, warnings=warnings, time=end, steps=total, energy=energy)
    # A run that came to rest has fewer frames than requested.
    step_number = {plan.start.time: 0, **{step.end: number for number, step in enumerate(plan.steps, 1)}}
    energies = state.energies or (None,) * len(state.frames)
    frames = tuple(
        replace(last, values=values, time=when, steps=step_number[when], energy=energy)
        for when, values, energy in zip(plan.evolution.frame_times, state.frames, energies, strict=False)
    )
    return replace(last, frames=frames)
