"""The context of a solve: a discretised scene, the linear solver, and operators kept for the next solve."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cpmkit.families.solve_options import Checkpointing
from cpmkit.forms.contract import Discretized
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.preconditioned import ReusablePreconditioner, SharedPreconditioner
from cpmkit.linear.protocols import LinearSolver, Operator, PreparedSolver
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.equations import Terms
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Progress

#: Number of operators that are kept with their factors: a run in time has those of shortened steps before frames too.
MOST_CACHED = 4


@dataclass(frozen=True, eq=False)
class OperatorCache:
    """Operators and prepared solvers of a discretised scene, by their keys; those used last are kept.

    Attributes
    ----------
    entries : dict
        By key.
    shares_preconditioner : bool
        Whether the preconditioner of the first operator serves further operators of its size.
    shared : dict
        The prepared solvers whose preconditioners serve others, by the size of their operators.
    """

    entries: dict[Hashable, Any] = field(default_factory=dict)
    shares_preconditioner: bool = False
    shared: dict[int, ReusablePreconditioner] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        # factors cannot be pickled, and are made again
        return {"entries": {}, "shares_preconditioner": self.shares_preconditioner, "shared": {}}

    def get(self, key: Hashable, make: Callable[..., Any], *arguments: Any) -> Any:
        """Return the entry of a key; without one make it by ``make(*arguments)``.

        ``make`` is no closure: where memory runs out, a closure would keep the tables alive.
        """
        self.entries[key] = self.entries.pop(key) if key in self.entries else make(*arguments)
        while len(self.entries) > MOST_CACHED:
            del self.entries[next(iter(self.entries))]
        return self.entries[key]


def operator_key(terms: Terms) -> Hashable:
    """Return a key that is equal for equations with the same operator: all terms but f, compared by identity."""
    parts = terms.c, terms.diffusivity, terms.velocity, terms.conservative, terms.lumped
    return tuple(_IdentityKey(part) if callable(part) or isinstance(part, np.ndarray) else part for part in parts)


@dataclass(frozen=True, eq=False)
class _IdentityKey:
    """A key that is equal to a key of the same object alone, and keeps the object alive."""

    target: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _IdentityKey) and other.target is self.target

    def __hash__(self) -> int:
        return id(self.target)


@dataclass(frozen=True, eq=False)
class SolveContext:
    """A solve in progress, from which each family of equations makes a solution.

    Attributes
    ----------
    discretized : Discretized
        The scene on the unknowns of a form.
    solver : LinearSolver
        Solves linear systems.
    solver_name : str
        Its name: "direct", "reference" or a plugin's.
    tolerance : float
        Relative residual of each linear solve.
    progress : callable
        ``progress(stage, fraction)``.
    started : float
        ``time.perf_counter()`` when the solve began.
    checkpointing : Checkpointing
        Where the state of a run in time is written and read.
    guess : (n, channels) float64, optional
        Where the iteration of a steady problem starts.
    cache : OperatorCache
        Operators and prepared solvers, shared by all solves on the same tables.
    default_tolerance : bool
        Whether ``tolerance`` is the default, not one that the user gave: a single steady solve may then stop by its
        error.
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
        """Return the solver of systems with ``operator``, prepared with the levels of the form."""
        lender = self.cache.shared.get(operator.size)
        if lender is not None:
            return SharedPreconditioner(lender.for_operator(operator), lambda: self._prepare(operator))
        prepared = self._prepare(operator)
        if self.cache.shares_preconditioner and isinstance(prepared, ReusablePreconditioner):
            self.cache.shared[operator.size] = prepared
        return prepared

    def _prepare(self, operator: Operator) -> PreparedSolver:
        takes_levels = getattr(self.solver, "takes_levels", True)
        return self.solver.prepare(operator, self.discretized.levels(operator) if takes_levels else ())

    def constants(self, operator: Operator) -> ConstantFunctions:
        """Return the constants that are taken out of systems with ``operator``."""
        return ConstantFunctions.of(operator, self.discretized.constant)

    def report(self, converged: bool, iterations: int, products: int, residual: float, reason: str) -> SolveReport:
        """Return the report of a solve that is more than one linear system."""
        return SolveReport(self.solver_name, converged, iterations, products, residual, self.tolerance, reason)
