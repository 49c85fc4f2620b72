"""The context of a solve: a discretised scene, the linear solver, and a cache of operators for later solves."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypedDict

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.files.whole_files import check_name, check_place
from cpmkit.forms.contract import Discretized, FormValues
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.operators import Bordered, LinearSolver, Operator, PreparedSolver, Stiffness
from cpmkit.linear.preconditioned import PreconditionedGMRES
from cpmkit.linear.residuals import SolveReport
from cpmkit.runtime.arrays import whole
from cpmkit.runtime.options import DeclaredOptions, option
from cpmkit.runtime.progress import ShownProgress
from cpmkit.scene.equations import Equation, Terms
from cpmkit.scene.equations_in_time import Evolution
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Progress, no_progress


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


class PreparingKeywords(DiscretizingKeywords, total=False):
    """Keyword arguments of ``prepare``, ``explain`` and ``estimate_error``, with those for the linear solver."""

    solver: str
    solver_tolerance: float | None
    max_iterations: int


class SolvingKeywords(PreparingKeywords, CheckpointingKeywords, total=False):
    """Keyword arguments of ``solve``, beside its back end; targets are :class:`cpmkit.forms.options.AccuracyTarget`."""

    tolerance: float | None
    norm: str
    seconds: float | None
    memory: float | str | None
    estimate: bool | Literal["tight"] | None
    progress: ShownProgress


def _checkpoint_path(value: Any, label: str) -> Path | None:
    """Return the option ``value`` as the path of a checkpoint; None if it is None or empty.

    Raises InputError if it is not a path, or not an accepted name; ``label`` is the name of the option.
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
        _checkpoint_path,
    )
    checkpoint_every: int = option(100, "Steps between two checkpoints.", partial(whole, least=1))
    resume: Path | None = option(
        None,
        "A checkpoint of the same problem: the run continues from there, and ends with the same values, bit by bit, as "
        "without the interruption. A later ``until`` makes a run longer.",
        _checkpoint_path,
    )

    def check_for(self, problem: Equation) -> None:
        """Raise, before anything is computed, if checkpoints are not possible for the equation ``problem``.

        Raises InputError if the equation is not one in time, or a file cannot be written or read.
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


@dataclass(frozen=True, eq=False)
class OperatorCache:
    """Cache of operators and prepared solvers of a discretised scene; the most recently used are kept."""

    entries: dict[Hashable, Any] = field(default_factory=dict)  #: Cached values by key, the least recently used first.
    #: Whether the preconditioner of the first operator is used for further operators of the same size.
    shares_preconditioner: bool = False
    #: Prepared solvers whose preconditioners are used for further operators, by the size of the operators.
    shared: dict[int, PreconditionedGMRES] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        # factors cannot be pickled, and are computed again
        return {"entries": {}, "shares_preconditioner": self.shares_preconditioner, "shared": {}}

    def get(self, key: Hashable, make: Callable[..., Any], *arguments: Any) -> Any:
        """Return the cached value of ``key``, or else ``make(*arguments)``, and cache it; the last four used are kept.

        ``make`` must not be a closure, which would keep the tables of the form alive if memory runs out.
        """
        self.entries[key] = self.entries.pop(key) if key in self.entries else make(*arguments)
        while len(self.entries) > 4:  # a run in time has several, as steps before frames are shorter
            del self.entries[next(iter(self.entries))]
        return self.entries[key]


def operator_key(terms: Terms) -> Hashable:
    """Return the cache key (a tuple) of an equation's operator: all of its ``terms`` but f.

    Functions and arrays are equal only if they are the same object.
    """
    parts = terms.c, terms.diffusivity, terms.velocity, terms.conservative, terms.lumped
    return tuple(_IdentityKey(part) if callable(part) or isinstance(part, np.ndarray) else part for part in parts)


@dataclass(frozen=True, eq=False)
class _IdentityKey:
    """A key equal only to keys of the same object ``target``, which it keeps alive."""

    target: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _IdentityKey) and other.target is self.target

    def __hash__(self) -> int:
        return id(self.target)


@dataclass(frozen=True, eq=False)
class PreparedSystem:
    """An operator with its prepared solver, and the constant functions that are separated from its solutions."""

    operator: Operator
    solver: PreparedSolver
    constants: ConstantFunctions

    def solve(
        self, b: Any, tolerance: float, guess: Any = None, progress: Progress = no_progress
    ) -> tuple[Any, SolveReport]:
        """Return u (n, channels) with ``operator u = b`` and the report, as :meth:`ConstantFunctions.solve` does."""
        return self.constants.solve(self.solver, b, tolerance, guess, progress)


def with_border(form: Discretized, stiffness: Stiffness) -> Operator:
    """Return ``stiffness``, bordered if on a piece of the manifold no condition or term determines a constant."""
    free = form.free_constants(stiffness)
    return stiffness if free is None else Bordered(stiffness, free)


def apply_mass(form: Discretized, u: Floats) -> Floats:
    """Return M u (n, k) for u (n, k) and the mass matrix M of the form; u itself if the form has none."""
    return u if form.mass is None else form.mass.apply(u)


@dataclass(frozen=True, eq=False)
class SolveContext:
    """The input of the solver of a family of equations."""

    discretized: Discretized  #: The scene on the unknowns of a form.
    solver: LinearSolver  #: The solver of linear systems.
    solver_name: str  #: Name of the linear solver: a built-in one, such as "direct", or a plugin's.
    tolerance: float  #: Relative residual of each linear solve.
    progress: Progress  #: ``progress(stage, fraction)``.
    started: float  #: ``time.perf_counter()`` at the start of the solve.
    checkpointing: Checkpointing  #: Files to which the state of a run in time is written and from which it is read.
    guess: Floats | None = None  #: (n, channels): initial guess of the iteration of a steady problem.
    #: Operators and prepared solvers, shared by all solves on the same tables.
    cache: OperatorCache = field(default_factory=OperatorCache)
    #: Whether ``tolerance`` is the default and not given by the user: the iteration of a single steady solve may then
    #: stop by an estimate of its error.
    default_tolerance: bool = False

    @property
    def scene(self) -> Scene:
        """The scene that is solved."""
        return self.discretized.scene

    def prepare(self, operator: Operator) -> PreparedSolver:
        """Return the prepared solver of systems with ``operator``, given the form's multigrid levels if it takes any.

        With ``cache.shares_preconditioner``, later operators of equal size use the preconditioner of the first
        unsymmetric one that is solved by GMRES. Raises as the ``prepare`` of the linear solver does.
        """
        lender = self.cache.shared.get(operator.size)
        if lender is not None:
            return replace(lender, operator=operator, fallback=lambda: self._prepare(operator))
        prepared = self._prepare(operator)
        shares = self.cache.shares_preconditioner and not operator.symmetric  # only equations with a velocity
        if shares and isinstance(prepared, PreconditionedGMRES):
            self.cache.shared[operator.size] = prepared
        return prepared

    def _prepare(self, operator: Operator) -> PreparedSolver:
        """Return the prepared solver of systems with ``operator``, with a preconditioner of its own."""
        takes_levels = getattr(self.solver, "takes_levels", True)
        return self.solver.prepare(operator, self.discretized.levels(operator) if takes_levels else ())

    def prepare_system(self, operator: Operator) -> PreparedSystem:
        """Return ``operator`` with its prepared solver and the constant functions of the form."""
        constants = ConstantFunctions.from_functions(operator, self.discretized.constant)
        return PreparedSystem(operator, self.prepare(operator), constants)

    def report(self, converged: bool, iterations: int, products: int, residual: float, reason: str) -> SolveReport:
        """Return the report of a solve that consists of several linear systems.

        ``iterations`` and ``products`` are totals, ``residual`` is relative, ``reason`` says why the solve ended.
        """
        return SolveReport(self.solver_name, converged, iterations, products, residual, self.tolerance, reason)

    def common_fields(self, operator: Operator, report: SolveReport, built: float) -> dict[str, Any]:
        """Return discretized, report, work and seconds by name, the fields that all families fill alike in a solution.

        ``built`` is the value of time.perf_counter() after the assembly.
        """
        form, seconds = self.discretized, {"build": built - self.started, "solve": time.perf_counter() - built}
        return {"discretized": form, "report": report, "work": form.work(operator, report), "seconds": seconds}


def is_nonnegative(form: FormValues) -> bool:
    """Return True if the signs of the data show that the continuous operator has no eigenvalue below zero.

    The result is True if there is no velocity, c is nowhere negative and all conditions are dissipative. False means
    unknown.
    """
    terms = form.scene.problem.terms()
    if terms.velocity is not None or float(form.data_at_points(terms.c, "the factor c").min(initial=0.0)) < 0:
        return False
    return all(condition.law.is_dissipative for condition in form.scene.conditions)
