"""What is asked for and what comes: tolerances, times and memories in, answers, their errors and costs out.

Run ``python benchmarks/trade.py``, which takes hours, with ``--quick`` within five minutes, with ``--json`` for
records, or with names of problems; it needs ``pip install . ./plugins/*``, this repository's folder ``tests`` beside
it, and, for real meshes, ``CPMKIT_DATA`` set to their folder. A table follows of what must hold over all runs.

With ``--into FOLDER`` each run is kept there when it is done, as are the solutions that errors are measured against;
what is there already is not run again, so that a long run may be broken off. ``--minutes`` breaks it off by itself.
All problems come with one tolerance before any comes with the next, at one position of the lattice after the other.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from trade_problems import QUICK_REFERENCE_UNKNOWNS, REFERENCE_UNKNOWNS, Problem, problems
from trade_records import TradeRun, append, finite, printed, read, table

import cpmkit as ck
from cpmkit.errors import CpmkitError
from cpmkit.grid.lattice import lattice_of
from cpmkit.runtime.memory import peak_growth_bytes, reset_peak_memory

TOLERANCES, QUICK_TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4), (3e-3, 3e-4)
SECONDS, QUICK_SECONDS = (3.0, 10.0), (3.0,)
POSITIONS = 3
#: With which each problem is solved once before anything is measured.
WARMING_TOLERANCE = 0.3
#: Of the problems for ``--quick``.
QUICK = ("sphere, waves", "tamarind", "cube", "slit, value", "layer", "spot", "eigenvalues", "heat")
#: Memory for each run: what is beyond it is not reached. A run then takes less than about a minute.
MEMORY, QUICK_MEMORY = "256 MiB", "128 MiB"


def wanted(chosen: Sequence[Problem], quick: bool, positions: int) -> Iterator[tuple[Problem, TradeRun]]:
    """Yield all that is to be asked: one tolerance of all problems, then the next, at one position after the other."""
    tolerances, memory = (QUICK_TOLERANCES, QUICK_MEMORY) if quick else (TOLERANCES, MEMORY)
    for position in range(positions):
        for tolerance, norm, problem in product(tolerances, ("rms", "max"), chosen):
            yield problem, TradeRun(problem.name, position, tolerance, norm, None, memory)
        for seconds, problem in product((QUICK_SECONDS if quick else SECONDS) if position == 0 else (), chosen):
            yield problem, TradeRun(problem.name, position, None, "rms", seconds, memory)


def run(problem: Problem, target: TradeRun) -> TradeRun:
    """Solve once, on a lattice at a random position."""
    shift = np.random.default_rng(target.position).uniform(0, 1, problem.scene.surface.dim)
    origin = lattice_of(problem.scene.surface, 1e-3).origin + 0.2 * shift
    goal: dict[str, Any] = {
        "tolerance": target.asked_tolerance,
        "seconds": target.asked_seconds,
        "memory": target.memory,
    }
    before = reset_peak_memory()
    try:
        solution = ck.solve(problem.scene, origin=origin, norm=target.norm, **goal)
    except CpmkitError as error:
        print(f"{problem.name}: {error}", file=sys.stderr)
        return target
    used, trade = peak_growth_bytes(before), solution.solve_history
    return replace(
        target,
        status=trade.status,
        estimate=finite(trade.error),
        true_error=finite(problem.errors(solution)[0 if target.norm == "rms" else 1]),
        slow=bool(solution.error.slow),
        seconds=trade.seconds,
        predicted_bytes=trade.predicted_bytes,
        bytes=used,
        unknowns=solution.discretized.size,
        cost_over_last_solve=trade.cost_over_last_solve,
        solves=len(trade.steps),
    )


def told(number: int, count: int, one: TradeRun) -> str:
    """Return a line on a run."""
    goal = f"{one.asked_seconds:g} s" if one.asked_tolerance is None else f"{one.norm} {one.asked_tolerance:g}"
    if one.estimate is None or one.true_error is None:
        return f"{number}/{count} {one.name}, {goal}, position {one.position}: {one.status}"
    return (
        f"{number}/{count} {one.name}, {goal}, position {one.position}: {one.status}, {one.unknowns:,} unknowns, "
        f"estimate {one.estimate:.2g}, error {one.true_error:.2g}, {one.seconds:.2f} s, cost "
        f"{one.cost_over_last_solve:.2f}"
    )


def main(arguments: Sequence[str]) -> None:
    """Run, and print records or a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of problems; all if left out")
    parser.add_argument("--quick", action="store_true", help="eight problems, one position, little memory")
    parser.add_argument("--json", action="store_true", help="print records alone")
    parser.add_argument("--into", type=Path, metavar="FOLDER", help="where runs are kept, and found again")
    parser.add_argument("--positions", type=int, help="of the lattice, three if left out, one with --quick")
    parser.add_argument("--processor", action="store_true", help="seconds are the processor's: for a busy machine")
    parser.add_argument("--minutes", type=float, default=np.inf, help="no run begins later")
    given = parser.parse_args(arguments)
    if given.processor:
        time.perf_counter = time.process_time  # with CPMKIT_THREADS=1 that is what a quiet machine would take
    names = given.names or (QUICK if given.quick else None)
    if given.into:
        given.into.mkdir(parents=True, exist_ok=True)
    file = given.into / "runs.jsonl" if given.into else None
    reference = QUICK_REFERENCE_UNKNOWNS if given.quick else REFERENCE_UNKNOWNS
    chosen = [one for one in problems(reference, given.into) if names is None or one.name in names]
    todo = list(wanted(chosen, given.quick, given.positions or (1 if given.quick else POSITIONS)))
    found, started = {one.key: one for one in read(file)}, time.monotonic()
    warm: set[str] = set()
    for number, (problem, target) in enumerate(todo, 1):
        if target.key not in found and time.monotonic() - started < 60 * given.minutes:
            if problem.name not in warm:  # what is compiled or read for the first time is no part of a solve
                ck.solve(problem.scene, tolerance=WARMING_TOLERANCE)
                warm.add(problem.name)
            found[target.key] = one = run(problem, target)
            append(file, one)
            print(told(number, len(todo), one), file=sys.stderr, flush=True)
    done = [found[target.key] for _, target in todo if target.key in found]
    print(printed(done) if given.json else "\n".join(table(done)))


if __name__ == "__main__":
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ck.CpmkitWarning)
        main(sys.argv[1:])
