"""How near ``explain(..., seconds=True)`` comes: seconds, unknowns and bytes foretold over those of the solve.

A second table compares the bytes that small solves to a tolerance foretold with those that the system counted.

Run ``python benchmarks/seconds_foretold.py``, some minutes; it needs ``pip install . ./plugins/*``, Linux for bytes,
and, for Spot, ``CPMKIT_DATA`` set to the folder of the mesh. On a busy machine ratios of seconds say little.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

import cpmkit as ck
from cpmkit.runtime.memory import peak_growth_bytes, reset_peak_memory
from cpmkit.studies.tables import table_row, table_rule


def scenes() -> Iterator[tuple[str, ck.Scene, tuple[float, ...]]]:
    """Yield scenes and the spacings of their solves."""
    ball = ck.source("analytic.sphere")
    yield "sphere", ck.Scene(ball, ck.ScreenedPoisson(lambda x: x[:, 1] * x[:, 2])), (0.25, 0.12, 0.08, 0.04, 0.025)
    ring = ck.source("analytic.circle", normal=[0, 0, 1])
    cut = ck.Boundary("ring", ring, left=ck.Dirichlet(1), right=ck.Dirichlet(lambda x: x[:, 0]))
    yield "two-sided", ck.Scene(ball, ck.ScreenedPoisson(lambda x: x[:, 1]), [cut]), (0.08, 0.04, 0.025)
    vertices, faces = ck.read_mesh("spot.obj")
    vertices = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max()
    spot = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    yield "spot", ck.Scene(spot, ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0]))), (0.03, 0.015, 0.01)


def to_a_tolerance() -> Iterator[tuple[str, ck.Scene]]:
    """Yield scenes that are solved to a tolerance of two percent."""
    ball, ring = ck.source("analytic.sphere"), ck.source("analytic.circle", normal=[0, 0, 1])
    cut = ck.Boundary("ring", ring, left=ck.Dirichlet(1), right=ck.Dirichlet(lambda x: x[:, 0]))
    yield "two-sided", ck.Scene(ball, ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0])), [cut])
    level = ck.source("levelset.expression", phi="x*x + y*y + z*z - 1", bounds=[[-1.2] * 3, [1.2] * 3])
    yield "level set", ck.Scene(level, ck.ScreenedPoisson(lambda x: 7 * x[:, 0] * x[:, 1]))
    yield "steps", ck.Scene(ball, ck.Heat(lambda x: x[:, 2], until=0.1, step=0.02))


def main() -> None:
    """Print the tables."""
    print(table_row(["", "spacing", "unknowns", "seconds", "unknowns foretold over true", "bytes", "seconds"]))
    print(table_rule(1, 6), flush=True)
    for name, scene, spacings in scenes():
        for spacing in spacings:
            told = ck.explain(scene, spacing, seconds=True)
            before, started = reset_peak_memory(), time.perf_counter()
            solution = ck.solve(scene, spacing)
            spent, used = time.perf_counter() - started, peak_growth_bytes(before)
            size = solution.discretized.size
            ratios = [told.unknowns / size, told.bytes / used if used else np.nan, (told.seconds or np.nan) / spent]
            cells = [name, f"{spacing:g}", f"{size:,}", f"{spent:.2f}", *(f"{one:.2f}" for one in ratios)]
            print(table_row(cells), flush=True)
    print()
    print(table_row(["to 2 %", "bytes"]))
    print(table_rule(1, 1), flush=True)
    for name, scene in to_a_tolerance():
        ck.solve(scene, tolerance=0.3)  # what is compiled or read for the first time is no table
        before = reset_peak_memory()
        trade = ck.solve(scene, tolerance=0.02).solve_history
        used = peak_growth_bytes(before)
        assert trade is not None
        print(table_row([name, f"{trade.predicted_bytes / used:.2f}" if used else "nan"]), flush=True)


if __name__ == "__main__":
    main()
