"""Options of a solve: where the state of a run in time is written, and the keywords that type checkers see.

What an option does, its default and its check stand where it is declared; a test compares declarations and keywords.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypedDict

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import check_name, check_place
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.options import DeclaredOptions, option
from cpmkit.scene.equations import Equation
from cpmkit.scene.equations_in_time import Evolution


class SolverKeywords(TypedDict, total=False):
    """How linear systems are solved; see :class:`cpmkit.linear.choice.SolverOptions`."""

    solver: str
    solver_tolerance: float | None
    max_iterations: int


class DiscretizingKeywords(TypedDict, total=False):
    """How a scene is discretised: options of all forms, and of each."""

    form: str
    origin: Any
    degree: int
    order: int
    sheets: bool
    stabilisation: str
    samples: str
    tips: str
    refine: str
    refine_levels: int


class CheckpointingKeywords(TypedDict, total=False):
    """Where the state of a run in time is written; see :class:`Checkpointing`."""

    checkpoint: str | PathLike[str] | None
    checkpoint_every: int
    resume: str | PathLike[str] | None


class TargetKeywords(TypedDict, total=False):
    """The target of a solution; see :class:`cpmkit.forms.accuracy_target.AccuracyTarget`."""

    tolerance: float | None
    norm: str
    seconds: float | None
    memory: float | str | None
    estimate: bool | Literal["tight"] | None


class PreparingKeywords(DiscretizingKeywords, SolverKeywords, total=False):
    """Options of ``prepare``, ``explain`` and ``estimate_error``."""


class SolvingKeywords(TargetKeywords, PreparingKeywords, CheckpointingKeywords, total=False):
    """Options of ``solve``."""


def _path(value: Any, label: str) -> Path | None:
    """Return the path of a file; None where the value is None or empty."""
    if value is None or value == "":
        return None
    if not isinstance(value, (str, os.PathLike)):
        raise InputError(f"{label} must be the path of an .npz file, got {shown(value)}.")
    check_name(Path(value))
    return Path(value)


@dataclass(frozen=True)
class Checkpointing(DeclaredOptions):
    """Where the state of a run is written and read."""

    checkpoint: Path | None = option(
        None,
        "Of problems in time: an .npz file to which the state of the run is written every ``checkpoint_every`` steps "
        "and at the end, each time completely.",
        _path,
    )
    checkpoint_every: int = option(100, "Steps between two checkpoints.", partial(whole, least=1))
    resume: Path | None = option(
        None,
        "A checkpoint of the same problem: the run continues from there, and ends with the same values, bit by bit, as "
        "without the interruption. A later ``until`` makes a run longer.",
        _path,
    )

    def check_for(self, problem: Equation) -> None:
        """Refuse, before anything is built, checkpoints that an equation cannot have.

        Raises
        ------
        InputError
            If the problem has no time, or a file cannot be written or read.
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
