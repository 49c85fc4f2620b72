"""Linear solvers. Each returns a solution with a report, and raises when it did not converge."""

from __future__ import annotations

from functools import partial
from typing import Any

from cpmkit.errors import InputError
from cpmkit.plugins import call, factory, installed_kinds
from cpmkit.protocols import LinearSolver
from cpmkit.solvers.direct import solve_direct
from cpmkit.solvers.reference import solve_reference

#: Up to this many unknowns, by dimension of the manifold, a direct factorisation is the quicker one.
DIRECT_UP_TO = {0: 10**6, 1: 100_000, 2: 6_000, 3: 3_000}
SOLVERS = {"direct": solve_direct, "reference": solve_reference}


def choose_solver(name: str, unknowns: int, manifold_dim: int | None) -> str:
    """Return the solver that ``name`` means for this many unknowns; ``auto`` takes the quicker one."""
    if name != "auto":
        return name
    return "direct" if unknowns <= DIRECT_UP_TO.get(3 if manifold_dim is None else manifold_dim, 0) else "reference"


def check_solver(name: str) -> str:
    """Return ``name`` if a solver has it.

    Raises
    ------
    InputError
        If the name is neither auto, nor a built-in solver, nor a kind of an installed plugin.
    """
    if name != "auto" and name not in SOLVERS and name not in [installed.kind for installed in installed_kinds()]:
        raise InputError(f"solver must be auto, {', '.join(SOLVERS)}, or the kind of a solver's plugin, got {name!r}.")
    return name


def make_solver(name: str, options: dict[str, Any]) -> LinearSolver:
    """Return the built-in solver ``name``, or the one that a plugin makes, with its options.

    Raises
    ------
    InputError
        If an option is not one of the solver's.
    PluginError
        If ``name`` is the kind of something else.
    """
    if name not in SOLVERS:
        made: LinearSolver = call(factory(name, "cpmkit_solvers"), f"the solver {name!r}", options)
        return made
    accepted = {"reference": ("max_iterations",)}.get(name, ())
    unknown = [key for key in options if key not in accepted]
    if unknown:
        raise InputError(
            f"the solver {name!r} has no option {unknown[0]!r}; accepted are {', '.join(accepted) or 'none'}."
        )
    return partial(SOLVERS[name], **options)
