"""What a solve works on: a scene, its tables, and the solver that was chosen."""

from __future__ import annotations

from dataclasses import dataclass

from cpmkit.families.evolution.checkpoints import Checkpointing
from cpmkit.forms.collocation.discretization import Discretization
from cpmkit.protocols import LinearSolver, Progress
from cpmkit.scene.scene import Scene


@dataclass(frozen=True, eq=False)
class Job:
    """A solve under way: each family of equations makes a solution of it.

    Attributes
    ----------
    scene : Scene
        What is solved.
    tables : Discretization
        Its tables.
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
    balance : int
        Degree of the polynomials against which fluxes balance, 0 for none; of steady problems.
    """

    scene: Scene
    tables: Discretization
    solver: LinearSolver
    solver_name: str
    tolerance: float
    progress: Progress
    started: float
    checkpointing: Checkpointing
    balance: int
