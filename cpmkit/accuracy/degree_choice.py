"""Choice of the degree of splines that reaches an error soonest, from timings of ``benchmarks/knobs.py --record``."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from cpmkit.accuracy.adaptive_run import AdaptiveRun
from cpmkit.types import Floats

#: Kinds of equations that were timed.
RECORDED_KINDS = ("poisson", "screened")


def cheaper_degree(run: AdaptiveRun, tolerance: float) -> int | None:
    """Return a higher degree of splines with which a tolerance is reached sooner; None to keep the degree.

    A degree is returned only where the recorded timings hold: neither a degree nor a memory is given, the manifold is a
    smooth closed surface that is known exactly, and the error falls at its expected order.
    """
    form, scene = run.last.solution.discretized, run.scene
    recorded = (
        not run.degree_given
        and tolerance > 0
        and run.target.memory is None
        and form.traits.higher_degree is not None
        and scene.problem.kind in RECORDED_KINDS
        and not form.source_error()
        and not form.diagnosis().slow
        and tolerance < error_of_equal_cost()
    )
    return form.traits.higher_degree if recorded else None


@cache
def error_of_equal_cost() -> float:
    """Return the error below which cubic splines take less time than quadratic splines, the mean over the surfaces.

    The time is assumed to be a power of the error, through the two finest solves of each degree.
    """
    rows = json.loads((files("cpmkit.accuracy") / "degree_choice.json").read_text(encoding="utf-8"))
    logarithms = []
    for surface in sorted({row["surface"] for row in rows}):
        (slope, height), (cubic_slope, cubic_height) = (_cost_line(rows, surface, degree) for degree in (2, 3))
        logarithms.append((cubic_height - height) / (slope - cubic_slope))
    return float(np.exp(np.mean(logarithms)))


def _cost_line(rows: list[dict[str, Any]], surface: str, degree: int) -> Floats:
    """Return the slope and the height of log(seconds) as a line over log(error), for a surface and a degree."""
    chosen = [row for row in rows if row["surface"] == surface and row["degree"] == degree]
    finest = sorted(chosen, key=lambda row: row["spacing"])[:2]
    log = np.log([[row["error"], row["seconds"]] for row in finest])
    return np.asarray(np.polyfit(log[:, 0], log[:, 1], 1))
