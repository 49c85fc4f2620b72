"""Running a study: solve, measure the error, record; skip what is recorded already."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from cpmkit.errors import InputError
from cpmkit.files.whole_files import check_place
from cpmkit.protocols import Progress, no_progress
from cpmkit.studies.checking import check_study
from cpmkit.studies.making import make_run
from cpmkit.studies.records import (
    RECORDS_FILE,
    Record,
    append_record,
    drop_unfinished_line,
    of_content,
    read_records,
)
from cpmkit.studies.studyfile import Study
from cpmkit.studies.sweep import Run
from cpmkit.studies.truth import Truth, truth_of

#: What is asked for before the first run that counts.
ROUGH_TOLERANCE = 0.1
#: A run whose last stage is over still has to be measured and recorded.
UNFINISHED_SHARE = 0.99


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


def ignore_record(record: Record) -> None:
    """Ignore a record."""
    del record


def run_study(
    study: Study,
    folder: Path,
    *,
    cheap: bool = False,
    spacings: Sequence[float] = (),
    truth: Truth | None = None,
    progress: Progress = no_progress,
    recorded: Callable[[Record], None] = ignore_record,
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
    spacings : sequence of float
        Only these of the study's spacings; all if empty.
    truth : Truth, optional
        What every run should give, in place of what the study says.
    progress : callable, optional
        Told the number of the run and the share of its stage.
    recorded : callable, optional
        Given each record once it is written.

    Raises
    ------
    InputError
        If the study has none of the ``spacings``.
    CpmkitError
        If the study itself is wrong: its scene, its formulas or its options.
    """
    runs = _chosen(study.sweep.runs(cheap), spacings)
    file = folder / RECORDS_FILE
    check_place(file)
    drop_unfinished_line(file)
    done = {Run.of(record) for record in of_content(read_records(file), study.content)}
    waiting = [run for run in runs if run not in done]
    if not waiting:
        return Outcome(0, len(runs), 0, file)
    check_study(study)
    truth = truth_of(study) if truth is None else truth
    failed = 0
    for run in {run.method: run for run in reversed(study.sweep.runs(cheap))}.values():
        make_run(study, _quick(run), truth)  # what a first run compiles or reads is no cost of any method
    for number, run in enumerate(waiting, len(runs) - len(waiting) + 1):
        stage = f"run {number} of {len(runs)}"
        record = make_run(study, run, truth, partial(_share_of, progress, stage))
        folder.mkdir(parents=True, exist_ok=True)  # not before: a study that fails at once leaves nothing behind
        append_record(file, record)
        progress(stage, 1.0)
        recorded(record)
        failed += "error" in record
    return Outcome(len(waiting), len(runs) - len(waiting), failed, file)


def _quick(run: Run) -> Run:
    """Return the run, or one to a rough tolerance in place of what it asks for."""
    return replace(run, asked_tolerance=ROUGH_TOLERANCE, asked_seconds=None) if run.target else run


def _chosen(runs: Sequence[Run], spacings: Sequence[float]) -> Sequence[Run]:
    """Return the runs of ``spacings``, all if there are none."""
    known = list(dict.fromkeys(run.spacing for run in runs if run.spacing is not None))
    unknown = [spacing for spacing in spacings if spacing not in known]
    if unknown:
        listed = ", ".join(f"{spacing:g}" for spacing in known)
        raise InputError(f"the study has no spacing {unknown[0]:g}; it has {listed}.")
    return [run for run in runs if run.spacing in spacings] if spacings else runs


def _share_of(progress: Progress, run: str, stage: str, share: float) -> None:
    """Report the progress of a stage of a run; the run itself ends later."""
    del stage
    progress(run, min(share, UNFINISHED_SHARE))
