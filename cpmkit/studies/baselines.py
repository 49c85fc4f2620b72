"""Two older ways to impose Dirichlet data in the closest point method, for comparison: both fix nodes at boundaries.

``nearest`` fixes the nodes nearest to the boundary (King et al. (2024), section 4.8),
``ball`` all nodes within the tube's radius of it (Auer, Macdonald, Treib, Schneider and Westermann 2012).
Both are of first order, do not distinguish the sides of a boundary, and impose no other condition.
"""

from __future__ import annotations

import time
from dataclasses import replace
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
from cpmkit.manifold.local_source import LocalSource, largest_dim, localize
from cpmkit.scene.data import evaluate_data
from cpmkit.scene.laws import Value
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Progress, no_progress


def solve_by_fixed_nodes(
    scene: Scene, spacing: float, *, method: str, progress: Progress = no_progress, **options: Any
) -> Solution:
    """Solve a scene with Dirichlet boundaries by the closest point method, with fixed values at nodes near boundaries.

    Parameters
    ----------
    scene : Scene
        A steady problem; each boundary has the same Dirichlet condition on both sides.
    method : str
        ``nearest`` or ``ball``.
    spacing, progress, **options
        As for :func:`cpmkit.solve`.

    Returns
    -------
    Solution
        The solution of the scene without its boundaries; its values include those of the fixed nodes.

    Raises
    ------
    SceneError
        If the problem or a condition is of another kind, sides differ, or there is no boundary.
    """
    check_fixable(scene, method)
    clock = [time.perf_counter()]
    bare = replace(scene, boundaries=())
    target, rest = options_of(scene, spacing, {**options, "form": "collocation"})
    solver = SolverOptions.of(rest)
    form = discretize(bare, target, progress)
    tables = form.tables
    sources = [localize(boundary.source, tables.layout.lattice.origin) for boundary in scene.boundaries]
    fixed, values = _fixed_nodes(scene, tables, sources, method)
    terms = scene.problem.terms()
    stiffness = form.stiffness(terms)
    operator, b = _without_fixed_nodes(stiffness, form.load(terms.f) + form.condition_load(stiffness), fixed, values)
    clock.append(time.perf_counter())
    chosen = choose_solver(solver.solver, operator.size, largest_dim(scene.surface))
    prepared = make_solver(chosen, solver.further).prepare(operator)
    values[~fixed], report = prepared.solve(b, solver.residual, progress=progress)
    clock.append(time.perf_counter())
    seconds = {"build": clock[1] - clock[0], "solve": clock[2] - clock[1]}
    work = measure_work(tables, operator, report)
    queries = {one.name: source.queries["points"] for one, source in zip(scene.boundaries, sources, strict=True)}
    queries |= work.queries
    work = replace(work, ghosts=0, closest_point_queries=sum(queries.values()), queries=queries)
    return Solution(form, values, report, work, seconds)


def check_fixable(scene: Scene, method: str) -> None:
    """Raise if a scene cannot be solved by fixing nodes.

    Raises
    ------
    SceneError
        If the problem or a condition is of another kind, sides differ, or there is no boundary.
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
    """Return a mask (n,) of the band's inner nodes that are fixed, and values (n, channels).

    The value of a fixed node is the datum of the nearest boundary at its closest point; the others are zero.
    """
    layout = tables.layout
    positions = layout.band.positions[: layout.band.inner]
    values = np.zeros((len(positions), scene.channels))
    nearest = np.full(len(positions), np.inf)
    for boundary, source in zip(scene.boundaries, sources, strict=True):
        feet = source.closest_point(positions)
        ball = method == "ball"
        chosen = _ball(layout.band, feet.distance) if ball else _nearest(layout.band, source, feet.distance)
        taken = np.flatnonzero(chosen & (feet.distance < nearest))
        nearest[taken] = feet.distance[taken]
        datum, at = boundary.condition("left").one_sided.datum, layout.lattice.to_scene(feet.points[taken])
        values[taken] = evaluate_data(datum, at, scene.channels, f"boundary {boundary.name!r}")
    return np.isfinite(nearest), values


def _nearest(band: Band, source: LocalSource, distance: Floats) -> Bools:
    """Return a mask (n,) of the inner nodes that are the node nearest to some point of the boundary.

    The points are closest points of four samples along each axis of the cells around nodes up to two spacings from the
    boundary. ``distance`` (n,) is the distance of each inner node from the boundary.
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


def _ball(band: Band, distance: Floats) -> Bools:
    """Return a mask (n,) of the inner nodes within the tube's radius, King et al. (2024), eq. 4, of the boundary."""
    half = 0.5 * (band.degree + 1)
    radius = np.hypot(np.sqrt(band.dim - 1) * half, 1 + half) * band.spacing
    return np.asarray(distance <= (1 + 1e-4) * radius)  # with the nodes at exactly the radius


def _without_fixed_nodes(
    operator: ExtensionOperator, b: Floats, fixed: Bools, values: Floats
) -> tuple[ExtensionOperator, Floats]:
    """Return the operator and the right-hand side for the nodes that are not ``fixed`` (n,).

    The columns of fixed nodes, times their ``values``, are moved to the right-hand side.
    """
    free, diagonal = np.flatnonzero(~fixed), operator.diagonal
    b = b + operator.spread(operator.extension[:, np.flatnonzero(fixed)] @ values[fixed])
    diagonal = diagonal[free] if isinstance(diagonal, np.ndarray) else diagonal
    extension, differences = operator.extension[:, free], operator.differences[free]
    return replace(operator, extension=extension, differences=differences, diagonal=diagonal), b[free]
