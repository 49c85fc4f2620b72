"""What is asked of a run in time: where its state is written, how often, and where it goes on from."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import check_name
from cpmkit.runtime.arrays import whole
from cpmkit.scene.equations import Equation
from cpmkit.scene.equations_in_time import Evolution

#: Steps between two checkpoints unless asked otherwise.
EVERY = 100


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


def check_checkpointing(
    problem: Equation, write: str | Path | None, every: int, resume: str | Path | None
) -> Checkpointing:
    """Return the request, checked before anything is built.

    Raises
    ------
    InputError
        If the problem has no time, ``every`` is no number of steps, or a file cannot be what is asked of it.
    """
    if (write or resume) and not isinstance(problem, Evolution):
        raise InputError(
            f"checkpoint and resume are for problems in time, not for {problem.kind!r}; leave them out, or use Heat."
        )
    asked = Checkpointing(_path(write, "checkpoint"), whole(every, "checkpoint_every", 1), _path(resume, "resume"))
    if asked.write is not None and (asked.write.suffix != ".npz" or not asked.write.parent.is_dir()):
        raise InputError(f"a checkpoint must be an .npz file in a folder that exists, got {shown(str(asked.write))}.")
    if asked.resume is not None and not asked.resume.is_file():
        raise InputError(f"no checkpoint {shown(str(asked.resume))}; give the file that an earlier run wrote.")
    return asked


def _path(given: Any, what: str) -> Path | None:
    """Return what names a file as a path; None where nothing is asked for."""
    if given is None or given == "":
        return None
    if not isinstance(given, (str, os.PathLike)):
        raise InputError(f"{what} must be the path of an .npz file, got {shown(given)}.")
    check_name(Path(given))
    return Path(given)
