"""What is asked of a run in time: where its state is written, how often, and where it goes on from."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import check_name, check_place
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.options import DeclaredOptions, option
from cpmkit.scene.equations import Equation
from cpmkit.scene.equations_in_time import Evolution


def _path(given: Any, what: str) -> Path | None:
    """Return what names a file as a path; None where nothing is asked for."""
    if given is None or given == "":
        return None
    if not isinstance(given, (str, os.PathLike)):
        raise InputError(f"{what} must be the path of an .npz file, got {shown(given)}.")
    check_name(Path(given))
    return Path(given)


@dataclass(frozen=True)
class Checkpointing(DeclaredOptions):
    """Where the state of a run is written and read."""

    checkpoint: Path | None = option(
        None,
        "Of problems in time: an .npz file in which the state of the run is kept, written every ``checkpoint_every`` "
        "steps and at the end, each time whole.",
        _path,
    )
    checkpoint_every: int = option(100, "Steps between two checkpoints.", partial(whole, least=1))
    resume: Path | None = option(
        None,
        "A checkpoint of the same problem: the run goes on from there, and ends with the same values, bit by bit, as "
        "without the interruption. A later ``until`` makes a run longer.",
        _path,
    )

    def check_for(self, problem: Equation) -> None:
        """Refuse, before anything is built, what cannot be done for an equation.

        Raises
        ------
        InputError
            If the problem has no time, or a file cannot be what is asked of it.
        """
        write, resume = self.checkpoint, self.resume
        if (write or resume) and not isinstance(problem, Evolution):
            raise InputError(
                f"checkpoint and resume are for problems in time, not for {problem.kind!r}; leave them out, or use "
                "Heat."
            )
        if write is not None and (write.suffix != ".npz" or not write.parent.is_dir()):
            raise InputError(f"a checkpoint must be an .npz file in a folder that exists, got {shown(str(write))}.")
        if resume is not None and not resume.is_file():
            raise InputError(f"no checkpoint {shown(str(resume))}; give the file that an earlier run wrote.")
        if write is not None:
            check_place(write)
