"""Velocities by both forms: smooth solutions and layers at outflow at every cell number, and what the iteration takes.

Run ``python benchmarks/velocities.py``; it needs ``pip install . ./plugins/*``. It prints the tables of
tables/velocities.md and tables/velocities-iterations.md. The cell number is |v| h / a. ``--large`` adds
300,000 unknowns.
"""

from __future__ import annotations

import sys
import warnings
from time import process_time

import numpy as np

import cpmkit as ck
from cpmkit.errors import CpmkitError
from cpmkit.studies.tables import table_row, table_rule
from cpmkit.types import Floats

AXIS = np.array([1.0, 2.0, 2.0]) / 3
SPHERE, CIRCLE = ck.source("analytic.sphere"), ck.source("analytic.circle")
CELL_NUMBERS, SPACINGS, POSITIONS = (0.1, 1, 10, 100), (0.2, 0.1, 0.05), 4


def u(x: Floats) -> Floats:
    """Return the smooth solution, x y + z."""
    return x[:, 0] * x[:, 1] + x[:, 2]


def turning(speed: float) -> ck.Scene:
    """Return a velocity about an axis of the sphere, with the solution u."""

    def v(x: Floats) -> Floats:
        return speed * np.cross(AXIS, x)

    def f(x: Floats) -> Floats:
        slope = np.stack([x[:, 1], x[:, 0], np.ones(len(x))], axis=1)
        return 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2] + np.sum(v(x) * slope, axis=1)

    return ck.Scene(SPHERE, ck.Elliptic(f, velocity=v, c=1.0))


def with_layer(speed: float) -> ck.Scene:
    """Return a circle cut at a point where u = 0: the angle, and a layer where v arrives."""

    def v(x: Floats) -> Floats:
        return speed * np.stack([-x[:, 1], x[:, 0]], axis=1)

    cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), both=ck.Dirichlet(0.0))
    return ck.Scene(CIRCLE, ck.Elliptic(speed, velocity=v), [cut])


def smooth_error(cell_number: float, h: float, form: str) -> str:
    """Return the rms and the greatest error over positions of the lattice, or what refused it."""
    points = np.random.default_rng(0).normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    scene, errors = turning(cell_number / h), []
    for position in range(POSITIONS):
        origin = h * np.random.default_rng(position).random(3)
        try:
            errors.append(ck.solve(scene, h, origin=origin, form=form).evaluate(points) - u(points))
        except CpmkitError:
            return "refused"
    return f"{np.sqrt(np.mean(np.square(errors))):.1e}, {np.abs(errors).max():.1e}"


def overshoot(cell_number: float, h: float, form: str) -> str:
    """Return by how much u leaves its range, and its error three spacings off the cut, in percent of the range."""
    t, scene, found = np.linspace(1e-4, 2 * np.pi - 1e-4, 2000), with_layer(cell_number / h), []
    points = np.stack([np.cos(t), np.sin(t)], axis=1)
    for position in range(POSITIONS):
        origin = h * np.random.default_rng(position).random(2)
        try:
            found.append(ck.solve(scene, h, origin=origin, form=form).evaluate(points))
        except CpmkitError:
            return "refused"
    left = max(np.max(found) - 2 * np.pi, -np.min(found), 0.0) / (2 * np.pi)
    speed = cell_number / h
    exact = t - 2 * np.pi * np.exp(speed * (t - 2 * np.pi)) * np.expm1(-speed * t) / np.expm1(-2 * np.pi * speed)
    off = np.abs(np.array(found) - exact)[:, t < 2 * np.pi - 3 * h].max() / (2 * np.pi)
    return f"{100 * left:.2f}, {100 * off:.2f}"


def iterations(h: float) -> list[str]:
    """Return unknowns, iterations and CPU seconds of the solver multigrid at every cell number."""
    cells = []
    for cell_number in CELL_NUMBERS:
        prepared = ck.prepare(turning(cell_number / h), h, solver="multigrid")
        started = process_time()
        report = prepared.solve().report
        cells.append(f"{report.iterations}, {process_time() - started:.1f}")
    return [f"{prepared.discretized.size:,}", *cells]


def main() -> None:
    """Print the tables."""
    warnings.simplefilter("ignore")
    numbers = [f"{one:g}" for one in CELL_NUMBERS]
    print(table_row(["problem", "form", "spacing", *numbers]))
    print(table_rule(2, 1 + len(numbers)))
    for name, measured in (("smooth: rms, greatest error", smooth_error), ("layer: overshoot, error, %", overshoot)):
        for form in ("collocation", "galerkin"):
            for h in SPACINGS:
                print(table_row([name, form, f"{h:g}", *(measured(one, h, form) for one in CELL_NUMBERS)]), flush=True)
    print()
    print(table_row(["unknowns", *numbers]))
    print(table_rule(0, 1 + len(numbers)))
    for h in (0.1, 0.05, 0.025, *([0.0137] if "--large" in sys.argv else [])):
        print(table_row(iterations(h)), flush=True)


if __name__ == "__main__":
    main()
