"""Keyword options as type checkers and editors see them: the same names as are declared, and what each accepts.

What an option does, its default and its check stand where it is declared; a test holds both to each other.
"""

from __future__ import annotations

from os import PathLike
from typing import Any, Literal, TypedDict


class SolverKeywords(TypedDict, total=False):
    """How linear systems are solved; see :class:`cpmkit.linear.solver_options.SolverOptions`."""

    solver: str
    solver_tolerance: float | None
    max_iterations: int


class DiscretizingKeywords(TypedDict, total=False):
    """How a scene is discretised: what all forms share, and what belongs to one of them."""

    form: str
    origin: Any
    degree: int
    order: int
    sheets: bool
    strength: str
    samples: str
    tips: str
    refine: str
    refine_levels: int


class CheckpointingKeywords(TypedDict, total=False):
    """Where the state of a run in time is kept; see :class:`cpmkit.families.checkpointing.Checkpointing`."""

    checkpoint: str | PathLike[str] | None
    checkpoint_every: int
    resume: str | PathLike[str] | None


class AskedKeywords(TypedDict, total=False):
    """What a solution is to reach or to cost; see :class:`cpmkit.forms.accuracy_target.AccuracyTarget`."""

    tolerance: float | None
    norm: str
    seconds: float | None
    memory: float | str | None
    estimate: bool | Literal["tight"] | None


class PreparingKeywords(DiscretizingKeywords, SolverKeywords, total=False):
    """Options of ``prepare``, ``explain`` and ``estimate_error``."""


class SolvingKeywords(AskedKeywords, PreparingKeywords, CheckpointingKeywords, total=False):
    """Options of ``solve``."""
