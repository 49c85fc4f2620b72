"""What a family of equations works on: a discretised scene, and the solver that was chosen."""

from __future__ import annotations

from dataclasses import dataclass

from cpmkit.families.checkpointing import Checkpointing
from cpmkit.forms.contract import Discretized
from cpmkit.protocols import LinearSolver, Operator, PreparedSolver, Progress
from cpmkit.scene.scene import Scene


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
    """

    discretized: Discretized
    solver: LinearSolver
    solver_name: str
    tolerance: float
    progress: Progress
    started: float
    checkpointing: Checkpointing

    @property
    def scene(self) -> Scene:
        """What is solved."""
        return self.discretized.scene

    def prepare(self, operator: Operator) -> PreparedSolver:
        """Return the solver of systems with ``operator``, with what it makes once of it and of the form's levels."""
        return self.solver.prepare(operator, self.discretized.levels(operator))
