"""Scenes discretised once and solved for many equations and right-hand sides."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Literal, Unpack, overload

from cpmkit.dispatch import resolve_options, solve_discretized
from cpmkit.errors import InputError, shown
from cpmkit.facade import EigenSolution, EvolvedSolution, Solution
from cpmkit.families.context import Checkpointing, OperatorCache, PreparedKeywords, PreparingKeywords
from cpmkit.forms.choice import FORMS, explain_memory_error
from cpmkit.forms.contract import Discretized
from cpmkit.forms.field import Field, field_of
from cpmkit.forms.options import Options
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.runtime.messages import did_you_mean, warn_each
from cpmkit.runtime.options import declared_options, document_options, split_options
from cpmkit.runtime.progress import ShownProgress, shown_progress
from cpmkit.scene.equations import EigenFamily, Equation, Family, TimeFamily
from cpmkit.scene.scene import Scene, with_replaced_data
from cpmkit.solution.record import SolutionRecord
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class Prepared(Generic[Family]):
    """A scene discretised once, for many equations and right-hand sides; see :func:`prepare`."""

    discretized: Discretized  #: The discretised scene with its tables.
    solver: SolverOptions  #: Options of the linear solver.
    progress: ShownProgress = None  #: A callable, or whether to show it, as for :func:`cpmkit.solve`.
    options: Options[Any] | None = None  #: Options of the discretisation on a lattice; None for another back end.
    cache: OperatorCache = field(default_factory=OperatorCache)  #: The most recently used operators and factors.
    #: The same tables with other solvers; see :meth:`solved_by`.
    others: dict[str, Prepared[Any]] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        form = self.discretized
        parts = f"form {form.form}, spacing {form.spacing:g}, {form.size:,} unknowns, solver {self.solver.solver}"
        return f"<Prepared: {parts}\n  {self.scene.problem.kind} on {self.scene.surface!r}>"

    @overload
    def solve(
        self: Prepared[EigenFamily], *, problem: None = None, **options: Unpack[PreparedKeywords]
    ) -> EigenSolution: ...
    @overload
    def solve(
        self: Prepared[TimeFamily], *, problem: None = None, **options: Unpack[PreparedKeywords]
    ) -> EvolvedSolution: ...
    @overload
    def solve(self, *, problem: Equation[EigenFamily], **options: Unpack[PreparedKeywords]) -> EigenSolution: ...
    @overload
    def solve(self, *, problem: Equation[TimeFamily], **options: Unpack[PreparedKeywords]) -> EvolvedSolution: ...
    @overload
    def solve(self, *, problem: Equation[Any] | None = None, **options: Unpack[PreparedKeywords]) -> Solution: ...
    @document_options(Checkpointing)
    def solve(
        self,
        *,
        problem: Equation | None = None,
        data: Mapping[str, Any] | None = None,
        guess: SolutionRecord | None = None,
        **options: Any,
    ) -> Any:
        """Solve an equation with the prepared tables, and return its solution.

        Parameters
        ----------
        problem : Equation, optional
            An equation in place of the scene's.
        data : mapping, optional
            Conditions of the same kinds with other data, by boundary: ``{"cut": Dirichlet(2)}``, ``{"cut": {"left":
            ..., "right": ...}}``, and ``{"edge": ...}`` for the edge.
        guess : Solution, optional
            A solution on the same tables, at which iterations of steady problems, also Newton's, start; else not used.
        **options
            Other options are refused.

        Returns
        -------
        Solution

        Raises
        ------
        CpmkitError
            One sentence: the value that was given, the values that are accepted, and a remedy.
        """
        checkpointing, others = split_options(Checkpointing, options)
        if others:
            known = ("problem", "data", "guess", *declared_options(Checkpointing))
            name = next(iter(others))
            raise InputError(
                f"Prepared.solve has no option {name!r}{did_you_mean(name, known)}; those of the solver are given to "
                "prepare."
            )
        scene = with_replaced_data(self.discretized.scene, problem, data)
        checkpointing.check_for(scene.problem)
        start = getattr(guess, "values", None)
        if guess is not None and getattr(start, "shape", None) != (self.discretized.size, scene.channels):
            raise InputError(
                f"guess must be a solution on the same tables, ({self.discretized.size}, {scene.channels}) values, got "
                f"{getattr(start, 'shape', shown(guess))}."
            )
        with explain_memory_error(scene, self.options, self.solver.solver), shown_progress(self.progress) as progress:
            started = time.perf_counter()
            form = self.discretized if scene is self.discretized.scene else self.discretized.with_scene(scene)
            solution = solve_discretized(form, self.solver, self.cache, progress, checkpointing, start, started)
        warn_each(solution.warnings)
        return solution

    def solved_by(self, solver: str, **options: Any) -> Prepared[Family]:
        """Return the scene, discretised as here, prepared for another linear solver, given by its name and options.

        The result is cached, with its factors and multigrid levels, for further calls; for the same solver it is this
        object. Raises InputError if there is no such solver, or it has no such option.
        """
        target = SolverOptions.from_keywords({"solver": solver, **options})
        if target == self.solver:
            return self
        key = repr(target)
        if key not in self.others:
            self.others[key] = replace(self, solver=target, cache=OperatorCache())
        return self.others[key]

    def sharing_preconditioner(self) -> Prepared[Family]:
        """Return the prepared scene for equations that differ a little from each other, as in an iteration.

        The preconditioner of the first equation with a velocity is used for the following ones too, which then take a
        few iterations more, but half of the time or less. An equation that does not converge with it gets its own.
        Direct solvers, and equations without a velocity, are not affected.
        """
        return replace(self, cache=OperatorCache(shares_preconditioner=True), others={})

    lending = DeprecatedMember("sharing_preconditioner")

    @property
    def scene(self) -> Scene:
        """The prepared scene."""
        return self.discretized.scene

    @property
    def points(self) -> Floats:
        """Points (p, d) where the form has values, in the scene's coordinates: quadrature samples or closest points."""
        return self.discretized.points.copy()

    def field(self, data: Any) -> Field:
        """Return the field with values at :attr:`points` that ``data`` describe; see :class:`~cpmkit.Field`.

        Parameters
        ----------
        data : number, sequence, array, callable, VertexData or Solution
            A function of points; values at ``prepared.points``, (p,) or (p, channels); or a solution, which is not
            interpolated if it is on the same discretisation.
        """
        return field_of(self.discretized, data)


