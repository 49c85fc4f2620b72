"""Origins of distances, and short-time heat from them, of numbers and tangential vectors, on manifolds with barriers.

The heat method (Crane, Weischedel and Wardetzky 2013) takes the directions in which heat flows; the vector heat method
(Sharp, Soliman and Crane 2019) lets vectors flow with the Laplacian of the connection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

import cpmkit as ck
from cpmkit.errors import InputError, SceneError, shown
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource, Discretized, HasGivenMesh, Terms, unit
from cpmkit.preparing import Prepared
from cpmkit.types import Bools, Floats, Ints

#: Origins farther from the manifold than so many spacings are refused.
AWAY_SPACINGS = 3.0


@dataclass(frozen=True, eq=False)
class Origins:
    """Origins of a distance: points of a manifold, and curves in it."""

    surface: ClosestPointSource  #: The manifold.
    points: Floats  #: (k, d): points of the manifold.
    curves: Sequence[ClosestPointSource]  #: Curves in the manifold.
    gap: float = 0.0  #: The largest distance of a given point from the manifold.

    def check_near(self, spacing: float) -> None:
        """Raise InputError if a given point is more than three spacings away from the manifold."""
        if self.gap > AWAY_SPACINGS * spacing:
            raise InputError(
                f"an origin is {self.gap:.3g} away from the surface, more than {AWAY_SPACINGS:g} spacings, "
                f"{AWAY_SPACINGS * spacing:.3g}; move it onto the surface, or check its unit of length."
            )

    def closest_origins(self, points: Floats) -> tuple[Floats, Floats, Ints]:
        """Return straight distances (n,) of ``points`` (n, d) from origins, the nearest points (n, d) and numbers (n,).

        The numbers are those of the nearest origins: first come the origins that are points, then curves.
        """
        count = len(self.points)
        best, number = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
        if count:
            best, number = self._tree.query(points)
        places = self.points[number] if count else np.zeros_like(points)
        for k, curve in enumerate(self.curves):
            feet = curve.closest_point(points)
            nearer = feet.distance < best
            best, places = np.where(nearer, feet.distance, best), np.where(nearer[:, None], feet.points, places)
            number = np.where(nearer, count + k, number)
        return best, places, number

    def samples(self, spacing: float) -> tuple[Floats, Ints]:
        """Return points (k, d) on all origins, about a ``spacing`` apart on curves, and their origins' numbers (k,)."""
        at, owner = [self.points], [np.arange(len(self.points))]
        for number, curve in enumerate(self.curves, len(self.points)):
            at.append(ck.boundary_points(curve, self.surface, spacing).points)
            owner.append(np.full(len(at[-1]), number))
        return np.concatenate(at), np.concatenate(owner)

    def heat_source(self, spacing: float, reach: float) -> ck.PointSource:
        """Return heat sources on all origins: of strength 1 per spacing on curves, and stronger at points.

        ``spacing`` is that of the lattice. Heat of time t = reach^2 from a curve decays as exp(-s / reach), heat from a
        point as the Bessel function K0(s / reach) / pi, which is sqrt(2 reach / (pi s)) / 2 as large. The strength of
        points makes both equal at a distance s of a quarter of the manifold's size: ridges between points and curves
        then lie half way, up to a fraction of ``reach``.
        """
        far = 0.25 * float(np.ptp(self.surface.bounds, axis=0).max())
        of_point = np.pi * reach / spacing * np.sqrt(2 * far / (np.pi * reach))
        at, strength = [self.points], [np.full(len(self.points), of_point)]
        for curve in self.curves:
            along = ck.boundary_points(curve, self.surface, spacing)
            at.append(along.points)
            strength.append(along.weights / spacing)
        return ck.PointSource(np.concatenate(at), np.concatenate(strength))

    @cached_property
    def _tree(self) -> Any:
        """Search tree of the points."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points)


def origins_of(origins: Any, surface: ClosestPointSource) -> Origins:
    """Return origins given as points (k, d) or (d,), numbers of vertices, a source, or a list of these.

    Points are projected on ``surface``; ``gap`` is how far they are moved. Raises InputError if there are no origins,
    or an entry is none of these.
    """
    points, curves, gap = [np.zeros((0, surface.dim))], [], 0.0
    accepted = f"origins are finite points (k, {surface.dim}), numbers of vertices of a mesh, or sources of curves"
    for entry in [origins] if _is_one_table(origins) else origins:
        if _are_vertex_numbers(entry, surface):
            entry = ck.Boundary("origins", entry, both=ck.Neumann(0.0)).on(surface).source
        if isinstance(entry, ClosestPointSource):
            if entry.manifold_dim == 0:
                points.append(ck.boundary_points(entry, surface, 1.0).points)
            else:
                curves.append(entry)
            continue
        try:
            array = np.atleast_2d(np.asarray(entry, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise InputError(f"{accepted}, got {shown(entry)}.") from error
        if array.ndim != 2 or array.shape[1] != surface.dim or not np.isfinite(array).all():
            raise InputError(f"{accepted}, got {shown(entry)}.")
        feet = surface.closest_point(array)
        points.append(feet.points)
        gap = max(gap, float(feet.distance.max(initial=0.0)))
    every = np.concatenate(points)
    if not len(every) and not curves:
        raise InputError("a distance needs origins: give points or the source of a curve.")
    return Origins(surface, every, curves, gap)


def _is_one_table(origins: Any) -> bool:
    """Return whether ``origins`` are no list of several arrays, numbers or sources, but one of these."""
    if not isinstance(origins, (list, tuple)):
        return True
    try:
        return np.asarray(origins, dtype=np.float64).ndim < 3
    except (TypeError, ValueError):  # sources, or entries of different shapes
        return False


def _are_vertex_numbers(numbers: Any, surface: ClosestPointSource) -> bool:
    """Return whether ``numbers`` are integers of vertices; d of them are a point if ``surface`` has no given mesh."""
    try:
        array = np.asarray(numbers)
    except ValueError:  # rows of different lengths
        return False
    whole = array.dtype.kind in "iu" and array.ndim < 2 and array.size > 0
    return whole and (isinstance(surface, HasGivenMesh) or array.size != surface.dim)


@dataclass(frozen=True, eq=False)
class Pieces:
    """The connected pieces of a prepared manifold with barriers; distances are infinite on those without an origin."""

    count: int  #: Number of pieces.
    of_unknown: Ints  #: (n,): the number of the piece of each unknown.
    of_point: Ints  #: (p,): the number of the piece of each point of the prepared scene.

    def piece_numbers(self, form: Discretized, points: Floats) -> Ints:
        """Return the numbers (k,) of the pieces that contain ``points`` (k, d); ``form`` is the discretised manifold.

        The points are origins of a distance, or points of the manifold at which the distance is evaluated.
        """
        if self.count == 1 or not len(points):
            return np.zeros(len(points), dtype=np.int64)
        return np.asarray(np.rint(form.evaluation_matrix(points) @ self.of_unknown.astype(np.float64)).astype(np.int64))


#: Cache of :func:`pieces_of` by discretised scene.
_CACHE: WeakKeyDictionary[Discretized, Pieces] = WeakKeyDictionary()


def pieces_of(prepared: Prepared) -> Pieces:
    """Return the connected pieces of a prepared scene whose boundaries are barriers, computed once per scene."""
    form = prepared.discretized
    if form not in _CACHE:
        border = form.free_constants(form.stiffness(Terms()))
        numbers = np.zeros(form.size) if border is None else border.indicator @ np.arange(border.indicator.shape[1])
        of_unknown = np.rint(numbers).astype(np.int64)
        of_point = np.rint(form.at_points(numbers[:, None].astype(np.float64))[:, 0]).astype(np.int64)
        _CACHE[form] = Pieces(int(of_unknown.max()) + 1, of_unknown, of_point)
    return _CACHE[form]


#: Relative residual at which solves stop: distances are exact to 1e-3, so that a direct solve need not be refined.
DISTANCE_RESIDUAL = 1e-7
#: Time of the heat step over the spacing squared, and the factor by which it grows until heat arrives everywhere.
HEAT_TIME, TIME_GROWTH = 0.5, 4.0
#: Heat below this share of its largest value is noise if an iterative solver computed it.
NOISE_SHARE = 1e-9


def scene_of(surface: ClosestPointSource | ck.Scene | Prepared) -> ck.Scene:
    """Return the scene of an application's ``surface``: for a source a scene with the equation Laplace."""
    if isinstance(surface, Prepared):
        return surface.scene
    return surface if isinstance(surface, ck.Scene) else ck.Scene(surface, ck.Laplace())


