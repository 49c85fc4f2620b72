"""Records of the runs of benchmarks/trade.py: kept in a file line by line, printed, and what holds over all of them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.studies.tables import table_row, table_rule

#: What `--json` prints of a run.
PRINTED = (
    "asked_tolerance",
    "norm",
    "estimate",
    "true_error",
    "status",
    "asked_seconds",
    "seconds",
    "predicted_bytes",
    "bytes",
    "cost_over_last_solve",
)


@dataclass(frozen=True)
class TradeRun:
    """One run of a problem at one position of the lattice; None where nothing of the kind was asked for, or is known.

    Beside what is asked for, and its ``position``, all is None where the solve was refused: ``status`` is "failed".
    """

    name: str
    position: int
    asked_tolerance: float | None
    norm: str
    asked_seconds: float | None
    memory: str
    status: str = "failed"
    estimate: float | None = None
    true_error: float | None = None
    slow: bool = False
    seconds: float | None = None
    predicted_bytes: float | None = None
    bytes: int | None = None
    unknowns: int | None = None
    cost_over_last_solve: float | None = None
    solves: int | None = None

    @property
    def key(self) -> tuple[Any, ...]:
        """What was asked for."""
        return self.name, self.position, self.asked_tolerance, self.norm, self.asked_seconds, self.memory


def printed(runs: Sequence[TradeRun]) -> str:
    """Return all runs as JSON: ``{"problems": [{"name", "runs": [{...}]}]}``."""
    names = list(dict.fromkeys(run.name for run in runs))
    of = {name: [run for run in runs if run.name == name] for name in names}
    kept = [{"name": name, "runs": [{key: getattr(run, key) for key in PRINTED} for run in of[name]]} for name in names]
    return json.dumps({"problems": kept}, indent=1, allow_nan=False)


def read(file: Path | None) -> list[TradeRun]:
    """Return the runs in a file, a line each, or none where there is no file."""
    if file is None or not file.exists():
        return []
    return [TradeRun(**json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]


def append(file: Path | None, run: TradeRun) -> None:
    """Add a run to a file."""
    if file is not None:
        with file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(asdict(run), allow_nan=False) + "\n")


def finite(value: float) -> float | None:
    """Return a number, or None where it is none."""
    return float(value) if np.isfinite(value) else None


def table(runs: Sequence[TradeRun]) -> Iterator[str]:
    """Yield what must hold, and what was found, as rows."""
    target = [one for one in runs if one.asked_tolerance is not None]
    accepted = [one for one in target if one.status == "reached"]
    ratios = np.array([one.estimate / one.true_error for one in runs if one.estimate and one.true_error])
    below = [one for one in accepted if one.true_error <= one.asked_tolerance]
    silent = [one for one in accepted if one.true_error > one.asked_tolerance and not one.slow]
    timed = np.array([one.seconds / one.asked_seconds for one in runs if one.asked_seconds and one.seconds])
    better = [one.asked_tolerance / one.true_error for one in accepted]
    further = [share for share, one in zip(better, accepted, strict=True) if (one.solves or 0) > 2]
    costs = [one.cost_over_last_solve for one in runs if one.cost_over_last_solve]
    foretold = np.array([one.predicted_bytes / one.bytes for one in runs if one.predicted_bytes and one.bytes])
    statuses = [f"{sum(one.status == status for one in target)} {status}" for status in _statuses(target)]
    rows = {
        "problems, positions, memory for each run": f"{len({one.name for one in runs})}, "
        f"{len({one.position for one in runs})}, {' or '.join(sorted({one.memory for one in runs}))}",
        "runs with a tolerance": f"{len(target)}: {', '.join(statuses)}",
        "accepted answers whose true error is below the tolerance": f"{len(below)} of {len(accepted)}",
        "effectivity in [.5, 3]": f"{np.mean((ratios >= 0.5) & (ratios <= 3)):.0%} of {len(ratios)}",
        "lowest, median, highest effectivity": f"{ratios.min():.2g}, {np.median(ratios):.2g}, {ratios.max():.2g}",
        "cost over that of the last solve, median": f"{np.median(costs):.2f}",
        "accuracy over what was asked, median": f"{np.median(better):.2g}",
        "the same, of answers that took more than two solves": f"{np.median(further):.2g}" if further else "none",
        "time within 1.5 of that asked": f"{np.sum(timed <= 1.5)} of {len(timed)}, at most {timed.max(initial=0):.2f}",
        "bytes foretold within a factor of two": f"{np.mean((foretold >= 0.5) & (foretold <= 2)):.0%}, "
        f"{foretold.min(initial=np.inf):.2f} to {foretold.max(initial=0):.2f} of the truth",
        "answers above tolerance that were accepted without the flag": str(len(silent)),
    }
    yield table_row(["over all runs", "found"])
    yield table_rule(1, 1)
    for name, value in rows.items():
        yield table_row([name, value])


def _statuses(runs: Sequence[TradeRun]) -> list[str]:
    return [one for one in ("reached", "floor", "not reached", "failed") if any(run.status == one for run in runs)]
