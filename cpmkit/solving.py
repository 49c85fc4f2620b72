"""The line from a scene to its solution: discretise, assemble, solve; or hand the scene to another back end."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.families.checkpointing import EVERY, check_checkpointing
from cpmkit.families.context import SolveContext
from cpmkit.families.nonlinear import solve_nonlinear
from cpmkit.files.whole_files import check_place
from cpmkit.forecast.resolution import needed_spacing
from cpmkit.forecast.running_out import memory_ran_out
from cpmkit.forms.collocation.conservation.flux_balance import check_balance
from cpmkit.forms.collocation.form import discretize
from cpmkit.grid.fitting import check_fits
from cpmkit.linear.choice import check_solver, check_tolerance, choose_solver, make_solver
from cpmkit.manifold.localized import largest_dim, localize
from cpmkit.plugins import call, factory
from cpmkit.protocols import Parting, Progress, nothing
from cpmkit.runtime.memory import memory_limit, ran_out
from cpmkit.runtime.telling import tell
from cpmkit.scene.laws import Nonlinear
from cpmkit.scene.scene import Scene
from cpmkit.solution.solution import Solution

#: The module that solves each family of equations, and its function.
FAMILIES = {
    "steady": ("cpmkit.families.steady", "solve_steady"),
    "time": ("cpmkit.families.evolution.stepping", "solve_in_time"),
    "eigen": ("cpmkit.families.eigen.solving", "solve_eigen"),
    "biharmonic": ("cpmkit.families.biharmonic", "solve_biharmonic"),
}


def solve(
    scene: Scene,
    spacing: float | None = None,
    *,
    backend: str = "cpm",
    degree: int = 3,
    order: int = 2,
    origin: Any = None,
    sheets: Parting = True,
    balance: int = 0,
    solver: str = "auto",
    tolerance: float = 1e-10,
    checkpoint: str | Path | None = None,
    checkpoint_every: int = EVERY,
    resume: str | Path | None = None,
    progress: Progress = nothing,
    **solver_options: Any,
) -> Solution:
    """Solve a scene, by the closest point method unless another back end is asked for.

    Parameters
    ----------
    scene : Scene
        What to solve.
    spacing : float
        Spacing of the lattice, in the scene's unit of length. There is no default; without one, the
        error suggests one. Another back end may do without: ``fem`` solves on a mesh's own triangles.
    backend : str
        ``cpm``, or the name of a back end that a plugin offers, such as ``fem``. One of those takes
        ``tolerance``, ``progress`` and options of its own; ``degree``, ``order``, ``origin``, ``sheets``,
        ``balance`` and ``solver`` belong to ``cpm``. Its solution reads, saves and draws like the one described here.
    degree : int
        Degree of the interpolation, 2 to 5. 3 is right for most; 2 is quicker and irregular.
    order : int
        Order of accuracy of the conditions at boundaries and edges: 1, 2, or 3, which makes second order more
        regular. 4 makes the Laplacian fourth order too, needs degree 4 or 5, and an exact, smooth source whose
        curvature leaves room for a wider tube.
    origin : (d,) array, optional
        Position of a lattice node; by default the centre of the surface's bounds.
    sheets : bool or "unfolded"
        Whether a node that several sheets of the surface share gets an unknown for each. With ``"unfolded"`` the
        surface is unfolded, too, where it bends more sharply than a stencil is wide: further unknowns, for coarse
        spacings. False is the plain method, for comparisons: where sheets share a band it mixes them, and the solution
        is wrong there.
    balance : int
        Where nothing flows out, on closed surfaces and between walls, u is put right by polynomials in the coordinates
        up to this degree, at most 8, so that fluxes balance against all of them: 5 leaves a twentieth to a half of the
        error, for little work. 0 puts the mean alone right.
    solver : str
        ``auto``, ``direct``, ``reference``, or the kind of a solver that a plugin offers.
    tolerance : float
        Relative residual, recomputed after the solve.
    checkpoint : path, optional
        Of problems in time: an .npz file in which the state of the run is kept, written every ``checkpoint_every``
        steps and at the end, each time whole.
    checkpoint_every : int
        Steps between two checkpoints.
    resume : path, optional
        A checkpoint of the same problem: the run goes on from there, and ends with the same values, bit by bit, as
        without the interruption. A later ``until`` makes a run longer.
    progress : callable, optional
        ``progress(stage, fraction)``.
    **solver_options
        For the solver; ``reference`` takes ``max_iterations``. For another back end, its own options.

    Returns
    -------
    Solution

    Raises
    ------
    CpmkitError
        One sentence: what was got, what is accepted, what to do.

    Warns
    -----
    CpmkitWarning
        Each of the solution's ``warnings``, once.

    Examples
    --------
    A circle, cut at one point. Left is where the curve comes from, so a quarter turn after the cut
    u has risen by a quarter.

    >>> import cpmkit as ck
    >>> cut = ck.Boundary("cut", ck.source("analytic.point", at=[1, 0]), left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    >>> scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), [cut])
    >>> ck.solve(scene, spacing=0.05).evaluate([[0, 1], [-1, 0]]).round(3)
    array([0.25, 0.5 ])
    """
    grid = {"degree": degree, "order": order, "origin": origin, "sheets": sheets}
    run = {"checkpoint": checkpoint, "checkpoint_every": checkpoint_every, "resume": resume}
    how = {**grid, **run, "balance": balance, "solver": solver}
    tolerance = check_tolerance(tolerance)
    limit = memory_limit()
    try:
        if backend == "cpm":
            solution = _solve_here(scene, spacing, grid, how, tolerance, progress, solver_options)
        else:
            options = {**_given(**how), **solver_options}
            solution = _solve_elsewhere(backend, scene, spacing, tolerance, progress, options)
    except Exception as error:
        if ran_out(error):
            raise memory_ran_out(scene, spacing, degree, solver, error, limit) from error
        raise
    tell(solution.warnings)
    return solution


def _solve_here(
    scene: Scene,
    spacing: float | None,
    grid: dict[str, Any],
    how: dict[str, Any],
    tolerance: float,
    progress: Progress,
    solver_options: dict[str, Any],
) -> Solution:
    """Solve by the closest point method."""
    spacing = needed_spacing(scene, spacing)
    check_solver(how["solver"], solver_options)
    check_balance(scene, how["balance"])
    checkpointing = check_checkpointing(scene.problem, how["checkpoint"], how["checkpoint_every"], how["resume"])
    if checkpointing.write is not None:
        check_place(checkpointing.write)
    start = time.perf_counter()
    discretized = discretize(scene, spacing, balance=how["balance"], progress=progress, **grid)
    dim, unknowns = largest_dim(scene.surface), discretized.size
    chosen = choose_solver(how["solver"], unknowns, dim, scene.problem.factorise_up_to)
    if chosen == "direct":  # what others need was checked before the tables were made
        check_fits(localize(scene.surface, np.zeros(scene.surface.dim)), unknowns, spacing, grid["degree"], chosen)
    made = make_solver(chosen, solver_options)
    context = SolveContext(discretized, made, chosen, tolerance, progress, start, checkpointing)
    module, function = FAMILIES[scene.problem.family]
    solve_family: Callable[[SolveContext], Solution] = getattr(import_module(module), function)
    if any(isinstance(condition.law, Nonlinear) for condition in scene.conditions):
        return solve_nonlinear(context, solve_family)
    return solve_family(context)


def _given(**options: Any) -> dict[str, Any]:
    """Return the options of the closest point method that differ from what they are by default."""
    defaults = {name: parameter.default for name, parameter in inspect.signature(solve).parameters.items()}
    return {
        name: value
        for name, value in options.items()
        if type(value) is not type(defaults[name]) or value != defaults[name]
    }


def _solve_elsewhere(
    backend: str, scene: Scene, spacing: float | None, tolerance: float, progress: Progress, options: dict[str, Any]
) -> Solution:
    """Solve by a plugin's back end; an option that it does not take is answered with those that it takes.

    Raises
    ------
    PluginError
        If no installed plugin offers the back end.
    """
    solve_by = call(factory(backend, "cpmkit_backends"), f"the back end {backend!r}", {})
    table = {"scene": scene, "spacing": spacing, "tolerance": tolerance, "progress": progress, **options}
    solution: Solution = call(solve_by, f"the back end {backend!r}", table)
    return solution
