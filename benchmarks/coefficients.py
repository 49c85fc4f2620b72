"""Diffusivities that vary, jump, conduct along directions, or depend on u: errors, steps and iterations.

Run ``python benchmarks/coefficients.py``, or with the spacings behind it; it needs ``pip install . ./plugins/*``. It
prints the tables of tables/coefficients.md, on the unit sphere with exact solutions: root mean squares of the
error over 2,000 points and four positions of the grid, over the solution's range. Right-hand sides are in closed form.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.types import Floats

SPHERE = ck.source("analytic.sphere")
#: Positions of the grid.
POSITIONS = 4
#: Slope and constant of the solution that is linear in space.
W, MEAN = np.array([0.3, 1.0, -0.5]), 0.4
#: The direction along which tensors conduct better.
E = np.array([1.0, 0.7, 0.3]) / np.linalg.norm([1.0, 0.7, 0.3])
#: Height of the circle at which the diffusivity jumps, and by how much.
HEIGHT, JUMP = 0.3, 3000.0
RING = ck.source("analytic.circle", center=[0, 0, HEIGHT], normal=[0, 0, 1], radius=np.sqrt(1 - HEIGHT**2))
#: The slope below which p-Laplacians are regular.
REGULAR = 0.1


@dataclass(frozen=True)
class Case:
    """A problem with its solution."""

    problem: Any
    u: Callable[[Floats], Floats]
    boundaries: tuple[Any, ...] = ()


def linear(x: Floats) -> Floats:
    """Return u = W . x + MEAN; on the unit sphere |grad u|^2 = |W|^2 - (W . x)^2 and Lap u = -2 W . x."""
    return np.asarray(x @ W + MEAN)


def varying(a: Callable[[Floats], Floats], slope: Callable[[Floats], Floats]) -> Case:
    """Return the case of a(y), ``slope`` (n, 3) its gradient in space, for the linear solution and c = 1."""

    def f(x: Floats) -> Floats:
        tangential = W - (x @ W)[:, None] * x
        return np.asarray(2 * a(x) * (x @ W) - np.sum(slope(x) * tangential, axis=1) + linear(x))

    return Case(ck.Elliptic(f, diffusivity=a, c=1.0), linear)


def oscillating() -> Case:
    """Return a = 1 + .9 sin(40 x)."""
    return varying(
        lambda x: 1 + 0.9 * np.sin(40 * x[:, 0]),
        lambda x: np.stack([36 * np.cos(40 * x[:, 0]), 0 * x[:, 0], 0 * x[:, 0]], axis=1),
    )


def contrast() -> Case:
    """Return a = exp(4 sin(3 x + 2 y)), which spans 3000."""

    def a(x: Floats) -> Floats:
        return np.asarray(np.exp(4 * np.sin(3 * x[:, 0] + 2 * x[:, 1])))

    def slope(x: Floats) -> Floats:
        rate = 4 * np.cos(3 * x[:, 0] + 2 * x[:, 1]) * a(x)
        return np.stack([3 * rate, 2 * rate, 0 * rate], axis=1)

    return varying(a, slope)


def jump() -> Case:
    """Return a = 1 above a circle and 3000 below it: u = z / a, continued across; a du/dz is 1 everywhere."""

    def below(x: Floats) -> Any:
        return x[:, 2] < HEIGHT

    def a(x: Floats) -> Floats:
        return np.where(below(x), JUMP, 1.0)

    def u(x: Floats) -> Floats:
        return np.where(below(x), HEIGHT + (x[:, 2] - HEIGHT) / JUMP, x[:, 2])

    problem = ck.Elliptic(lambda x: 2 * x[:, 2] + u(x), diffusivity=a, c=1.0)
    return Case(problem, u, (ck.Boundary("ring", RING, across=ck.Transmission()),))


def tensor(ratio: float) -> Case:
    """Return A = I + (ratio - 1) e e'."""
    A = np.eye(3) + (ratio - 1) * np.outer(E, E)

    def f(x: Floats) -> Floats:
        along, inside = x @ W, np.sum(x * (x @ A), axis=1)
        mixed = x @ A @ W
        return np.asarray(mixed - along * inside + along * (np.trace(A) - inside) + 2 * (mixed - along * inside))

    return Case(ck.Elliptic(lambda x: f(x) + linear(x), diffusivity=A, c=1.0), linear)


