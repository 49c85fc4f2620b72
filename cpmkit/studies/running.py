"""Running a study: solve, measure the error, record; skip what is recorded already."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import ConvergenceError, InputError, ResolutionError, SceneError
from cpmkit.protocols import Floats, Progress, nothing
from cpmkit.readable import ReadableSolution
from cpmkit.scene import Scene
from cpmkit.scene_data import evaluate_data
from cpmkit.solving import solve
from cpmkit.studies.baselines import solve_by_fixed_nodes
from cpmkit.studies.records import FILE, Record, append_record, drop_unfinished_line, of_content, read_records
from cpmkit.studies.sampling import sample_points
from cpmkit.studies.studyfile import Study
from cpmkit.studies.sweep import BASELINES, Run

#: What of a solve's work is recorded, where the method has it.
WORK = ("unknowns", "nonzeros", "operator_applications", "closest_point_queries", "table_bytes")
#: A last time step shorter than this share of the others is rounding.
ROUNDING = 1e-9
#: A run whose last stage is over still has to be measured and recorded.
UNFINISHED = 0.99


@dataclass(frozen=True)
class Outcome:
    """What running a study did.

    Attributes
    ----------
    made, skipped, failed : int
        Runs that were made, that were recorded before, and of those made the ones that ended with an error.
    file : Path
        The records.
    """

    made: int
    skipped: int
    failed: int
    file: Path


def unheard(record: Record) -> None:
    """Tell nobody of a record."""
    del record


def run_study(
    study: Study,
    folder: Path,
    *,
    cheap: bool = False,
    progress: Progress = nothing,
    recorded: Callable[[Record], None] = unheard,
) -> Outcome:
    """Make the runs of a study that are not recorded in ``folder`` yet.

    A run that ends with a ResolutionError or a ConvergenceError is recorded with its sentence, and the study goes on.
    Interrupted, it goes on at the next call where it stopped.

    Parameters
    ----------
    study : Study
    folder : Path
        Where the records are, made if need be.
    cheap : bool
        Only the study's cheap spacings.
    progress : callable, optional
        Told the number of the run and the share of its stage.
    recorded : callable, optional
        Given each record once it is written.

    Raises
    ------
    CpmkitError
        If the study itself is wrong: its scene, its formulas or its options.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder {folder} cannot be made: {error.strerror}.") from error
    file = folder / FILE
    drop_unfinished_line(file)
    done = {_run_of(record) for record in of_content(read_records(file), study.content)}
    runs = study.sweep.runs(cheap)
    waiting = [run for run in runs if run not in done]
    points = sample_points(study.scene, study.exact.points) if waiting else np.zeros((0, 0))
    failed = 0
    if waiting:
        make_run(study, runs[0], points)  # what is compiled or read at the first run is no cost of any method
    for number, run in enumerate(waiting, len(runs) - len(waiting) + 1):
        stage = f"run {number} of {len(runs)}"
        record = make_run(study, run, points, partial(_share_of, progress, stage))
        append_record(file, record)
        progress(stage, 1.0)
        recorded(record)
        failed += "error" in record
    return Outcome(len(waiting), len(runs) - len(waiting), failed, file)


def _share_of(progress: Progress, run: str, stage: str, share: float) -> None:
    """Tell how far a stage of a run is; the run itself ends later."""
    del stage
    progress(run, min(share, UNFINISHED))


def _run_of(record: Record) -> Run:
    return Run(**{field.name: record[field.name] for field in fields(Run)})


def make_run(study: Study, run: Run, points: Floats, progress: Progress = nothing) -> Record:
    """Solve once, and return the record: parameters, errors at ``points`` (n, d), work and seconds."""
    record: Record = {"study": study.name, "title": study.title, "content": study.content, **run.as_dict()}
    scene = at_spacing(study.scene, study.sweep.step_per_spacing, run.spacing)
    start = time.process_time()
    try:
        solution = _solve(scene, run, study.options, progress)
    except (ResolutionError, ConvergenceError) as error:
        return {**record, "error": f"{type(error).__name__}: {error}"}
    cpu_seconds = time.process_time() - start
    exact = evaluate_data(study.solution, points, 1, "u of [exact]", end_of(scene))[:, 0]
    measured = _measured(solution, solution.evaluate(points) - exact)
    return {**record, **measured, "cpu_seconds": round(cpu_seconds, 4)}


def _solve(scene: Scene, run: Run, options: dict[str, Any], progress: Progress) -> ReadableSolution:
    if run.degree is None:  # a plugin's back end, which makes of the spacing what it likes
        common = {name: value for name, value in options.items() if name == "tolerance"}
        return solve(scene, run.spacing, backend=run.method, progress=progress, **common)
    lattice = scene.lattice(run.spacing, options.get("origin"))
    placed = {**options, "degree": run.degree, "origin": lattice.origin + run.shift(scene.surface.dim)}
    if run.method in BASELINES:
        return solve_by_fixed_nodes(scene, run.spacing, method=run.method, progress=progress, **placed)
    assert run.order is not None
    return solve(scene, run.spacing, order=run.order, progress=progress, **placed)


def _measured(solution: ReadableSolution, error: Floats) -> Record:
    work = solution.work.as_dict()
    return {
        "max_error": float(np.abs(error).max()),
        "rms_error": float(np.sqrt(np.mean(error**2))),
        **{name: work.get(name) for name in WORK},
        "iterations": solution.report.iterations,
        "residual": solution.report.residual,
        "seconds": {stage: round(spent, 4) for stage, spent in solution.seconds.items()},
        "warnings": list(solution.warnings),
        "versions": solution.summary()["versions"],
    }


def at_spacing(scene: Scene, step_per_spacing: float | None, spacing: float) -> Scene:
    """Return the scene with its time step tied to the spacing: equal steps, none longer than the ratio allows.

    Raises
    ------
    SceneError
        If the scene's problem has no time step.
    """
    if step_per_spacing is None:
        return scene
    problem: Any = scene.problem
    if not {"step", "until"} <= {field.name for field in fields(problem)}:
        raise SceneError(f"step_per_spacing of [sweep] is for problems with a time step, not for {problem.kind!r}.")
    steps = math.ceil(problem.until / (step_per_spacing * spacing) - ROUNDING)
    return replace(scene, problem=replace(problem, step=problem.until / max(steps, 1)))


def end_of(scene: Scene) -> float | None:
    """Return the time at which the scene's solution is read, None where it has none."""
    return getattr(scene.problem, "until", None)
