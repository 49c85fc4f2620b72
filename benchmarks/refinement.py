"""Splines that are finer where the solution asks for it, against one spacing everywhere: unknowns at equal error.

Run ``python benchmarks/refinement.py``; it needs ``pip install . ./plugins/*``. It prints the table of
tables/refinement.md. The uniform spacing is halved until the error is below that of the refined solution, once
more than its levels at most; the unknowns at equal error follow from the last two, on logarithms. The last column is
the time of the finest uniform one.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from time import process_time

import numpy as np

import cpmkit as ck
from cpmkit.errors import CpmkitError
from cpmkit.facade import Solution
from cpmkit.studies.tables import table_row, table_rule
from cpmkit.types import Floats

SPHERE = ck.source("analytic.sphere")
CENTRE = np.array([0.6, 0.48, 0.64])
TURN = np.array([[0.96, -0.28, 0], [0.28, 0.96, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
HEAD = ("case", "levels", "unknowns", "uniform, of equal error", "gain", "error", "iterations", "time, s", "uniform, s")

Case = tuple[ck.Scene, Callable[[Floats], Floats], Floats]


def spike(width: float) -> Case:
    """Return a spike of this width on the unit sphere: the solution, and so nearly the load, is a narrow Gaussian."""
    k = width**-2

    def u(x: Floats) -> Floats:
        return np.exp(-k * (1 - x @ CENTRE / np.linalg.norm(x, axis=1)))

    def f(x: Floats) -> Floats:
        s = x @ CENTRE / np.linalg.norm(x, axis=1)
        return u(x) * (1 - (1 - s * s) * k * k + 2 * s * k)

    points = np.random.default_rng(0).normal(size=(4000, 3))
    points[:2000] = CENTRE + 0.8 * width * points[:2000]
    points /= np.linalg.norm(points, axis=1)[:, None]
    return ck.Scene(SPHERE, ck.ScreenedPoisson(f, c=1.0)), u, points


def layer(width: float) -> Case:
    """Return a layer of this width along the equator of the unit sphere, between -1 and 1."""

    def u(x: Floats) -> Floats:
        return np.tanh(x[:, 2] / np.linalg.norm(x, axis=1) / width)

    def f(x: Floats) -> Floats:
        z = x[:, 2] / np.linalg.norm(x, axis=1)
        slope = (1 - u(x) ** 2) / width
        return u(x) + (1 - z * z) * 2 * u(x) * slope / width + 2 * z * slope

    points = np.random.default_rng(0).normal(size=(4000, 3))
    points[:2000, 2] *= width
    points /= np.linalg.norm(points, axis=1)[:, None]
    return ck.Scene(SPHERE, ck.ScreenedPoisson(f, c=1.0)), u, points


def slit(value: bool) -> Case:
    """Return a turned plate with a slit to its middle, and the root of the distance: with a value there, or no flux."""

    def u(x: Floats) -> Floats:
        y = x @ TURN
        half = np.arctan2(y[:, 1], y[:, 0]) / 2
        return np.sqrt(np.hypot(y[:, 0], y[:, 1])) * (np.cos(half) if value else np.sin(half))

    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]) @ TURN.T
    plate = ck.source("mesh.triangles", vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]), closest="faceted")
    line = ck.source("mesh.polyline", points=np.array([[-1, 0, 0], [-0.5, 0, 0], [0, 0, 0.0]]) @ TURN.T)
    held = ck.Dirichlet(0.0) if value else ck.Neumann(0.0)
    scene = ck.Scene(plate, ck.Laplace(), [ck.Boundary("slit", line, both=held)], edge=ck.Dirichlet(u))
    y = np.random.default_rng(0).uniform(-0.95, 0.95, size=(4000, 2))
    y[:2000] *= 0.1
    return scene, u, np.column_stack([y, np.zeros(len(y))])[np.abs(y[:, 1]) > 1e-3] @ TURN.T


CASES = {
    "end of a slit, no flux": (slit(False), 0.2, 3),
    "end of a slit, a value": (slit(True), 0.2, 3),
    "spike of width 0.05": (spike(0.05), 0.2, 2),
    "spike of width 0.02": (spike(0.02), 0.1, 2),
    "layer of width 0.05": (layer(0.05), 0.1, 2),
}


def measured(case: Case, spacing: float, **options: object) -> tuple[Solution, float, float]:
    """Return the solution at a spacing, its error and the processor time that it took."""
    scene, u, points = case
    started = process_time()
    solution = ck.solve(scene, spacing, solver="multigrid", **options)
    taken = process_time() - started
    return solution, float(np.sqrt(np.mean((solution.evaluate(points) - u(points)) ** 2))), taken


def row(name: str) -> list[str]:
    """Return a row of the table."""
    case, spacing, levels = CASES[name]
    solution, error, taken = measured(case, spacing, refine="auto", refine_levels=levels)
    sizes = solution.discretization()["refined_levels"]
    last: tuple[int, float] | None = None
    for halvings in range(1, levels + 2):
        uniform, theirs, longer = measured(case, spacing / 2**halvings)
        size = uniform.work.unknowns
        if theirs <= error or halvings == levels + 1:
            break
        last = size, theirs
    equal = float(size)
    if last is not None:
        order = math.log(last[1] / theirs) / math.log(size / last[0])
        equal = size * (theirs / error) ** (1 / order)
    unknowns = sum(sizes)
    return [
        name,
        " + ".join(f"{one:,}" for one in sizes),
        f"{unknowns:,}",
        f"{equal:,.0f}",
        f"{equal / unknowns:.1f}",
        f"{error:.2g}",
        str(solution.report.iterations),
        f"{taken:.1f}",
        f"{longer:.1f}",
    ]


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore", CpmkitError)
    print(table_row(HEAD))
    print(table_rule(2, len(HEAD) - 2))
    for name in CASES:
        print(table_row(row(name)), flush=True)


if __name__ == "__main__":
    main()
