"""What is done to the solution of a linear system before it is handed out: constants, means and fluxes put right."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from cpmkit.forms.collocation.conservation.balance import correct_mean
from cpmkit.forms.collocation.conservation.flux_balance import Balancing, galerkin_correction
from cpmkit.forms.collocation.conservation.free_constants import remove_constants
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.forms.form_records import SteadyResult
from cpmkit.linear.operators import Bordered
from cpmkit.protocols import Floats, Operator
from cpmkit.scene.scene import Scene


def settled(
    tables: Discretization, scene: Scene, operator: Operator, b: Floats, u: Floats
) -> tuple[SteadyResult, Floats]:
    """Return the solution with its free constants and means put right, and the one whose means were left alone."""
    raw, defects = remove_constants(tables, scene, operator, u) if isinstance(operator, Bordered) else (u, ())
    even, missed = correct_mean(tables, scene, b, raw)
    return SteadyResult(even, (*defects, *missed), max((one.relative for one in missed), default=0.0)), raw


def with_balanced_fluxes(
    tables: Discretization,
    scene: Scene,
    read: Callable[[Floats, Floats], Floats],
    plain: SteadyResult,
    raw: Floats,
    prepared: Balancing,
    degree: int,
) -> SteadyResult:
    """Return ``raw``, whose means were left alone, with its fluxes balanced; ``plain`` where that explains nothing."""
    start = time.perf_counter()
    done = galerkin_correction(tables, scene, read, raw, prepared, degree, plain.missed)
    if isinstance(done, str):
        return replace(plain, warnings=(done,))
    defects = (one for one in plain.imbalances if one.of == "data")
    seconds = {"balance": time.perf_counter() - start}
    return SteadyResult(done.values, (*defects, done.balance), plain.missed, queries=done.queries, seconds=seconds)
