"""One run of a study: solve, measure the error and the cost, and tell both."""

from __future__ import annotations

import time
from typing import Any, cast

import numpy as np

from cpmkit.errors import ConvergenceError, ResolutionError
from cpmkit.facade import Solution
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.forms.choice import cost_model
from cpmkit.forms.collocation.form import Collocation
from cpmkit.forms.options import lattice_options
from cpmkit.grid.lattice import lattice_of
from cpmkit.protocols import Progress, no_progress
from cpmkit.runtime.memory import peak_growth_bytes, reset_peak_memory
from cpmkit.runtime.messages import collected_warnings
from cpmkit.runtime.options import declared_options
from cpmkit.scene.scene import Scene
from cpmkit.solving import for_any_backend, solve
from cpmkit.studies.baselines import solve_by_fixed_nodes
from cpmkit.studies.checking import at_spacing
from cpmkit.studies.records import FORETOLD, LARGEST_RECORDED, MEASURED, Record
from cpmkit.studies.refined import solve_on_refined_mesh
from cpmkit.studies.studyfile import Study
from cpmkit.studies.sweep import BASELINES, REFINED, Run, closest_points
from cpmkit.studies.truth import Truth

#: What of a solve's work is recorded, where the method has it.
WORK_ENTRIES = ("unknowns", "nonzeros", "operator_applications", "closest_point_queries", "table_bytes")
#: Lattices whose spacing is not yet known are moved by up to this share of the surface's size.
SHIFTED_SHARE = 0.1


def make_run(study: Study, run: Run, truth: Truth, progress: Progress = no_progress) -> Record:
    """Solve once, and return the record: parameters, errors, work and seconds."""
    named = {"study": study.name, "title": study.title, "content": study.content}
    record: Record = {**named, "reference": study.exact.reference, **run.as_dict()}
    scene = at_spacing(study.scene, study.sweep.step_per_spacing, run.spacing)
    before, start = reset_peak_memory(), time.process_time()
    try:
        with collected_warnings():  # they are recorded
            solution = _solve(scene, run, study.options, progress)
    except (ResolutionError, ConvergenceError) as error:
        return {**record, "error": f"{type(error).__name__}: {error}"}
    cpu_seconds = time.process_time() - start
    record |= costs_in_memory(solution, peak_growth_bytes(before))
    with np.errstate(over="ignore"):
        measured = _measured(solution, truth, run)
    if not 0 <= (off := measured["max_error"]) < LARGEST_RECORDED:
        return {**record, "error": f"ResolutionError: the solution is off by {off:g}, beyond all use."}
    return {**record, **measured, "cpu_seconds": round(cpu_seconds, 4)}


def _solve(scene: Scene, run: Run, options: dict[str, Any], progress: Progress) -> Solution:
    if run.method == REFINED:
        return solve_on_refined_mesh(scene, cast("float", run.spacing), progress=progress, **options)
    set_by = closest_points()
    if run.method not in (*set_by, *BASELINES):  # a plugin's back end, which makes of the spacing what it likes
        return solve(scene, run.spacing, backend=run.method, progress=progress, **for_any_backend(options))
    if run.spacing is None:
        if run.origin is not None:  # the spacing is not known yet: a share of the whole is as good
            extent = float(np.ptp(scene.surface.bounds, axis=0).max())
            centre = np.asarray(scene.surface.bounds).mean(axis=0)
            options = {**options, "origin": centre + run.shift(scene.surface.dim, SHIFTED_SHARE * extent)}
        return solve(scene, progress=progress, **{**options, **dict(run.options), **set_by[run.method], **run.target})
    own = {name: value for name, value in options.items() if name not in declared_options(AccuracyTarget)}
    lattice = lattice_of(scene.surface, run.spacing, own.get("origin"))
    placed = {**own, **dict(run.options), "origin": lattice.origin + run.shift(scene.surface.dim)}
    if run.method in BASELINES:
        return solve_by_fixed_nodes(scene, run.spacing, method=run.method, progress=progress, **placed)
    return solve(scene, run.spacing, progress=progress, **placed, **set_by[run.method])


def _measured(solution: Solution, truth: Truth, run: Run) -> Record:
    error = solution.evaluate(truth.points) - truth.values
    work, form = solution.work.as_dict(), solution.discretized
    trade = solution.solve_history
    twins = len(form.doubled) if isinstance(form, Collocation) else None  # none without a grid
    return {
        "spacing": solution.spacing if run.spacing is None else run.spacing,
        "max_error": float(np.abs(error).max()),
        "rms_error": float(np.sqrt(np.mean(error**2))),
        "rms_without_mean": float(np.std(error)),
        "half_range": truth.half_range,
        **{name: work.get(name) for name in WORK_ENTRIES},
        "twins": twins,
        "imbalances": [imbalance.as_dict() for imbalance in solution.imbalances],
        "iterations": solution.report.iterations,
        "residual": solution.report.residual,
        "seconds": {stage: round(spent, 4) for stage, spent in _stages(solution).items()},
        "estimate": None if trade is None else float(trade.error),
        "status": None if trade is None else trade.status,
        "warnings": list(solution.warnings),
        "versions": solution.summary()["versions"],
    }


def _stages(solution: Solution) -> dict[str, float]:
    """Return the seconds of each stage, or, where several were solved on the way, of each purpose."""
    if solution.solve_history is None:
        return dict(solution.seconds)
    spent: dict[str, float] = {}
    for step in solution.solve_history.steps:
        spent[step.purpose] = spent.get(step.purpose, 0.0) + step.seconds
    return spent


def costs_in_memory(solution: Solution, measured: int | None) -> Record:
    """Return the bytes at the peak, measured if the system told, else foretold, and which; null where neither is."""
    if measured is not None:
        return {"bytes": measured, "bytes_are": MEASURED}
    options, scene = lattice_options(solution.discretized), solution.scene
    if options is None:
        return {"bytes": None, "bytes_are": None}
    unknowns, model = solution.discretized.size, cost_model(scene, options)
    return {"bytes": round(model.peak_bytes(unknowns, model.choose_solver("auto", unknowns))), "bytes_are": FORETOLD}