@overload
def prepare(
    scene: Scene[Family],
    spacing: float | None = None,
    *,
    backend: Literal["cpm"] = "cpm",
    progress: ShownProgress = None,
    **options: Unpack[PreparingKeywords],
) -> Prepared[Family]: ...
@overload
def prepare(
    scene: Scene[Family], spacing: float | None = None, *, backend: str, progress: ShownProgress = None, **options: Any
) -> Prepared[Family]: ...
@document_options(Options, *FORMS.values(), SolverOptions)
def prepare(
    scene: Scene, spacing: float | None = None, *, backend: str = "cpm", progress: ShownProgress = None, **options: Any
) -> Prepared[Any]:
    """Return a scene discretised once, for the solution of many equations and right-hand sides.

    Parameters
    ----------
    scene : Scene
        The scene, with the equation that is solved unless another is given.
    spacing : float
        Spacing of the lattice, in the scene's unit of length.
    backend : str
        ``cpm``, or the name of a back end that a plugin offers, as for :func:`cpmkit.solve`.
    progress : callable or bool, optional
        As for :func:`cpmkit.solve`.
    **options
        Further options of the solver. For another back end, the options of the back end.

    Returns
    -------
    Prepared

    Raises
    ------
    CpmkitError
        One sentence: the value that was given, the values that are accepted, and a remedy.

    Examples
    --------
    The scene is discretised and factorised once.

    >>> import cpmkit as ck
    >>> circle = ck.source("analytic.circle")
    >>> prepared = ck.prepare(ck.Scene(circle, ck.ScreenedPoisson(1.0)), spacing=0.1)
    >>> [float(prepared.solve(problem=ck.ScreenedPoisson(f)).evaluate([[1, 0]])[0].round(6)) for f in (1.0, 3.0)]
    [1.0, 3.0]
    """
    with shown_progress(progress) as shown:
        discretise, solver, target = resolve_options(backend, scene, spacing, shown, options)
        with explain_memory_error(scene, target, solver.solver):
            return Prepared(discretise(), solver, progress, target)
