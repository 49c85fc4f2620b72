"""A system solved with the preconditioner of another one that differs a little."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from cpmkit.errors import ConvergenceError
from cpmkit.linear.report import SolveReport
from cpmkit.protocols import Floats, Operator, PreparedSolver, Progress, no_progress


@runtime_checkable
class Lends(PreparedSolver, Protocol):
    """A prepared solver whose preconditioner serves other operators of its size, with more iterations."""

    @property
    def operator(self) -> Operator:
        """That it was made for."""

    def for_operator(self, operator: Operator, /) -> PreparedSolver:
        """Return the iteration for another operator with the same preconditioner."""


@dataclass(frozen=True, eq=False)
class Lent:
    """The iteration with what another one lends, and what prepares its own should that not do.

    Attributes
    ----------
    iteration : PreparedSolver
        With the preconditioner that was lent.
    prepare : callable
        Returns the one with its own.
    """

    iteration: PreparedSolver
    prepare: Callable[[], PreparedSolver]

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Solve for all channels.

        Raises
        ------
        ConvergenceError
            If neither preconditioner leads to the tolerance.
        """
        try:
            return self.iteration.solve(b, tolerance, guess, progress)
        except ConvergenceError:
            return self.prepare().solve(b, tolerance, guess, progress)
