"""Which linear solver it is: by name, or the quicker one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.linear.direct import Direct
from cpmkit.linear.jacobi import Jacobi, Quicker
from cpmkit.linear.multigrid.solver import Multigrid
from cpmkit.linear.reference import Reference
from cpmkit.plugins import call, factory, installed_kinds
from cpmkit.protocols import LinearSolver
from cpmkit.runtime.arrays import positive, whole
from cpmkit.runtime.messages import did_you_mean
from cpmkit.runtime.options import Declared, declared, option

#: Up to this many unknowns, by dimension of the manifold, a direct factorisation is the quicker one.
DIRECT_UNKNOWNS = {0: 10**6, 1: 100_000, 2: 600, 3: 300}
#: The same where a form has coarser levels for a multigrid.
DIRECT_BESIDE_MULTIGRID = {**DIRECT_UNKNOWNS, 2: 1_500, 3: 1_000}
#: Relative residual of linear systems where none is asked for.
DEFAULT_RESIDUAL = 1e-10
SOLVERS: Mapping[str, Callable[..., LinearSolver]] = {
    "direct": Direct,
    "multigrid": Multigrid,
    "jacobi": Jacobi,
    "reference": Reference,
}
#: Options of the built-in solvers.
SOLVER_OPTIONS = {
    "auto": ("max_iterations",),
    "direct": (),
    "multigrid": ("max_iterations",),
    "jacobi": ("max_iterations",),
    "reference": ("max_iterations",),
}


def choose_solver(
    name: str, unknowns: int, manifold_dim: int, factor: float = 1.0, iterative: str = "reference"
) -> str:
    """Return the solver that ``name`` means for this many unknowns; ``auto`` takes the quicker one.

    A ``factor`` above one is for what an iterative solver does slowly or not at all. ``iterative`` is the one for large
    systems: ``multigrid`` where a form has symmetric operators and coarser levels for them, ``direct`` where none is.
    """
    if name != "auto":
        return name
    most = DIRECT_BESIDE_MULTIGRID if iterative == "multigrid" else DIRECT_UNKNOWNS
    return "direct" if unknowns <= factor * most.get(manifold_dim, 0) else iterative


def _check_tolerance(tolerance: Any, what: str) -> float | None:
    if tolerance is None:
        return None
    value = positive(tolerance, what)
    if value >= 1:  # nothing would be solved
        raise InputError(f"{what} must be below 1, got {value:g}: u = 0 has a relative residual of 1; use 1e-10.")
    return value


def make_solver(name: str, options: Mapping[str, Any]) -> LinearSolver:
    """Return the built-in solver ``name``, or the one that a plugin makes, with its options.

    Raises
    ------
    SceneError
        If an option is not one of the plugin's solver.
    PluginError
        If ``name`` is the kind of something else.
    """
    if name in SOLVERS:
        return SOLVERS[name](**{key: value for key, value in options.items() if key in SOLVER_OPTIONS[name]})
    made: LinearSolver = call(factory(name, "cpmkit_solvers"), f"the solver {name!r}", options)
    return made


def solver_of_steps(target: SolverOptions, chosen: str) -> LinearSolver:
    """Return the solver of systems M + factor A, which steps in time pose, where ``chosen`` is that of others.

    With ``auto`` the multigrid's cycle gives way to the diagonal where M dominates: what was chosen is told by reports.
    """
    made = make_solver(chosen, target.further)
    return Quicker(made) if target.solver == "auto" and isinstance(made, Multigrid) else made


@dataclass(frozen=True)
class SolverOptions(Declared):
    """How linear systems are solved; ``further`` are options of the solver's own, ``auto`` takes all built-in ones'.

    Raises
    ------
    InputError
        If the name is neither auto, nor a built-in solver, nor a kind of an installed plugin, or an option is unknown
        or not what is accepted.
    """

    solver: str = option(
        "auto",
        "``auto``, ``direct``, ``multigrid``, ``jacobi``, ``reference``, or the kind of a solver that a plugin offers.",
    )
    solver_tolerance: float | None = option(
        None,
        "Relative residual of linear systems, recomputed after the solve; 1e-10 if left out, but steady problems of "
        "the Galerkin form by ``multigrid`` stop at 1e-8 of the preconditioned residual, which follows the error, and "
        "1e-6 of the residual. It is relative to what is left of the right side when a constant u is taken out, and "
        "what rounding leaves of a residual is accepted.",
        _check_tolerance,
    )
    further: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        name, further = self.solver, self.further
        if name not in SOLVER_OPTIONS:
            if name not in [installed.kind for installed in installed_kinds()]:
                raise InputError(
                    f"solver must be auto, {', '.join(SOLVERS)}, or the kind of a solver's plugin, got {shown(name)}."
                )
            make_solver(name, further)
            return
        _check_further(name, further)
        if "max_iterations" in further:
            whole(further["max_iterations"], f"max_iterations of the solver {name!r}", 1)

    @property
    def residual(self) -> float:
        """Relative residual of linear systems, asked for or not."""
        return DEFAULT_RESIDUAL if self.solver_tolerance is None else self.solver_tolerance

    @classmethod
    def of(cls, given: Mapping[str, Any], others: Iterable[str] = ()) -> SolverOptions:
        """Return the options among keyword arguments; all that are not declared are the solver's own.

        One that a built-in solver lacks is answered with the one that may be meant, ``others`` among them.
        """
        own = {name: given[name] for name in declared(cls) if name in given}
        further = {name: value for name, value in given.items() if name not in own}
        _check_further(given.get("solver", cls.solver), further, (*others, *declared(cls)))
        return cls(**own, further=further)


def _check_further(solver: Any, further: Mapping[str, Any], others: Iterable[str] = ()) -> None:
    """Refuse options that a built-in solver lacks; a plugin's checks its own."""
    accepted = SOLVER_OPTIONS.get(solver) if isinstance(solver, str) else None
    unknown = [] if accepted is None else [key for key in further if key not in accepted]
    if accepted is not None and unknown:
        near = did_you_mean(unknown[0], (*accepted, *others))
        raise InputError(
            f"the solver {solver!r} has no option {unknown[0]!r}{near}; accepted are {', '.join(accepted) or 'none'}."
        )
