"""How near estimates of errors are to the truth: by a coarser solution, by the solution alone, and by both together.

Run ``python benchmarks/estimates.py``; it needs ``pip install . ./plugins/*``, this repository's folder ``tests``
beside it, and, for real meshes, ``CPMKIT_DATA`` set to their folder. Each steady problem of trade_problems.py is solved
at spacings 1.6 times apart, on lattices whose nodes lie elsewhere; every solution is held against those of 1.6 and 2.5
times its spacing. It prints the table of tables/estimates.md: of estimates over true errors, in both norms. With
``--into FOLDER`` the solutions that errors are measured against are kept there, as by trade.py.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from trade_problems import REFERENCE_UNKNOWNS, Problem, problems

import cpmkit as ck
from cpmkit.accuracy.error_estimate import estimate_alone, estimate_from
from cpmkit.accuracy.estimate import shifted_origin
from cpmkit.accuracy.spacing_search import first_spacing
from cpmkit.errors import CpmkitError
from cpmkit.facade import Solution
from cpmkit.studies.tables import table_row, table_rule
from cpmkit.types import Floats

#: Spacings over that of a tolerance's first solve.
SHARES = (1.0, 0.63, 0.4, 0.25, 0.16, 0.1)
#: A solution is held against coarser ones whose spacings are so many times its own, about.
RATIOS = (1.59, 2.5)
MOST_UNKNOWNS = 30_000
HEAD = ("estimate", "spacings apart", "in [.5, 3]", "lowest of 50", "median", "highest of 50", "scatter")


def solutions(problem: Problem) -> Iterator[Solution]:
    """Yield solutions at ever smaller spacings, none with more than so many unknowns."""
    for number, share in enumerate(SHARES, 1):
        spacing = share * first_spacing(problem.scene)
        try:
            found = ck.solve(problem.scene, spacing, origin=shifted_origin(problem.scene, spacing, number))
        except CpmkitError as error:
            print(f"{problem.name}: {error}", file=sys.stderr)
            continue
        if found.discretized.size > MOST_UNKNOWNS:
            return
        yield found


def shares(problem: Problem) -> Iterator[tuple[float, Floats]]:
    """Yield a ratio of spacings, and (3, 2) estimates over true errors: by another solution, alone, by both."""
    made: list[Solution] = []
    for fine in solutions(problem):
        alone = estimate_alone(fine)
        for coarse in made:
            near = [ratio for ratio in RATIOS if abs(coarse.spacing / fine.spacing / ratio - 1) < 0.02]
            if near and alone is not None:
                apart = estimate_from(fine, [coarse])
                both = estimate_from(fine, [coarse], alone=alone)
                told = [float(np.max(one / apart.unit)) for one in (alone.rms, alone.largest)]
                rows = [[one.of("rms"), one.of("max")] for one in (apart, both)]
                yield near[0], np.array([rows[0], told, rows[1]]) / problem.errors(fine)
        made.append(fine)


def table(found: Sequence[tuple[float, Floats]]) -> Iterator[str]:
    """Yield rows of what was found."""
    yield table_row(HEAD)
    yield table_rule(2, 5)
    for number, name in enumerate(("by a coarser solution", "by the solution alone", "by both")):
        for ratio in RATIOS:
            one = np.concatenate([share[number] for apart, share in found if apart == ratio])
            low, middle, high = np.percentile(one, [2, 50, 98])
            inside = np.mean((one >= 0.5) & (one <= 3))
            scatter = np.exp(np.std(np.log(one)))
            yield table_row(
                [name, f"{ratio:g}", f"{inside:.0%}", f"{low:.2f}", f"{middle:.2f}", f"{high:.1f}", f"{scatter:.2f}"]
            )


def main(arguments: Sequence[str]) -> None:
    """Solve, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of problems; all if left out")
    parser.add_argument("--into", type=Path, metavar="FOLDER", help="where finest solutions are kept, and found again")
    given = parser.parse_args(arguments)
    chosen = [one for one in problems(REFERENCE_UNKNOWNS, given.into) if not given.names or one.name in given.names]
    steady = [one for one in chosen if not isinstance(one.scene.problem, ck.Heat | ck.Eigen)]
    print("\n".join(table([pair for problem in steady for pair in shares(problem)])))


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ck.CpmkitWarning)
        main(sys.argv[1:])
