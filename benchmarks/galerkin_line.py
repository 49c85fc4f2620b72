"""What a whole solve by the Galerkin form costs on a real mesh, beside one by the collocation form, and its stages.

Run ``CPMKIT_DATA=folder python benchmarks/galerkin_line.py``; it needs ``pip install . ./plugins/cpmkit-mesh`` and the
mesh spot.obj in that folder. Solves of -Lap u + u = f from source to solution take turns, in processor time, after one
of each that compiles. Stages are those of the Galerkin form, in microseconds an unknown.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.families.steady import assemble
from cpmkit.linear.multigrid.solver import MultigridSolver

SPACING = 0.0193
FINER = (0.0193, 0.00965, 0.004825)
ROUNDS = 3
READ_POINTS = 100_000
TOLERANCES = (1e-6, 1e-8, 1e-10)


def scene(closest: str) -> ck.Scene:
    """Return the problem on Spot, moved and scaled so that its largest side is 1."""
    vertices, faces = ck.read_mesh("spot.obj")
    vertices = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max()
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest=closest)
    return ck.Scene(surface, ck.ScreenedPoisson(c=1.0, f=lambda x: np.cos(6 * x[:, 0]) + x[:, 1] * np.sin(9 * x[:, 2])))


def seconds(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time of ``work()``, and what it returns."""
    start = process_time()
    made = work()
    return process_time() - start, made


def compare(closest: str) -> None:
    """Print the processor time of solves, and of reading points, by both forms, and their ratios."""
    spent: dict[str, list[tuple[float, float]]] = {"galerkin": [], "collocation": []}
    points, sizes = None, {}
    for _ in range(ROUNDS + 1):
        for form, times in spent.items():
            one = scene(closest)
            solve, solution = seconds(lambda: ck.solve(one, SPACING, form=form))  # noqa: B023
            points = one.surface.mesh(SPACING)[0] if points is None else points
            at = points[np.arange(READ_POINTS) % len(points)]
            read, _ = seconds(lambda: solution.evaluate(at))  # noqa: B023
            times.append((solve, read))
            sizes[form] = solution.work.unknowns
    galerkin, collocation = (np.median(times[1:], axis=0) for times in spent.values())
    solve, read = collocation / galerkin
    print(f"{closest}: {sizes['galerkin']} and {sizes['collocation']} unknowns; {galerkin[0]:.2f} and", end=" ")
    print(f"{collocation[0]:.2f} s, {solve:.1f} times; read {galerkin[1]:.2f} and {collocation[1]:.2f} s, {read:.1f}")


def stages(closest: str, spacing: float) -> None:
    """Print what the stages of a solve cost at a spacing, and how solving depends on the tolerance."""
    one, times = scene(closest), {}
    times["space"], form = seconds(lambda: ck.discretize(one, spacing, form="galerkin"))
    times["system"], system = seconds(lambda: assemble(form))
    times["levels"], levels = seconds(lambda: form.levels(system.operator))
    times["cycle"], prepared = seconds(lambda: MultigridSolver().prepare(system.operator, levels))
    solved = [(tolerance, *seconds(lambda: prepared.solve(system.right_side, tolerance))) for tolerance in TOLERANCES]  # noqa: B023
    times["solve"] = solved[-1][1]
    times["telling"] = seconds(form.warnings)[0]
    print(f"{closest} {spacing}: {form.size} unknowns;", end=" ")
    print(", ".join(f"{name} {1e6 * time / form.size:.1f}" for name, time in times.items()), end="; ")
    print(f"all {1e6 * sum(times.values()) / form.size:.1f} us an unknown;", end=" ")
    exact = solved[-1][2][0]
    for tolerance, time, (u, report) in solved:
        off = np.abs(u - exact).max() / np.ptp(exact)
        print(f"to {tolerance:g} {report.iterations} steps {1e6 * time / form.size:.1f} us, off {off:.0e};", end=" ")
    print(flush=True)


def main() -> None:
    """Print all."""
    warnings.simplefilter("ignore", ck.CpmkitWarning)
    for closest in ("faceted", "smooth"):
        compare(closest)
    for spacing in FINER:
        stages("faceted", spacing)


if __name__ == "__main__":
    main()
