"""Warnings of a run in time about lost heat, growth without a cause, and steps or waves that are not resolved."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.families.context import is_nonnegative
from cpmkit.families.evolution import semidiscrete
from cpmkit.forms.contract import Discretized
from cpmkit.scene.compound_equations import ReactionDiffusion
from cpmkit.scene.data import evaluate_data, takes_time
from cpmkit.scene.diffusivities import mean_diffusivity
from cpmkit.scene.equations_in_time import Heat, Wave
from cpmkit.types import Floats


def run_warnings(plan: semidiscrete.RunPlan, history: semidiscrete.History) -> tuple[str, ...]:
    """Return the warnings at the end of a run, () if there are none; ``history`` has its last moments."""
    waves = (_oscillation_warnings, _unresolved_wave_warnings, _short_pattern_warnings)
    changes = (_long_step_warnings, _heat_drift_warnings, _missed_rest_warnings)
    return tuple(text for check in (*waves, *changes) for text in check(plan, history))


def _heat_drift_warnings(plan: semidiscrete.RunPlan, history: semidiscrete.History) -> list[str]:
    """Return a list with a warning if over 2 percent of heat was lost or gained on a piece without outflow, or [].

    On such a piece the mean of u should grow by the mean of f times the time, in every scheme. This is checked only for
    heat with c = 0, steady f, no velocity and no ``after_step``, if the form has ``closed_component_means``.
    """
    problem, heat, start, u = plan.problem, plan.evolution, plan.start.u, history[-1].u
    if not isinstance(heat, Heat) or callable(heat.c) or heat.c or heat.velocity is not None or takes_time(heat.f):
        return []
    if heat.after_step is not None:
        return []
    mean = problem.form.closed_component_means()
    if mean is None:
        return []
    supplied = (history[-1].time - plan.start.time) * (mean @ problem.steady_forcing)
    drift = mean @ u - mean @ start - supplied
    size = mean @ np.abs(start) + np.abs(supplied)
    span = np.maximum(np.ptp(start, axis=0), np.ptp(u, axis=0))
    share = np.divide(np.abs(drift), size, out=np.zeros_like(drift), where=size > 0)
    share[np.abs(drift) <= 2e-3 * span] = 0.0
    if share.max(initial=0.0) <= 2e-2:
        return []
    worst = np.unravel_index(int(share.argmax()), share.shape)
    verb = "gained" if drift[worst] > 0 else "lost"
    return [
        f"Heat was {verb} on a piece that nothing flows out of: the mean of u is off by {drift[worst]:.3g}, "
        f"{share[worst]:.1%} of the heat there, because creases or thin parts that the spacing does not resolve let it "
        "leak; the solution is off by as much at least; use a smaller spacing."
    ]


def wave_energy(problem: semidiscrete.SemiDiscrete, moment: semidiscrete.Moment) -> Floats | None:
    """Return the energy (channels,) of a wave, ``v'Mv/2 + u'Au/2 - u'b``, with the forcing b as a potential.

    u and v are ``u`` and ``rate`` of ``moment``. It is conserved if b is constant. None without a rate or symmetric A.
    """
    if moment.rate is None or not problem.stiffness.symmetric:
        return None
    kinetic = 0.5 * np.sum(moment.rate * problem.apply_mass(moment.rate), axis=0)
    force = 0.5 * problem.stiffness.apply(moment.u) - problem.forcing(moment.time)
    return np.asarray(kinetic + np.sum(moment.u * force, axis=0))


def growth_check(plan: semidiscrete.RunPlan) -> Callable[[Floats, float], None] | None:
    """Return a function of u (n, channels) and the time that raises ResolutionError above four times an a priori bound.

    If A has no eigenvalue below zero and b does not depend on time, the norm of u after a time t is at most ``|u0| +
    |b| t`` for heat and ``|u0| + |v0| t + |b| t^2 / 2`` for waves with the initial rate v0. A norm above four times
    that bound proves an eigenvalue of the wrong sign. The result is None for other data, operators and equations, with
    ``after_step``, and with a mass matrix M, since the norm of b then does not bound that of ``M^-1 b``.
    """
    problem, evolution, start, form = plan.problem, plan.evolution, plan.start, plan.problem.form
    if not isinstance(evolution, (Heat, Wave)) or evolution.after_step is not None:
        return None
    if problem.depends_on_time or form.mass is not None or not is_nonnegative(form):
        return None
    first, rate, push = float(np.linalg.norm(start.u)), float(np.linalg.norm(problem.steady_forcing)), 0.0
    if start.rate is not None:
        rate, push = float(np.linalg.norm(start.rate)), rate

    def check(u: Floats, time: float) -> None:
        """Raise ResolutionError if the norm of u (n, channels) at ``time`` exceeds four times its a priori bound."""
        elapsed = time - start.time
        bound, size = first + rate * elapsed + 0.5 * push * elapsed**2, float(np.linalg.norm(u))
        if size > 4 * bound > 0:  # the norm is over the band, whose nodes are not equally dense everywhere
            raise ResolutionError(
                f"The solution grows without a cause: at time {time:.4g} it is {size / bound:.3g} times as large as "
                "the data allow; it grows from what the spacing does not resolve, such as limbs that are two spacings "
                'thick; use a smaller spacing, or form="galerkin".'
            )

    return check


def _long_step_warnings(plan: semidiscrete.RunPlan, history: semidiscrete.History) -> list[str]:
    """Return a list with a warning if long steps cause errors of advection over a tenth of u's variation, or [].

    The error is estimated from waves like those at the start, for the whole run or the time until diffusion removes
    them. Equations without velocity, a constant start, and a u that varies and has become steady are not checked.
    """
    evolution, form = plan.evolution, plan.problem.form
    if not isinstance(evolution, Heat) or evolution.velocity is None or len(history) < 2:
        return []
    points, share = _spread_points(form)
    capacity = evaluate_data(evolution.capacity, points, 1, "the capacity")
    v = evaluate_data(evolution.velocity, points, None, "the velocity") / capacity
    values, slopes = form.evaluate(plan.start.u, points), form.gradient(plan.start.u, points)
    size = np.sqrt(share @ (values - share @ values) ** 2)
    varies = size > 1e-3 * np.sqrt(share @ values**2)
    now, before = (form.evaluate(moment.u, points) for moment in (history[-1], history[-2]))
    variation = np.sqrt(share @ (now - share @ now) ** 2)
    change = np.sqrt(share @ (now - before) ** 2)
    is_steady = (change <= 1e-3 * variation).all() and (variation >= 0.1 * size).all()  # driven, as it still varies
    if not varies.any() or is_steady:
        return []
    along = np.sqrt(share @ np.einsum("pcd,pd->pc", slopes, v) ** 2)[varies] / size[varies]
    steep = (share @ (slopes**2).sum(axis=2))[varies] / size[varies] ** 2
    lasts = 1 / np.maximum(mean_diffusivity(evolution.kappa, points) * steep, 1 / evolution.duration)
    # For each radian of advection at r radians a step the error, of the phase by BDF2 and Crank-Nicolson, of the size
    # by backward Euler, is ``factor r^order`` (cos 3t round the circle in 12 to 400 steps: .6 to 1.1 of that up to .3).
    factor, order = {"bdf2": (1 / 3, 2), "crank-nicolson": (1 / 12, 2), "backward-euler": (1 / 2, 1)}[evolution.scheme]
    errors = factor * (along * evolution.step) ** order * along * lasts
    worst = int(errors.argmax())
    error, radians = float(errors[worst]), float(along[worst] * evolution.step)
    if error <= 0.1:
        return []
    spacings = float(np.linalg.norm(v, axis=1).max()) * evolution.step / form.spacing
    advised = evolution.step * (0.02 / error) ** (1 / order)
    return [
        f"step={evolution.step:g} is long for the velocity, which moves u by up to {spacings:.2g} spacings in it, "
        f"{radians:.2g} radians of its waves: scheme {evolution.scheme!r} then leaves "
        f"{'much' if error > 1 else f'about {error:.0%}'} of the advected variation behind, or damps it; use a step of "
        f"{advised:.2g} or less."
    ]


def _short_pattern_warnings(plan: semidiscrete.RunPlan, history: semidiscrete.History) -> list[str]:
    """Return a list with a warning if a reaction's pattern is so short that the lattice shapes it, or []."""
    if not isinstance(plan.evolution, ReactionDiffusion):
        return []
    form, u = plan.problem.form, history[-1].u
    points, share = _spread_points(form)
    values, slopes = form.evaluate(u, points), form.gradient(u, points)
    spread = share @ (values - share @ values) ** 2
    steep = np.einsum("p,pcd->c", share, slopes**2)
    varies = spread > 1e-6 * (share @ values**2)
    wavenumbers = np.sqrt(np.divide(steep, spread, out=np.zeros_like(steep), where=varies))
    longest = float(wavenumbers.max(initial=0.0)) * form.spacing
    coarsest = form.traits.dispersion.coarsest
    if longest <= coarsest:
        return []
    advised = 0.9 * form.spacing * coarsest / longest
    return [
        f"The pattern is {2 * np.pi / longest:.2g} spacings long, too few for the lattice not to be felt: its length "
        f"and the directions of its stripes are not those of the equation; use a spacing of {advised:.2g} or less."
    ]


