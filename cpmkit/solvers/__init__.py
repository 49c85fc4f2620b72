"""Linear solvers. Each returns a solution with a report, and raises when it did not converge."""

from __future__ import annotations

from typing import Any

from cpmkit.errors import InputError
from cpmkit.operators import LinearSystem
from cpmkit.protocols import Floats, Progress
from cpmkit.solvers.direct import solve_direct
from cpmkit.solvers.reference import solve_reference
from cpmkit.solvers.report import SolveReport

#: Up to this many unknowns, by dimension of the manifold, a direct factorisation is the quicker one.
DIRECT_UP_TO = {0: 10**6, 1: 100_000, 2: 6_000, 3: 3_000}
SOLVERS = {"direct": solve_direct, "reference": solve_reference}


def choose_solver(name: str, unknowns: int, manifold_dim: int | None) -> str:
    """Return the solver that ``name`` means for this many unknowns; ``auto`` takes the quicker one.

    Raises
    ------
    InputError
        If the name is none of auto, direct, reference.
    """
    if name == "auto":
        return "direct" if unknowns <= DIRECT_UP_TO.get(3 if manifold_dim is None else manifold_dim, 0) else "reference"
    if name not in SOLVERS:
        raise InputError(f"solver must be one of auto, {', '.join(SOLVERS)}, got {name!r}.")
    return name


def solve_system(
    system: LinearSystem, name: str, tolerance: float, progress: Progress, **options: Any
) -> tuple[Floats, SolveReport]:
    """Solve ``system`` with the solver ``name`` to a relative residual of ``tolerance``.

    Returns
    -------
    u : (n, channels) float64
    report : SolveReport

    Raises
    ------
    ConvergenceError
        If the residual, recomputed after the solve, is above the tolerance.
    """
    return SOLVERS[name](system, tolerance, progress, **options)