def prepare_manifold(surface: Any, spacing: float | None, options: dict[str, Any]) -> Prepared:
    """Return a source or a scene with barriers, prepared, by default in the form galerkin; a prepared scene as it is.

    Raises InputError if a boundary is no barrier, or a spacing or options are given beside a prepared scene.
    """
    scene = barrier_scene(surface)
    if not isinstance(surface, Prepared):
        prepared: Prepared = ck.prepare(scene, spacing, **{"form": "galerkin", **options})
        return prepared
    if spacing is not None or options:
        raise InputError("spacing and options are those of the prepared scene; leave them out.")
    return surface


def barrier_scene(surface: ClosestPointSource | ck.Scene | Prepared) -> ck.Scene:
    """Return the scene of a manifold whose boundaries are barriers, with the equation Poisson and f = 0.

    Raises InputError if a condition of a boundary or the edge is not zero flux.
    """
    scene = scene_of(surface)
    for condition in scene.conditions:
        if not condition.law.is_zero_flux:
            raise InputError(
                f"boundaries of a scene are barriers, with the condition Neumann(0), got {shown(condition)}; curves "
                "that distances are measured from are origins."
            )
    return ck.Scene(scene.surface, ck.Poisson(0.0), scene.boundaries, scene.edge)


def with_direct_solver_if_small(prepared: Prepared) -> Prepared:
    """Return the prepared scene with a direct solver, whose values have no noise; itself above 60,000 unknowns."""
    if prepared.discretized.size > 60_000:
        return prepared
    return prepared.solved_by("direct", solver_tolerance=DISTANCE_RESIDUAL)


