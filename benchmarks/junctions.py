"""Members of different dimension that meet, by both forms: errors, iterations, estimates, and the total of heat.

Run ``python benchmarks/junctions.py``, which prints and writes tables/junctions.md, or with ``--quick``, which prints
the rows of scenes in the plane at one position. It needs ``pip install . ./plugins/*`` and this repository's folder
``tests`` beside it.

Errors are the largest on all members, as shares of the range of u; in a ball with a circle those of v, and of u at more
than .3 from the circle. Those of rods are relative: of v half way and at .05 from the joint. The total of heat is
compared with the first. Each is the worst of four positions: the first has parts of the scene in planes of the lattice,
the second is along its axes, the others are turned. The estimate is compared with the largest error at each position,
and the lowest and the highest ratio are printed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from junction_scenes import CURVES, Case, arms, ball, disk, line, ring, rod, spoke, vessel, warm  # noqa: E402
from row_tables import print_and_write  # noqa: E402

import cpmkit as ck  # noqa: E402

TABLE = Path(__file__).parent / "tables" / "junctions.md"
HEAD = ("members", "data", "h", "Galerkin", "collocation", "iterations, Galerkin", "estimate over error, Galerkin")
FORMS = ("galerkin", "collocation")
POSITIONS = 4


@dataclass(frozen=True)
class Solved:
    """At one position: the error, iterations, and the estimate over the error, NaN if not asked for."""

    error: float
    iterations: int = 0
    ratio: float = np.nan


def reader(solution: Any, dim: int, form: str) -> Any:
    """Return the solution on the members of dimension ``dim``; that of collocation is one for all members."""
    return solution.of_dimension(dim) if form == "galerkin" else solution


def solved(case: Case, spacing: float, form: str, position: int) -> Solved:
    """Solve at one position, in the Galerkin form by multigrid."""
    scene, turn = case.placed(position)
    options = {"solver": "multigrid"} if form == "galerkin" and len(case.problem.exact) > 1 else {}
    solution = ck.solve(scene, spacing, form=form, origin=case.origin(spacing, position), **options)
    found = {m: reader(solution, m, form).evaluate(case.points[m] @ turn.T) for m in case.problem.exact}
    away = {m: np.abs(found[m] - case.values(m)) for m in found}
    if case.name.startswith("rod"):
        return Solved(float((away[1] / case.values(1)).max()), solution.report.iterations)
    error = float(max(each.max() for each in away.values()))
    # near curves in solids errors are not read, and the estimate is of all errors
    ratio = solution.error.error[0] / error if options and not case.data.startswith("radius") else np.nan
    return Solved(error / case.range, solution.report.iterations, ratio)


def short(value: float) -> str:
    """Return an error for a cell."""
    return f"{value:.1e}"


def error_row(case: Case, spacing: float, positions: int) -> list[str]:
    """Return the cells of the errors of a case."""
    ours, other = ([solved(case, spacing, form, k) for k in range(positions)] for form in FORMS)
    errors = [short(float(np.max([one.error for one in found]))) for found in (ours, other)]
    ratios = [one.ratio for one in ours]
    estimates = "" if np.isnan(ratios).any() else f"{min(ratios):.2f} to {max(ratios):.2f}"
    iterations = max(one.iterations for one in ours)
    return [case.name, case.data, f"{spacing:g}", *errors, str(iterations or ""), estimates]


def heat_row(case: Case, spacing: float, positions: int) -> list[str]:
    """Return the cells of the change of the total of heat, over the first one, with nothing through the boundary."""
    drifts = []
    for k in range(positions):
        scene, _ = case.placed(k)
        solution = ck.solve(scene, spacing, form="galerkin", origin=case.origin(spacing, k))
        totals = np.array([frame.totals for frame in solution.frames])
        drifts.append(np.abs(totals / totals[0] - 1).max())
    return [case.name, case.data, f"{spacing:g}", short(float(max(drifts))), "", "", ""]


def error_cases() -> Iterator[tuple[Case, tuple[float, ...]]]:
    """Yield cases with spacings."""
    yield from ((ring(a), (0.2, 0.1, 0.05)) for a in (0.01, 1.0, 100.0))
    yield from ((line(a), (0.2, 0.1, 0.05)) for a in (1.0, 100.0))
    yield from ((ball(r), (0.4, 0.2, 0.1, 0.05)) for r in (0.0, 1.0))
    yield from ((disk(r), (0.2, 0.1, 0.05)) for r in (0.0, 1.0))
    yield from ((rod(r), (0.2, 0.1, 0.07, 0.05)) for r in (0.05, 0.01))
    yield vessel(0.02), (0.2, 0.1, 0.07)
    yield from ((case, (0.2, 0.1, 0.05)) for case in (*map(arms, CURVES), spoke()))


def heat_cases() -> Iterator[tuple[Case, float]]:
    """Yield cases of heat with a spacing."""
    yield from ((warm(case), 0.1) for case in (ring(1.0), disk(1.0), rod(0.05)))
    yield warm(ball(1.0)), 0.2


def rows(quick: bool) -> Iterator[list[str]]:
    """Yield the cells of all rows, or of those in the plane at one position."""
    positions = 1 if quick else POSITIONS
    for case, spacings in error_cases():
        if case.dim == 2 or not quick:
            yield from (error_row(case, spacing, positions) for spacing in spacings)
    for case, spacing in heat_cases():
        if case.dim == 2 or not quick:
            yield heat_row(case, spacing, positions)


if __name__ == "__main__":
    print_and_write(rows, HEAD, TABLE, __doc__, "scenes in the plane at one position; nothing is written")
