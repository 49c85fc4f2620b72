"""Flows to a harmonic map: implicit steps, and the paper's explicit steps for comparison.

An implicit step is backward Euler with a projection on the target. The normal part n of Lap u, which moves the map off
the target, is known from the previous step and is added to the next one,

    (u* - u) / step = Lap u* + n,    u_next = cp(u*),    n_next = normal part of n + (u_next - u*) / step,

as the pressure is in projection methods for fluids. Without n the limit has an error proportional to the step. Steps
longer than about a third of the square of half the manifold's size oscillate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import cpmkit as ck
from cpmkit.errors import InputError
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource
from cpmkit.preparing import Prepared
from cpmkit.runtime.arrays import positive
from cpmkit.runtime.messages import warn_each
from cpmkit.types import Floats

#: A step is refused if it raises the energy by more than this share: rounding and projections raise it less.
RISING_SHARE = 1e-6
#: Ratio of the energies after and before a projection above which images jump between parts of the target, as between
#: legs that are thin for the step; and the ratio below which steps are doubled.
TORN_RATIO, SMOOTH_RATIO = 1.1, 1.01
#: A map that covers a closed target has at least its area as energy, up to this share for the error of the lattice.
COVERING_SHARE = 0.99
#: Shortest step over the first one, which is the spacing squared.
LEAST_SHARE = 0.01
UNCOVERED = (
    "The next step would lower the energy to {:.4g}, below the area {:.4g} that the map covers: the lattice is too "
    "coarse for thin parts of the target, and the map would slip off them. The map before it is returned; fix the "
    "ends of thin parts by landmarks, or use a smaller spacing."
)
#: Step of the differences of closest points that give tangential parts, over the target's size.
DIFFERENCE_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class _State:
    """A map between two steps.

    Attributes
    ----------
    points : Field
        Images (p, k) on the target of the points of the prepared scene.
    normal : (p, k) float64
        Part of Lap u normal to the target, at the images.
    energy : float
        The Dirichlet energy.
    solution : Solution or None
        The map on splines before the projection; None before the first step.
    projection_ratio : float
        Ratio of the energies after and before the projection.
    """

    points: ck.Field
    normal: Floats
    energy: float
    solution: Solution | None = None
    projection_ratio: float = 1.0


def implicit_flow(
    prepared: Prepared,
    target: ClosestPointSource,
    start: Floats,
    step: float,
    most_steps: int,
    rest: float,
    covering: float,
) -> tuple[Solution, list[float], bool]:
    """Take implicit steps, short ones first, until the energy is at rest.

    A step that raises the energy or tears the map is repeated with half its length. Where conditions
    are prescribed, the first step is never repeated, since the initial map need not satisfy them.

    Parameters
    ----------
    prepared : Prepared
        The manifold with landmarks as boundaries.
    target : ClosestPointSource
        The manifold of the images.
    start : (p, k) float64
        Images of the points of ``prepared``.
    step : float
        The longest step.
    most_steps : int
        Limit of the number of steps.
    rest : float
        Relative change of the energy below which the flow is at rest.
    covering : float
        Area that the initial map covers; 0 if unknown.

    Returns
    -------
    Solution, list of float, bool
        The map, the energies of the initial map and after each step, and whether the flow is at rest.
    """
    points = prepared.field(start).projected().project(target)
    state = _State(points, np.zeros_like(start), points.energy())
    length = min(step, prepared.discretized.spacing**2)
    least, energy, rests = LEAST_SHARE * length, [state.energy], False
    while len(energy) <= most_steps and not rests:
        later = _step(prepared, target, state, length)
        unchecked = state.solution is None and bool(prepared.scene.boundaries)
        fall = 1.0 if unchecked or state.energy == 0 else 1 - later.energy / state.energy
        if (fall < -RISING_SHARE or (later.projection_ratio > TORN_RATIO and not unchecked)) and length > least:
            length *= 0.5
            continue
        if later.energy < COVERING_SHARE * covering and state.solution is not None:
            warn_each([UNCOVERED.format(later.energy, covering)])
            return state.solution, energy, False
        state, rests = later, abs(fall) < rest and length >= min(step, prepared.discretized.spacing**2)
        energy.append(state.energy)
        if later.projection_ratio < SMOOTH_RATIO:
            length = min(2 * length, step)
    assert state.solution is not None
    return state.solution, energy, rests


def _step(prepared: Prepared, target: ClosestPointSource, state: _State, step: float) -> _State:
    """Return the map after one step of backward Euler, of length ``step``, and a projection on the target."""
    f = prepared.field(state.points.values / step + state.normal)
    solution = prepared.solve(problem=ck.ScreenedPoisson(f, c=1 / step), guess=state.solution)
    unprojected = prepared.field(solution)
    points = unprojected.project(target)
    normal = state.normal + (points.columns - unprojected.columns) / step
    normal -= _tangential(target, points.columns, normal)
    energy = points.energy()
    return _State(points, normal, energy, solution, energy / max(unprojected.energy(), np.finfo(float).tiny))


def _tangential(target: ClosestPointSource, points: Floats, vectors: Floats) -> Floats:
    """Return the tangential parts of ``vectors`` (p, k) at points of the target, by differences of closest points."""
    step = DIFFERENCE_SHARE * float(np.ptp(target.bounds, axis=0).max())
    longest = float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
    if longest == 0.0:
        return np.zeros_like(vectors)
    shift = step / longest * vectors
    ahead, behind = (target.closest_point(points + sign * shift).points for sign in (1.0, -1.0))
    return np.asarray((ahead - behind) * (longest / (2 * step)))


#: The explicit step over the spacing squared, and the largest stable one.
EXPLICIT_STEP_SHARE, LARGEST_STEP_SHARE = 0.1, 1 / 6
#: The energy is integrated after so many explicit steps, and its mean decrease per step is compared with ``rest``.
STEPS_PER_ENERGY = 50


def explicit_flow(
    prepared: Prepared, target: ClosestPointSource, start: Floats, step: float | None, most_steps: int, rest: float
) -> tuple[Solution, list[float], bool]:
    """Take the explicit steps u_next = cp(u + step Lap u) of King et al. (2024), eq. 24, until the energy is at rest.

    Arguments and results are those of :func:`implicit_flow`. Stable steps are bounded by the spacing squared.

    Raises
    ------
    InputError
        If the form is not ``collocation``, or the step too long.
    """
    h = prepared.discretized.spacing
    step = EXPLICIT_STEP_SHARE * h * h if step is None else positive(step, "step")
    if prepared.discretized.form != "collocation":
        raise InputError("explicit steps are taken in the form 'collocation'; use method='implicit' in others.")
    if step > LARGEST_STEP_SHARE * h * h:
        raise InputError(f"explicit steps are at most {LARGEST_STEP_SHARE * h * h:.3g} here, got {step:.3g}.")
    system = ck.assemble(prepared.discretized)  # u - Lap u, and the data of boundaries
    solution = prepared.solve(problem=ck.ScreenedPoisson(prepared.field(start)))
    u = prepared.discretized.project(start)
    energy, rests = [_energy(replace(solution, values=u))], False
    for done in range(1, most_steps + 1):
        u = target.closest_point(u + step * (u - system.operator.apply(u) + system.right_side)).points
        if done % STEPS_PER_ENERGY and done < most_steps:
            continue
        energy.append(_energy(replace(solution, values=u)))
        if energy[-2] - energy[-1] < rest * STEPS_PER_ENERGY * energy[-2]:
            rests = True
            break
    return replace(solution, values=u), energy, rests


def _energy(solution: Solution) -> float:
    """Return the Dirichlet energy, the integral of |grad u|^2 / 2 over all channels."""
    integral = solution.integrate(lambda points, _: 0.5 * (solution.gradient(points) ** 2).sum(axis=(1, 2)))
    return float(np.sum(integral))
