"""One step of each scheme in time.

With M u' = -A u + b(t), h the step and w the ratio of the step to the one before (Hairer, Norsett and Wanner 1993,
section III.5 for variable steps):

backward Euler: ``(M + h A) u1 = M u0 + h b1``;
BDF2: ``(M + g h A) u1 = M [(1 + w)^2 u0 - w^2 u_1] / (1 + 2 w) + g h b1`` with ``g = (1 + w) / (1 + 2 w)``, after a
first step of two half steps of backward Euler, which leave half of the error of one whole step;
a reaction r, which is explicit: backward Euler adds ``h r0``, BDF2 ``g h [(1 + w) r0 - w r_1]``;
Crank-Nicolson: ``(M + h/2 A) u1 = M u0 + h/2 (-A u0 + b0 + b1)``.

For waves see :mod:`cpmkit.families.evolution.wave_schemes`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.families.evolution.moment import History, Moment
from cpmkit.families.evolution.schedule import Step
from cpmkit.families.evolution.semidiscrete import SemiDiscrete
from cpmkit.families.evolution.shifted import ShiftedSolver
from cpmkit.types import Floats

#: Takes the moments so far, the last one last, and returns the next.
Scheme = Callable[[SemiDiscrete, ShiftedSolver, History, Step], Moment]


def backward_euler(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Take one step of backward Euler."""
    h = step.length
    right_side = problem.weighed(history[-1].u) + h * problem.forcing(step.end)
    if problem.reaction is not None:
        right_side += h * problem.reacting(history[-1])
    return Moment(solver.solve(h, right_side, extrapolate(history, h)), None, h, time=step.end)


def bdf2(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Take one step of BDF2; the first one as two half steps of backward Euler."""
    before, ratio = previous_moment(history, step.length)
    if before is None:
        return half_steps(problem, solver, history, step)
    gh = (1 + ratio) / (1 + 2 * ratio) * step.length
    right_side = problem.weighed(bdf2_start(history[-1].u, before.u, ratio)) + gh * problem.forcing(step.end)
    if problem.reaction is not None:
        now, past = problem.reacting(history[-1]), problem.reacting(before)
        right_side += gh * (now + ratio * (now - past))
    return Moment(solver.solve(gh, right_side, extrapolate(history, step.length)), None, step.length)


def crank_nicolson(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Take one step of Crank-Nicolson."""
    half, u = 0.5 * step.length, history[-1].u
    solver.tally.operator_applications += u.shape[1]
    right_side = problem.weighed(u) + half * (problem.rate(u, step.start) + problem.forcing(step.end))
    return Moment(solver.solve(half, right_side, extrapolate(history, step.length)), None, step.length)


def damped_crank_nicolson(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Take one step of Crank-Nicolson; the first one as two half steps of backward Euler, with the same matrix."""
    if len(history) > 1:
        return crank_nicolson(problem, solver, history, step)
    return half_steps(problem, solver, history, step)


def half_steps(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Take one step as two half steps of backward Euler."""
    half, middle = 0.5 * step.length, 0.5 * (step.start + step.end)
    first = backward_euler(problem, solver, history, Step(step.start, middle, half, False))
    second = backward_euler(problem, solver, [*history, first], Step(middle, step.end, half, False))
    return Moment(second.u, None, step.length)


def previous_moment(history: History, length: float) -> tuple[Moment | None, float]:
    """Return the moment that BDF2 looks back on, and the step's ``length`` over the time since then.

    It lies at least half a step back: from a shortened step to a full one the coefficients would be large.
    """
    back = 0.0
    for k in range(len(history) - 1, 0, -1):
        back += history[k].length
        if back >= 0.5 * length:
            return history[k - 1], length / back
    return None, 0.0


def bdf2_start(now: Floats, before: Floats, ratio: float) -> Floats:
    """Return what BDF2 steps from: ``[(1 + w)^2 now - w^2 before] / (1 + 2 w)``."""
    return np.asarray(((1 + ratio) ** 2 * now - ratio**2 * before) / (1 + 2 * ratio))


def extrapolate(history: History, length: float) -> Floats:
    """Return the polynomial through the values so far, a step of ``length`` later: where a solver starts."""
    times = -np.cumsum([0.0, *(moment.length for moment in history[:0:-1])])
    values = np.zeros_like(history[-1].u)
    for k, moment in enumerate(reversed(history)):
        others = np.delete(times, k)
        values += np.prod((length - others) / (times[k] - others)) * moment.u
    return values
