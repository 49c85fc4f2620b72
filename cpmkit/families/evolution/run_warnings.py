"""Warnings of a run in time about lost heat, growth without a cause, and steps or waves that are not resolved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.families.context import surely_positive
from cpmkit.families.evolution.run_state import History, Moment, rate_of_change
from cpmkit.families.evolution.semidiscrete import SemiDiscrete, largest_eigenvalue
from cpmkit.forms.contract import Discretized
from cpmkit.scene.compound_equations import ReactionDiffusion
from cpmkit.scene.data import evaluate_data, takes_time
from cpmkit.scene.diffusivities import mean_diffusivity
from cpmkit.scene.equations_in_time import Evolution, Heat, Wave
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats

#: Least drift of the mean that is reported, as a share of the heat and as a share of the range of u.
DRIFT_SHARE_OF_HEAT, DRIFT_SHARE_OF_RANGE = 2e-2, 2e-3
#: Factor by which a solution may exceed its growth bound; beyond it discretisation errors grow. The norm is over the
#: band, whose nodes are not equally dense everywhere.
UNSTABLE_GROWTH = 4.0
#: Crank-Nicolson oscillates if its last step reverses more than the first share of the step before, and is more than
#: the second share of the solution.
RINGING_SHARE_OF_STEP, RINGING_SHARE_OF_SOLUTION = 0.5, 1e-4
#: Waves are unresolved if |A u| is more than this share of |u| times the largest eigenvalue. For waves that grow it is
#: 0.49, for a jump 0.3.
SHORTEST_WAVE_SHARE = 0.4
#: With a mass matrix waves are unresolved if their phase changes by more than this in a spacing: a quarter of a wave.
SHORTEST_WAVE_PHASE = 0.5 * np.pi
#: Error of a wave for each radian of advection, at r radians a step: ``factor r^order``, of its phase by BDF2 and
#: Crank-Nicolson, of its size by backward Euler (cos 3t round the circle in 12 to 400 steps: .6 to 1.1 of that up to
#: .3). It is reported above the first share, and the step that is advised has the second.
ADVECTION_ERRORS = {"bdf2": (1 / 3, 2), "crank-nicolson": (1 / 12, 2), "backward-euler": (1 / 2, 1)}
REPORTED_ADVECTION_ERROR, ADVISED_ADVECTION_ERROR = 0.1, 0.02
#: A run is at rest if its last step changed u by at most the first share of its variation, and that is the second share
#: of the variation at the start.
AT_REST_SHARE, STILL_VARIES_SHARE = 1e-3, 0.1
#: Number of points at which the length of a pattern is computed, and least variation of a pattern as a share of u.
PATTERN_POINTS, PATTERN_SHARE = 2000, 1e-3
#: The advised spacing, as a share of the largest spacing that resolves the pattern.
WELL_BELOW = 0.9


def heat_drift_warning(problem: SemiDiscrete, scene: Scene, start: Floats, u: Floats, time: float) -> list[str]:
    """Return a warning if heat was lost or gained in ``time`` on pieces without outflow; only for c = 0.

    On such pieces the mean of u should grow by the mean of f times the time, in every scheme. ``start`` and ``u``
    (n, channels) are the unknowns at the beginning and the end.
    """
    heat = scene.problem
    if not isinstance(heat, Heat) or callable(heat.c) or heat.c or heat.velocity is not None or takes_time(heat.f):
        return []
    if heat.after_step is not None:
        return []
    mean = problem.form.means_without_flux()
    if mean is None:
        return []
    supplied = time * (mean @ problem.steady_forcing)
    drift = mean @ u - mean @ start - supplied
    size = mean @ np.abs(start) + np.abs(supplied)
    span = np.maximum(np.ptp(start, axis=0), np.ptp(u, axis=0))
    share = np.divide(np.abs(drift), size, out=np.zeros_like(drift), where=size > 0)
    share[np.abs(drift) <= DRIFT_SHARE_OF_RANGE * span] = 0.0
    if share.max(initial=0.0) <= DRIFT_SHARE_OF_HEAT:
        return []
    worst = np.unravel_index(int(share.argmax()), share.shape)
    verb = "gained" if drift[worst] > 0 else "lost"
    return [
        f"Heat was {verb} on a piece that nothing flows out of: the mean of u is off by {drift[worst]:.3g}, "
        f"{share[worst]:.1%} of the heat there, because creases or thin parts that the spacing does not resolve let it "
        "leak; the solution is off by as much at least; use a smaller spacing."
    ]


def wave_energy(problem: SemiDiscrete, moment: Moment, time: float) -> Floats | None:
    """Return the energy (channels,) of a wave, ``v'Mv/2 + u'Au/2 - u'b``, with the forcing as a potential.

    It is conserved if b does not depend on the time. None for equations other than waves, and if A is not symmetric.
    """
    if moment.rate is None or not problem.stiffness.symmetric:
        return None
    kinetic = 0.5 * np.sum(moment.rate * problem.times_mass(moment.rate), axis=0)
    force = 0.5 * problem.stiffness.apply(moment.u) - problem.forcing(time)
    return np.asarray(kinetic + np.sum(moment.u * force, axis=0))


@dataclass(frozen=True)
class GrowthBound:
    """A bound of the norm of u: ``start + rate t`` for heat, ``start + rate t + push t^2 / 2`` for waves.

    t is the time since ``begin``. It holds if A has no eigenvalue below zero and the data do not depend on time.
    """

    start: float
    rate: float
    push: float
    begin: float = 0.0

    def check(self, u: Floats, time: float) -> None:
        """Raise if the norm of u (n, channels) exceeds the bound.

        Raises
        ------
        ResolutionError
            In this case, which proves an eigenvalue of the wrong sign.
        """
        elapsed = time - self.begin
        bound = self.start + self.rate * elapsed + 0.5 * self.push * elapsed**2
        size = float(np.linalg.norm(u))
        if size > UNSTABLE_GROWTH * bound > 0:
            raise ResolutionError(
                f"The solution grows without a cause: at time {time:.4g} it is {size / bound:.3g} times as large as "
                "the data allow; it grows from what the spacing does not resolve, such as limbs that are two spacings "
                'thick; use a smaller spacing, or form="galerkin".'
            )


def growth_bound(problem: SemiDiscrete, scene: Scene, start: Moment) -> GrowthBound | None:
    """Return the growth bound of a run; None if there is none.

    There is none for data that depend on time, for an operator that may have negative eigenvalues, and with a mass
    matrix, since the norm of b then does not bound that of ``M^-1 b``.
    """
    evolution, form = scene.problem, problem.form
    if not isinstance(evolution, (Heat, Wave)) or evolution.after_step is not None:
        return None
    if problem.depends_on_time or form.mass is not None or not surely_positive(form):
        return None
    size, forcing = float(np.linalg.norm(start.u)), float(np.linalg.norm(problem.steady_forcing))
    if isinstance(evolution, Wave):
        rate = 0.0 if start.rate is None else float(np.linalg.norm(start.rate))
        return GrowthBound(size, rate, forcing, start.time)
    return GrowthBound(size, forcing, 0.0, start.time)


def run_warnings(problem: SemiDiscrete, evolution: Evolution, start: Moment, history: History) -> tuple[str, ...]:
    """Return the warnings at the end of a run that began at ``start``."""
    warnings = _oscillation_warning(evolution, history)
    if isinstance(evolution, Wave):
        warnings += _unresolved_wave_warning(problem, evolution, history)
    if isinstance(evolution, ReactionDiffusion):
        warnings += _short_pattern_warning(problem, history)
    if isinstance(evolution, Heat):
        warnings += _long_step_warning(problem, evolution, start, history)
    return tuple(warnings)


def _long_step_warning(problem: SemiDiscrete, evolution: Heat, start: Moment, history: History) -> list[str]:
    """Return a warning in a list if the error of advection in the scheme is large; else [].

    It is estimated over the whole run, or over the time in which diffusion removes the variation of u.
    """
    if evolution.velocity is None or len(history) < 2:
        return []
    form = problem.form
    points, share = _pattern_points(form)
    v = evaluate_data(evolution.velocity, points, None, "the velocity")
    values, slopes = form.evaluate(start.u, points), form.gradient(start.u, points)
    size = np.sqrt(share @ (values - share @ values) ** 2)
    varies = size > PATTERN_SHARE * np.sqrt(share @ values**2)
    if not varies.any() or _is_driven_steady(problem, history, size, points, share):
        return []
    along = np.sqrt(share @ np.einsum("pcd,pd->pc", slopes, v) ** 2)[varies] / size[varies]
    steep = (share @ (slopes**2).sum(axis=2))[varies] / size[varies] ** 2
    lasts = 1 / np.maximum(mean_diffusivity(evolution.kappa, points) * steep, 1 / evolution.duration)
    factor, order = ADVECTION_ERRORS[evolution.scheme]
    errors = factor * (along * evolution.step) ** order * along * lasts
    worst = int(errors.argmax())
    error, radians = float(errors[worst]), float(along[worst] * evolution.step)
    if error <= REPORTED_ADVECTION_ERROR:
        return []
    spacings = float(np.linalg.norm(v, axis=1).max()) * evolution.step / form.spacing
    advised = evolution.step * (ADVISED_ADVECTION_ERROR / error) ** (1 / order)
    return [
        f"step={evolution.step:g} is long for the velocity, which moves u by up to {spacings:.2g} spacings in it, "
        f"{radians:.2g} radians of its waves: scheme {evolution.scheme!r} then leaves "
        f"{'much' if error > 1 else f'about {error:.0%}'} of the advected variation behind, or damps it; use a step of "
        f"{advised:.2g} or less."
    ]


def _is_driven_steady(problem: SemiDiscrete, history: History, size: Floats, points: Floats, share: Floats) -> bool:
    """Return True if the last step hardly changed a solution that still varies in space: it is nearly steady.

    ``size`` (channels,) is the variation at the start; ``share`` (k,) are the weights of ``points`` (k, d).
    """
    now, before = (problem.form.evaluate(moment.u, points) for moment in (history[-1], history[-2]))
    variation = np.sqrt(share @ (now - share @ now) ** 2)
    change = np.sqrt(share @ (now - before) ** 2)
    return bool((change <= AT_REST_SHARE * variation).all() and (variation >= STILL_VARIES_SHARE * size).all())


def _short_pattern_warning(problem: SemiDiscrete, history: History) -> list[str]:
    """Return a warning in a list if a reaction's pattern is so short that the lattice determines it; else []."""
    form = problem.form
    longest = float(_wavenumbers(problem, history[-1].u).max(initial=0.0)) * form.spacing
    coarsest = form.traits.dispersion.coarsest
    if longest <= coarsest:
        return []
    advised = WELL_BELOW * form.spacing * coarsest / longest
    return [
        f"The pattern is {2 * np.pi / longest:.2g} spacings long, too few for the lattice not to be felt: its length "
        f"and the directions of its stripes are not those of the equation; use a spacing of {advised:.2g} or less."
    ]


