"""What is asked for and what comes: tolerances, times and memories in, answers, their errors and costs out.

Run ``python benchmarks/trade.py``, with ``--quick`` in about ten minutes, with ``--json`` for records, or with names of
problems; it needs ``pip install . ./plugins/*``, this repository's folder ``tests`` beside it, and, for real meshes,
``CPMKIT_DATA`` set to their folder. A table follows of what must hold over all runs.
"""

from __future__ import annotations

import argparse
import json
import sys
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np
from trade_problems import Problem, problems

import cpmkit as ck
from cpmkit.grid.lattice import lattice_of
from cpmkit.runtime.peak import bytes_since, forget_peak
from cpmkit.studies.tables import table_row, table_rule

TOLERANCES, QUICK_TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4), (3e-3, 3e-4)
SECONDS, QUICK_SECONDS = (3.0, 10.0), (3.0,)
POSITIONS = 3
#: Of the problems for ``--quick``.
QUICK = ("sphere, waves", "tamarind", "cube", "slit, value", "layer", "spot", "eigenvalues", "heat")
#: Memory for each run: what is beyond it is not reached.
MEMORY = "1 GiB"


@dataclass(frozen=True)
class TradeRun:
    """One run; None where nothing of the kind was asked for."""

    asked_tolerance: float | None
    norm: str
    estimate: float
    true_error: float
    status: str
    slow: bool
    asked_seconds: float | None
    seconds: float
    predicted_bytes: float
    bytes: int | None
    unknowns: int
    cost_over_last_solve: float


def run(problem: Problem, position: int, norm: str, **asked: Any) -> TradeRun:
    """Solve once, on a lattice at a random position."""
    shift = np.random.default_rng(position).uniform(0, 1, problem.scene.surface.dim)
    origin = lattice_of(problem.scene.surface, 1e-3).origin + 0.2 * shift
    before = forget_peak()
    solution = ck.solve(problem.scene, origin=origin, norm=norm, memory=MEMORY, **asked)
    error = problem.errors(solution)[0 if norm == "rms" else 1]
    trade = solution.trade
    return TradeRun(
        asked.get("tolerance"),
        norm,
        trade.error,
        error,
        trade.status,
        bool(solution.error.slow),
        asked.get("seconds"),
        trade.seconds,
        trade.predicted_bytes,
        bytes_since(before),
        solution.discretized.size,
        trade.cost_over_last_solve,
    )


def runs(problem: Problem, quick: bool) -> Iterator[TradeRun]:
    """Yield every run of a problem."""
    tolerances = QUICK_TOLERANCES if quick else TOLERANCES
    for tolerance, norm, position in product(tolerances, ("rms", "max"), range(1 if quick else POSITIONS)):
        yield run(problem, position, norm, tolerance=tolerance)
    for seconds in QUICK_SECONDS if quick else SECONDS:
        yield run(problem, 0, "rms", seconds=seconds)


def table(found: dict[str, list[TradeRun]]) -> Iterator[str]:
    """Yield what must hold, and what was found, as rows."""
    every = [one for kept in found.values() for one in kept]
    asked = [one for one in every if one.asked_tolerance is not None]
    accepted = [one for one in asked if one.status == "reached"]
    ratios = np.array([one.estimate / one.true_error for one in every if one.estimate > 0])
    below = [one for one in accepted if one.true_error <= (one.asked_tolerance or 0)]
    silent = [one for one in accepted if one.true_error > (one.asked_tolerance or 0) and not one.slow]
    timed = np.array([one.seconds / one.asked_seconds for one in every if one.asked_seconds])
    better = np.median([(one.asked_tolerance or 0) / one.true_error for one in accepted])
    rows = {
        "runs, accepted": f"{len(asked)}, {len(accepted)}",
        "accepted answers whose true error is below the tolerance": f"{len(below)} of {len(accepted)}",
        "effectivity in [.5, 3]": f"{np.mean((ratios >= 0.5) & (ratios <= 3)):.0%} of {len(ratios)}",
        "lowest, median, highest effectivity": f"{ratios.min():.2g}, {np.median(ratios):.2g}, {ratios.max():.2g}",
        "cost over that of the last solve, median": f"{np.median([one.cost_over_last_solve for one in every]):.2f}",
        "accuracy over what was asked, median": f"{better:.2g}",
        "time within 1.5 of that asked": f"{np.mean(timed <= 1.5):.0%}, at most {timed.max(initial=0):.2f}",
        "answers above tolerance that were accepted without the flag": str(len(silent)),
    }
    yield table_row(["over all runs", "found"])
    yield table_rule(1, 1)
    for name, value in rows.items():
        yield table_row([name, value])


def main(arguments: Sequence[str]) -> None:
    """Run, and print records or tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of problems; all if left out")
    parser.add_argument("--quick", action="store_true", help="eight problems, one position")
    parser.add_argument("--json", action="store_true", help="print records alone")
    given = parser.parse_args(arguments)
    wanted = given.names or (QUICK if given.quick else None)
    found: dict[str, list[TradeRun]] = {}
    for problem in problems():
        if wanted is not None and problem.name not in wanted:
            continue
        found[problem.name] = []
        for one in runs(problem, given.quick):
            found[problem.name].append(one)
            print(f"{problem.name}: {one}", file=sys.stderr, flush=True)
    if given.json:
        kept = [{"name": name, "runs": [asdict(one) for one in each]} for name, each in found.items()]
        print(json.dumps({"problems": kept}, indent=1))
        return
    print("\n".join(table(found)))


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ck.CpmkitWarning)
        main(sys.argv[1:])
