"""Estimates of errors over true errors, and errors over tolerances, on some 120 problems with exact solutions.

Run ``python benchmarks/effectivity.py``, which prints the table of tables/effectivity.md, and with ``--each`` a
line a problem; it needs ``pip install . ./plugins/*`` and the folder ``tests`` of this repository. The problems are
those of tests/extremes/exact_problems.py: smooth shapes, boundaries that end inside, curves that nearly coincide.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / "tests")]

from extremes.exact_problems import ExactProblem, exact_problems  # noqa: E402

from cpmkit.errors import CpmkitError  # noqa: E402
from cpmkit.studies.tables import table_row, table_rule  # noqa: E402

TOLERANCE = 1e-3
HEAD = (
    "problems",
    "",
    "in [.5, 3], rms",
    "in [.5, 3], largest",
    "lowest",
    "highest",
    "worst error / tolerance",
    "slow",
)


@dataclass(frozen=True)
class Measured:
    """Of one problem: the estimate over the error in both norms, whether it may be slow, and what a tolerance gave.

    ``reached`` is the error over the tolerance where the solution claims to keep it, else NaN.
    """

    problem: ExactProblem
    ratios: tuple[float, float]
    slow: bool
    reached: float


def measured(problem: ExactProblem) -> Measured:
    """Solve at the spacing, and to the tolerance."""
    solution = problem.solve()
    estimate = solution.error
    rms, largest = problem.errors(solution)
    reached = np.nan
    try:
        answer = problem.solve(tolerance=TOLERANCE)
    except CpmkitError as error:
        print(f"{problem.name}: {error}", file=sys.stderr)
    else:
        if answer.solve_history.status == "reached":
            reached = problem.errors(answer)[0] / TOLERANCE
    slow = bool(estimate.slow or solution.warnings)
    return Measured(problem, (estimate.of("rms") / rms, estimate.of("max") / largest), slow, reached)


def row(name: str, found: Sequence[Measured]) -> str:
    """Return a row of the table."""
    ratios = np.array([one.ratios for one in found])
    inside = np.mean((ratios >= 0.5) & (ratios <= 3), axis=0)
    worst = np.nanmax([*(one.reached for one in found), 0.0])
    cells = [f"{inside[0]:.0%}", f"{inside[1]:.0%}", f"{ratios.min():.2f}", f"{ratios.max():.2f}", f"{worst:.2f}"]
    return table_row([name, str(len(found)), *cells, str(sum(one.slow for one in found))])


def main(arguments: Sequence[str]) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", action="store_true", help="print a line a problem, too")
    given, found = parser.parse_args(arguments), []
    for problem in exact_problems():
        one = measured(problem)
        found.append(one)
        if given.each:
            said = " slow" if one.slow else ""
            line = f"{problem.name}: {one.ratios[0]:.2f} {one.ratios[1]:.2f}, {one.reached:.2f} of the tolerance{said}"
            print(line, file=sys.stderr, flush=True)
    print("\n".join([table_row(HEAD), table_rule(1, 7)]))
    for group in dict.fromkeys(one.problem.group for one in found):
        print(row(group, [one for one in found if one.problem.group == group]))
    print(row("all", found))


if __name__ == "__main__":
    main(sys.argv[1:])
