"""The paper's explicit flow of harmonic maps, for comparison: u_next = cp(u + step Lap u) at each node.

King et al. (2024), eq. 24. Steps are bound by the square of the spacing, whatever is left to do.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import cpmkit as ck
from cpmkit.errors import InputError
from cpmkit.facade import Solution
from cpmkit.preparing import Prepared
from cpmkit.protocols import ClosestPointSource, Floats
from cpmkit.runtime.arrays import positive

#: The step over the spacing's square, and the largest at which steps are stable.
STEP_SHARE, LARGEST_STEP_SHARE = 0.1, 1 / 6
#: The energy is integrated after so many steps, and judged by the mean fall of one.
STEPS_PER_ENERGY = 50


def explicit_flow(
    prepared: Prepared, target: ClosestPointSource, start: Floats, step: float | None, most_steps: int, rest: float
) -> tuple[Solution, list[float], bool]:
    """Return the map at the end, energies, and whether it rests; arguments as of the implicit flow.

    Raises
    ------
    InputError
        If the form is not ``collocation``, or the step too long.
    """
    h = prepared.discretized.spacing
    step = STEP_SHARE * h * h if step is None else positive(step, "step")
    if prepared.discretized.form != "collocation":
        raise InputError("explicit steps are taken in the form 'collocation'; use method='implicit' in others.")
    if step > LARGEST_STEP_SHARE * h * h:
        raise InputError(f"explicit steps are at most {LARGEST_STEP_SHARE * h * h:.3g} here, got {step:.3g}.")
    system = ck.assemble(prepared.discretized)  # u - Lap u, and what boundaries add
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
    """Return the integral of |grad u|^2 / 2."""
    found = solution.integrate(lambda points, _: 0.5 * (solution.gradient(points) ** 2).sum(axis=(1, 2)))
    return float(np.sum(found))
