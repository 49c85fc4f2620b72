"""Equations in time: one step of each scheme, and the loop over the steps, with frames and checkpoints.

With M u' = -A u + b(t), h the step and w the ratio of the step to the one before (Hairer, Norsett and Wanner 1993,
section III.5 for variable steps):

backward Euler: ``(M + h A) u1 = M u0 + h b1``;
BDF2: ``(M + g h A) u1 = M [(1 + w)^2 u0 - w^2 u_1] / (1 + 2 w) + g h b1`` with ``g = (1 + w) / (1 + 2 w)``, after a
first step of two half steps of backward Euler, whose error is half that of one whole step;
a reaction r, which is explicit: backward Euler adds ``h r0``, BDF2 ``g h [(1 + w) r0 - w r_1]``;
Crank-Nicolson: ``(M + h/2 A) u1 = M u0 + h/2 (-A u0 + b0 + b1)``.

For waves, M u'' = -A u + b(t):

Newmark's average acceleration, with v for u': ``(M + h^2/4 A) u1 = M (u0 + h v0) + h^2/4 (-A u0 + b0 + b1)``,
``v1 = 2 (u1 - u0) / h - v0``. It conserves the energy ``v'Mv/2 + u'Au/2`` where A is symmetric and b zero. No
acceleration is stored, as M may be singular.
Leapfrog, M being the identity: ``v1 = v0 + h (-A u0 + b0)``, ``u1 = u0 + h v1``, the rate v half a step before u. It is
damped: ``v1 -= h eps A^2 v0``, with eps so small that the damping is of third order in the spacing, and so large that
waves of a few spacings decay, which grow where A has complex eigenvalues
(:func:`cpmkit.forms.collocation.layout_checks.check_waves`).
The implicit scheme is BDF2 for u' = v, M v' = -A u + b: ``(M + (g h)^2 A) u1 = ...``, v eliminated.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from cpmkit.errors import ConvergenceError, ResolutionError
from cpmkit.families.context import SolveContext
from cpmkit.families.evolution.checkpoints import read_checkpoint, write_checkpoint
from cpmkit.families.evolution.run_warnings import growth_check, run_warnings, wave_energy
from cpmkit.families.evolution.semidiscrete import (
    REMEMBERED_MOMENTS,
    ChannelGroup,
    History,
    Moment,
    RunPlan,
    RunState,
    SemiDiscrete,
    ShiftedSolver,
    SolveTally,
    Step,
    apply_after_step,
    largest_lattice_eigenvalue,
    rate_of_change,
    schedule,
)
from cpmkit.forms.contract import Discretized, require_ability
from cpmkit.runtime.memory import available_bytes
from cpmkit.scene.compound_equations import ReactionDiffusion
from cpmkit.scene.equations_in_time import Evolution, Heat, Wave
from cpmkit.solution.frames import EvolvedRecord
from cpmkit.types import Floats

#: Damping of the shortest waves of the lattice by leapfrog, per time in which a wave crosses a spacing.
LEAPFROG_DAMPING = 0.8


def backward_euler(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step`` by backward Euler, from the last of the moments ``history``."""
    h = step.length
    right_side = problem.apply_mass(history[-1].u) + h * problem.forcing(step.end)
    if problem.reaction is not None:
        right_side += h * problem.reaction_load(history[-1])
    return Moment(solver.solve(h, right_side, extrapolate_in_time(history, h)), None, h, time=step.end)