def _wavenumbers(problem: SemiDiscrete, u: Floats) -> Floats:
    """Return the rms of grad u over the rms of u - mean(u), (channels,): the wavenumber of a wave, 0 of constants."""
    form = problem.form
    points, share = _pattern_points(form)
    values, slopes = form.evaluate(u, points), form.gradient(u, points)
    spread = share @ (values - share @ values) ** 2
    steep = np.einsum("p,pcd->c", share, slopes**2)
    varies = spread > PATTERN_SHARE**2 * (share @ values**2)
    return np.asarray(np.sqrt(np.divide(steep, spread, out=np.zeros_like(steep), where=varies)))


def _pattern_points(form: Discretized) -> tuple[Floats, Floats]:
    """Return points (k, d) spread over the manifold, and the share of the manifold (k,) that each represents."""
    every = slice(None, None, max(1, len(form.points) // PATTERN_POINTS))
    points, weights = form.points[every], form.point_weights
    share = np.full(len(points), 1.0) if weights is None else weights[every]
    return points, share / share.sum()


def _oscillation_warning(evolution: Evolution, history: History) -> list[str]:
    """Return a warning in a list if the last steps oscillate; else [].

    Only schemes without damping, or with an explicit reaction, are checked.
    """
    if evolution.scheme not in ("crank-nicolson", "sbdf2", "euler") or len(history) < 3:
        return []
    before, after = history[-2].u - history[-3].u, history[-1].u - history[-2].u
    size = float(np.abs(history[-1].u).max(initial=0.0))
    swing = float(np.abs(after).max(initial=0.0))
    reversed_ = -float(np.sum(before * after)) > RINGING_SHARE_OF_STEP * float(np.sum(before * before))
    if swing <= RINGING_SHARE_OF_SOLUTION * size or not reversed_:
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


def _unresolved_wave_warning(problem: SemiDiscrete, evolution: Wave, history: History) -> list[str]:
    """Return a warning in a list if the lattice does not resolve a wave; else []."""
    if problem.form.mass_in_time is None:
        u = history[-1].u
        largest = largest_eigenvalue(problem, evolution.speed)
        sharpness = float(np.linalg.norm(problem.rate(u, evolution.until))) / largest
        if sharpness <= SHORTEST_WAVE_SHARE * float(np.linalg.norm(u)):
            return []
        return [
            "The solution consists of waves of two spacings, which do not solve the equation: they grew from what the "
            "spacing does not resolve; use a smaller spacing, smoother data, or scheme 'implicit' with a longer step."
        ]
    if _mean_frequency(problem, history) * problem.form.spacing <= SHORTEST_WAVE_PHASE * evolution.speed:
        return []
    return [
        "The solution consists of waves of four spacings or less, which the spacing does not resolve; use a smaller "
        "spacing, smoother data, or scheme 'implicit' with a longer step."
    ]


def _mean_frequency(problem: SemiDiscrete, history: History) -> float:
    """Return the fourth root of the mean of u_tt^2 over that of u^2: for a wave its speed times its wavenumber."""
    before, now = history[-2:]
    assert before.rate is not None
    assert now.rate is not None
    pair = ((now.rate - before.rate) / now.length, 0.5 * (before.u + now.u))
    acceleration, size = (float(np.trace(problem.form.inner(values, values))) for values in pair)
    return float((acceleration / size) ** 0.25) if size > 0 else 0.0


def rest_warning(form: Discretized, evolution: Evolution, start: Moment, history: History) -> list[str]:
    """Return a warning in a list if a run that should have come to rest did not; else []."""
    if evolution.rest is None:
        return []
    rate = rate_of_change(form, start, history)
    if rate < evolution.rest:
        return []
    return [
        f"The run did not come to rest until {evolution.until:g}: u still changes by {rate:.2g} of its size per unit "
        f"of time, and rest={evolution.rest:g} was asked for; use a later `until`."
    ]