def heat_directions(prepared: Prepared, origins: Origins, pieces: Pieces | None = None) -> ck.Field:
    """Return the field (p, d) of the unit vectors in which heat flows away from the origins.

    Vectors are zero at the few points where heat underflows, and on those of ``pieces`` that have no origin. Raises
    SceneError if no heat arrives at another point; without ``pieces``, every piece needs an origin.
    """
    h, heated = prepared.discretized.spacing, with_direct_solver_if_small(prepared)
    time = HEAT_TIME * h * h
    longest = float(np.ptp(prepared.scene.surface.bounds, axis=0).max()) ** 2  # then heat is everywhere
    while True:
        source = origins.heat_source(h, time**0.5)
        solution = heated.solve(problem=ck.ScreenedPoisson(source, c=1 / time, lumped=True))
        heat = prepared.field(solution)
        cold = heat.values <= heat.values.max() * (0.0 if solution.report.solver == "direct" else NOISE_SHARE)
        if pieces is not None:
            warm = np.bincount(pieces.of_point, heat.values > 0.0, pieces.count) > 0  # pieces with an origin
            cold &= warm[pieces.of_point]
        # Few points may be cold by underflow: a longer time would blur all directions. On pieces without an origin heat
        # is exactly zero.
        underflow = bool(cold.mean() <= 0.01 and heat.values[cold].all())
        if underflow or time > longest:
            break
        time *= TIME_GROWTH
    if not underflow:
        check_heat_reaches(cold, prepared.scene.surface)
    undirected = cold | (heat.values <= 0.0)
    return heat.gradient().map(lambda _, slopes: np.where(undirected[:, None], 0.0, -unit(slopes)))


