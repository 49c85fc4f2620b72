"""Runs of a study: each is solved, and its error and cost are recorded; runs that are recorded already are skipped."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from cpmkit.errors import ConvergenceError, InputError, ResolutionError, SceneError
from cpmkit.facade import Solution
from cpmkit.families.evolution.semidiscrete import ROUNDED_STEP_SHARE
from cpmkit.files.whole_files import check_place
from cpmkit.forms.choice import cost_model
from cpmkit.forms.options import AccuracyTarget, lattice_options
from cpmkit.grid.lattice import lattice_of
from cpmkit.plugins import factory
from cpmkit.runtime.memory import peak_growth_bytes, reset_peak_memory
from cpmkit.runtime.messages import collected_warnings
from cpmkit.runtime.options import declared_options
from cpmkit.scene.scene import Scene
from cpmkit.solving import backend_independent_options, solve
from cpmkit.studies import records, reference_values
from cpmkit.studies.studyfile import Study
from cpmkit.studies.sweep import BASELINES, REFINED, Run, lattice_methods
from cpmkit.types import Progress, no_progress


def check_study(study: Study) -> None:
    """Check that a study can be run, before its first run.

    Raises SceneError if the scene, the formula or the sweep is not accepted, or the scene's solution is not one
    function. Raises PluginError if a method or the reference is neither built in nor offered by a plugin.
    """
    reference_values.check_comparable(study.scene)
    if study.sweep.spacings is not None:
        tie_step_to_spacing(study.scene, study.sweep.step_per_spacing, study.sweep.spacings[0])
    if study.solution is not None and study.solution.takes_time and getattr(study.scene.problem, "until", None) is None:
        raise SceneError(f"u of [exact] depends on t, and the problem {study.scene.problem.kind!r} has no time.")
    for method in study.sweep.methods:
        if method in BASELINES:
            reference_values.check_fixable(study.scene, method)
    others = [method for method in study.sweep.methods if method not in (*lattice_methods(), *BASELINES)]
    others = ["fem" if method == REFINED else method for method in others]
    for backend in [*others, *([] if study.exact.reference is None else [study.exact.reference])]:
        factory(backend, "cpmkit_backends")


def tie_step_to_spacing(scene: Scene, step_per_spacing: float | None, spacing: float | None) -> Scene:
    """Return the scene with equal time steps, at most ``step_per_spacing`` x ``spacing``; itself if either is None.

    Raises SceneError if the scene's problem has no time step.
    """
    if step_per_spacing is None or spacing is None:
        return scene
    problem: Any = scene.problem
    if not {"step", "until"} <= {field.name for field in fields(problem)}:
        raise SceneError(f"step_per_spacing of [sweep] is for problems with a time step, not for {problem.kind!r}.")
    steps = math.ceil(problem.duration / (step_per_spacing * spacing) - ROUNDED_STEP_SHARE)
    return replace(scene, problem=replace(problem, step=problem.duration / max(steps, 1)))


def measure_run(
    study: Study, run: Run, truth: reference_values.Reference, progress: Progress = no_progress
) -> records.Record:
    """Solve the scene of a run, and return the record: parameters, errors, work and seconds.

    ``truth`` are the reference values. After a ResolutionError or ConvergenceError, or if the largest error is NaN or
    too large to record, the entry ``error``, a message, replaces errors, work and seconds. Other exceptions are raised.
    """
    named = {"study": study.name, "title": study.title, "content": study.content}
    record: records.Record = {**named, "reference": study.exact.reference, **run.as_dict()}
    scene = tie_step_to_spacing(study.scene, study.sweep.step_per_spacing, run.spacing)
    before, start = reset_peak_memory(), time.process_time()
    try:
        with collected_warnings():  # the record contains the warnings
            solution = _solve_run(scene, run, study.options, progress)
    except (ResolutionError, ConvergenceError) as error:
        return {**record, "error": f"{type(error).__name__}: {error}"}
    cpu_seconds = time.process_time() - start
    record |= memory_entries(solution, peak_growth_bytes(before))
    with np.errstate(over="ignore"):
        measured = _measured_entries(solution, truth, run)
    if not 0 <= (max_error := measured["max_error"]) < records.LARGEST_RECORDED:
        return {**record, "error": f"ResolutionError: the error {max_error:g} of the solution is too large."}
    return {**record, **measured, "cpu_seconds": round(cpu_seconds, 4)}


def _solve_run(scene: Scene, run: Run, options: dict[str, Any], progress: Progress) -> Solution:
    """Return the solution of a scene by the method of ``run``; ``options`` of ``solve`` are those of all runs."""
    if run.method == REFINED:
        return reference_values.solve_on_refined_mesh(scene, cast("float", run.spacing), progress=progress, **options)
    set_by = lattice_methods()
    if run.method not in (*set_by, *BASELINES):  # a plugin's back end, which may use the spacing in its own way
        return solve(scene, run.spacing, backend=run.method, progress=progress, **backend_independent_options(options))
    if run.spacing is None:
        if run.origin is not None:  # a target has no spacing yet: shift by up to a tenth of the surface's size
            extent = float(np.ptp(scene.surface.bounds, axis=0).max())
            centre = np.asarray(scene.surface.bounds).mean(axis=0)
            options = {**options, "origin": centre + run.lattice_shift(scene.surface.dim, 0.1 * extent)}
        return solve(scene, progress=progress, **{**options, **dict(run.options), **set_by[run.method], **run.target})
    without_target = {name: value for name, value in options.items() if name not in declared_options(AccuracyTarget)}
    lattice = lattice_of(scene.surface, run.spacing, without_target.get("origin"))
    placed = {**without_target, **dict(run.options), "origin": lattice.origin + run.lattice_shift(scene.surface.dim)}
    if run.method in BASELINES:
        return reference_values.solve_by_fixed_nodes(scene, run.spacing, method=run.method, progress=progress, **placed)
    return solve(scene, run.spacing, progress=progress, **placed, **set_by[run.method])


def _measured_entries(solution: Solution, truth: reference_values.Reference, run: Run) -> records.Record:
    """Return the measured entries of the record of ``run`` by name: errors at the points of ``truth``, and costs."""
    error = solution.evaluate(truth.points) - truth.values
    work, form = solution.work.as_dict(), solution.discretized
    trade = solution.solve_history
    seconds = dict(solution.seconds if trade is None else dict.fromkeys([step.purpose for step in trade.steps], 0.0))
    for step in () if trade is None else trade.steps:  # several solves: the seconds of each purpose
        seconds[step.purpose] += step.seconds
    doubled = form.diagnosis().doubled
    counts = ("unknowns", "nonzeros", "operator_applications", "closest_point_queries", "table_bytes")
    return {
        "spacing": solution.spacing if run.spacing is None else run.spacing,
        "max_error": float(np.abs(error).max()),
        "rms_error": float(np.sqrt(np.mean(error**2))),
        "rms_without_mean": float(np.std(error)),
        "half_range": truth.half_range,
        **{name: work.get(name) for name in counts},
        "twins": None if doubled is None else len(doubled),
        "imbalances": [imbalance.as_dict() for imbalance in solution.imbalances],
        "iterations": solution.report.iterations,
        "residual": solution.report.residual,
        "seconds": {stage: round(spent, 4) for stage, spent in seconds.items()},
        "estimate": None if trade is None else float(trade.error),
        "status": None if trade is None else trade.status,
        "warnings": list(solution.warnings),
        "versions": solution.summary()["versions"],
    }


def memory_entries(solution: Solution, measured: int | None) -> records.Record:
    """Return the record's entries on peak memory: ``bytes``, and in ``bytes_are`` whether measured or predicted.

    ``measured`` are the bytes measured during the solve; if None, ``bytes`` is predicted from the number of unknowns.
    Both entries are None for a solution that no cost model predicts.
    """
    if measured is not None:
        return {"bytes": measured, "bytes_are": "measured"}
    options, scene = lattice_options(solution.discretized), solution.scene
    if options is None:
        return {"bytes": None, "bytes_are": None}
    unknowns, model = solution.discretized.size, cost_model(scene, options)
    return {"bytes": round(model.peak_bytes(unknowns, model.choose_solver("auto", unknowns))), "bytes_are": "predicted"}


@dataclass(frozen=True)
class Outcome:
    """The outcome of running a study."""

    #: made, skipped, failed: Numbers of new runs, of runs recorded before, and of new runs that ended with an error.
    made: int
    skipped: int
    failed: int
    file: Path  #: The file of records.


def run_study(
    study: Study,
    folder: Path,
    *,
    cheap: bool = False,
    spacings: Sequence[float] = (),
    truth: reference_values.Reference | None = None,
    progress: Progress = no_progress,
    recorded: Callable[[records.Record], None] | None = None,
) -> Outcome:
    """Solve and record the runs of a study that are not recorded in ``folder`` yet, and return the numbers of runs.

    A run that fails as in :func:`measure_run` is recorded with its message, and the study continues. After an
    interruption the study continues at the next call. Raises InputError if one of ``spacings`` is not in the study, or
    records cannot be read or written; CpmkitError if any run is not recorded yet and the study's scene, formulas or
    options are wrong.

    ``folder``: folder of the records, which is created.
    ``cheap``: use the study's cheap spacings only.
    ``spacings``: use only these of the study's spacings, without accuracy targets; all if empty.
    ``truth``: reference values in place of the study's.
    ``progress``: called with the number of the run and the completed share of its stage.
    ``recorded``: called with each record once it is written.
    """
    runs = study.sweep.runs(cheap)
    known = list(dict.fromkeys(run.spacing for run in runs if run.spacing is not None))
    unknown = [spacing for spacing in spacings if spacing not in known]
    if unknown:
        listed = ", ".join(f"{spacing:g}" for spacing in known)
        raise InputError(f"the study has no spacing {unknown[0]:g}; it has {listed}.")
    runs = [run for run in runs if run.spacing in spacings] if spacings else runs
    file = folder / records.RECORDS_FILE
    check_place(file)
    records.drop_unfinished_line(file)
    done = {Run.from_record(record) for record in records.read_records(file) if record["content"] == study.content}
    pending = [run for run in runs if run not in done]
    if not pending:
        return Outcome(0, len(runs), 0, file)
    check_study(study)
    truth = reference_values.compute_reference(study) if truth is None else truth
    failed = 0
    for run in {run.method: run for run in reversed(study.sweep.runs(cheap))}.values():
        # Each method first makes a rough run, so that no measured cost includes compilation.
        measure_run(study, replace(run, targets=(("tolerance", 0.1),)) if run.targets else run, truth)
    for number, run in enumerate(pending, len(runs) - len(pending) + 1):
        stage = f"run {number} of {len(runs)}"

        def report_share(_: str, share: float, stage: str = stage) -> None:
            progress(stage, min(share, 0.99))  # below 1, since the run is not recorded yet

        record = measure_run(study, run, truth, report_share)
        folder.mkdir(parents=True, exist_ok=True)  # not earlier: a study that fails at once leaves no folder
        records.append_record(file, record)
        progress(stage, 1.0)
        if recorded is not None:
            recorded(record)
        failed += "error" in record
    return Outcome(len(pending), len(runs) - len(pending), failed, file)
