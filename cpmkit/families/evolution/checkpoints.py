"""Checkpoints: files with the state of a run in time, from which the run continues with the same results."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.families.evolution.semidiscrete import (
    REMEMBERED_MOMENTS,
    ROUNDED_STEP_SHARE,
    Moment,
    RunPlan,
    RunState,
    SolveTally,
    apply_after_step,
)
from cpmkit.files.array_files import SavedArray, read_json_table, read_saved
from cpmkit.files.plain_values import record_from_table
from cpmkit.files.whole_files import written_whole
from cpmkit.types import Floats

MOMENT_ARRAYS = ("u", "rate", "acceleration")  #: Names of the arrays of a moment.
#: The arrays of a checkpoint. ``digest`` identifies the run; ``contents`` is a digest of all other arrays.
CHECKPOINT_ARRAYS = (
    SavedArray("run", "U"),
    SavedArray("tally", "U"),
    SavedArray("digest", "U"),
    SavedArray("contents", "U"),
    SavedArray("ends", "f", ("steps",)),
    SavedArray("kept", "b", ("steps",)),
    SavedArray("lengths", "f", ("moments",)),
    SavedArray("frames", "f", ("frames", "unknowns", "channels")),
    SavedArray("energies", "f", ("energies", "channels"), needed=False),
    *(
        SavedArray(f"{name}_{k}", "f", ("unknowns", "channels"), needed=False)
        for name in MOMENT_ARRAYS
        for k in range(REMEMBERED_MOMENTS)
    ),
)
CHECKPOINT_WORDS = "a checkpoint of a run in time"


def write_checkpoint(path: Path, plan: RunPlan, state: RunState, tally: SolveTally) -> None:
    """Write ``state``, after at least one step, into an .npz file, completely or not at all, with digests of its run.

    ``tally`` has the counts of the linear solves. Raises InputError if the file cannot be written.
    """
    arrays: dict[str, Any] = {
        f"{name}_{k}": array
        for k, moment in enumerate(state.history)
        for name in MOMENT_ARRAYS
        if (array := getattr(moment, name)) is not None
    }
    done = plan.steps[: state.done]
    arrays["lengths"] = np.array([moment.length for moment in state.history])
    arrays["ends"] = np.array([step.end for step in done])
    arrays["kept"] = np.array([step.is_frame for step in done])
    arrays["frames"] = np.stack(state.frames) if state.frames else np.zeros((0, *plan.start.u.shape))
    if state.energies:
        arrays["energies"] = np.stack(state.energies)
    arrays["tally"] = np.array(json.dumps(asdict(tally)))
    arrays["run"] = np.array(json.dumps(describe_run(plan)))
    arrays["digest"] = np.array(digest_run(plan, done[-1].end))
    arrays["contents"] = np.array(digest_arrays(arrays))
    with written_whole(path) as unfinished:
        np.savez(unfinished, **arrays)


def read_checkpoint(path: Path, plan: RunPlan) -> tuple[RunState, SolveTally]:
    """Return the state of the run ``plan`` from a checkpoint, and the counts of its linear solves so far.

    Raises InputError if the file is not a checkpoint, is damaged or altered, or belongs to another run: scene, spacing,
    scheme, step and frames so far must agree.
    """
    (text,) = read_saved(path, CHECKPOINT_ARRAYS[:1], CHECKPOINT_WORDS).values()
    run = read_json_table(text, path, "run")
    for key, value in describe_run(plan).items():
        if run.get(key) != value:
            raise InputError(f"{_mismatch(path)}: its {key} is {shown(run.get(key))}, and here it is {value!r}.")
    unknowns, channels = plan.start.u.shape
    arrays = read_saved(path, CHECKPOINT_ARRAYS, CHECKPOINT_WORDS, {"unknowns": unknowns, "channels": channels})
    contents = str(arrays.pop("contents"))
    _check_steps(path, plan, arrays)
    if contents != digest_arrays(arrays):
        raise InputError(f"{shown(path.name)} is not as it was written: its arrays do not match their digest.")
    if str(arrays["digest"]) != digest_run(plan, float(arrays["ends"][-1])):
        raise InputError(f"{_mismatch(path)}: the scene, its data or the versions of the libraries are not the same.")
    tally = record_from_table(
        SolveTally, read_json_table(arrays["tally"], path, "tally"), f"the tally of {shown(path.name)}"
    )
    times = [plan.start.time, *(step.end for step in plan.steps[: len(arrays["ends"])])][-len(arrays["lengths"]) :]
    history = tuple(
        Moment(arrays[f"u_{k}"], arrays.get(f"rate_{k}"), float(length), arrays.get(f"acceleration_{k}"), times[k])
        for k, length in enumerate(arrays["lengths"])
    )
    return RunState(len(arrays["ends"]), history, tuple(arrays["frames"]), tuple(arrays.get("energies", ()))), tally


def _mismatch(path: Path) -> str:
    return f"The checkpoint {path} is of another run"


def _check_steps(path: Path, plan: RunPlan, arrays: Mapping[str, np.ndarray]) -> None:
    """Raise InputError if a checkpoint's steps are not the first of this run, or its state does not belong to them.

    ``arrays`` are those of the file ``path`` by name, see :data:`CHECKPOINT_ARRAYS`.
    """
    ends, is_frame = arrays["ends"], arrays["kept"]
    done = plan.steps[: len(ends)]
    same = len(done) == len(ends) > 0 and np.array_equal(is_frame, [step.is_frame for step in done])
    if not same or not _same_times(ends, [step.end for step in done], plan):
        raise InputError(f"{_mismatch(path)}: its {len(ends)} steps and their frames are not those of this one.")
    lengths = [0.0, *(step.length for step in done)][-REMEMBERED_MOMENTS:]
    moments = range(len(lengths))
    frames = int(np.count_nonzero(is_frame)) + (plan.start.time in plan.evolution.frame_times)
    needed = [f"{name}_{k}" for name in ("u", "rate")[: 1 if plan.start.rate is None else 2] for k in moments]
    lacking = [name for name in needed if name not in arrays]
    if lacking or len(arrays["frames"]) != frames or not _same_times(arrays["lengths"], lengths, plan):
        raise InputError(
            f"{shown(path.name)} is damaged: after {len(done)} steps it should hold {len(lengths)} moments with their "
            f"lengths and {frames} frames, and it holds {len(arrays['lengths'])} and {len(arrays['frames'])}"
            f"{f', without {lacking[0]}' if lacking else ''}."
        )


def _same_times(times: Floats, expected: Sequence[float], plan: RunPlan) -> bool:
    """Return True if ``times`` (k,) are the ``expected`` ones up to rounding, a share of the step of ``plan``."""
    rounding = ROUNDED_STEP_SHARE * plan.evolution.step
    return len(times) == len(expected) and bool(np.abs(times - expected).max() <= rounding)


def digest_arrays(arrays: Mapping[str, np.ndarray]) -> str:
    """Return a digest of the names, types, shapes and entries of arrays, by which a damaged file is recognised."""
    digest = hashlib.blake2b(digest_size=16)
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        text = array.dtype.kind == "U"
        digest.update(f"{name} {'text' if text else array.dtype.str} {array.shape};".encode())
        digest.update(str(array).encode() if text else np.ascontiguousarray(array).data)
    return digest.hexdigest()


def digest_run(plan: RunPlan, time: float) -> str:
    """Return a digest (hexadecimal) of a run's operators, initial values, and data at the start and at ``time``."""
    problem, start = plan.problem, plan.start
    probe = np.random.default_rng(0).normal(size=(problem.form.size, 1))
    tables = [array for group in problem.groups for array in (group.stiffness.apply(probe), group.stiffness.diagonal)]
    data = [start.u, *([] if start.rate is None else [start.rate]), problem.forcing(start.time), problem.forcing(time)]
    data += [apply_after_step(problem.form, plan.evolution, replace(start, time=when)).u for when in (start.time, time)]
    if problem.reaction is not None:
        data += [problem.reaction_load(replace(start, u=start.u.copy(), time=when)) for when in (start.time, time)]
    digest = hashlib.blake2b(digest_size=16)
    for array in [*tables, *data]:
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def describe_run(plan: RunPlan) -> dict[str, Any]:
    """Return the definition of a run as plain values by name, to be compared at a resume; ``until`` is left out."""
    form, evolution = plan.problem.form, plan.evolution
    return {
        "kind": evolution.kind,
        "scheme": evolution.scheme,
        "start": getattr(evolution, "start", ""),
        "step": evolution.step,
        **({"t0": evolution.t0} if evolution.t0 else {}),
        "spacing": form.spacing,
        **{name: value for name, value in form.describe().items() if isinstance(value, (int, float, str))},
        "number of unknowns": form.size,
        "number of channels": form.scene.channels,
    }
