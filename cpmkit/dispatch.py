"""From a scene and its options to a solution: choice of the form that discretises and of the solver of the equation."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from cpmkit.families.context import Checkpointing, OperatorCache, SolveContext
from cpmkit.families.quasilinear import solve_nonlinear, solve_quasilinear
from cpmkit.forms.choice import Backend, every_option, explain_memory_error, module_of, options_of
from cpmkit.forms.contract import Discretized, require_ability
from cpmkit.forms.options import AccuracyTarget, Options, solver_of
from cpmkit.linear.solver_options import SOLVER_OPTIONS, SolverOptions, make_solver, make_step_solver
from cpmkit.plugins import call_factory, check_keys, factory, takes_key
from cpmkit.runtime.options import declared_options, split_options
from cpmkit.scene.laws import Nonlinear
from cpmkit.scene.nonlinear_equations import QuasilinearEquation
from cpmkit.scene.scene import Scene
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats, Progress, no_progress

#: The module and the function that solve each family of equations.
FAMILIES = {
    "steady": ("cpmkit.families.steady", "solve_steady"),
    "time": ("cpmkit.families.evolution.stepping", "solve_in_time"),
    "eigen": ("cpmkit.families.eigen.solve_eigen", "solve_eigen"),
    "coupled": ("cpmkit.families.coupled", "solve_coupled"),
    "biharmonic": ("cpmkit.families.coupled", "solve_biharmonic"),
}


def solve_scene(
    scene: Scene,
    spacing: float | None = None,
    *,
    backend: str = "cpm",
    progress: Progress = no_progress,
    **options: Any,
) -> SolutionRecord:
    """Return the solution of a scene by the form ``backend``; its warnings are stored in it, and not issued.

    ``spacing`` None is for a back end that needs none; ``options`` are those of :func:`cpmkit.solve` without accuracy
    targets. Raises CpmkitError if an argument is not accepted or the solver fails.
    """
    checkpointing, rest = split_options(Checkpointing, options)
    checkpointing.check_for(scene.problem)
    started = time.perf_counter()
    discretize, solver, target = resolve_options(backend, scene, spacing, progress, rest)
    with explain_memory_error(scene, target, solver.solver):  # no local may keep tables alive
        return solve_discretized(discretize(), solver, OperatorCache(), progress, checkpointing, started=started)


def solve_discretized(
    form: Discretized,
    options: SolverOptions,
    cache: OperatorCache,
    progress: Progress,
    checkpointing: Checkpointing,
    guess: Floats | None = None,
    started: float | None = None,
) -> SolutionRecord:
    """Solve a discretised scene by the solver of its equation's family, and return the solution.

    ``cache`` has operators and factors of earlier solves on the same tables, and receives new ones; ``guess``
    (unknowns, channels) begins iterations of steady problems; ``started`` is ``time.perf_counter()`` at the start
    of the discretisation, by default now. Raises CpmkitError as the family's solver does.
    """
    started = time.perf_counter() if started is None else started
    chosen = solver_of(form, options.solver)
    steps = form.scene.problem.family == "time"
    solver = make_step_solver(options, chosen) if steps else make_solver(chosen, options.further)
    default_tolerance = options.solver_tolerance is None
    context = SolveContext(
        form, solver, chosen, options.tolerance, progress, started, checkpointing, guess, cache, default_tolerance
    )
    if form.scene.has_tensor:
        require_ability(form, "diffusivity that is a tensor")
    module, function = FAMILIES[form.scene.problem.family]
    solve_family: Callable[[SolveContext], SolutionRecord] = getattr(import_module(module), function)
    if isinstance(form.scene.problem, QuasilinearEquation):
        solve_family = solve_quasilinear
    if any(isinstance(condition.law, Nonlinear) for condition in form.scene.conditions):
        return solve_nonlinear(context, solve_family)  # Newton's method around the family's solver
    return solve_family(context)


def resolve_options(
    backend: str, scene: Scene, spacing: float | None, progress: Progress, options: Mapping[str, Any]
) -> tuple[Callable[[], Discretized], SolverOptions, Options[Any] | None]:
    """Return (function that discretises the scene, solver options, lattice options) after a check of all options.

    The function has no arguments and returns the discretised scene. The lattice options are None for a ``backend``
    other than "cpm", for which ``spacing`` may be None. Raises InputError if an option is not accepted, SceneError if
    the form of "cpm" cannot discretise the scene, and PluginError if no installed plugin offers the back end.
    """
    if backend != "cpm":
        label = f"the back end {backend!r}"
        plugin: Backend = call_factory(factory(backend, "cpmkit_backends"), label, {})
        of_plugin = {name: value for name, value in options.items() if takes_key(plugin.discretize, name)}
        rest = {name: value for name, value in options.items() if name not in of_plugin}
        built_in = options.get("solver", "auto") in list(SOLVER_OPTIONS)  # a plugin's solver checks its options itself
        of_solver = (*declared_options(SolverOptions), *(SOLVER_OPTIONS["auto"] if built_in else rest))
        check_keys(plugin.discretize, label, options, (*declared_options(Checkpointing), *of_solver))
        table = {"scene": scene, "spacing": spacing, "progress": progress, **of_plugin}
        return lambda: call_factory(plugin.discretize, label, table), SolverOptions.from_keywords(rest), None
    target, rest = options_of(scene, spacing, options)
    solver = SolverOptions.from_keywords(
        rest, (*every_option(), *declared_options(AccuracyTarget), *declared_options(Checkpointing))
    )
    form = module_of(target.form)
    form.check(scene, target)
    return lambda: form.discretize(scene, target, progress), solver, target
