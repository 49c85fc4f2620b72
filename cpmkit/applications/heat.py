"""Short-time heat of numbers and of tangential vectors, the first step of the heat methods, on manifolds with barriers.

The heat method (Crane, Weischedel and Wardetzky 2013) takes the directions in which heat flows; the vector heat method
(Sharp, Soliman and Crane 2019) lets vectors flow with the Laplacian of the connection.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications.origins import Origins, Pieces
from cpmkit.errors import InputError, SceneError
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource, unit
from cpmkit.preparing import Prepared
from cpmkit.types import Bools, Floats

#: Relative residual at which solves stop: distances are exact to 1e-3, so that a direct solve need not be refined.
DISTANCE_RESIDUAL = 1e-7
#: Time of the heat step over the spacing squared, and the factor by which it grows until heat arrives everywhere.
HEAT_TIME, TIME_GROWTH = 0.5, 4.0
#: Heat below this share of its largest value is noise if an iterative solver computed it.
NOISE_SHARE = 1e-9


def scene_of(surface: ClosestPointSource | ck.Scene | Prepared) -> ck.Scene:
    """Return the scene of a source, with the equation Laplace; a scene, or that of a prepared scene, as it is."""
    if isinstance(surface, Prepared):
        return surface.scene
    return surface if isinstance(surface, ck.Scene) else ck.Scene(surface, ck.Laplace())


def prepare_manifold(surface: Any, spacing: float | None, options: dict[str, Any]) -> Prepared:
    """Return the prepared scene of a source or a scene, whose boundaries are barriers, or a prepared scene itself.

    Raises
    ------
    InputError
        If a boundary is no barrier, or a spacing or options are given beside a prepared scene.
    """
    scene = barriers(surface)
    if not isinstance(surface, Prepared):
        prepared: Prepared = ck.prepare(scene, spacing, **{"form": "galerkin", **options})
        return prepared
    if spacing is not None or options:
        raise InputError("spacing and options are those of the prepared scene; leave them out.")
    return surface


def barriers(surface: ClosestPointSource | ck.Scene | Prepared) -> ck.Scene:
    """Return the scene of a manifold with its barriers and with f = 0.

    Raises
    ------
    InputError
        If a condition of a boundary or the edge is not of the kind Neumann.
    """
    scene = scene_of(surface)
    for condition in scene.conditions:
        if condition.kind != "neumann":
            raise InputError(
                f"boundaries of a scene are barriers, with the condition Neumann(0), got {condition.kind!r}; curves "
                "that distances are measured from are origins."
            )
    return ck.Scene(scene.surface, ck.Poisson(0.0), scene.boundaries, scene.edge)


def heat_solver(prepared: Prepared) -> Prepared:
    """Return the prepared scene with the solver of the heat step: direct up to 60,000 unknowns.

    A direct solution decays without noise.
    """
    if prepared.discretized.size > 60_000:
        return prepared
    return prepared.solved_by("direct", solver_tolerance=DISTANCE_RESIDUAL)


def longest_time(prepared: Prepared) -> float:
    """Return the time in which heat spreads over the whole manifold: the square of its size."""
    return float(np.ptp(prepared.scene.surface.bounds, axis=0).max()) ** 2


def heat_directions(prepared: Prepared, origins: Origins, pieces: Pieces | None = None) -> ck.Field:
    """Return the unit vectors (p, d) in which heat flows away from the origins.

    They are zero at the few points where heat underflows, and on those of the ``pieces`` that have no origin.

    Raises
    ------
    SceneError
        If no heat arrives at some points: of a piece with an origin, or of any piece if ``pieces`` are not given.
    """
    h, heated = prepared.discretized.spacing, heat_solver(prepared)
    share, time = 0.0 if heated is not prepared else NOISE_SHARE, HEAT_TIME * h * h
    while True:
        source = origins.heat_source(h, time**0.5)
        heat = prepared.field(heated.solve(problem=ck.ScreenedPoisson(source, c=1 / time, lumped=True)))
        cold = heat.values <= share * heat.values.max()
        if pieces is not None:
            warm = np.bincount(pieces.of_point, heat.values > 0.0, pieces.count) > 0  # pieces with an origin
            cold &= warm[pieces.of_point]
        # Few points may be cold by underflow: a longer time would blur all directions. On pieces without an origin heat
        # is exactly zero.
        underflow = bool(cold.mean() <= 0.01 and heat.values[cold].all())
        if underflow or time > longest_time(prepared):
            break
        time *= TIME_GROWTH
    if not underflow:
        check_warmed(cold, prepared.scene.surface)
    undirected = cold | (heat.values <= 0.0)
    return heat.gradient().map(lambda _, slopes: np.where(undirected[:, None], 0.0, -unit(slopes)))


def check_warmed(cold: Bools, surface: ClosestPointSource) -> None:
    """Raise if heat does not reach all points of a manifold.

    Raises
    ------
    SceneError
        If any point is ``cold`` (p,); the message has their number.
    """
    if cold.any():
        raise SceneError(
            f"no heat arrives at {np.count_nonzero(cold)} points of the {type(surface).__name__}: a piece of it has no "
            "origin, or is too far away for the spacing; give each piece an origin, or leave the piece out."
        )


def vector_heat_directions(
    prepared: Prepared, coupling: ck.Field, source: ck.PointSource, shortest: float
) -> tuple[Floats, Solution]:
    """Return the directions of vectors that diffuse from points, each after the shortest time in which heat arrives.

    Parameters
    ----------
    prepared : Prepared
        A surface.
    coupling : Field
        The coefficient that keeps vectors tangential, see :func:`tangential_coupling`.
    source : PointSource
        Vectors at points.
    shortest : float
        The shortest time, over the spacing squared. Where only noise has arrived, four times that time, and so on.

    Returns
    -------
    (p, 3) float64, Solution
        Unit vectors at the points of ``prepared``, and the same on its splines.

    Raises
    ------
    SceneError
        If no vector arrives somewhere.
    """
    h = prepared.discretized.spacing
    heated = prepared.solved_by("jacobi", solver_tolerance=1e-12)  # well below NOISE_SHARE
    directions = np.zeros_like(prepared.points)
    cold, time = np.ones(len(directions), dtype=bool), shortest * h * h
    while cold.any() and time < TIME_GROWTH * longest_time(prepared):
        problem = ck.Coupled(lambda x: coupling(x).reshape(-1, 3, 3), f=source, c=1 / time, lumped=True)
        heat = heated.solve(problem=problem)
        vectors = prepared.field(heat).project().values
        size = np.linalg.norm(vectors, axis=1)
        warm = cold & (size > NOISE_SHARE * size.max())
        directions[warm] = unit(vectors[warm])
        cold, time = cold & ~warm, TIME_GROWTH * time
    check_warmed(cold, prepared.scene.surface)
    return directions, replace(heat, values=prepared.discretized.project(directions))


def tangential_coupling(prepared: Prepared, parallel: bool) -> ck.Field:
    """Return the zeroth-order coefficient of the system for the components of tangential vectors.

    It is (25 / h^2) n n', with the normal n, which penalises normal components; less S^2, with the shape operator S, if
    vectors are transported in ``parallel``. With 1 in place of 25 directions are 18 times less exact on a sphere; with
    100 twice as many iterations are needed. The field has nine channels, a 3 x 3 matrix per point.
    """
    normals = ck.normals_at(prepared.scene.surface, prepared.points)
    projector = np.einsum("pi,pj->pij", normals, normals)
    coupling = 25.0 / prepared.discretized.spacing**2 * projector
    if parallel:
        shape = _shape_operator(prepared, projector)
        coupling = coupling - np.einsum("pik,pjk->pij", shape, shape)
    return prepared.field(np.ascontiguousarray(coupling.reshape(-1, 9)))


def _shape_operator(prepared: Prepared, projector: Floats) -> Floats:
    """Return the shape operator S (p, 3, 3), of either sign, from the projectors n n' (p, 3, 3) on normals.

    Since n . n = 1, grad(n n') n = grad n.
    """
    column = np.einsum("pii->pi", projector).argmax(axis=1)
    normal = unit(projector[np.arange(len(projector)), :, column])
    shape = np.zeros_like(projector)
    for i in range(3):
        for j in range(3):
            entry = prepared.field(np.ascontiguousarray(projector[:, i, j]))
            shape[:, i] += entry.gradient().values * normal[:, j, None]
    return shape
