"""Solids by both forms: errors on corners, slabs and meshes, eigenvalues, total of heat, boundaries inside.

Run ``python benchmarks/solids.py``, which prints and writes tables/solids.md, or with ``--quick``, which prints the
rows of solids in the plane at one position. It needs ``pip install . ./plugins/*`` and this repository's folder
``tests`` beside it.

Errors are the largest at points inside, as shares of the range of u; those of eigenvalues are relative, and the total
of heat is compared with the first. Each is the worst of some positions: another lattice, and another turn of the solid.
The estimate is compared with the largest error at each position, and the lowest and the highest ratio are printed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from exact_eigenvalues import ball_eigenvalues, cube_eigenvalues  # noqa: E402
from row_tables import print_and_write  # noqa: E402
from solid_boundaries import SCENES, BoundaryScene  # noqa: E402
from solid_shapes import (  # noqa: E402
    BALL,
    CONDITIONS,
    CUBE,
    DISK,
    ELL,
    LINEAR,
    SMOOTH,
    SQUARE,
    Known,
    Solid,
    balls,
    box,
)

import cpmkit as ck  # noqa: E402
from cpmkit.errors import CpmkitError  # noqa: E402

TABLE = Path(__file__).parent / "tables" / "solids.md"
HEAD = ("solid", "data", "h", "Galerkin", "collocation", "iterations, Galerkin", "estimate over error, Galerkin")
FORMS = ("galerkin", "collocation")
#: Eigenvalues, and steps of heat.
MODES, STEPS = 10, 100
#: Thickness of the slabs, in spacings.
THIN = 0.05
SLABS = {"in the plane": (1.0,), "in space": (1.0, 1.0)}


@dataclass(frozen=True)
class Solved:
    """At one position: the error, iterations, and the estimate over the error if asked for; NaN if refused."""

    error: float
    iterations: int = 0
    ratio: float = np.nan


def solved(solid: Solid, known: Known, kind: str, spacing: float, form: str, position: int) -> Solved:
    """Solve with a condition on the whole boundary, by multigrid if the iterations and estimates are of interest."""
    source, normal, points = solid.placed(position)
    scene = ck.Scene(source, ck.ScreenedPoisson(known.load), edge=known.condition(kind, normal))
    counted = form == "galerkin" and known is SMOOTH
    options = {"solver": "multigrid"} if counted else {}
    try:
        solution = ck.solve(scene, spacing, form=form, origin=solid.origin(spacing, position), **options)
        u = known.u(points)
        error = float(np.abs(solution.evaluate(points) - u).max() / np.ptp(u))
        return Solved(error, solution.report.iterations, solution.error.of("max") / error if counted else np.nan)
    except CpmkitError:
        return Solved(np.nan)


def eigenvalue_error(solid: Solid, exact: Any, spacing: float, form: str, position: int) -> float:
    """Return the largest relative error of an eigenvalue above zero."""
    scene, origin = ck.Scene(solid.placed(position)[0], ck.Eigen(len(exact))), solid.origin(spacing, position)
    return float(np.abs(ck.solve(scene, spacing, form=form, origin=origin).eigenvalues[1:] / exact[1:] - 1).max())


def heat_drift(solid: Solid, spacing: float, form: str, position: int) -> float:
    """Return the largest change of the integral of u, over the first one, with nothing through the boundary."""
    heat = ck.Heat(lambda x: np.exp(-4 * np.sum((x - 0.3) ** 2, axis=1)), until=1.0, step=1 / STEPS, frames=10)
    scene, origin = ck.Scene(solid.placed(position)[0], heat), solid.origin(spacing, position)
    solution = ck.solve(scene, spacing, form=form, origin=origin)
    totals = np.array([frame.integrate() for frame in solution.frames])
    return float(np.abs(totals / totals[0] - 1).max())


def short(value: float) -> str:
    """Return an error for a cell, or nothing if something was refused."""
    return "" if np.isnan(value) else f"{value:.1e}"


def error_row(solid: Solid, kind: str, spacing: float, positions: int) -> list[str]:
    """Return the cells of a smooth solution's row."""
    ours, other = ([solved(solid, SMOOTH, kind, spacing, form, k) for k in range(positions)] for form in FORMS)
    return row_of(solid.name, kind, spacing, ours, other)


