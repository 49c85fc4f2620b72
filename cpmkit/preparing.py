"""A scene discretised once, and solved for many equations and right-hand sides."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Generic, Literal, TypeVar, Unpack, overload

from cpmkit.errors import InputError
from cpmkit.families.checkpointing import Checkpointing
from cpmkit.families.context import Kept, SolveContext
from cpmkit.families.keywords import CheckpointingKeywords, PreparingKeywords
from cpmkit.families.nonlinear import solve_nonlinear
from cpmkit.families.quasilinear import solve_quasilinear
from cpmkit.forecast.running_out import explain_memory_error
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.forms.choice import FORMS, every_option, module_of, options_of
from cpmkit.forms.contract import Discretized, require
from cpmkit.forms.field import Field, field_of
from cpmkit.forms.options import Options, solver_of
from cpmkit.linear.solver_options import SOLVER_OPTIONS, SolverOptions, make_solver, solver_of_steps
from cpmkit.plugins import call, check_keys, factory, takes
from cpmkit.protocols import Backend, Floats, Progress, no_progress
from cpmkit.runtime.messages import did_you_mean, warn_each
from cpmkit.runtime.options import declared, showing, take
from cpmkit.runtime.progress import ShownProgress, shown_progress
from cpmkit.scene.equations import Equation, Solved
from cpmkit.scene.laws import Nonlinear
from cpmkit.scene.nonlinear_equations import QuasilinearEquation
from cpmkit.scene.scene import Scene, restated
from cpmkit.solution.solution import Solution

Other = TypeVar("Other", bound=Solution)
#: The module that solves each family of equations, and its function.
FAMILIES = {
    "steady": ("cpmkit.families.steady", "solve_steady"),
    "time": ("cpmkit.families.evolution.stepping", "solve_in_time"),
    "eigen": ("cpmkit.families.eigen.solving", "solve_eigen"),
    "coupled": ("cpmkit.families.coupled", "solve_coupled"),
    "biharmonic": ("cpmkit.families.biharmonic", "solve_biharmonic"),
}


@dataclass(frozen=True, eq=False)
class Prepared(Generic[Solved]):
    """A scene on a form's unknowns, for many equations and right-hand sides; see :func:`prepare`.

    Attributes
    ----------
    discretized : Discretized
        The scene with its tables.
    solver : SolverOptions
        How linear systems are solved.
    progress : callable or bool, optional
        As for :func:`cpmkit.solve`.
    options : Options, optional
        How it is discretised by the closest point method.
    kept : Kept
        Operators and factors that were used last.
    others : dict
        The same tables with other solvers, see :meth:`solved_by`.
    """

    discretized: Discretized
    solver: SolverOptions
    progress: ShownProgress = None
    options: Options[Any] | None = None
    kept: Kept = field(default_factory=Kept)
    others: dict[str, Prepared[Any]] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        made = self.discretized
        what = f"form {made.form}, spacing {made.spacing:g}, {made.size:,} unknowns, solver {self.solver.solver}"
        return f"<Prepared: {what}\n  {self.scene.problem.kind} on {self.scene.surface!r}>"

    @overload
    def solve(
        self,
        *,
        problem: None = None,
        data: Mapping[str, Any] | None = None,
        guess: Solution | None = None,
        **options: Unpack[CheckpointingKeywords],
    ) -> Solved: ...
    @overload
    def solve(
        self,
        *,
        problem: Equation[Other],
        data: Mapping[str, Any] | None = None,
        guess: Solution | None = None,
        **options: Unpack[CheckpointingKeywords],
    ) -> Other: ...
    @showing(Checkpointing)
    def solve(
        self,
        *,
        problem: Equation[Any] | None = None,
        data: Mapping[str, Any] | None = None,
        guess: Solution | None = None,
        **options: Any,
    ) -> Any:
        """Solve an equation on the tables that are there.

        Parameters
        ----------
        problem : Equation, optional
            Another equation than the scene's.
        data : mapping, optional
            Other conditions of the same kinds, which differ in their data alone, by boundary: ``{"cut":
            Dirichlet(2)}``, ``{"cut": {"left": ..., "right": ...}}``, and ``{"edge": ...}`` for the edge.
        guess : Solution, optional
            Of the same tables, near which an iterative solver starts; of steady problems.
        **options
            Any other is refused.

        Returns
        -------
        Solution

        Raises
        ------
        CpmkitError
            One sentence: what was got, what is accepted, what to do.
        """
        checkpointing, others = take(Checkpointing, options)
        if others:
            known = ("problem", "data", "guess", *declared(Checkpointing))
            name = next(iter(others))
            raise InputError(
                f"Prepared.solve has no option {name!r}{did_you_mean(name, known)}; those of the solver are given to "
                "prepare."
            )
        scene = restated(self.discretized.scene, problem, data)
        checkpointing.check_for(scene.problem)
        start = None if guess is None else guess.values
        if start is not None and start.shape != (self.discretized.size, scene.channels):
            raise InputError(
                f"guess must be a solution on the same tables, ({self.discretized.size}, {scene.channels}) values, got "
                f"{start.shape}."
            )
        with explain_memory_error(scene, self.options, self.solver.solver):
            solution = self.run(scene, checkpointing, start)
        warn_each(solution.warnings)
        return solution

    def solved_by(self, solver: str, **options: Any) -> Prepared[Solved]:
        """Return the same tables with another solver, ``direct``, ``multigrid`` or another, and its options.

        What that one makes of the tables, factors above all, is kept for the next time.

        Raises
        ------
        InputError
            If there is no such solver, or it takes no such option.
        """
        target = SolverOptions.of({"solver": solver, **options})
        if target == self.solver:
            return self
        key = repr(target)
        if key not in self.others:
            self.others[key] = replace(self, solver=target, kept=Kept())
        return self.others[key]

    def lending(self) -> Prepared[Solved]:
        """Return the same tables for equations that differ a little, as the rounds of an iteration do.

        What preconditions the first one that has a velocity preconditions the following ones too, which then take some
        iterations more, and half of the time or less. One that does not converge so gets its own. Direct solvers, and
        equations without a velocity, are not concerned.
        """
        return replace(self, kept=Kept(lends=True), others={})

    @property
    def scene(self) -> Scene:
        """What is prepared."""
        return self.discretized.scene

    @property
    def points(self) -> Floats:
        """(p, d) where the scene's form keeps values: samples, or feet of nodes; in the scene's coordinates."""
        return self.discretized.points.copy()

    def field(self, data: Any) -> Field:
        """Return values at the points where the scene's form keeps them; see :class:`~cpmkit.Field`.

        Parameters
        ----------
        data : number, sequence, array, callable, VertexData or Solution
            A function of points; the values at ``prepared.points`` themselves, (p,) or (p, channels); or a solution,
            which is read without loss if it is on the same tables.
        """
        return field_of(self.discretized, data)

    def run(
        self,
        scene: Scene,
        checkpointing: Checkpointing,
        guess: Floats | None = None,
        started: float | None = None,
    ) -> Solution:
        """Solve a scene that differs from the prepared one in its equation and data alone."""
        started = time.perf_counter() if started is None else started
        form = self.discretized if scene is self.discretized.scene else self.discretized.with_scene(scene)
        chosen = solver_of(form, self.solver.solver)
        steps = scene.problem.family == "time"
        made = solver_of_steps(self.solver, chosen) if steps else make_solver(chosen, self.solver.further)
        with shown_progress(self.progress) as progress:
            return _solve_family(
                SolveContext(
                    form,
                    made,
                    chosen,
                    self.solver.residual,
                    progress,
                    started,
                    checkpointing,
                    guess,
                    self.kept,
                    by_default=self.solver.solver_tolerance is None,
                )
            )


def _solve_family(context: SolveContext) -> Solution:
    """Solve by the family of the scene's equation, by Newton's method where fluxes depend on the solution."""
    if context.scene.has_tensor:
        require(context.discretized, "diffusivity that is a tensor")
    module, function = FAMILIES[context.scene.problem.family]
    solve_family: Callable[[SolveContext], Solution] = getattr(import_module(module), function)
    if isinstance(context.scene.problem, QuasilinearEquation):
        solve_family = solve_quasilinear
    if any(isinstance(condition.law, Nonlinear) for condition in context.scene.conditions):
        return solve_nonlinear(context, solve_family)
    return solve_family(context)


def solved(
    scene: Scene,
    spacing: float | None = None,
    *,
    backend: str = "cpm",
    progress: Progress = no_progress,
    **options: Any,
) -> Solution:
    """Solve a scene as :func:`cpmkit.solve` does, and leave its warnings in the solution."""
    checkpointing, rest = take(Checkpointing, options)
    checkpointing.check_for(scene.problem)
    started = time.perf_counter()
    discretise, solver, target = ask(backend, scene, spacing, progress, rest)
    with explain_memory_error(scene, target, solver.solver):  # nothing here holds the tables, should memory run out
        return Prepared(discretise(), solver, progress, target).run(scene, checkpointing, started=started)


@overload
def prepare(
    scene: Scene[Solved],
    spacing: float | None = None,
    *,
    backend: Literal["cpm"] = "cpm",
    progress: ShownProgress = None,
    **options: Unpack[PreparingKeywords],
) -> Prepared[Solved]: ...
@overload
def prepare(
    scene: Scene[Solved],
    spacing: float | None = None,
    *,
    backend: str,
    progress: ShownProgress = None,
    **options: Any,
) -> Prepared[Solved]: ...
@showing(Options, *FORMS.values(), SolverOptions)
def prepare(
    scene: Scene,
    spacing: float | None = None,
    *,
    backend: str = "cpm",
    progress: ShownProgress = None,
    **options: Any,
) -> Prepared[Any]:
    """Discretise a scene once, for many equations and right-hand sides on it.

    Parameters
    ----------
    scene : Scene
        With the equation that is solved unless another is given.
    spacing : float
        Spacing of the lattice, in the scene's unit of length.
    backend : str
        ``cpm``, or the name of a back end that a plugin offers, as for :func:`cpmkit.solve`.
    progress : callable or bool, optional
        As for :func:`cpmkit.solve`.
    **options
        Further ones of the solver. For another back end, its own options.

    Returns
    -------
    Prepared

    Raises
    ------
    CpmkitError
        One sentence: what was got, what is accepted, what to do.

    Examples
    --------
    The tables and the factors are made once.

    >>> import cpmkit as ck
    >>> circle = ck.source("analytic.circle")
    >>> prepared = ck.prepare(ck.Scene(circle, ck.ScreenedPoisson(1.0)), spacing=0.1)
    >>> [float(prepared.solve(problem=ck.ScreenedPoisson(f)).evaluate([[1, 0]])[0].round(6)) for f in (1.0, 3.0)]
    [1.0, 3.0]
    """
    with shown_progress(progress) as shown:
        discretise, solver, target = ask(backend, scene, spacing, shown, options)
        with explain_memory_error(scene, target, solver.solver):
            return Prepared(discretise(), solver, progress, target)


def ask(
    backend: str, scene: Scene, spacing: float | None, progress: Progress, given: Mapping[str, Any]
) -> tuple[Callable[[], Discretized], SolverOptions, Options[Any] | None]:
    """Return what discretises, how systems are solved, and the options of the closest point method, all checked.

    Raises
    ------
    InputError
        If an option is not accepted.
    PluginError
        If no installed plugin offers the back end.
    """
    if backend != "cpm":
        return (*_ask_elsewhere(backend, scene, spacing, progress, given), None)
    target, rest = options_of(scene, spacing, given)
    solver, form = (
        SolverOptions.of(rest, (*every_option(), *declared(AccuracyTarget), *declared(Checkpointing))),
        module_of(target.form),
    )
    form.check(scene, target)
    return lambda: form.discretize(scene, target, progress), solver, target


def _ask_elsewhere(
    backend: str, scene: Scene, spacing: float | None, progress: Progress, given: Mapping[str, Any]
) -> tuple[Callable[[], Discretized], SolverOptions]:
    """Return what discretises by a plugin's form; an option that it lacks is answered with those that it takes."""
    what = f"the back end {backend!r}"
    made: Backend = call(factory(backend, "cpmkit_backends"), what, {})
    own = {name: value for name, value in given.items() if takes(made.discretize, name)}
    rest = {name: value for name, value in given.items() if name not in own}
    built_in = given.get("solver", "auto") in list(SOLVER_OPTIONS)  # a plugin's solver checks its options itself
    of_solver = (*declared(SolverOptions), *(SOLVER_OPTIONS["auto"] if built_in else rest))
    check_keys(made.discretize, what, given, (*declared(Checkpointing), *of_solver))
    table = {"scene": scene, "spacing": spacing, "progress": progress, **own}
    return lambda: call(made.discretize, what, table), SolverOptions.of(rest)
