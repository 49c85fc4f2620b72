"""Factors of the assembled matrix, with a step of iterative refinement where more than rounding is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.linear.factorization import Factors, factorize
from cpmkit.linear.report import SolveReport, judge
from cpmkit.protocols import Floats, Operator, Progress, no_progress

#: A residual below this share of the tolerance is not refined: by default one of 1e-14, where nothing is to be won.
REFINED_SHARE = 1e-4


@dataclass(frozen=True)
class Direct:
    """SuperLU, or dense Cholesky factors of what is small, symmetric and positive."""

    takes_levels: ClassVar[bool] = False

    def prepare(self, operator: Operator, levels: Sequence[Any] = ()) -> Factorized:
        """Factorise.

        Raises
        ------
        SceneError
            If the matrix is singular.
        """
        del levels
        try:
            return Factorized(operator, factorize(operator))
        except RuntimeError as error:
            raise SceneError(
                f"The linear system is singular ({error}): nothing fixes the solution somewhere."
            ) from error


@dataclass(frozen=True, eq=False)
class Factorized:
    """An operator with its factors."""

    operator: Operator
    factors: Factors

    def solve(
        self, b: Floats, tolerance: float, guess: Floats | None = None, progress: Progress = no_progress
    ) -> tuple[Floats, SolveReport]:
        """Solve for all channels.

        Raises
        ------
        ConvergenceError
            If the residual is above the tolerance.
        """
        del guess
        progress("solve", 0.0)
        u = self.factors.solve(b)
        rest = b - self.operator.apply(u)
        if np.linalg.norm(rest) > REFINED_SHARE * tolerance * np.linalg.norm(b):
            u += self.factors.solve(rest)
        progress("solve", 1.0)
        remedy = "ask for a larger solver_tolerance: rounding limits a direct solve"
        return u, judge(self.operator, b, u, "direct", tolerance, 0, 1, remedy)
