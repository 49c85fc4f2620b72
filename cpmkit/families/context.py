"""What a family of equations works on: a discretised scene, and the solver that was chosen."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cpmkit.families.checkpointing import Checkpointing
from cpmkit.forms.contract import Discretized
from cpmkit.linear.constant_functions import ConstantFunctions
from cpmkit.linear.preconditioned import ReusablePreconditioner, SharedPreconditioner
from cpmkit.linear.protocols import LinearSolver, Operator, PreparedSolver
from cpmkit.linear.solve_report import SolveReport
from cpmkit.scene.equations import Terms
from cpmkit.scene.scene import Scene
from cpmkit.types import Floats, Progress

#: So many operators are kept with their factors: of a run in time, those of shortened steps before frames, too.
KEPT = 4


@dataclass(frozen=True, eq=False)
class Kept:
    """What was made of a discretised scene, by what it was made for; what was used last is kept.

    Attributes
    ----------
    made : dict
        Operators and prepared solvers.
    lends : bool
        Whether the first operator's preconditioner serves the others of its size.
    lenders : dict
        The prepared solvers that lend theirs, by the size of their operators.
    """

    made: dict[Hashable, Any] = field(default_factory=dict)
    lends: bool = False
    lenders: dict[int, ReusablePreconditioner] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        return {"made": {}, "lends": self.lends, "lenders": {}}  # factors do not pickle, and are made again

    def get(self, key: Hashable, make: Callable[..., Any], *arguments: Any) -> Any:
        """Return what was made for ``key``, or make it of the ``arguments``.

        No closure: where memory runs out, one would hold the tables.
        """
        self.made[key] = self.made.pop(key) if key in self.made else make(*arguments)
        while len(self.made) > KEPT:
            del self.made[next(iter(self.made))]
        return self.made[key]


def left_side(terms: Terms) -> Hashable:
    """Return what tells the operators of two equations apart: all terms but f, functions and arrays by themselves."""
    parts = terms.c, terms.diffusivity, terms.velocity, terms.conservative, terms.lumped
    return tuple(_Itself(one) if callable(one) or isinstance(one, np.ndarray) else one for one in parts)


@dataclass(frozen=True, eq=False)
class _Itself:
    """A key that is equal to another of the same thing alone, and keeps it alive."""

    thing: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Itself) and other.thing is self.thing

    def __hash__(self) -> int:
        return id(self.thing)


@dataclass(frozen=True, eq=False)
class SolveContext:
    """A solve under way: each family of equations makes a solution of it.

    Attributes
    ----------
    discretized : Discretized
        The scene on a form's unknowns.
    solver : LinearSolver
        Solves linear systems.
    solver_name : str
        Its name: "direct", "reference" or a plugin's.
    tolerance : float
        Relative residual of each linear solve.
    progress : callable
        Told the stage and the share of it that is done.
    started : float
        ``time.perf_counter()`` when the solve began.
    checkpointing : Checkpointing
        Where the state of a run in time is written and read.
    guess : (n, channels) float64, optional
        Where the iteration of a steady problem starts.
    kept : Kept
        Operators and prepared solvers, shared by all solves on the same tables.
    by_default : bool
        True if nobody asked for that tolerance: one solve that nothing is built on may then stop by its error.
    """

    discretized: Discretized
    solver: LinearSolver
    solver_name: str
    tolerance: float
    progress: Progress
    started: float
    checkpointing: Checkpointing
    guess: Floats | None = None
    kept: Kept = field(default_factory=Kept)
    by_default: bool = False

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return self.discretized.scene

    def prepare(self, operator: Operator) -> PreparedSolver:
        """Return the solver of systems with ``operator``, with what it makes once of it and of the form's levels."""
        lender = self.kept.lenders.get(operator.size)
        if lender is not None:
            return SharedPreconditioner(lender.for_operator(operator), lambda: self._prepare(operator))
        made = self._prepare(operator)
        if self.kept.lends and isinstance(made, ReusablePreconditioner):
            self.kept.lenders[operator.size] = made
        return made

    def _prepare(self, operator: Operator) -> PreparedSolver:
        takes = getattr(self.solver, "takes_levels", True)
        return self.solver.prepare(operator, self.discretized.levels(operator) if takes else ())

    def constants(self, operator: Operator) -> ConstantFunctions:
        """Return the constants that are taken out of systems with ``operator``."""
        return ConstantFunctions.of(operator, self.discretized.constant)

    def report(self, converged: bool, iterations: int, products: int, residual: float, reason: str) -> SolveReport:
        """Return the report of a solve that is more than one linear system."""
        return SolveReport(self.solver_name, converged, iterations, products, residual, self.tolerance, reason)