def check_heat_reaches(cold: Bools, surface: ClosestPointSource) -> None:
    """Raise SceneError if any point of a manifold is marked ``cold`` (p,), which heat does not reach."""
    if cold.any():
        raise SceneError(
            f"no heat arrives at {np.count_nonzero(cold)} points of the {type(surface).__name__}: a piece of it has no "
            "origin, or is too far away for the spacing; give each piece an origin, or leave the piece out."
        )


def vector_heat_directions(
    prepared: Prepared, coupling: ck.Field, source: ck.PointSource, shortest: float
) -> tuple[Floats, Solution]:
    """Return the unit directions (p, 3) of diffused vectors at ``prepared.points``, and a solution with these values.

    Each point has the direction at the first time at which its vector exceeds noise: ``shortest`` times the squared
    spacing, four times that, and so on. Raises SceneError if the vector of some point never exceeds noise.

    ``prepared``: the surface, prepared for solving.
    ``coupling``: the coefficient that keeps vectors tangential, see :func:`tangential_coupling`.
    ``source``: the vectors (k, 3) that diffuse, at points.
    """
    h = prepared.discretized.spacing
    heated = prepared.solved_by("jacobi", solver_tolerance=1e-12)  # well below NOISE_SHARE
    directions = np.zeros_like(prepared.points)
    cold, time = np.ones(len(directions), dtype=bool), shortest * h * h
    longest = TIME_GROWTH * float(np.ptp(prepared.scene.surface.bounds, axis=0).max()) ** 2
    while cold.any() and time < longest:
        problem = ck.Coupled(lambda x: coupling(x).reshape(-1, 3, 3), f=source, c=1 / time, lumped=True)
        heat = heated.solve(problem=problem)
        vectors = prepared.field(heat).project().values
        size = np.linalg.norm(vectors, axis=1)
        warm = cold & (size > NOISE_SHARE * size.max())
        directions[warm] = unit(vectors[warm])
        cold, time = cold & ~warm, TIME_GROWTH * time
    check_heat_reaches(cold, prepared.scene.surface)
    return directions, replace(heat, values=prepared.discretized.project(directions))


def tangential_coupling(prepared: Prepared, parallel: bool) -> ck.Field:
    """Return the zeroth-order coefficient of the system for the components of tangential vectors.

    The coefficient is a 3 x 3 matrix per point, a field of nine channels: (25 / h^2) n n', which penalises components
    along the normal n, minus the square S^2 of the shape operator if vectors are transported in ``parallel``. With 1 in
    place of 25, directions are 18 times less exact on a sphere; with 100, twice as many iterations are needed.
    """
    normals = ck.normals_at(prepared.scene.surface, prepared.points)
    projector = np.einsum("pi,pj->pij", normals, normals)
    coupling = 25.0 / prepared.discretized.spacing**2 * projector
    if parallel:
        shape = _shape_operator(prepared, projector)
        coupling = coupling - np.einsum("pik,pjk->pij", shape, shape)
    return prepared.field(np.ascontiguousarray(coupling.reshape(-1, 9)))


def _shape_operator(prepared: Prepared, projector: Floats) -> Floats:
    """Return the shape operator S (p, 3, 3), of either sign, from projectors n n' (p, 3, 3): grad(n n') n = grad n."""
    column = np.einsum("pii->pi", projector).argmax(axis=1)
    normal = unit(projector[np.arange(len(projector)), :, column])
    shape = np.zeros_like(projector)
    for i in range(3):
        for j in range(3):
            entry = prepared.field(np.ascontiguousarray(projector[:, i, j]))
            shape[:, i] += entry.gradient().values * normal[:, j, None]
    return shape
