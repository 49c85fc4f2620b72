"""The context of a solve: a discretised scene, the linear solver, and a cache of operators for later solves."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cpmkit.families.solve_options import Checkpointing
from cpmkit.forms.contract import Discretized, FormValues
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.preconditioned import ReusablePreconditioner, SharedPreconditioner
from cpmkit.linear.protocols import LinearSolver, Operator, PreparedSolver
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.equations import Terms
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Progress

#: Number of operators cached with their factors; a run in time has several, as steps before frames are shorter.
MOST_CACHED = 4


@dataclass(frozen=True, eq=False)
class OperatorCache:
    """Cache of operators and prepared solvers of a discretised scene; the most recently used are kept.

    Attributes
    ----------
    entries : dict
        Cached values by their keys, the least recently used first.
    shares_preconditioner : bool
        Whether the preconditioner of the first operator is used for further operators of the same size.
    shared : dict
        Prepared solvers whose preconditioners are used for further operators, by the size of the operators.
    """

    entries: dict[Hashable, Any] = field(default_factory=dict)
    shares_preconditioner: bool = False
    shared: dict[int, ReusablePreconditioner] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        # factors cannot be pickled, and are computed again
        return {"entries": {}, "shares_preconditioner": self.shares_preconditioner, "shared": {}}

    def get(self, key: Hashable, make: Callable[..., Any], *arguments: Any) -> Any:
        """Return the cached value of ``key``, or else ``make(*arguments)``, which is then cached.

        ``make`` must be no closure: if memory runs out, a closure would keep the tables of the form alive.
        """
        self.entries[key] = self.entries.pop(key) if key in self.entries else make(*arguments)
        while len(self.entries) > MOST_CACHED:
            del self.entries[next(iter(self.entries))]
        return self.entries[key]


def operator_key(terms: Terms) -> Hashable:
    """Return a key that is equal for equations with the same operator: all terms but f.

    Functions and arrays are compared by identity.
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
class SolveContext:
    """The input of the solver of a family of equations.

    Attributes
    ----------
    discretized : Discretized
        The scene on the unknowns of a form.
    solver : LinearSolver
        The solver of linear systems.
    solver_name : str
        Name of the linear solver: "direct", "reference" or the name of a plugin's solver.
    tolerance : float
        Relative residual of each linear solve.
    progress : callable
        ``progress(stage, fraction)``.
    started : float
        ``time.perf_counter()`` at the start of the solve.
    checkpointing : Checkpointing
        Files to which the state of a run in time is written and from which it is read.
    guess : (n, channels) float64, optional
        Initial guess of the iteration of a steady problem.
    cache : OperatorCache
        Operators and prepared solvers, shared by all solves on the same tables.
    default_tolerance : bool
        Whether ``tolerance`` is the default and not given by the user: the iteration of a single steady solve may then
        stop by an estimate of its error.
    """

    discretized: Discretized
    solver: LinearSolver
    solver_name: str
    tolerance: float
    progress: Progress
    started: float
    checkpointing: Checkpointing
    guess: Floats | None = None
    cache: OperatorCache = field(default_factory=OperatorCache)
    default_tolerance: bool = False

    @property
    def scene(self) -> Scene:
        """The scene that is solved."""
        return self.discretized.scene

    def prepare(self, operator: Operator) -> PreparedSolver:
        """Return the prepared solver of systems with ``operator``, using the form's multigrid levels.

        With ``cache.shares_preconditioner``, the preconditioner of an earlier operator of the same size is used.
        """
        lender = self.cache.shared.get(operator.size)
        if lender is not None:
            return SharedPreconditioner(lender.for_operator(operator), lambda: self._prepare(operator))
        prepared = self._prepare(operator)
        if self.cache.shares_preconditioner and isinstance(prepared, ReusablePreconditioner):
            self.cache.shared[operator.size] = prepared
        return prepared

    def _prepare(self, operator: Operator) -> PreparedSolver:
        """Return the prepared solver of systems with ``operator``, with a preconditioner of its own."""
        takes_levels = getattr(self.solver, "takes_levels", True)
        return self.solver.prepare(operator, self.discretized.levels(operator) if takes_levels else ())

    def constants(self, operator: Operator) -> ConstantFunctions:
        """Return the constant functions that are taken out of systems with ``operator`` before the solve."""
        return ConstantFunctions.of(operator, self.discretized.constant)

    def report(self, converged: bool, iterations: int, products: int, residual: float, reason: str) -> SolveReport:
        """Return the report of a solve that consists of several linear systems.

        ``products`` counts operator applications, ``residual`` is relative, ``reason`` says why the solve ended.
        """
        return SolveReport(self.solver_name, converged, iterations, products, residual, self.tolerance, reason)


def surely_positive(form: FormValues) -> bool:
    """Return whether the operator of the scene's equation surely has no eigenvalue below zero.

    It has none if there is no velocity, c is nowhere negative and all conditions are dissipative.
    """
    terms = form.scene.problem.terms()
    if terms.velocity is not None or float(form.data_at_points(terms.c, "the factor c").min(initial=0.0)) < 0:
        return False
    return all(condition.law.is_dissipative for condition in form.scene.conditions)
