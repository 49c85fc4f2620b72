"""The choice of the linear solver, by name or by expected speed, and the solver's options."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cpmkit.errors import InputError, shown
from cpmkit.linear.direct import DirectSolver
from cpmkit.linear.krylov import ReferenceSolver
from cpmkit.linear.multigrid.solver import MultigridSolver
from cpmkit.linear.operators import LinearSolver
from cpmkit.linear.preconditioned import JacobiOrMultigrid, JacobiSolver
from cpmkit.plugins import call_factory, factory, installed_kinds
from cpmkit.runtime.arrays import positive, whole
from cpmkit.runtime.messages import FORM_NAMES, did_you_mean
from cpmkit.runtime.options import DeclaredOptions, declared_options, option

#: Up to this many unknowns, by dimension of the manifold, the direct solver is faster than the reference solver.
DIRECT_UNKNOWNS = {0: 10**6, 1: 100_000, 2: 600, 3: 300}
#: The same where a form has levels for multigrid.
DIRECT_BESIDE_MULTIGRID = {**DIRECT_UNKNOWNS, 2: 1_500, 3: 1_000}
SOLVERS: Mapping[str, Callable[..., LinearSolver]] = {
    "direct": DirectSolver,
    "multigrid": MultigridSolver,
    "jacobi": JacobiSolver,
    "reference": ReferenceSolver,
}
#: Names of the options of the built-in solvers.
SOLVER_OPTIONS: dict[str, tuple[str, ...]] = {
    name: () if name == "direct" else ("max_iterations",) for name in ("auto", *SOLVERS)
}


def choose_solver(
    name: str, unknowns: int, manifold_dim: int, factor: float = 1.0, iterative: str = "reference"
) -> str:
    """Return ``name``, or if that is ``auto`` the name of the faster solver for this number of unknowns.

    ``manifold_dim`` is the dimension of the manifold. A ``factor`` above one favours the direct solver, for problems
    that iterative solvers solve slowly. ``iterative`` is the solver of large systems: ``multigrid`` where the form has
    levels for the problem, ``direct`` where no iterative solver is suitable.
    """
    if name != "auto":
        return name
    limits = DIRECT_BESIDE_MULTIGRID if iterative == "multigrid" else DIRECT_UNKNOWNS
    return "direct" if unknowns <= factor * limits.get(manifold_dim, 0) else iterative


def _check_tolerance(tolerance: Any, label: str) -> float | None:
    """Return a tolerance as a float, or None; raise InputError with ``label`` unless it is above 0 and below 1."""
    if tolerance is None:
        return None
    value = positive(tolerance, label)
    if value >= 1:  # u = 0 would be accepted
        raise InputError(f"{label} must be below 1, got {value:g}: u = 0 has a relative residual of 1; use 1e-10.")
    return value


def make_solver(name: str, options: Mapping[str, Any]) -> LinearSolver:
    """Return the built-in solver ``name``, or a plugin's solver of that kind, with its ``options`` by name.

    A built-in solver ignores options that it does not have. Raises SceneError if a plugin's solver does not accept an
    option, PluginError if ``name`` is no kind, or that of a source, a condition or a back end.
    """
    if name in SOLVERS:
        return SOLVERS[name](**{key: value for key, value in options.items() if key in SOLVER_OPTIONS[name]})
    solver: LinearSolver = call_factory(factory(name, "cpmkit_solvers"), f"the solver {name!r}", options)
    return solver


def make_step_solver(options: SolverOptions, chosen: str) -> LinearSolver:
    """Return the solver of the systems M + factor A of time steps; ``chosen`` names the solver of other systems.

    If ``options.solver`` is ``auto``, multigrid is replaced by conjugate gradients with the diagonal where M dominates;
    reports name it. Raises SceneError or PluginError as :func:`make_solver` does.
    """
    solver = make_solver(chosen, options.further)
    return JacobiOrMultigrid(solver) if options.solver == "auto" and isinstance(solver, MultigridSolver) else solver


@dataclass(frozen=True)
class SolverOptions(DeclaredOptions):
    """The choice of the linear solver, its tolerance, and in ``further`` the options of the solver itself.

    Raises InputError if the name is neither auto, nor a built-in solver, nor a kind of an installed plugin, or an
    option is unknown or has a value that is not accepted; for a kind of a plugin the errors of :func:`make_solver`.
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
        """Check the options declared here, the name of the solver, and its own options; raises as the class says."""
        super().__post_init__()
        name, further = self.solver, self.further
        if name not in [*SOLVER_OPTIONS]:  # a list is refused, though it is no key
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
    def tolerance(self) -> float:
        """The relative residual that linear systems have to reach, the default if the user sets none."""
        return 1e-10 if self.solver_tolerance is None else self.solver_tolerance

    @classmethod
    def from_keywords(cls, keywords: Mapping[str, Any], others: Iterable[str] = ()) -> SolverOptions:
        """Return the options from ``keywords``; those that are not declared here are options of the solver itself.

        The InputError for an unknown option suggests a similar name, among those of ``others`` too.
        """
        selected = {name: keywords[name] for name in declared_options(cls) if name in keywords}
        further = {name: value for name, value in keywords.items() if name not in selected}
        _check_further(keywords.get("solver", cls.solver), further, (*others, *declared_options(cls)))
        return cls(**selected, further=further)


def _check_further(solver: Any, further: Mapping[str, Any], others: Iterable[str] = ()) -> None:
    """Raise InputError if ``further`` has an option that a built-in solver lacks; ``others`` are suggested too."""
    accepted = SOLVER_OPTIONS.get(solver) if isinstance(solver, str) else None
    unknown = [] if accepted is None else [key for key in further if key not in accepted]
    if accepted is not None and unknown:
        value = further[unknown[0]]
        is_form = isinstance(value, str) and value in FORM_NAMES
        hint = f" (did you mean form={value!r}?)" if is_form else did_you_mean(unknown[0], (*accepted, *others))
        raise InputError(
            f"the solver {solver!r} has no option {unknown[0]!r}{hint}; accepted are {', '.join(accepted) or 'none'}."
        )