def of_value() -> Case:
    """Return a = 1 + u^2: -div(a grad u) = 2 a W . x - a' |grad u|^2."""

    def f(x: Floats) -> Floats:
        u, squares = linear(x), W @ W - (x @ W) ** 2
        return np.asarray(2 * (1 + u**2) * (x @ W) - 2 * u * squares + u)

    return Case(ck.NonlinearDiffusion(lambda u: 1 + u**2, f, c=1.0), linear)


def p_laplacian(p: float) -> Case:
    """Return a = (s^2 + r^2)^((p - 2)/2): -div(a grad u) = (2 a + s da/ds) W . x."""

    def f(x: Floats) -> Floats:
        squares = W @ W - (x @ W) ** 2
        a = (squares + REGULAR**2) ** (p / 2 - 1)
        rate = (p - 2) * squares * (squares + REGULAR**2) ** (p / 2 - 2)
        return np.asarray((2 * a + rate) * (x @ W) + linear(x))

    return Case(ck.PLaplacian(p, f, 1.0, regularization=REGULAR), linear)


def error(case: Case, spacing: float, **options: Any) -> tuple[float, Any]:
    """Return the error over four positions of the grid, and the last solution."""
    generator = np.random.default_rng(0)
    points = generator.normal(size=(2000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    exact, squares = case.u(points), []
    scene = ck.Scene(SPHERE, case.problem, case.boundaries)
    for _ in range(POSITIONS):
        solution = ck.solve(scene, spacing, origin=spacing * generator.uniform(size=3), **options)
        squares.append(np.mean((solution.evaluate(points) - exact) ** 2))
    return float(np.sqrt(np.mean(squares)) / np.ptp(exact)), solution


def both_forms(spacings: Sequence[float]) -> None:
    """Print the table of numbers that vary and jump."""
    cases = {
        "1 + 0.9 sin(40 x)": oscillating(),
        "exp(4 sin(3 x + 2 y)), contrast 3000": contrast(),
        "1 above a circle, 3000 below": jump(),
    }
    print('| diffusivity | spacing | collocation | Galerkin | Galerkin, `stabilisation="accurate"` |')
    print("|---|--:|--:|--:|--:|")
    for name, case in cases.items():
        for spacing in spacings:
            row = [error(case, spacing, form="collocation")[0], error(case, spacing, form="galerkin")[0]]
            row.append(error(case, spacing, form="galerkin", stabilisation="accurate")[0])
            print(f"| {name} | {spacing:g} | {' | '.join(f'{one:.1e}' for one in row)} |", flush=True)


def galerkin_alone(spacings: Sequence[float]) -> None:
    """Print the table of tensors and of what depends on u."""
    cases = {f"tensor {ratio:g}:1": tensor(ratio) for ratio in (1, 10, 100, 1000)}
    cases["1 + u^2"] = of_value()
    cases |= {f"p-Laplacian, p = {p:g}": p_laplacian(p) for p in (1.5, 3.0, 4.0)}
    print("| diffusivity | spacing | error | steps | iterations |")
    print("|---|--:|--:|--:|--:|")
    for name, case in cases.items():
        for spacing in spacings:
            found, solution = error(case, spacing, solver="multigrid")
            steps = len(getattr(solution, "history", ())) or "linear"
            print(f"| {name} | {spacing:g} | {found:.1e} | {steps} | {solution.report.iterations} |", flush=True)


if __name__ == "__main__":
    target = [float(one) for one in sys.argv[1:]] or [0.2, 0.1, 0.05]
    both_forms(target)
    print()
    galerkin_alone(target)
