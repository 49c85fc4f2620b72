"""Solution of equations in time: the loop over the steps, with frames and checkpoints."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from cpmkit.errors import ConvergenceError, ResolutionError
from cpmkit.families.context import SolveContext
from cpmkit.families.evolution.checkpoints import read_checkpoint, write_checkpoint
from cpmkit.families.evolution.run_state import (
    REMEMBERED_MOMENTS,
    Moment,
    RunPlan,
    RunState,
    after_step,
    rate_of_change,
    schedule,
)
from cpmkit.families.evolution.run_warnings import growth_check, run_warnings, wave_energy
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
from cpmkit.forms.contract import Discretized, require_ability
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


def solve_in_time(context: SolveContext) -> EvolvedRecord:
    """Solve an equation in time up to its end, and return the solution there with its frames.

    Raises ResolutionError or SceneError if the scheme would be unstable, the solution grows without a cause, or frames
    exceed the memory. Raises ConvergenceError if a step does not reach the tolerance; the message contains the time.
    Raises InputError if a checkpoint is of another run.
    """
    form = context.discretized
    evolution = cast("Evolution", context.scene.problem).with_scheme("explicit steps" not in form.cannot)
    form.check(context.solver_name)
    if evolution.scheme in ("leapfrog", "newmark"):
        require_ability(form, "explicit steps" if evolution.scheme == "leapfrog" else "undamped steps")
    problem = semidiscrete(form, evolution)
    check_frames_fit(len(evolution.frame_times), form.size, form.scene.channels)
    steps = schedule(evolution.until, evolution.step, evolution.frame_times, evolution.t0)
    t0, rate, initial = evolution.t0, None, cast("Heat | ReactionDiffusion | Wave", evolution).initial
    if isinstance(evolution, Wave):
        rate = form.interpolate(evolution.initial_rate, "the initial rate", t0, step=steps[0].length)
    u = form.interpolate(initial, "the initial data", t0, in_range=rate is None)
    plan = RunPlan(problem, evolution, steps, Moment(u, rate, 0.0, time=t0))
    solver = ShiftedSolver(problem, context)
    built = time.perf_counter()
    state = _run(context, plan, solver)
    return _solution_at_end(context, plan, state, solver.tally, built)


def semidiscrete(form: Discretized, evolution: Evolution) -> SemiDiscrete:
    """Return an equation in time discretised in space, with one operator for all channels whose terms are equal."""
    groups_of_channels = [(tuple(range(form.scene.channels)), evolution.terms())]
    reaction: Any = None
    if isinstance(evolution, ReactionDiffusion):
        groups_of_channels, reaction = evolution.terms_of_channels(form.scene.channels), evolution.reaction
    groups = tuple(ChannelGroup(channels, terms, form.stiffness(terms)) for channels, terms in groups_of_channels)
    return SemiDiscrete(form, groups, evolution.terms().f, reaction)


def _run(context: SolveContext, plan: RunPlan, solver: ShiftedSolver) -> RunState:
    """Take all steps, or steps up to rest, from the start or a checkpoint, write checkpoints; return the last state."""
    target, total, evolution = context.checkpointing, len(plan.steps), plan.evolution
    scheme = SCHEMES[evolution.scheme]
    if scheme is damped_crank_nicolson and getattr(evolution, "start", "") == "plain":
        scheme = crank_nicolson
    check_growth = growth_check(plan)
    state = RunState(0, (plan.start,))
    if plan.start.time in evolution.frame_times:
        state = state.with_frame(plan.start.u, wave_energy(plan.problem, plan.start))
    if target.resume is not None:
        state, tally = read_checkpoint(target.resume, plan)
        solver.tally.add(tally)
    ended = _has_ended(plan, state)
    while not ended:
        state = _take_step(state, plan, solver, scheme, check_growth)
        context.progress("steps", state.done / total)
        ended = _has_ended(plan, state)
        if target.checkpoint is not None and (ended or state.done % target.checkpoint_every == 0):
            write_checkpoint(target.checkpoint, plan, state, solver.tally)
    return state


def _has_ended(plan: RunPlan, state: RunState) -> bool:
    """Return True after the last step, or if the run has come to rest and is to end then."""
    rest = plan.evolution.rest
    at_rest = rest is not None and rate_of_change(plan.problem.form, plan.start, state.history) < rest
    return at_rest or state.done == len(plan.steps)


def _take_step(
    state: RunState, plan: RunPlan, solver: ShiftedSolver, scheme: Scheme, check_growth: Callable[..., None] | None
) -> RunState:
    """Return the state after one more step by ``scheme``.

    Raises ConvergenceError, with the time, if the linear solver does not reach the tolerance. Raises ResolutionError if
    the solution is not finite, or fails ``check_growth`` (None: no check).
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
    if check_growth is not None:
        check_growth(moment.u, step.end)
    moment = after_step(plan.problem.form, plan.evolution, replace(moment, time=step.end))
    history = (*state.history, moment)[-REMEMBERED_MOMENTS:]
    later = replace(state, done=state.done + 1, history=history)
    return later.with_frame(moment.u, wave_energy(plan.problem, moment)) if step.is_frame else later


def _solution_at_end(
    context: SolveContext, plan: RunPlan, state: RunState, tally: SolveTally, built: float
) -> EvolvedRecord:
    """Return the solution at the end of a run, with frames and warnings; ``built`` is perf_counter() before the run."""
    u, total, end = state.history[-1].u, state.done, state.history[-1].time
    reason = (
        f"relative residual {tally.residual:.2e} at most in {total} steps with {tally.iterations} iterations, "
        f"tolerance {context.tolerance:.2e}"
    )
    report = context.report(True, tally.iterations, tally.operator_applications, tally.residual, reason)
    report = replace(report, solver=tally.solver or report.solver)  # the solver of the last step
    form = context.discretized
    common = context.common_fields(plan.problem.stiffness, report, built)
    warnings = (*form.warnings(), *run_warnings(plan, state.history))
    energy = wave_energy(plan.problem, state.history[-1])
    last = EvolvedRecord(values=u, warnings=warnings, time=end, steps=total, energy=energy, **common)
    # A run that came to rest has fewer frames than requested.
    step_number = {plan.start.time: 0, **{step.end: number for number, step in enumerate(plan.steps, 1)}}
    energies = state.energies or (None,) * len(state.frames)
    frames = tuple(
        replace(last, values=values, time=when, steps=step_number[when], energy=energy)
        for when, values, energy in zip(plan.evolution.frame_times, state.frames, energies, strict=False)
    )
    return replace(last, frames=frames)