def _spread_points(form: Discretized) -> tuple[Floats, Floats]:
    """Return up to 4000 of the form's points (k, d), and weights (k,) of sum 1 for means over the manifold."""
    rows, points = form.some_points(4000)
    weights = form.point_weights
    share = np.full(len(points), 1.0) if weights is None else weights[rows]
    return points, share / share.sum()


def _oscillation_warnings(plan: semidiscrete.RunPlan, history: semidiscrete.History) -> list[str]:
    """Return a list with a warning if the changes of u in the last two steps are opposite and not small, or [].

    Only Crank-Nicolson, which does not damp, and schemes with an explicit reaction are checked.
    """
    evolution = plan.evolution
    if evolution.scheme not in ("crank-nicolson", "sbdf2", "euler") or len(history) < 3:
        return []
    before, after = history[-2].u - history[-3].u, history[-1].u - history[-2].u
    size = float(np.abs(history[-1].u).max(initial=0.0))
    swing = float(np.abs(after).max(initial=0.0))
    reversed_ = -float(np.sum(before * after)) > 0.5 * float(np.sum(before * before))
    if swing <= 1e-4 * size or not reversed_:
        return []
    if evolution.scheme != "crank-nicolson":
        return [
            f"The last steps swing back and forth by {swing / size:.1g} of the solution: the reaction is explicit, and "
            f"step={evolution.step:g} is longer than the time in which it acts; use a shorter step."
        ]
    return [
        f"The last steps of Crank-Nicolson swing back and forth by {swing / size:.1g} of the solution: it does not "
        f"damp what step={evolution.step:g} does not resolve; use scheme 'bdf2' or 'backward-euler', or a shorter step."
    ]


