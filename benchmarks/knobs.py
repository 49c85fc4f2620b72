"""What the knobs of the Galerkin form cost and gain: degree, stabilisation and samples, on the sphere and a torus.

Run ``python benchmarks/knobs.py``, or with the spacings behind it; it needs ``pip install . ./plugins/cpmkit-analytic``
and takes three minutes. It prints the table of tables/knobs.md, from which ``CUBIC_ERROR`` follows, below which
``tolerance=`` chooses degree 3 (cpmkit/accuracy/spacing_search.py, tests/accuracy/test_degree_choice.py). Solutions are
in closed form, errors root mean squares over the samples, of a solution with range about 1; processor times are of a
whole solve on one thread, after one that compiles.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.types import Floats

SPACINGS = (0.2, 0.1, 0.05)
DEGREES = (1, 2, 3)
#: Options of a row, beside the degree.
KNOBS = ({}, {"stabilisation": "accurate"}, {"samples": "plain"})
#: The radii of the torus.
MAJOR, MINOR = 1.0, 0.4


def on_sphere(x: Floats) -> tuple[Floats, Floats]:
    """Return u = 5 x y z and -Lap u + u at points (n, 3) near the unit sphere."""
    u = 5 * np.prod(x / np.linalg.norm(x, axis=1)[:, None], axis=1)
    return u, 13 * u


def on_torus(x: Floats) -> tuple[Floats, Floats]:
    """Return u = sin 2p cos t / 2, p around the axis and t around the core, and -Lap u + u."""
    axis = np.hypot(x[:, 0], x[:, 1])
    p, t = np.arctan2(x[:, 1], x[:, 0]), np.arctan2(x[:, 2], axis - MAJOR)
    width = MAJOR + MINOR * np.cos(t)
    u = 0.5 * np.sin(2 * p) * np.cos(t)
    across = 0.5 * np.sin(2 * p) * (-np.cos(t) / MINOR**2 + np.sin(t) ** 2 / (MINOR * width))
    return u, 4 * u / width**2 - across + u


def measured(
    name: str, surface: object, exact: Callable[[Floats], tuple[Floats, Floats]], h: float, **knobs: Any
) -> str:
    """Return a row of the table."""
    scene = ck.Scene(surface, ck.ScreenedPoisson(lambda x: exact(x)[1], c=1.0))
    start = process_time()
    solution = ck.solve(scene, h, form="galerkin", solver="multigrid", **knobs)
    seconds, work = process_time() - start, solution.work
    form = solution.discretized
    error = solution.evaluate(form.points).ravel() - exact(form.points)[0]
    rms = np.sqrt(form.point_weights @ error**2 / form.point_weights.sum())
    said = ", ".join(f'`{key}="{value}"`' for key, value in knobs.items() if key != "degree")
    counts = f"{work.unknowns:,} | {work.nonzeros / work.unknowns:.0f} | {work.samples / work.unknowns:.0f}"
    first = f"| {name} | {h:g} | {knobs['degree']} | {said or 'as they are'}"
    return f"{first} | {counts} | {solution.report.iterations} | {seconds:.2f} | {rms:.1e} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("spacings", nargs="*", type=float, help="in place of the usual ones")
    target = parser.parse_args()
    os.environ["CPMKIT_THREADS"] = "1"
    spacings = target.spacings or SPACINGS
    torus = ck.source("analytic.torus", major=MAJOR, minor=MINOR)
    shapes = (("sphere", ck.source("analytic.sphere"), on_sphere), ("torus", torus, on_torus))
    print("| surface | spacing | degree | other knobs | unknowns | entries | samples | iterations | seconds | error |")
    print("|---|--:|--:|---|--:|--:|--:|--:|--:|--:|")
    for name, surface, exact in shapes:
        for degree in DEGREES:
            for knobs in KNOBS:
                measured(name, surface, exact, SPACINGS[0], degree=degree, **knobs)
        for h in spacings:
            for degree in DEGREES:
                for knobs in KNOBS:
                    print(measured(name, surface, exact, h, degree=degree, **knobs), flush=True)


if __name__ == "__main__":
    main()
