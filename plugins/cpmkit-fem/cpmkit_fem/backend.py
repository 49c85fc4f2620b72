"""The back end ``fem``: from a scene to its solution by linear elements on a triangulation."""

from __future__ import annotations

import time

import numpy as np

from cpmkit.plugin import Backend, Equation, Progress, Scene, SceneError, evaluate_data, nothing, positive
from cpmkit_fem.assembly import stiffness_and_mass
from cpmkit_fem.pins import pin
from cpmkit_fem.rim import inflow, rim_of
from cpmkit_fem.solution import FemSolution, FemWork
from cpmkit_fem.system import check_fixed, reduce, solve_free
from cpmkit_fem.triangulation import triangulate


def fem() -> Backend:
    """Return the back end ``solve(scene, spacing, backend="fem")``, with the one option ``tolerance``.

    A surface that is itself a mesh is solved on its own triangles and needs no spacing; any other that
    can be drawn is triangulated with edges of about the spacing.
    """
    return solve_fem


def solve_fem(
    scene: Scene, spacing: float | None = None, *, tolerance: float = 1e-10, progress: Progress = nothing
) -> FemSolution:
    """Solve a scene by linear finite elements.

    Parameters
    ----------
    scene : Scene
        A surface with Dirichlet data, the same on both sides, at its boundaries, and any data on its edge.
    spacing : float, optional
        About the length of an edge, in the scene's unit; a mesh needs none and keeps its own.
    tolerance : float
        Relative residual, recomputed after the solve.
    progress : callable, optional
        ``progress(stage, fraction)``.

    Returns
    -------
    FemSolution

    Raises
    ------
    CpmkitError
        One sentence: what was got, what is accepted, what to do.
    """
    positive(tolerance, "tolerance")
    check_equation(scene.problem)
    start = time.perf_counter()
    progress("build", 0.0)
    mesh = triangulate(scene, spacing)
    rim = rim_of(mesh)
    pins = pin(scene, mesh, rim)
    check_fixed(scene, mesh, pins)
    stiffness, mass = stiffness_and_mass(mesh.vertices, mesh.faces)
    terms = scene.problem.terms()
    f = evaluate_data(terms.f, mesh.vertices, scene.channels, "the right-hand side f")
    system = reduce((stiffness + terms.c * mass).tocsr(), mass @ f + inflow(scene, rim), pins)
    progress("build", 1.0)
    built = time.perf_counter()
    free, report = solve_free(system, tolerance, progress)
    values = np.empty((len(mesh.vertices), scene.channels))
    values[system.free], values[pins.vertices] = free, pins.values
    seconds = {"build": built - start, "solve": time.perf_counter() - built}
    work = FemWork(len(free), len(mesh.vertices), len(mesh.faces), system.matrix.nnz, report.operator_applications)
    return FemSolution(scene, values, report, work, seconds, mesh.vertices, mesh.faces, warnings=pins.warnings)


def check_equation(problem: Equation) -> None:
    """Refuse what this back end does not assemble.

    Raises
    ------
    SceneError
        If the equation is not ``-Lap u + c u = f`` with a constant c that is not below zero.
    """
    terms = problem.terms()
    plain = not callable(terms.diffusivity) and terms.diffusivity == 1 and terms.velocity is None
    if problem.family != "steady" or not plain or callable(terms.c) or terms.c < 0:
        raise SceneError(
            f"backend='fem' solves -Lap u + c u = f with a constant c, got the kind {problem.kind!r} ({problem}); use "
            "backend='cpm'."
        )
