"""Which degree of splines reaches an error soonest, by a record that ``benchmarks/knobs.py --record`` prints again."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from cpmkit.accuracy.way import Way
from cpmkit.forms.galerkin.form import Galerkin
from cpmkit.protocols import Floats

#: The form's own degree, and the one that may be better.
DEGREE, HIGHER_DEGREE = 2, 3
#: Equations for which the record stands.
RECORDED_KINDS = ("poisson", "screened")


def worth_higher_degree(way: Way, aim: float) -> bool:
    """Return whether the way goes on with cubic splines.

    Only where the record, which is one of seconds, says something: neither a degree nor a memory is asked for, nothing
    bounds a smooth closed surface that is known exactly, and the error falls as it should.
    """
    form, scene = way.last.solution.discretized, way.scene
    return (
        not way.degree_given
        and aim > 0
        and way.target.memory is None
        and isinstance(form, Galerkin)
        and form.sampled.mesh.manifold_dim == 2
        and form.sampled.geometry == "feet"
        and form.options.own.refine == "off"
        and scene.problem.kind in RECORDED_KINDS
        and not scene.boundaries
        and not len(form.sampled.boundary)
        and not form.source_error()
        and not form.diagnosis().slow
        and aim < error_of_equal_cost()
    )


@cache
def error_of_equal_cost() -> float:
    """Return the error below which cubic splines take less time than quadratic ones, the mean over the surfaces.

    Seconds are taken to grow with a power of the error, through the two finest solves of each degree.
    """
    rows = json.loads((files("cpmkit.accuracy") / "knobs.json").read_text(encoding="utf-8"))
    found = []
    for surface in sorted({row["surface"] for row in rows}):
        (low, up), (less, more) = (_line(rows, surface, degree) for degree in (DEGREE, HIGHER_DEGREE))
        found.append((more - up) / (low - less))
    return float(np.exp(np.mean(found)))


def _line(rows: list[dict[str, Any]], surface: str, degree: int) -> Floats:
    """Return the slope and the height of log seconds over log error."""
    kept = [row for row in rows if row["surface"] == surface and row["degree"] == degree]
    finest = sorted(kept, key=lambda row: row["spacing"])[:2]
    log = np.log([[row["error"], row["seconds"]] for row in finest])
    return np.asarray(np.polyfit(log[:, 0], log[:, 1], 1))
