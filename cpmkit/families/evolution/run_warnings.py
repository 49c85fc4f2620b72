"""What a reader of a solution in time should know: where its steps or its waves are not resolved."""

from __future__ import annotations

import numpy as np

from cpmkit.families.evolution.moment import History, Moment
from cpmkit.families.evolution.semidiscrete import SemiDiscrete, largest_eigenvalue
from cpmkit.forms.contract import Discretized
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.diffusivities import mean_diffusivity
from cpmkit.scene.equations_in_time import Evolution, Heat, Wave
from cpmkit.scene.reaction_diffusion import ReactionDiffusion
from cpmkit.types import Floats

#: Crank-Nicolson rings where its last step takes back more than this share of the one before, and both are more than
#: the second share of the solution.
RINGING_SHARE_OF_STEP, RINGING_SHARE_OF_SOLUTION = 0.5, 1e-4
#: Schemes that can ring: one that does not damp, and those of a reaction.
RINGING_SCHEMES = ("crank-nicolson", "sbdf2", "euler")
#: Waves are not resolved where A u is more than this share of its largest eigenvalue times u. Of waves that grow it is
#: 0.49, of a jump 0.3.
SHORTEST_WAVE_SHARE = 0.4
#: Nor where the form has a mass and the solution's phase turns by more than this over a spacing: a quarter of a wave.
SHORTEST_WAVE_PHASE = 0.5 * np.pi
#: What a scheme leaves of a wave for each radian that a velocity carries it, at r radians a step: ``share r^order``, of
#: its phase by BDF2 and Crank-Nicolson, of its size by backward Euler (cos 3t carried round the circle in 12 to 400
#: steps: .6 to 1.1 of that up to .3). From the first share of what is carried on it is told, and a step is advised
#: that leaves the second.
ADVECTION_ERRORS = {"bdf2": (1 / 3, 2), "crank-nicolson": (1 / 12, 2), "backward-euler": (1 / 2, 1)}
TOLD_ADVECTION_ERROR, ADVISED_ADVECTION_ERROR = 0.1, 0.02
#: A run has come to rest where its last step changed less than this share of what varies, and it varies as before.
AT_REST_SHARE, STILL_VARIES_SHARE = 1e-3, 0.1
#: Points at which the length of a pattern is measured, and the share of u's size that one is worth telling of.
PATTERN_POINTS, PATTERN_SHARE = 2000, 1e-3
#: The spacing that is advised, as a share of the largest that carries the pattern.
WELL_BELOW = 0.9


def run_warnings(problem: SemiDiscrete, evolution: Evolution, start: Moment, history: History) -> tuple[str, ...]:
    """Return one sentence for each thing found at the end of a run that began at ``start``."""
    waves = _unresolved_wave_sentence(problem, evolution, history) if isinstance(evolution, Wave) else []
    patterns = _short_pattern_sentence(problem, history) if isinstance(evolution, ReactionDiffusion) else []
    carried = _long_step_sentence(problem, evolution, start, history) if isinstance(evolution, Heat) else []
    return (*_ringing_sentence(evolution, history), *waves, *patterns, *carried)


def _long_step_sentence(problem: SemiDiscrete, evolution: Heat, start: Moment, history: History) -> list[str]:
    """Tell where a velocity carries u so far in a step that the scheme leaves it behind, or damps it.

    Over the whole run, or over the time in which diffusion takes away what is carried: later nobody sees it.
    """
    if evolution.velocity is None or len(history) < 2:
        return []
    form = problem.form
    points, share = _pattern_points(form)
    v = evaluate_data(evolution.velocity, points, None, "the velocity")
    values, slopes = form.evaluate(start.u, points), form.gradient(start.u, points)
    size = np.sqrt(share @ (values - share @ values) ** 2)
    varies = size > PATTERN_SHARE * np.sqrt(share @ values**2)
    if not varies.any() or _at_rest(problem, history, size, points, share):
        return []
    along = np.sqrt(share @ np.einsum("pcd,pd->pc", slopes, v) ** 2)[varies] / size[varies]
    steep = (share @ (slopes**2).sum(axis=2))[varies] / size[varies] ** 2
    lasts = 1 / np.maximum(mean_diffusivity(evolution.kappa, points) * steep, 1 / evolution.duration)
    factor, order = ADVECTION_ERRORS[evolution.scheme]
    errors = factor * (along * evolution.step) ** order * along * lasts
    worst = int(errors.argmax())
    error, radians = float(errors[worst]), float(along[worst] * evolution.step)
    if error <= TOLD_ADVECTION_ERROR:
        return []
    spacings = float(np.linalg.norm(v, axis=1).max()) * evolution.step / form.spacing
    wanted = evolution.step * (ADVISED_ADVECTION_ERROR / error) ** (1 / order)
    return [
        f"step={evolution.step:g} is long for the velocity, which carries u by up to {spacings:.2g} spacings in it, "
        f"{radians:.2g} radians of its waves: scheme {evolution.scheme!r} then leaves "
        f"{'much' if error > 1 else f'about {error:.0%}'} of what is carried behind, or damps it; use a step of "
        f"{wanted:.2g} or less."
    ]


