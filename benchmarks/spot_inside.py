"""The inside of Spot by the Galerkin form and by finite elements on tetrahedra, with about equal numbers of unknowns.

Run ``python benchmarks/spot_inside.py``, which prints and writes tables/spot-inside.md, or with ``--quick``, which
prints the smallest sizes alone. It needs ``pip install . ./plugins/* tetgen``, and CPMKIT_DATA with ``spot.obj``.

The equation is -Lap u + u = f with a known u, whose values are given on the boundary, the mesh as flat facets. Errors
are those at points inside, as shares of the range of u; times are those of the processor, over the Galerkin form's.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from row_tables import print_and_write

import cpmkit as ck

TABLE = Path(__file__).parent / "tables" / "spot-inside.md"
HEAD = ("size", "method", "h", "unknowns", "largest error", "rms error", "time over Galerkin")
GALERKIN: dict[str, Any] = {"form": "galerkin"}
LINEAR, QUADRATIC = ({"backend": "fem", "degree": degree} for degree in (1, 2))
NAMES = ("Galerkin", "linear elements", "quadratic elements")
#: Spacings of each method, by the size; quadratic elements on Spot's triangles have no fewer unknowns.
SIZES = {
    "small": (0.055, 0.05, None),
    "middle": (0.031, 0.03, 0.1),
    "large": (0.022, 0.0215, 0.05),
}
#: Points in the box of the solid, of which those inside are read.
POINTS = 20_000


def u(x: Any) -> Any:
    return np.sin(4 * x[:, 0]) * np.cos(3 * x[:, 1]) * np.exp(x[:, 2])


def f(x: Any) -> Any:
    """Minus the Laplacian of u, plus u."""
    return 25 * u(x)


def rows(quick: bool) -> Iterator[list[str]]:
    """Yield the cells of all rows, or of the smallest size."""
    mesh = ck.source("mesh.triangles", file=Path(os.environ["CPMKIT_DATA"]) / "spot.obj", closest="faceted")
    solid = ck.source("solid", of=mesh)
    points = np.random.default_rng(0).uniform(*np.asarray(solid.bounds), (POINTS, 3))
    points = points[solid.closest_point(points).edge < 0]
    scene, exact = ck.Scene(solid, ck.ScreenedPoisson(f), edge=ck.Dirichlet(u)), u(points)
    for options in (GALERKIN, LINEAR):
        ck.solve(scene, 0.1, **options)  # compiles
    for size, spacings in SIZES.items():
        first = None
        for name, options, spacing in zip(NAMES, (GALERKIN, LINEAR, QUADRATIC), spacings, strict=True):
            if spacing is None:
                continue
            start = time.process_time()
            solution = ck.solve(scene, spacing, **options)
            seconds = time.process_time() - start
            first = first or seconds
            error = np.abs(solution.evaluate(points) - exact) / np.ptp(exact)
            errors = [f"{error.max():.1e}", f"{np.sqrt(np.mean(error**2)):.1e}"]
            yield [size, name, f"{spacing:g}", f"{solution.work.unknowns}", *errors, f"{seconds / first:.2f}"]
        if quick:
            return


if __name__ == "__main__":
    print_and_write(rows, HEAD, TABLE, __doc__, "the smallest size alone; nothing is written")