def _unresolved_wave_warnings(plan: semidiscrete.RunPlan, history: semidiscrete.History) -> list[str]:
    """Return a list with a warning if a wave equation's u ends in waves too short for the lattice, or []."""
    problem, evolution = plan.problem, plan.evolution
    if not isinstance(evolution, Wave):
        return []
    if problem.form.mass_in_time is None:
        u = history[-1].u
        largest = semidiscrete.largest_lattice_eigenvalue(problem, evolution.speed)
        sharpness = float(np.linalg.norm(problem.net_forcing(u, evolution.until))) / largest
        if sharpness <= 0.4 * float(np.linalg.norm(u)):  # for waves that grow it is 0.49, for a jump 0.3
            return []
        return [
            "The solution consists of waves of two spacings, which do not solve the equation: they grew from what the "
            "spacing does not resolve; use a smaller spacing, smoother data, or scheme 'implicit' with a longer step."
        ]
    before, now = history[-2:]
    assert before.rate is not None
    assert now.rate is not None
    pair = ((now.rate - before.rate) / now.length, 0.5 * (before.u + now.u))
    acceleration, size = (float(np.trace(problem.form.inner(values, values))) for values in pair)
    frequency = (acceleration / size) ** 0.25 if size > 0 else 0.0  # the root of the rms of u_tt over that of u
    if frequency * problem.form.spacing <= 0.5 * np.pi * evolution.speed:  # a quarter of a wave
        return []
    return [
        "The solution consists of waves of four spacings or less, which the spacing does not resolve; use a smaller "
        "spacing, smoother data, or scheme 'implicit' with a longer step."
    ]


def _missed_rest_warnings(plan: semidiscrete.RunPlan, history: semidiscrete.History) -> list[str]:
    """Return a list with a warning if u still changes at the rate ``rest`` of the run or faster, or []."""
    evolution = plan.evolution
    rate = semidiscrete.rate_of_change(plan.problem.form, plan.start, history)
    if evolution.rest is None or rate < evolution.rest:
        return []
    return [
        f"The run did not come to rest until {evolution.until:g}: u still changes by {rate:.2g} of its size per unit "
        f"of time, more than rest={evolution.rest:g}; use a later `until`."
    ]