def _at_rest(problem: SemiDiscrete, history: History, size: Floats, points: Floats, share: Floats) -> bool:
    """Tell whether the last step changed nothing of a solution that varies, as where it is driven to a steady one."""
    now, before = (problem.form.evaluate(one.u, points) for one in (history[-1], history[-2]))
    left = np.sqrt(share @ (now - share @ now) ** 2)
    changed = np.sqrt(share @ (now - before) ** 2)
    return bool((changed <= AT_REST_SHARE * left).all() and (left >= STILL_VARIES_SHARE * size).all())


def _short_pattern_sentence(problem: SemiDiscrete, history: History) -> list[str]:
    """Tell where what a reaction has grown is so short that the lattice decides its length and direction."""
    form = problem.form
    longest = float(_wavenumbers(problem, history[-1].u).max(initial=0.0)) * form.spacing
    if longest <= form.traits.dispersion.coarsest:
        return []
    wanted = WELL_BELOW * form.spacing * form.traits.dispersion.coarsest / longest
    return [
        f"The pattern is {2 * np.pi / longest:.2g} spacings long, too few for the lattice not to be felt: its length "
        f"and the directions of its stripes are not those of the equation; use a spacing of {wanted:.2g} or less."
    ]


def _wavenumbers(problem: SemiDiscrete, u: Floats) -> Floats:
    """Return |grad u| over |u - mean| (channels,), in root mean squares: of a wave its wavenumber; 0 of constants."""
    form = problem.form
    points, share = _pattern_points(form)
    values, slopes = form.evaluate(u, points), form.gradient(u, points)
    spread = share @ (values - share @ values) ** 2
    steep = np.einsum("p,pcd->c", share, slopes**2)
    varies = spread > PATTERN_SHARE**2 * (share @ values**2)
    return np.asarray(np.sqrt(np.divide(steep, spread, out=np.zeros_like(steep), where=varies)))


def _pattern_points(form: Discretized) -> tuple[Floats, Floats]:
    """Return points (k, d) spread over the manifold, and the share of it (k,) that each stands for."""
    every = slice(None, None, max(1, len(form.points) // PATTERN_POINTS))
    points, weights = form.points[every], form.point_weights
    share = np.full(len(points), 1.0) if weights is None else weights[every]
    return points, share / share.sum()


def _ringing_sentence(evolution: Evolution, history: History) -> list[str]:
    """Tell where the last steps swing back and forth instead of settling."""
    if evolution.scheme not in RINGING_SCHEMES or len(history) < 3:
        return []
    before, after = history[-2].u - history[-3].u, history[-1].u - history[-2].u
    size = float(np.abs(history[-1].u).max(initial=0.0))
    swing = float(np.abs(after).max(initial=0.0))
    taken_back = -float(np.sum(before * after)) > RINGING_SHARE_OF_STEP * float(np.sum(before * before))
    if swing <= RINGING_SHARE_OF_SOLUTION * size or not taken_back:
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


def _unresolved_wave_sentence(problem: SemiDiscrete, evolution: Wave, history: History) -> list[str]:
    """Tell where a wave consists of what the lattice cannot carry."""
    if problem.form.mass_in_time is None:
        u = history[-1].u
        sharpness = float(np.linalg.norm(problem.rate(u, evolution.until))) / largest_eigenvalue(
            problem, evolution.speed
        )
        if sharpness <= SHORTEST_WAVE_SHARE * float(np.linalg.norm(u)):
            return []
        return [
            "The solution consists of waves of two spacings, which do not solve the equation: they grew from what the "
            "spacing does not resolve; use a smaller spacing, smoother data, or scheme 'implicit' with a longer step."
        ]
    if _mean_wavenumber(problem, history) * problem.form.spacing <= SHORTEST_WAVE_PHASE * evolution.speed:
        return []
    return [
        "The solution consists of waves of four spacings or less, which the spacing does not resolve; use a smaller "
        "spacing, smoother data, or scheme 'implicit' with a longer step."
    ]


def _mean_wavenumber(problem: SemiDiscrete, history: History) -> float:
    """Return the root of |u''| over |u|, in mean squares: of a wave its speed times its wavenumber."""
    before, now = history[-2:]
    assert before.rate is not None
    assert now.rate is not None
    pair = ((now.rate - before.rate) / now.length, 0.5 * (before.u + now.u))
    bend, size = (float(np.trace(problem.form.inner(one, one))) for one in pair)
    return float((bend / size) ** 0.25) if size > 0 else 0.0
