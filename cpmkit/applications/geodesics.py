"""Geodesic distance, from heat, and from a transport equation whose solution is the distance.

The heat method (Crane, Weischedel and Wardetzky 2013; King et al. (2024), section 7.2): heat v flows from the origins
for a short time, X = -grad v / |grad v| approximates the gradient of the distance phi, and Lap phi = div X gives phi.
The heat step has a lumped mass here, so that v stays positive while it decays.

X is wrong where heat is smoothed over ridges and thin parts. Each round of transport solves

    -e Lap phi + X . grad phi = 1 - e div X,    e = 1.05 h,

whose solution is the distance itself where X is its gradient. It transports the distance along X from the origins, and
its gradient is the next X.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications import heat
from cpmkit.applications.result import Measured, check_rounds, measure_to_target
from cpmkit.errors import ResolutionError, place
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource, unit
from cpmkit.preparing import Prepared
from cpmkit.runtime.arrays import as_points
from cpmkit.runtime.messages import warn_each
from cpmkit.types import Bools, Floats

#: Within so many spacings of an origin the straight distance is prescribed.
PRESCRIBED_SPACINGS = 3.0


def prepare_transport(prepared: Prepared) -> Prepared:
    """Return the prepared scene with one preconditioner for all rounds of transport and a default residual of 1e-7."""
    solver = prepared.solver
    if solver.solver_tolerance is None:
        prepared = prepared.solved_by(solver.solver, solver_tolerance=heat.DISTANCE_RESIDUAL, **solver.further)
    return prepared.sharing_preconditioner()


def transport_distance(
    prepared: Prepared,
    field: ck.Field,
    prescribed: Bools,
    target: Floats,
    sign: Floats | float = 1.0,
    guess: Solution | None = None,
) -> Solution:
    """Return the solution phi of -e Lap phi + sign X . grad phi = sign - e div X, e = 1.05 h, a transported distance.

    ``prepared``: the manifold, as :func:`prepare_transport` returns it.
    ``field``: the unit vectors X (p, d) along which phi grows.
    ``prescribed`` (p,): the points at which phi is prescribed, by a penalty.
    ``target`` (p,): the values of phi there.
    ``sign``, number or (p,): the sign of phi, 1, -1 or 0: it is transported along X, against X, or not at all.
    ``guess``: initial guess of iterative solvers; None for zero.
    """
    h = prepared.discretized.spacing
    penalty = prescribed * (10 / h)
    e = 1.05 * h  # for a cell Peclet number just below one
    velocity = field.map(lambda _, vectors: (sign * vectors.T).T)
    f = ck.Divergence(field, -e, beside=prepared.field(sign + penalty * target))
    problem = ck.Elliptic(f, diffusivity=e, velocity=velocity, c=prepared.field(penalty))
    return prepared.solve(problem=problem, guess=guess)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Distance(Measured):
    """The geodesic distance from origins: read, saved and drawn as a solution.

    ``solution`` is the distance as a spline on the lattice, which is smooth at the origins where the distance is not.
    """

    origins: heat.Origins  #: Points and curves from which the distance is measured.
    rounds: int  #: Number of rounds of transport.
    pieces: heat.Pieces  #: Connected pieces of the manifold.
    reached: Bools  #: (count,): which pieces have an origin.

    def evaluate(self, points: Any) -> Floats:
        """Return the distance (n,), zero or above, at the points of the manifold nearest to ``points`` (n, d).

        Within two spacings of an origin the result is the straight distance, except on the far side of a thin part; on
        pieces without an origin it is infinite. Raises InputError as
        :meth:`cpmkit.Solution.evaluate`, and for one point (d,).
        """
        surface, h = self.solution.scene.surface, self.solution.spacing
        at = as_points(points, surface.dim)
        distance = self.solution.evaluate(at)
        feet = surface.closest_point(at).points
        straight = self.origins.closest_origins(feet)[0]
        at_tip = (straight < 2 * h) & (distance < PRESCRIBED_SPACINGS * h)  # splines round the tip off
        distance = np.where(at_tip, straight, np.maximum(distance, 0.0))
        if self.reached.all():
            return distance
        return np.where(self.reached[self.pieces.piece_numbers(self.solution.discretized, feet)], distance, np.inf)

    def path(self, start: Any) -> list[Floats]:
        """Return k shortest paths (m, d), each from one of the points ``start``, (k, d) or (d,), to the nearest origin.

        Paths begin on the manifold and descend the distance by the midpoint rule, in steps of half a spacing; the last
        spacing is straight. The number m of points differs by path. Raises ResolutionError if a point is on a piece
        without an origin, or a path does not arrive, InputError as :meth:`evaluate`.
        """
        surface, h = self.solution.scene.surface, self.solution.spacing
        start = as_points(np.atleast_2d(np.asarray(start, dtype=np.float64)), surface.dim)
        at = surface.closest_point(start).points
        paths, step = [[point.copy()] for point in at], 0.5 * h
        left = self.evaluate(at) if len(at) else np.zeros(0)
        if not np.isfinite(left).all():
            lost = place(start[int(np.argmin(np.isfinite(left)))])
            raise ResolutionError(f"no path leads from {lost} to an origin: its piece of the manifold has none.")
        moving = np.flatnonzero(left > h)  # the rest of a path is straight
        most = int(4 * (left.max(initial=0.0) / step + 10))
        for _ in range(most):
            if not len(moving):
                break
            here = at[moving]
            middle = surface.closest_point(here - 0.5 * step * unit(self.gradient(here))).points
            at[moving] = surface.closest_point(here - step * unit(self.gradient(middle))).points
            for number in moving:
                paths[number].append(at[number].copy())
            moving = moving[self.evaluate(at[moving]) > h]
        if len(moving):
            raise ResolutionError(
                f"{len(moving)} of {len(start)} paths did not arrive within {most} steps, the first from "
                f"{start[moving[0]]}; they are caught at a barrier, or where the distance is not resolved: use a "
                "smaller spacing."
            )
        ends = self.origins.closest_origins(at)[1]
        return [np.array([*path, end]) for path, end in zip(paths, ends, strict=True)]


def geodesic_distance(
    surface: ClosestPointSource | ck.Scene | Prepared,
    origins: Any,
    *,
    spacing: float | None = None,
    method: str = "transport",
    rounds: int = 2,
    **options: Any,
) -> Distance:
    """Return the geodesic distance from ``origins`` to everywhere on a curve or surface.

    Parameters
    ----------
    surface : ClosestPointSource, Scene or Prepared
        The manifold; a scene whose boundaries are barriers, which nothing passes; or a prepared scene, for many
        origins.
    origins : (k, d) or (d,) array, whole numbers, ClosestPointSource, or a list of these
        Points, vertices of a mesh by their numbers, and curves; the distance is that from the nearest origin.
    spacing : float
        Spacing of the lattice, in the scene's unit; not for a prepared scene. In its place ``tolerance``, the accepted
        error as a share of the largest distance, ``seconds`` or ``memory``, as for :func:`cpmkit.solve`.
    method : {"transport", "heat"}
        ``heat`` takes two linear solves, and little for further origins on a prepared scene. ``transport`` reduces its
        error on meshes by rounds that cost several times as much: on Spot with 19,000 unknowns from 1.1 percent of the
        mean distance to 0.2.
    rounds : int
        Number of rounds of transport, from 1 to 100; not used by ``heat``.
    **options
        Options of :func:`cpmkit.prepare`, which its ``help`` shows with defaults; ``form`` is ``galerkin`` by default.

    Returns
    -------
    Distance

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted, a point is over three spacings away from the manifold, or a boundary of the
        scene is no barrier; others as prepare and solve do.

    Notes
    -----
    On pieces of the manifold that have no origin, or lie behind a barrier, distances are infinite, and a warning says
    so; the solution, which is saved and drawn, is zero there.

    Examples
    --------
    >>> import cpmkit as ck
    >>> from cpmkit.applications import geodesic_distance
    >>> sphere = ck.source("analytic.sphere")
    >>> distance = geodesic_distance(sphere, [[0, 0, 1]], spacing=0.2, method="heat")
    >>> bool(abs(distance.evaluate([[1, 0, 0]])[0] - 1.5708) < 0.01)
    True
    """
    rounds = check_rounds(method, rounds)
    sources = heat.origins_of(origins, heat.scene_of(surface).surface)
    return measure_to_target(surface, spacing, options, lambda scene: _solve_geodesic_distance(scene, sources, rounds))


def _solve_geodesic_distance(prepared: Prepared, origins: heat.Origins, rounds: int) -> Distance:
    """Return the distance on a prepared scene, by heat and ``rounds`` of transport; warn of pieces without origin."""
    origins.check_near(prepared.discretized.spacing)
    points = prepared.discretized.points  # a local, so that all fields below share the array
    pieces = heat.pieces_of(prepared)
    straight, reached = _nearest_origins(prepared, origins, pieces, points)
    field, phi = _heat_distance(prepared, origins, straight, pieces)
    transport, unreached = prepare_transport(prepared), ~reached[pieces.of_point]
    for _ in range(rounds):
        # The previous distance must be small, too: the opposite side of a thin part is not prescribed.
        beside = np.maximum(prepared.field(phi).values, straight) < PRESCRIBED_SPACINGS * phi.spacing
        target = np.where(beside, straight, 0.0)
        phi = transport_distance(transport, field, beside | unreached, target, guess=phi)
        field = prepared.field(phi).gradient().map(lambda _, slopes: np.where(unreached[:, None], 0.0, unit(slopes)))
    if not reached.all():
        text = (
            f"{np.count_nonzero(~reached)} of {len(reached)} pieces of the {type(origins.surface).__name__} have no "
            "origin: distances are infinite there, and the solution, which is saved and drawn, is zero."
        )
        warn_each([text])
        phi = replace(phi, warnings=(*phi.warnings, text))
    return Distance(solution=phi, origins=origins, rounds=rounds, pieces=pieces, reached=reached)


def _nearest_origins(
    prepared: Prepared, origins: heat.Origins, pieces: heat.Pieces, points: Floats
) -> tuple[Floats, Bools]:
    """Return straight distances (p,) of ``points`` (p, d) from origins, and a mask (count,) of pieces with an origin.

    A distance is infinite where the nearest origin lies on another piece.
    """
    form = prepared.discretized
    straight, _, number = origins.closest_origins(points)
    places, owner = origins.samples(form.spacing)
    lies_on = np.zeros((owner.max() + 1, pieces.count), dtype=bool)
    lies_on[owner, pieces.piece_numbers(form, places)] = True
    return np.where(lies_on[number, pieces.of_point], straight, np.inf), np.asarray(lies_on.any(axis=0))


def _heat_distance(
    prepared: Prepared, origins: heat.Origins, straight: Floats, pieces: heat.Pieces
) -> tuple[ck.Field, Solution]:
    """Return the field X (p, d) of unit vectors away from the origins, and the distance by the heat method.

    On each piece with an origin the distance is shifted by the median difference from ``straight`` (p,) near origins.
    """
    field = heat.heat_directions(prepared, origins, pieces)
    phi = heat.with_direct_solver_if_small(prepared).solve(problem=ck.Poisson(field.divergence(-1.0)))
    h, shifts = phi.spacing, np.zeros(pieces.count)
    for piece in range(pieces.count):
        of_piece = pieces.of_point == piece
        beside = of_piece & (straight > h) & (straight < PRESCRIBED_SPACINGS * h)
        rows = np.flatnonzero(beside if beside.any() else of_piece & (straight <= straight[of_piece].min() + h))
        if np.isfinite(straight[rows]).any():
            shifts[piece] = np.median(straight[rows] - phi.discretized.at_points(phi.values, rows)[:, 0])
    return field, replace(phi, values=phi.values + shifts[pieces.of_unknown][:, None])