def row_of(name: str, data: str, spacing: float, ours: list[Solved], other: list[Solved]) -> list[str]:
    """Return the cells of a row from what both forms found at several positions."""
    errors = [short(max(one.error for one in found)) for found in (ours, other)]
    ratios = [one.ratio for one in ours]
    work = [str(max(one.iterations for one in ours)), f"{min(ratios):.2f} to {max(ratios):.2f}"]
    return [name, data, f"{spacing:g}", *errors, *work]


def worst(measure: Callable[[str, int], float], form: str, positions: int) -> float:
    """Return the largest ``measure(form, position)``, NaN if something was refused."""
    try:
        return float(np.max([measure(form, k) for k in range(positions)]))
    except CpmkitError:
        return np.nan


def patch_error(solid: Solid, spacing: float, form: str, position: int) -> float:
    """Return the error of a linear solution, the largest of all conditions."""
    return max(solved(solid, LINEAR, kind, spacing, form, position).error for kind in CONDITIONS)


def error_cases() -> Iterator[tuple[Solid, str, float, int]]:
    """Yield solids with a condition, a spacing and a number of positions."""
    for solid, spacings in ((DISK, (0.2, 0.1, 0.05)), (BALL, (0.4, 0.2, 0.1))):
        yield from ((solid, kind, h, 4) for kind in CONDITIONS for h in spacings)
    for solid, positions in ((SQUARE, 10), (ELL, 10), (CUBE, 4)):
        yield from ((solid, "Neumann", h, positions) for h in (0.2, 0.1))
    slabs = [box(f"slab {THIN:g} h thick, {at}", *sides, THIN * 0.1) for at, sides in SLABS.items()]
    for solid in (*slabs, *balls()):
        yield from ((solid, kind, 0.1, 4) for kind in ("Dirichlet", "Neumann"))


def other_cases() -> Iterator[tuple[Solid, str, float, Any]]:
    """Yield solids with what is measured, a spacing, and ``measure(form, position)``."""
    for solid, h in ((SQUARE, 0.1), (CUBE, 0.2)):
        yield solid, "linear u", h, partial(patch_error, solid, h)
    for solid, exact in ((BALL, ball_eigenvalues(MODES)), (CUBE, cube_eigenvalues(MODES))):
        yield solid, f"{MODES} eigenvalues", 0.1, partial(eigenvalue_error, solid, exact, 0.1)
    for solid, h in ((DISK, 0.1), (BALL, 0.2)):
        yield solid, f"total of heat, {STEPS} steps", h, partial(heat_drift, solid, h)


def solved_with_boundary(case: BoundaryScene, spacing: float, form: str, position: int) -> Solved:
    """Solve a scene with a boundary inside."""
    scene, exact, points = case.placed(position)
    shift = spacing * np.random.default_rng(position).uniform(0.0, 1.0, scene.surface.dim)
    try:
        own = {"solver": "multigrid", **case.options} if form == "galerkin" else {}
        solution = ck.solve(scene, spacing, form=form, origin=shift, **own)
        u = exact(points)
        errors, estimate = np.abs(solution.evaluate(points) - u) / np.ptp(u), solution.error
        error = float(case.norm(errors))
        return Solved(error, solution.report.iterations, estimate.of("max" if case.norm is np.max else "rms") / error)
    except CpmkitError:
        return Solved(np.nan)


def boundary_rows(quick: bool) -> Iterator[list[str]]:
    """Yield the cells of the rows of scenes with boundaries inside."""
    for case in SCENES:
        for spacing in case.spacings if case.placed(0)[0].surface.dim == 2 or not quick else ():
            found = [[solved_with_boundary(case, spacing, form, k) for k in range(1 if quick else 4)] for form in FORMS]
            yield row_of(case.name, case.data, spacing, *found)


def rows(quick: bool) -> Iterator[list[str]]:
    """Yield the cells of all rows, or of those in the plane at one position."""
    for solid, kind, spacing, positions in error_cases():
        if solid.source.dim == 2 or not quick:
            yield error_row(solid, kind, spacing, 1 if quick else positions)
    for solid, data, spacing, measure in other_cases():
        if solid.source.dim == 2 or not quick:
            errors = [worst(measure, form, 1 if quick else 4) for form in FORMS]
            yield [solid.name, data, f"{spacing:g}", *map(short, errors), "", ""]
    yield from boundary_rows(quick)


if __name__ == "__main__":
    print_and_write(rows, HEAD, TABLE, __doc__, "solids in the plane at one position; nothing is written")
