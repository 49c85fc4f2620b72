"""Sparse LU of the assembled matrix, with one step of iterative refinement."""

from __future__ import annotations

from cpmkit.errors import SceneError
from cpmkit.linear.operators import LinearSystem
from cpmkit.linear.report import SolveReport, judge
from cpmkit.protocols import Floats, Progress


def solve_direct(system: LinearSystem, tolerance: float, progress: Progress) -> tuple[Floats, SolveReport]:
    """Solve by SuperLU.

    Raises
    ------
    SceneError
        If the matrix is singular.
    ConvergenceError
        If the residual is above the tolerance.
    """
    progress("solve", 0.0)
    try:
        factors = system.operator.factors
    except RuntimeError as error:
        raise SceneError(f"The linear system is singular ({error}): nothing fixes the solution somewhere.") from error
    u = factors.solve(system.right_side)
    u += factors.solve(system.right_side - system.apply(u))
    progress("solve", 1.0)
    return u, judge(system, u, "direct", tolerance, 0, 1, "ask for a larger tolerance: rounding limits a direct solve")
