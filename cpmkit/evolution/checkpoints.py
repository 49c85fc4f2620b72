"""Checkpoints: the state of a run in time, written now and then, from which it goes on as if it had not stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from cpmkit.errors import InputError
from cpmkit.evolution.equations import Evolution
from cpmkit.evolution.schedule import ROUNDING, Step
from cpmkit.evolution.schemes import Moment
from cpmkit.evolution.semidiscrete import SemiDiscrete
from cpmkit.evolution.shifted import Tally
from cpmkit.files import written_whole
from cpmkit.problems import Equation
from cpmkit.protocols import Bools, Floats

#: Steps between two checkpoints unless asked otherwise.
EVERY = 100
#: Arrays of a moment.
MOMENT = ("u", "rate", "acceleration")


@dataclass(frozen=True)
class Checkpointing:
    """Where the state of a run is written and read.

    Attributes
    ----------
    write : Path or None
        Written every so many steps, each time whole.
    every : int
        Steps in between.
    resume : Path or None
        Where the run goes on from.
    """

    write: Path | None = None
    every: int = EVERY
    resume: Path | None = None


@dataclass(frozen=True, eq=False)
class RunPlan:
    """What makes a run what it is.

    Attributes
    ----------
    problem : SemiDiscrete
        A and b(t).
    evolution : Evolution
        The equation, its scheme and its step.
    steps : sequence of Step
        From the start to the end.
    start : Moment
        The unknowns at time 0.
    """

    problem: SemiDiscrete
    evolution: Evolution
    steps: Sequence[Step]
    start: Moment


@dataclass(frozen=True, eq=False)
class RunState:
    """Where a run is.

    Attributes
    ----------
    done : int
        Steps taken.
    history : tuple of Moment
        The last moments, the latest last.
    frames : tuple of (n, channels) float64
        Values of the frames so far.
    """

    done: int
    history: tuple[Moment, ...]
    frames: tuple[Floats, ...]


def check_checkpointing(
    problem: Equation, write: str | Path | None, every: int, resume: str | Path | None
) -> Checkpointing:
    """Return the request, checked before anything is built.

    Raises
    ------
    InputError
        If the problem has no time, ``every`` is no number of steps, or a file cannot be what is asked of it.
    """
    asked = Checkpointing(Path(write) if write else None, every, Path(resume) if resume else None)
    if (write or resume) and not isinstance(problem, Evolution):
        raise InputError(
            f"checkpoint and resume are for problems in time, not for {problem.kind!r}; leave them out, or use Heat."
        )
    if isinstance(every, bool) or not isinstance(every, int) or every < 1:
        raise InputError(f"checkpoint_every must be a number of steps, at least 1, got {every!r}.")
    if asked.write is not None and (asked.write.suffix != ".npz" or not asked.write.parent.is_dir()):
        raise InputError(f"a checkpoint must be an .npz file in a folder that exists, got {str(asked.write)!r}.")
    if asked.resume is not None and not asked.resume.is_file():
        raise InputError(f"no checkpoint {str(asked.resume)!r}; give the file that an earlier run wrote.")
    return asked


def write_checkpoint(path: Path, plan: RunPlan, state: RunState, tally: Tally) -> None:
    """Write ``state``, whole or not at all, with all that tells which run it belongs to.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    arrays: dict[str, Any] = {
        f"{name}_{k}": array
        for k, moment in enumerate(state.history)
        for name in MOMENT
        if (array := getattr(moment, name)) is not None
    }
    done = plan.steps[: state.done]
    arrays["lengths"] = np.array([moment.length for moment in state.history])
    arrays["ends"] = np.array([step.end for step in done])
    arrays["kept"] = np.array([step.is_frame for step in done])
    arrays["frames"] = np.array(state.frames)
    arrays["tally"] = np.array(json.dumps(asdict(tally)))
    arrays["run"] = np.array(json.dumps(_described(plan)))
    arrays["digest"] = np.array(_digest(plan, done[-1].end))
    with written_whole(path) as unfinished:
        np.savez(unfinished, **arrays)


def read_checkpoint(path: Path, plan: RunPlan) -> tuple[RunState, Tally]:
    """Return the state that ``path`` holds.

    Raises
    ------
    InputError
        If it is no checkpoint, or one of another run: scene, spacing, scheme, step and frames so far must agree.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays: dict[str, Any] = dict(file)
        run, ends, kept = json.loads(str(arrays["run"])), arrays["ends"], arrays["kept"]
        tally = Tally(**json.loads(str(arrays["tally"])))
        history = tuple(
            Moment(arrays[f"u_{k}"], arrays.get(f"rate_{k}"), float(length), arrays.get(f"acceleration_{k}"))
            for k, length in enumerate(arrays["lengths"])
        )
        frames, digest = tuple(arrays["frames"]), str(arrays["digest"])
    except (OSError, BadZipFile, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{path} is not a checkpoint of a run in time: {error}.") from error
    _check_same(path, plan, run, ends, kept, digest)
    return RunState(len(ends), history, frames), tally


def _check_same(path: Path, plan: RunPlan, run: dict[str, Any], ends: Floats, kept: Bools, digest: str) -> None:
    """Refuse the checkpoint of another run, and say what differs."""
    differs = f"The checkpoint {path} is of another run"
    for key, value in _described(plan).items():
        if run.get(key) != value:
            raise InputError(f"{differs}: its {key} is {run.get(key)!r}, and here it is {value!r}.")
    done = plan.steps[: len(ends)]
    same = len(done) == len(ends) and np.array_equal(kept, [step.is_frame for step in done])
    if not same or np.abs(ends - [step.end for step in done]).max() > ROUNDING * plan.evolution.step:
        raise InputError(f"{differs}: its {len(ends)} steps and their frames are not those of this one.")
    if digest != _digest(plan, float(ends[-1])):
        raise InputError(f"{differs}: the scene, its data or the versions of the libraries are not the same.")


def _described(plan: RunPlan) -> dict[str, Any]:
    """Return what makes a run what it is, as far as it fits a sentence; ``until`` may differ."""
    layout, evolution = plan.problem.tables.layout, plan.evolution
    return {
        "kind": evolution.kind,
        "scheme": evolution.scheme,
        "start": getattr(evolution, "start", ""),
        "step": evolution.step,
        "spacing": layout.lattice.spacing,
        "degree": layout.band.degree,
        "order": layout.order,
        "number of unknowns": plan.problem.operator.size,
        "number of channels": layout.channels,
    }


def _digest(plan: RunPlan, time: float) -> str:
    """Return a digest of the tables, of the start, and of the data at the start and at ``time``."""
    problem, start = plan.problem, plan.start
    E, W = problem.operator.extension, problem.operator.differences
    tables = [problem.tables.layout.band.nodes, E.data, E.indices, W.data, W.indices, problem.operator.diagonal]
    data = [start.u, *([] if start.rate is None else [start.rate]), problem.forcing(0.0), problem.forcing(time)]
    digest = hashlib.blake2b(digest_size=16)
    for array in [*tables, *data]:
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()
