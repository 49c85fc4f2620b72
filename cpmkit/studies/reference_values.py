"""What runs of a study are compared with: reference values at sample points, and other methods.

Two older methods impose Dirichlet data by fixing nodes, and have first order: ``nearest`` fixes the nodes nearest to a
boundary (King et al. (2024), section 4.8), ``ball`` all nodes within the tube's radius of it (Auer, Macdonald, Treib,
Schneider and Westermann 2012). They do not distinguish the sides of a boundary, and impose no other condition.
"""

from __future__ import annotations

import time
from copy import copy
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.facade import Solution
from cpmkit.forms.choice import options_of
from cpmkit.forms.collocation.discretization import Discretization, measure_work
from cpmkit.forms.collocation.extension_operator import ExtensionOperator
from cpmkit.forms.collocation.form import discretize
from cpmkit.grid.band import Band
from cpmkit.linear.solver_options import SolverOptions, choose_solver, make_solver
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.local_source import LocalSource, largest_dim, localize
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.mesh.mixed_cells import mesh_method, refine_mixed_cells
from cpmkit.runtime.messages import collected_warnings
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value
from cpmkit.scene.scene import Scene
from cpmkit.solving import backend_independent_options, solve
from cpmkit.studies.studyfile import Study
from cpmkit.types import Bools, Floats, Ints, Progress, no_progress


def sample_points(scene: Scene, wanted: int | str) -> Floats:
    """Return sample points (n, d) of the surface, off all boundaries, the same at every call.

    ``wanted`` is the number of random points in a box around the surface, whose closest points are the samples, or
    ``vertices`` for those of a mesh; samples on a boundary, to a millionth of the size, are left out. Raises SceneError
    if vertices are requested of a surface that is no mesh.
    """
    surface = scene.surface
    bounds = np.asarray(surface.bounds, dtype=np.float64)
    size = float(np.ptp(bounds, axis=0).max())
    if isinstance(wanted, str):
        meshes = [surface.mesh(size / edges)[0] for edges in (4, 8)] if isinstance(surface, HasMesh) else []
        if not meshes or not np.array_equal(meshes[0], meshes[1]):  # a mesh is the same at every spacing
            raise SceneError(
                "points = 'vertices' of [exact] needs a surface that is a mesh, such as mesh.triangles, got "
                f"{type(surface).__name__}; give a number of points."
            )
        points = meshes[0]
    else:
        lower, upper = bounds[0] - 0.1 * size, bounds[1] + 0.1 * size
        queries = np.random.default_rng(7).uniform(lower, upper, (wanted, surface.dim))
        points = surface.closest_point(queries).points
    for boundary in scene.boundaries:  # where data may jump
        points = points[boundary.source.closest_point(points).distance > 1e-6 * size]
    return np.ascontiguousarray(points)


@dataclass(frozen=True, eq=False)
class Reference:
    """Reference values of the runs of a study."""

    points: Floats  #: (n, d): points of the surface, none on a boundary.
    values: Floats  #: (n,): the solution there, at the final time of problems in time.

    @property
    def half_range(self) -> float:
        """Half the difference of the largest and the smallest value."""
        return float(np.ptp(self.values) / 2)


def compute_reference(study: Study) -> Reference:
    """Return the reference values of a study, from its formula or from one solution of another back end.

    Raises SceneError as :func:`check_comparable` and :func:`sample_points` do, or if no sample point lies off the
    boundaries; CpmkitError if the formula has no value somewhere, or the back end cannot solve the scene.
    """
    scene = study.scene
    check_comparable(scene)
    points = sample_points(scene, study.exact.points)
    if not len(points):
        raise SceneError(
            f"none of the points of [exact], {study.exact.points!r}, lies off the boundaries; ask for more."
        )
    if study.solution is not None:
        end: float | None = getattr(scene.problem, "until", None)
        return Reference(points, evaluate_data(study.solution, points, 1, "u of [exact]", end)[:, 0])
    assert study.exact.reference is not None
    with collected_warnings():
        solution = solve(scene, backend=study.exact.reference, **backend_independent_options(study.options))
    return Reference(points, solution.evaluate(points))