def bdf2(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step`` by BDF2, or two half steps of backward Euler without an earlier moment.

    That is the first step, and any that is more than twice as long as all remembered steps together.
    """
    before, ratio = previous_moment(history, step.length)
    if before is None:
        return euler_half_steps(problem, solver, history, step)
    gh = (1 + ratio) / (1 + 2 * ratio) * step.length
    right_side = problem.apply_mass(bdf2_start(history[-1].u, before.u, ratio)) + gh * problem.forcing(step.end)
    if problem.reaction is not None:
        now, past = problem.reaction_load(history[-1]), problem.reaction_load(before)
        right_side += gh * (now + ratio * (now - past))
    return Moment(solver.solve(gh, right_side, extrapolate_in_time(history, step.length)), None, step.length)


def crank_nicolson(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step`` by Crank-Nicolson, from the last of the moments ``history``.

    With a smooth start the first step is two half steps of backward Euler, with the same matrix.
    """
    if len(history) == 1 and getattr(problem.form.scene.problem, "start", "") == "smooth":
        return euler_half_steps(problem, solver, history, step)
    half, u = 0.5 * step.length, history[-1].u
    solver.tally.operator_applications += u.shape[1]
    right_side = problem.apply_mass(u) + half * (problem.net_forcing(u, step.start) + problem.forcing(step.end))
    return Moment(solver.solve(half, right_side, extrapolate_in_time(history, step.length)), None, step.length)


def euler_half_steps(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step`` by two half steps of backward Euler, from the last of ``history``."""
    half, middle = 0.5 * step.length, 0.5 * (step.start + step.end)
    first = backward_euler(problem, solver, history, Step(step.start, middle, half, False))
    second = backward_euler(problem, solver, [*history, first], Step(middle, step.end, half, False))
    return Moment(second.u, None, step.length)


def previous_moment(history: History, length: float) -> tuple[Moment | None, float]:
    """Return the earlier moment that BDF2 uses, and the ratio of the step's ``length`` to the time since then.

    The moment lies at least half a step back, since coefficients would be large if a full step followed a short one.
    None and 0 if ``history`` has no such moment.
    """
    back = 0.0
    for k in range(len(history) - 1, 0, -1):
        back += history[k].length
        if back >= 0.5 * length:
            return history[k - 1], length / back
    return None, 0.0


def bdf2_start(now: Floats, before: Floats, ratio: float) -> Floats:
    """Return the combination (n, channels) of earlier values in BDF2, ``[(1 + w)^2 now - w^2 before] / (1 + 2 w)``.

    w is ``ratio``, the ratio of the step to the time from ``before`` to ``now``, both (n, channels).
    """
    return np.asarray(((1 + ratio) ** 2 * now - ratio**2 * before) / (1 + 2 * ratio))


def extrapolate_in_time(history: History, length: float) -> Floats:
    """Return u (n, channels) a time ``length`` after the last of ``history``, by the polynomial in time through all."""
    times = -np.cumsum([0.0, *(moment.length for moment in history[:0:-1])])
    values = np.zeros_like(history[-1].u)
    for k, moment in enumerate(reversed(history)):
        others = np.delete(times, k)
        values += np.prod((length - others) / (times[k] - others)) * moment.u
    return values


def newmark(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return a wave's moment, u and rate, at the end of ``step`` by Newmark's method from the last of ``history``."""
    now, h = history[-1], step.length
    assert now.rate is not None
    solver.tally.operator_applications += now.u.shape[1]
    force = problem.net_forcing(now.u, step.start) + problem.forcing(step.end)
    right_side = problem.apply_mass(now.u + h * now.rate) + 0.25 * h**2 * force
    u = solver.solve(0.25 * h**2, right_side, extrapolate_in_time(history, h))
    return Moment(u, 2 / h * (u - now.u) - now.rate, h)


def leapfrog(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return a wave's moment at the end of ``step`` by leapfrog, damped from the second step on.

    From the last moment of ``history`` the rate is advanced, over half of the last step and half of this one, then the
    values. The ``solver`` only counts products.
    """
    now = history[-1]
    assert now.rate is not None
    acceleration = problem.net_forcing(now.u, step.start)
    rate = now.rate + 0.5 * (now.length + step.length) * acceleration
    if now.acceleration is not None:
        # ``-h eps A^2 v0``; the rate of change of -A u0 + b0 is -A v0 including boundary data
        wave = cast("Wave", problem.form.scene.problem)
        largest, dim = largest_lattice_eigenvalue(problem, wave.speed), problem.form.scene.surface.dim
        strength = LEAPFROG_DAMPING * step.length * np.sqrt(largest / (4 * dim))
        jerk = (acceleration - now.acceleration) / now.length
        rate += strength / largest**2 * problem.stiffness.apply(jerk)
    solver.tally.operator_applications += (1 if now.acceleration is None else 2) * now.u.shape[1]
    return Moment(now.u + step.length * rate, rate, step.length, acceleration)


def implicit_wave(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return a wave's moment at the end of ``step`` by BDF2, or by backward Euler without an earlier moment."""
    now = history[-1]
    before, ratio = previous_moment(history, step.length)
    assert now.rate is not None
    if before is None:
        gh, u, rate = step.length, now.u, now.rate
    else:
        assert before.rate is not None
        gh = (1 + ratio) / (1 + 2 * ratio) * step.length
        u, rate = bdf2_start(now.u, before.u, ratio), bdf2_start(now.rate, before.rate, ratio)
    right_side = problem.apply_mass(u + gh * rate) + gh**2 * problem.forcing(step.end)
    values = solver.solve(gh**2, right_side, extrapolate_in_time(history, step.length))
    return Moment(values, (values - u) / gh, step.length)


#: A function of the problem, its solver, the moments so far and a step that returns the moment at the end of the step.
Scheme = Callable[[SemiDiscrete, ShiftedSolver, History, Step], Moment]
SCHEMES: dict[str, Scheme] = {
    "backward-euler": backward_euler,
    "bdf2": bdf2,
    "crank-nicolson": crank_nicolson,
    "leapfrog": leapfrog,
    "implicit": implicit_wave,
    "newmark": newmark,
    "sbdf2": bdf2,
    "euler": backward_euler,
}


def solve_in_time(context: SolveContext) -> EvolvedRecord:
    """Solve an equation in time up to its end, or to rest, and return the solution there with its frames.

    Raises SceneError if the form lacks the scheme; InputError or ResolutionError if that would be unstable;
    ResolutionError if the solution grows without a cause or frames exceed the memory. Raises ConvergenceError if a step
    does not reach the tolerance; the message contains the time. Raises InputError as the checkpoint's functions do.
    """
    form = context.discretized
    evolution = cast("Evolution", context.scene.problem).with_scheme("explicit steps" not in form.cannot)
    form.check(context.solver_name)
    if evolution.scheme in ("leapfrog", "newmark"):
        require_ability(form, "explicit steps" if evolution.scheme == "leapfrog" else "undamped steps")
    problem = build_semidiscrete(form, evolution)
    _check_frames_fit(len(evolution.frame_times), form.size, form.scene.channels)
    steps = schedule(evolution.until, evolution.step, evolution.frame_times, evolution.t0)
    t0, rate, initial = evolution.t0, None, cast("Heat | ReactionDiffusion | Wave", evolution).initial
    if isinstance(evolution, Wave):
        rate = form.interpolate(evolution.initial_rate, "the initial rate", t0, step=steps[0].length)
    u = form.interpolate(initial, "the initial data", t0, in_range=rate is None)
    plan = RunPlan(problem, evolution, steps, Moment(u, rate, 0.0, time=t0))
    solver = ShiftedSolver(problem, context)
    built = time.perf_counter()
    state = _run_steps(context, plan, solver)
    return _solution_at_end(context, plan, state, solver.tally, built)


def _check_frames_fit(frames: int, unknowns: int, channels: int) -> None:
    """Check before the first time step that the memory can hold the solutions (unknowns, channels) of all ``frames``.

    ``frames`` is their number. Raises ResolutionError if it cannot, with the number of frames that fit.
    """
    frame_bytes, available = 2 * 8 * unknowns * channels, available_bytes()  # two copies while they are saved
    if frames * frame_bytes > available:
        raise ResolutionError(
            f"{frames} frames of {unknowns} unknowns need {frames * frame_bytes / 2**30:.3g} GiB, and "
            f"{available / 2**30:.3g} GiB are available; ask for {available // (2 * frame_bytes)} frames or less."
        )


def build_semidiscrete(form: Discretized, evolution: Evolution) -> SemiDiscrete:
    """Return an equation in time discretised in space, with one operator for all channels whose terms are equal."""
    groups_of_channels = [(tuple(range(form.scene.channels)), evolution.terms())]
    reaction: Any = None
    if isinstance(evolution, ReactionDiffusion):
        groups_of_channels, reaction = evolution.terms_of_channels(form.scene.channels), evolution.reaction
    groups = tuple(ChannelGroup(channels, terms, form.stiffness(terms)) for channels, terms in groups_of_channels)
    return SemiDiscrete(form, groups, evolution.terms().f, reaction)


def _run_steps(context: SolveContext, plan: RunPlan, solver: ShiftedSolver) -> RunState:
    """Take all steps, or those up to rest, from the start or a checkpoint; write checkpoints; return the last state."""
    target, total, evolution = context.checkpointing, len(plan.steps), plan.evolution
    scheme = SCHEMES[evolution.scheme]
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
    moment = apply_after_step(plan.problem.form, plan.evolution, replace(moment, time=step.end))
    history = (*state.history, moment)[-REMEMBERED_MOMENTS:]
    later = replace(state, done=state.done + 1, history=history)
    return later.with_frame(moment.u, wave_energy(plan.problem, moment)) if step.is_frame else later


def _solution_at_end(
    context: SolveContext, plan: RunPlan, state: RunState, tally: SolveTally, built: float
) -> EvolvedRecord:
    """Return the solution at the last step, with frames and warnings; ``built`` is perf_counter() before the steps."""
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
