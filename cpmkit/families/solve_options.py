"""Options of a solve: checkpoints of a run in time, and the keyword arguments that type checkers see.

The meaning, default and check of an option are given where it is declared; a test compares declarations and keywords.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypedDict

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import check_name, check_place
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.options import DeclaredOptions, option
from cpmkit.runtime.progress import ShownProgress
from cpmkit.scene.equations import Equation
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.solution.record import SolutionRecord


class SolverKeywords(TypedDict, total=False):
    """Keyword arguments for the linear solver; see :class:`cpmkit.linear.choice.SolverOptions`."""

    solver: str
    solver_tolerance: float | None
    max_iterations: int


class DiscretizingKeywords(TypedDict, total=False):
    """Keyword arguments for the discretisation: options of all forms and of single forms."""

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
    """Keyword arguments for checkpoints; see :class:`Checkpointing`."""

    checkpoint: str | PathLike[str] | None
    checkpoint_every: int
    resume: str | PathLike[str] | None


class PreparedKeywords(CheckpointingKeywords, total=False):
    """Keyword arguments of :meth:`cpmkit.preparing.Prepared.solve`, beside its equation."""

    data: Mapping[str, Any] | None
    guess: SolutionRecord | None


class TargetKeywords(TypedDict, total=False):
    """Keyword arguments for the target; see :class:`cpmkit.forms.accuracy_target.AccuracyTarget`."""

    tolerance: float | None
    norm: str
    seconds: float | None
    memory: float | str | None
    estimate: bool | Literal["tight"] | None


class PreparingKeywords(DiscretizingKeywords, SolverKeywords, total=False):
    """Keyword arguments of ``prepare``, ``explain`` and ``estimate_error``."""


class SolvingKeywords(TargetKeywords, PreparingKeywords, CheckpointingKeywords, total=False):
    """Keyword arguments of ``solve``, beside its back end."""

    progress: ShownProgress


def _path(value: Any, label: str) -> Path | None:
    """Return ``value`` as the path of a file; None if it is None or empty.

    Raises
    ------
    InputError
        If the value is not a path; ``label`` is its name in the message.
    """
    if value is None or value == "":
        return None
    if not isinstance(value, (str, os.PathLike)):
        raise InputError(f"{label} must be the path of an .npz file, got {shown(value)}.")
    check_name(Path(value))
    return Path(value)


@dataclass(frozen=True)
class Checkpointing(DeclaredOptions):
    """Options for writing and reading the state of a run in time."""

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
        """Raise, before anything is computed, if checkpoints are not possible for the equation ``problem``.

        Raises
        ------
        InputError
            If the equation is not one in time, or a file cannot be written or read.
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
