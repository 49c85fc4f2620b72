"""The line from a scene to its solution: discretise, assemble, solve; or hand the scene to another back end."""

from __future__ import annotations

import inspect
import time
from typing import Any

from cpmkit.arrays import positive
from cpmkit.components import check_pinned
from cpmkit.diagnosis import warnings_of
from cpmkit.discretization import discretize
from cpmkit.localized import largest_dim
from cpmkit.operators import assemble
from cpmkit.plugins import call, factory
from cpmkit.protocols import Progress, nothing
from cpmkit.resolution import needed_spacing
from cpmkit.scene import Scene
from cpmkit.solution import Solution
from cpmkit.solvers import check_solver, choose_solver, make_solver
from cpmkit.work import measure_work


def solve(
    scene: Scene,
    spacing: float | None = None,
    *,
    backend: str = "cpm",
    degree: int = 3,
    order: int = 2,
    origin: Any = None,
    solver: str = "auto",
    tolerance: float = 1e-10,
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
        ``tolerance``, ``progress`` and options of its own; ``degree``, ``order``, ``origin`` and ``solver``
        belong to ``cpm``. Its solution reads, saves and draws like the one described here.
    degree : int
        Degree of the interpolation, 2 to 5. 3 is right for most; 2 is quicker and irregular.
    order : int
        Order of accuracy of the conditions at boundaries and edges, 1 or 2.
    origin : (d,) array, optional
        Position of a lattice node; by default the centre of the surface's bounds.
    solver : str
        ``auto``, ``direct``, ``reference``, or the kind of a solver that a plugin offers.
    tolerance : float
        Relative residual, recomputed after the solve.
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
    if backend != "cpm":
        given = _given(degree=degree, order=order, origin=origin, solver=solver)
        return _solve_elsewhere(backend, scene, spacing, tolerance, progress, {**given, **solver_options})
    spacing = needed_spacing(scene, spacing)
    positive(tolerance, "tolerance")
    check_solver(solver, solver_options)
    clock = [time.perf_counter()]
    tables = discretize(scene, spacing, degree=degree, order=order, origin=origin, progress=progress)
    check_pinned(tables, scene, scene.problem)
    system = assemble(tables, scene.problem)
    clock.append(time.perf_counter())
    chosen = choose_solver(solver, system.size, largest_dim(scene.surface))
    values, report = make_solver(chosen, solver_options)(system, tolerance, progress)
    clock.append(time.perf_counter())
    seconds = {"build": clock[1] - clock[0], "solve": clock[2] - clock[1]}
    work = measure_work(tables, system, report)
    return Solution(scene, values, report, work, seconds, tables, warnings=warnings_of(tables.layout))


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
