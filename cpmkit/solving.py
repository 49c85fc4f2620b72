"""The line from a scene to its solution: discretise, assemble, solve."""

from __future__ import annotations

import time
from typing import Any

from cpmkit.arrays import positive
from cpmkit.components import check_pinned
from cpmkit.diagnosis import warnings_of
from cpmkit.discretization import discretize
from cpmkit.operators import assemble
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
    degree: int = 3,
    order: int = 2,
    origin: Any = None,
    solver: str = "auto",
    tolerance: float = 1e-10,
    progress: Progress = nothing,
    **solver_options: Any,
) -> Solution:
    """Solve a scene by the closest point method.

    Parameters
    ----------
    scene : Scene
        What to solve.
    spacing : float
        Spacing of the lattice, in the scene's unit of length. There is no default; without one, the
        error suggests one.
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
        For the solver; ``reference`` takes ``max_iterations``.

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
    spacing = needed_spacing(scene, spacing)
    positive(tolerance, "tolerance")
    check_solver(solver, solver_options)
    clock = [time.perf_counter()]
    tables = discretize(scene, spacing, degree=degree, order=order, origin=origin, progress=progress)
    check_pinned(tables, scene, scene.problem)
    system = assemble(tables, scene.problem)
    clock.append(time.perf_counter())
    chosen = choose_solver(solver, system.size, scene.surface.manifold_dim)
    values, report = make_solver(chosen, solver_options)(system, tolerance, progress)
    clock.append(time.perf_counter())
    seconds = {"build": clock[1] - clock[0], "solve": clock[2] - clock[1]}
    work = measure_work(tables, system, report)
    return Solution(scene, tables, values, report, work, seconds, warnings_of(tables.layout))
