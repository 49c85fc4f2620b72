"""One step of each scheme for waves, M u'' = -A u + b(t), h the step.

Newmark's average acceleration, with v for u': ``(M + h^2/4 A) u1 = M (u0 + h v0) + h^2/4 (-A u0 + b0 + b1)``,
``v1 = 2 (u1 - u0) / h - v0``. It keeps the energy ``v'Mv/2 + u'Au/2`` where A is symmetric and b zero. No acceleration
is kept: M may be singular.

Leapfrog, M being the identity: ``v1 = v0 + h (-A u0 + b0)``, ``u1 = u0 + h v1``, the rate v half a step before u. It is
damped: ``v1 -= h eps A^2 v0``, with eps so small that the damping is of third order in the spacing, and so
large that waves of a few spacings decay, which grow where A has complex eigenvalues
(:func:`cpmkit.forms.collocation.refusals.check_waves`).

The implicit scheme is BDF2 for u' = v, M v' = -A u + b: ``(M + (g h)^2 A) u1 = ...``, v eliminated.
"""

from __future__ import annotations

import numpy as np

from cpmkit.families.evolution.moment import History, Moment
from cpmkit.families.evolution.schedule import Step
from cpmkit.families.evolution.schemes import bdf2_start, extrapolate, previous_moment
from cpmkit.families.evolution.semidiscrete import SemiDiscrete, largest_eigenvalue
from cpmkit.families.evolution.shifted import ShiftedSolver
from cpmkit.scene.equations_in_time import Wave
from cpmkit.types import Floats

#: By how much leapfrog damps the shortest waves of the lattice, per time in which a wave crosses a spacing.
LEAPFROG_DAMPING = 0.8


def newmark(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Take one step of Newmark's average acceleration."""
    now, h = history[-1], step.length
    assert now.rate is not None
    solver.tally.operator_applications += now.u.shape[1]
    pushed = problem.rate(now.u, step.start) + problem.forcing(step.end)
    right_side = problem.weighed(now.u + h * now.rate) + 0.25 * h**2 * pushed
    u = solver.solve(0.25 * h**2, right_side, extrapolate(history, h))
    return Moment(u, 2 / h * (u - now.u) - now.rate, h)


def leapfrog(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Take one step of leapfrog: first the rate over half of the last step and half of this, then the values."""
    now = history[-1]
    assert now.rate is not None
    acceleration = problem.rate(now.u, step.start)
    rate = now.rate + 0.5 * (now.length + step.length) * acceleration
    if now.acceleration is not None:
        rate += _damping(problem, (acceleration - now.acceleration) / now.length, step.length)
    solver.tally.operator_applications += (1 if now.acceleration is None else 2) * now.u.shape[1]
    return Moment(now.u + step.length * rate, rate, step.length, acceleration)


def _damping(problem: SemiDiscrete, jerk: Floats, length: float) -> Floats:
    """Return ``-h eps A^2 v0``, with A v0 taken from the change of A u0: of that, boundary data are part."""
    wave = problem.form.scene.problem
    assert isinstance(wave, Wave)
    largest, dim = largest_eigenvalue(problem, wave.speed), problem.form.scene.surface.dim
    strength = LEAPFROG_DAMPING * length * np.sqrt(largest / (4 * dim))
    return np.asarray(strength / largest**2 * problem.stiffness.apply(jerk))


def implicit_wave(problem: SemiDiscrete, solver: ShiftedSolver, history: History, step: Step) -> Moment:
    """Take one step of BDF2 for values and rates; the first one of backward Euler."""
    now = history[-1]
    before, ratio = previous_moment(history, step.length)
    assert now.rate is not None
    if before is None:
        gh, u, rate = step.length, now.u, now.rate
    else:
        assert before.rate is not None
        gh = (1 + ratio) / (1 + 2 * ratio) * step.length
        u, rate = bdf2_start(now.u, before.u, ratio), bdf2_start(now.rate, before.rate, ratio)
    right_side = problem.weighed(u + gh * rate) + gh**2 * problem.forcing(step.end)
    values = solver.solve(gh**2, right_side, extrapolate(history, step.length))
    return Moment(values, (values - u) / gh, step.length)
