"""Implicit steps to a harmonic map: backward Euler, each put back to the target, none that raises or tears the map.

What a step takes off the target, the normal part n of Lap u, is known from the step before, and added to the next one,

    (u* - u) / step = Lap u* + n,    u_next = cp(u*),    n_next = normal part of n + (u_next - u*) / step,

as the pressure of a fluid is. Without it what comes to rest is off by an amount in proportion to the step. Steps longer
than about a third of the square of half the manifold's size make it swing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import cpmkit as ck
from cpmkit.facade import Solution
from cpmkit.preparing import Prepared
from cpmkit.protocols import ClosestPointSource, Floats
from cpmkit.runtime.messages import warn_each

#: A step raises the energy where it grows by more than this share of itself: rounding and projections are below.
RISING_SHARE = 1e-6
#: A projection that makes the energy so many times what it was jumps between parts of the target, as between legs that
#: are thin for the step; below the other, steps are doubled.
TORN_RATIO, SMOOTH_RATIO = 1.1, 1.01
#: A map that covers a closed target has no energy below its area, but for the error of the lattice.
COVERING_SHARE = 0.99
#: Steps begin at the spacing's square, and are no shorter than this share of it.
LEAST_SHARE = 0.01
UNCOVERED = (
    "The next step would lower the energy to {:.4g}, below the area {:.4g} that the map covers: the lattice is too "
    "coarse for thin parts of the target, and the map would come off them. The map before it is returned; hold the "
    "ends of thin parts by landmarks, or use a smaller spacing."
)
#: Between two closest points whose difference tells what is tangential, over the target's size.
DIFFERENCE_SHARE = 1e-4


@dataclass(frozen=True, eq=False)
class _State:
    """A map between two steps: its points on the target (p, k), the normal part of Lap u there, and its energy.

    ``made`` is the energy over that before the projection.
    """

    points: ck.Field
    normal: Floats
    energy: float
    solution: Solution | None = None
    made: float = 1.0


def implicit_flow(
    prepared: Prepared,
    target: ClosestPointSource,
    start: Floats,
    step: float,
    most_steps: int,
    rest: float,
    covering: float,
) -> tuple[Solution, list[float], bool]:
    """Take steps until the energy rests, short ones first; one that would raise or tear the map is taken again.

    Not the first one where something is held: the initial map need not meet it.
    """
    points = prepared.field(start).projected().project(target)
    state = _State(points, np.zeros_like(start), points.energy())
    length = min(step, prepared.discretized.spacing**2)
    least, energy, rests = LEAST_SHARE * length, [state.energy], False
    while len(energy) <= most_steps and not rests:
        later = _advanced(prepared, target, state, length)
        free = state.solution is None and bool(prepared.scene.boundaries)
        fall = 1.0 if free or state.energy == 0 else 1 - later.energy / state.energy
        if (fall < -RISING_SHARE or (later.made > TORN_RATIO and not free)) and length > least:
            length *= 0.5
            continue
        if later.energy < COVERING_SHARE * covering and state.solution is not None:
            warn_each([UNCOVERED.format(later.energy, covering)])
            return state.solution, energy, False
        state, rests = later, abs(fall) < rest and length >= min(step, prepared.discretized.spacing**2)
        energy.append(state.energy)
        if later.made < SMOOTH_RATIO:
            length = min(2 * length, step)
    assert state.solution is not None
    return state.solution, energy, rests


def _advanced(prepared: Prepared, target: ClosestPointSource, state: _State, step: float) -> _State:
    """Return the map one step of backward Euler later."""
    pushed = prepared.field(state.points.values / step + state.normal)
    solution = prepared.solve(problem=ck.ScreenedPoisson(pushed, c=1 / step), guess=state.solution)
    reached = prepared.field(solution)
    points = reached.project(target)
    normal = state.normal + (points.columns - reached.columns) / step
    normal -= _tangential(target, points.columns, normal)
    energy = points.energy()
    return _State(points, normal, energy, solution, energy / max(reached.energy(), np.finfo(float).tiny))


def _tangential(target: ClosestPointSource, points: Floats, vectors: Floats) -> Floats:
    """Return the tangential parts of ``vectors`` at points of the target: how closest points move with the query."""
    step = DIFFERENCE_SHARE * float(np.ptp(target.bounds, axis=0).max())
    longest = float(np.linalg.norm(vectors, axis=1).max(initial=0.0))
    if longest == 0.0:
        return np.zeros_like(vectors)
    shift = step / longest * vectors
    ahead, behind = (target.closest_point(points + sign * shift).points for sign in (1.0, -1.0))
    return np.asarray((ahead - behind) * (longest / (2 * step)))