def refine_surface_mesh(surface: ClosestPointSource) -> ClosestPointSource:
    """Return a copy of ``surface`` whose method ``mesh(spacing)`` halves the mesh's edges down to the spacing.

    The mesh's own vertices come first. New vertices are then moved to their closest points, which may lengthen edges;
    on a surface that is itself a mesh these lie on its flat triangles. Raises InputError if there is no mesh.
    """
    make_mesh = mesh_method(surface)

    def mesh(self: Any, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and cells (m, k) of the mesh, whose edges were halved down to ``spacing``."""
        points, cells = make_mesh(spacing)
        refined, cells = refine_mixed_cells(points, cells, points.shape[1], spacing)
        refined[len(points) :] = self.closest_point(refined[len(points) :]).points
        return refined, cells

    refined: ClosestPointSource = copy(surface)
    methods = {"mesh": mesh, "__reduce__": lambda _: (refine_surface_mesh, (surface,))}
    object.__setattr__(refined, "__class__", type("RefinedMesh", (type(surface),), methods))
    return refined


def solve_on_refined_mesh(
    scene: Scene, spacing: float, *, progress: Progress = no_progress, **options: Any
) -> Solution:
    """Return the finite element solution on the mesh that :func:`refine_surface_mesh` refines to ``spacing``.

    ``options`` are those of :func:`cpmkit.solve`; those of a lattice are ignored. Raises CpmkitError if the back end
    ``fem`` does, or the surface has no mesh.
    """
    refined = replace(scene, surface=refine_surface_mesh(scene.surface))
    return solve(refined, spacing, backend="fem", progress=progress, **backend_independent_options(options))


def check_comparable(scene: Scene) -> None:
    """Check that a study can compare the solution of a scene with reference values: one function with one channel.

    Raises SceneError if the scene has several channels, or its solution is eigenfunctions, whose factors are arbitrary.
    """
    if scene.problem.family == "eigen":
        raise SceneError("a study compares one function, and an eigenvalue problem has many; solve it without [exact].")
    if scene.channels != 1:
        raise SceneError(f"a study compares one channel, and the scene has {scene.channels}; make a study of each.")


def solve_by_fixed_nodes(
    scene: Scene, spacing: float, *, method: str, progress: Progress = no_progress, **options: Any
) -> Solution:
    """Return the solution of a scene by the closest point method with fixed values at the nodes near its boundaries.

    The solution's ``scene`` is ``scene`` without boundaries, and its values include those of the fixed nodes.

    ``scene``: a steady problem; each boundary has the same Dirichlet condition on both sides.
    ``method``: ``nearest`` or ``ball``, the method that selects the fixed nodes.
    ``spacing``, ``progress``, ``**options``: as for :func:`cpmkit.solve`, in the form collocation, no accuracy target.

    Raises SceneError if the problem or a condition is of another kind, sides differ, or there is no boundary.
    """
    check_fixable(scene, method)
    clock = [time.perf_counter()]
    bare = replace(scene, boundaries=())
    target, rest = options_of(scene, spacing, {**options, "form": "collocation"})
    solver = SolverOptions.from_keywords(rest)
    form = discretize(bare, target, progress)
    tables = form.tables
    sources = [localize(boundary.source, tables.layout.lattice.origin) for boundary in scene.boundaries]
    fixed, values = _fixed_nodes(scene, tables, sources, method)
    terms = scene.problem.terms()
    stiffness = form.stiffness(terms)
    operator, b = _eliminate_fixed_nodes(stiffness, form.load(terms.f) + form.condition_load(stiffness), fixed, values)
    clock.append(time.perf_counter())
    chosen = choose_solver(solver.solver, operator.size, largest_dim(scene.surface))
    prepared = make_solver(chosen, solver.further).prepare(operator)
    values[~fixed], report = prepared.solve(b, solver.tolerance, progress=progress)
    clock.append(time.perf_counter())
    seconds = {"build": clock[1] - clock[0], "solve": clock[2] - clock[1]}
    work = measure_work(tables, operator, report)
    queries = {one.name: source.queries["points"] for one, source in zip(scene.boundaries, sources, strict=True)}
    queries |= work.queries
    work = replace(work, ghosts=0, closest_point_queries=sum(queries.values()), queries=queries)
    return Solution(form, values, report, work, seconds)


def check_fixable(scene: Scene, method: str) -> None:
    """Check that a scene can be solved by :func:`solve_by_fixed_nodes` with this ``method``, named in messages.

    Raises SceneError if the problem is not steady, a condition is not Dirichlet, sides differ, or no boundary exists.
    """
    if scene.problem.family != "steady":
        raise SceneError(f"the method {method!r} solves one steady system, got {scene.problem.kind!r}; use 'cpm'.")
    if not scene.boundaries:
        raise SceneError(f"the method {method!r} differs from 'cpm' at boundaries only, and the scene has none.")
    for boundary in scene.boundaries:
        condition = boundary.condition("left")
        if not isinstance(condition.law, Value) or condition is not boundary.condition("right"):
            raise SceneError(
                f"the method {method!r} holds one Dirichlet condition for both sides, and boundary {boundary.name!r} "
                "has others; use the method 'cpm'."
            )


def _fixed_nodes(scene: Scene, tables: Discretization, sources: list[LocalSource], method: str) -> tuple[Bools, Floats]:
    """Return a mask (n,) of the band's inner nodes that a method fixes near boundaries, and values (n, channels).

    The value of a fixed node is the Dirichlet datum at the nearest point of the nearest boundary that fixes the node;
    that of other nodes is zero.
    ``sources`` are those of the boundaries relative to the lattice's origin, ``method`` is ``nearest`` or ``ball``.
    """
    layout = tables.layout
    half = 0.5 * (layout.band.degree + 1)
    radius = np.hypot(np.sqrt(layout.band.dim - 1) * half, 1 + half) * layout.band.spacing  # King et al. (2024), eq. 4
    positions = layout.band.positions[: layout.band.inner]
    values = np.zeros((len(positions), scene.channels))
    nearest = np.full(len(positions), np.inf)
    for boundary, source in zip(scene.boundaries, sources, strict=True):
        feet = source.closest_point(positions)
        within = feet.distance <= (1 + 1e-4) * radius  # with the nodes at exactly the radius
        chosen = within if method == "ball" else _nearest_nodes(layout.band, source, feet.distance)
        taken = np.flatnonzero(chosen & (feet.distance < nearest))
        nearest[taken] = feet.distance[taken]
        datum, at = boundary.condition("left").one_sided.datum, layout.lattice.to_scene(feet.points[taken])
        values[taken] = evaluate_data(datum, at, scene.channels, f"boundary {boundary.name!r}")
    return np.isfinite(nearest), values


def _nearest_nodes(band: Band, source: LocalSource, distance: Floats) -> Bools:
    """Return a mask (n,) of the inner nodes that are the nearest node of some sample of a boundary.

    The samples are the closest points of a lattice four times as fine, around the inner nodes up to two spacings from
    the boundary. ``distance`` (n,) is the distance of each inner node from it.
    """
    near = band.positions[: band.inner][distance <= 2 * band.spacing]
    steps = (np.arange(4) / 4 - 0.5) * band.spacing
    around = np.array(list(product(steps, repeat=band.dim)))
    samples = source.closest_point((near[:, None] + around).reshape(-1, band.dim)).points
    nodes = np.unique(np.rint(samples / band.spacing).astype(np.int64), axis=0)
    numbers = band.find_inner(nodes)
    chosen = np.zeros(band.inner, dtype=bool)
    chosen[numbers[numbers >= 0]] = True
    return chosen


def _eliminate_fixed_nodes(
    operator: ExtensionOperator, b: Floats, fixed: Bools, values: Floats
) -> tuple[ExtensionOperator, Floats]:
    """Return the operator and right-hand side (f, channels) of the f nodes that are not ``fixed`` (n,).

    ``operator`` and ``b`` (n, channels) are those of all n nodes. The columns of fixed nodes, times their ``values``
    (n, channels), are moved to the right-hand side.
    """
    free, diagonal = np.flatnonzero(~fixed), operator.diagonal
    b = b + operator.datum_load(operator.extension[:, np.flatnonzero(fixed)] @ values[fixed])
    diagonal = diagonal[free] if isinstance(diagonal, np.ndarray) else diagonal
    extension, differences = operator.extension[:, free], operator.differences[free]
    return replace(operator, extension=extension, differences=differences, diagonal=diagonal), b[free]
