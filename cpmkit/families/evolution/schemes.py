"""One step of each scheme in time.

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

from collections.abc import Callable
from typing import cast

import numpy as np

from cpmkit.families.evolution.run_state import History, Moment, Step
from cpmkit.families.evolution.semidiscrete import SemiDiscrete, ShiftedSolver, largest_eigenvalue
from cpmkit.scene.equations_in_time import Wave
from cpmkit.types import Floats

#: Damping of the shortest waves of the lattice by leapfrog, per time in which a wave crosses a spacing.
LEAPFROG_DAMPING = 0.8

#: A function of the problem, its solver, the moments so far and a step that returns the moment at the end of the step.
Scheme = Callable[[SemiDiscrete, ShiftedSolver, History, Step], Moment]


def backward_euler(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step`` by backward Euler, from the last of the moments ``history``."""
    h = step.length
    right_side = problem.times_mass(history[-1].u) + h * problem.forcing(step.end)
    if problem.reaction is not None:
        right_side += h * problem.reaction_load(history[-1])
    return Moment(solver.solve(h, right_side, extrapolate(history, h)), None, h, time=step.end)


def bdf2(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step`` by BDF2, or two half steps of backward Euler without an earlier moment.

    That is the first step, and any that is more than twice as long as all remembered steps together.
    """
    before, ratio = previous_moment(history, step.length)
    if before is None:
        return half_steps(problem, solver, history, step)
    gh = (1 + ratio) / (1 + 2 * ratio) * step.length
    right_side = problem.times_mass(bdf2_start(history[-1].u, before.u, ratio)) + gh * problem.forcing(step.end)
    if problem.reaction is not None:
        now, past = problem.reaction_load(history[-1]), problem.reaction_load(before)
        right_side += gh * (now + ratio * (now - past))
    return Moment(solver.solve(gh, right_side, extrapolate(history, step.length)), None, step.length)


def crank_nicolson(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step`` by Crank-Nicolson, from the last of the moments ``history``."""
    half, u = 0.5 * step.length, history[-1].u
    solver.tally.operator_applications += u.shape[1]
    right_side = problem.times_mass(u) + half * (problem.rate(u, step.start) + problem.forcing(step.end))
    return Moment(solver.solve(half, right_side, extrapolate(history, step.length)), None, step.length)


def damped_crank_nicolson(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step`` by Crank-Nicolson, or if it is the first by two half steps.

    The half steps are of backward Euler, and have the same matrix as the step of Crank-Nicolson. ``history`` has the
    moments so far.
    """
    if len(history) > 1:
        return crank_nicolson(problem, solver, history, step)
    return half_steps(problem, solver, history, step)


def half_steps(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return the moment at the end of ``step``, by two half steps of backward Euler from the last of ``history``."""
    half, middle = 0.5 * step.length, 0.5 * (step.start + step.end)
    first = backward_euler(problem, solver, history, Step(step.start, middle, half, False))
    second = backward_euler(problem, solver, [*history, first], Step(middle, step.end, half, False))
    return Moment(second.u, None, step.length)


def previous_moment(history: History, length: float) -> tuple[Moment | None, float]:
    """Return the earlier moment that BDF2 uses, and the ratio of the step's ``length`` to the time since then.

    It lies at least half a step back: with a shortened step before a full one the coefficients would be large. None and
    0 if ``history`` has no such moment.
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


def extrapolate(history: History, length: float) -> Floats:
    """Return the polynomial through u of all moments ``history``, extrapolated by ``length``: (n, channels)."""
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
    force = problem.rate(now.u, step.start) + problem.forcing(step.end)
    right_side = problem.times_mass(now.u + h * now.rate) + 0.25 * h**2 * force
    u = solver.solve(0.25 * h**2, right_side, extrapolate(history, h))
    return Moment(u, 2 / h * (u - now.u) - now.rate, h)


def leapfrog(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Return a wave's moment at the end of ``step`` by leapfrog, damped from the second step on.

    From the last moment of ``history`` the rate is advanced, over half of the last step and half of this one, then the
    values. The ``solver`` only counts products.
    """
    now = history[-1]
    assert now.rate is not None
    acceleration = problem.rate(now.u, step.start)
    rate = now.rate + 0.5 * (now.length + step.length) * acceleration
    if now.acceleration is not None:
        # ``-h eps A^2 v0``; the rate of change of -A u0 + b0 is -A v0 including boundary data
        wave = cast("Wave", problem.form.scene.problem)
        largest, dim = largest_eigenvalue(problem, wave.speed), problem.form.scene.surface.dim
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
    right_side = problem.times_mass(u + gh * rate) + gh**2 * problem.forcing(step.end)
    values = solver.solve(gh**2, right_side, extrapolate(history, step.length))
    return Moment(values, (values - u) / gh, step.length)
