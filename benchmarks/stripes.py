"""Stripes of a reaction on a sphere that is turned in the lattice: from which spacing on do they follow its axes.

The reaction is that of Barrio, Varea, Aragon and Maini (1999), which grows stripes. The pattern's length is
2 pi |u - mean| / |grad u|, in root mean squares. Directions are those of grad u. A wave that goes along direction g has
sum g_i^4 = 1 along an axis of the lattice and less elsewhere; in a tangent plane with normal n all directions together
have 3/8 sum (1 - n_i^2)^2. The difference of the two, weighed by |grad u|^2, is the `alignment`: .25 at most in a plane
of two axes. Where the lattice is not felt, the same initial data grow to the same pattern however the sphere is turned.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import cpmkit as ck

ALPHA, BETA, CUBIC = 0.899, -0.91, 3.5
KAPPA, UNTIL, STEP, TURNS = 0.004, 300.0, 1.5, 2
SPACINGS = {"galerkin": (0.31, 0.26, 0.2, 0.14), "collocation": (0.2, 0.14, 0.1)}


def reaction(u: Any) -> Any:
    """Return rates (p, 2) that grow stripes."""
    cubic = ALPHA * CUBIC * u[:, 0] * u[:, 1] ** 2
    return np.stack([ALPHA * u[:, 0] + u[:, 1] - cubic, BETA * u[:, 1] - ALPHA * u[:, 0] + cubic], axis=1)


def noise(turn: Any) -> Callable[[Any], Any]:
    """Return waves of all directions that turn with the sphere."""
    rng = np.random.default_rng(3)
    waves = rng.normal(size=(2, 60, 3))
    waves *= 9 / np.linalg.norm(waves, axis=2, keepdims=True)
    phases = rng.uniform(0, 2 * np.pi, (2, 60))
    return lambda x: 0.3 * np.cos(np.einsum("pd,cwd->pcw", x @ turn, waves) + phases).mean(axis=2)


def grown(form: str, spacing: float, turn: Any) -> ck.Solution:
    """Return the pattern that has grown on the sphere turned by ``turn`` (3, 3)."""
    problem = ck.ReactionDiffusion(noise(turn), reaction, kappa=[0.516 * KAPPA, KAPPA], until=UNTIL, step=STEP)
    scene = ck.Scene(ck.source("analytic.sphere"), problem)
    return ck.solve(scene, spacing, form=form, solver_tolerance=1e-6, estimate=False)


def points_of_sphere(count: int) -> Any:
    """Return (count, 3) points spread over the sphere."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def pattern(solution: ck.Solution, points: Any) -> tuple[float, float]:
    """Return the length of the first channel's pattern and its alignment."""
    u, slopes = solution.evaluate(points)[:, 0], solution.gradient(points)[:, 0]
    weights = (slopes**2).sum(axis=1)
    along = (slopes**4).sum(axis=1) / np.maximum(weights, 1e-300) ** 2
    isotropic = 3 / 8 * ((1 - points**2) ** 2).sum(axis=1)
    length = 2 * np.pi * float(np.sqrt(u.var() / weights.mean()))
    return length, float((weights * (along - isotropic)).sum() / weights.sum())


def main() -> None:
    """Print a row a form and spacing."""
    turns = [np.eye(3), *Rotation.random(TURNS - 1, random_state=0).as_matrix()]
    points = points_of_sphere(20_000)
    print(
        "| form | h | unknowns | length of the pattern over h | alignment of each turn | patterns differ by, % | told |"
    )
    print("|---|--:|--:|--:|---|--:|---|")
    for form, spacings in SPACINGS.items():
        for spacing in spacings:
            runs = [grown(form, spacing, turn) for turn in turns]
            found = [pattern(one, points) for one in runs]
            body = [one.evaluate(points @ turn.T)[:, 0] for one, turn in zip(runs, turns, strict=True)]
            off = [np.sqrt(((one - body[0]) ** 2).mean() / body[0].var()) for one in body[1:]]
            told = any("spacings long" in sentence for one in runs for sentence in one.warnings)
            alignments = ", ".join(f"{alignment:+.3f}" for _, alignment in found)
            length = float(np.mean([length for length, _ in found])) / spacing
            row = f"| {form} | {spacing} | {runs[0].work.unknowns:,} | {length:.2g} | {alignments} "
            print(f"{row}| {100 * max(off):.0f} | {'yes' if told else 'no'} |", flush=True)


if __name__ == "__main__":
    main()
