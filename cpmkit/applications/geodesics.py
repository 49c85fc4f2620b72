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
from typing import Any, NamedTuple

import numpy as np

import cpmkit as ck
from cpmkit.applications.heat import DISTANCE_RESIDUAL, heat_directions, heat_solver, manifold_of
from cpmkit.applications.origins import Origins, Pieces, origins_of, pieces_of
from cpmkit.applications.result import Measured, measure_to_target
from cpmkit.errors import InputError, ResolutionError, SceneError, place, shown
from cpmkit.facade import Solution
from cpmkit.plugin import ClosestPointSource, unit
from cpmkit.preparing import Prepared
from cpmkit.runtime.arrays import as_points, whole
from cpmkit.runtime.messages import warn_each
from cpmkit.types import Bools, Floats, Ints

#: Artificial diffusion of the transport over the spacing, for a cell Peclet number just below one.
DIFFUSION_SPACINGS = 1.05
#: Within so many spacings of an origin the straight distance is prescribed, by a penalty of PENALTY over the spacing.
PRESCRIBED_SPACINGS, PENALTY = 3.0, 10.0
#: Step of the descent of a path, and the distance at which the rest of a path is straight; both in spacings.
STEP_SPACINGS, ARRIVED_SPACINGS = 0.5, 1.0
#: Limit of the steps of a path, over those of a straight descent.
STEPS_OVER_LEAST = 4.0
METHODS = ("transport", "heat")


def transport_solver(prepared: Prepared) -> Prepared:
    """Return the prepared scene for transport: solves to a larger residual, with one preconditioner for all rounds."""
    solver = prepared.solver
    if solver.solver_tolerance is None:
        prepared = prepared.solved_by(solver.solver, solver_tolerance=DISTANCE_RESIDUAL, **solver.further)
    return prepared.sharing_preconditioner()


def transport_distance(
    prepared: Prepared,
    field: ck.Field,
    prescribed: Bools,
    target: Floats,
    sign: Floats | float = 1.0,
    guess: Solution | None = None,
) -> Solution:
    """Solve -e Lap phi + sign X . grad phi = sign - e div X, with phi = ``target`` (p,) where it is ``prescribed``.

    Parameters
    ----------
    prepared : Prepared
        The manifold, as :func:`transport_solver` returns it.
    field : Field
        X, unit vectors (p, d) along which phi grows.
    prescribed : (p,) bool
        Points at which the target is prescribed.
    target : (p,) float64
        The distance there.
    sign : (p,) float64
        Sign of phi: it is transported along X where it is positive, and against X where it is negative.
    guess : Solution
        Initial guess of iterative solvers.
    """
    h = prepared.discretized.spacing
    penalty = prescribed * (PENALTY / h)
    e = DIFFUSION_SPACINGS * h
    velocity = field.map(lambda _, vectors: (sign * vectors.T).T)
    f = ck.Divergence(field, -e, beside=prepared.field(sign + penalty * target))
    problem = ck.Elliptic(f, diffusivity=e, velocity=velocity, c=prepared.field(penalty))
    return prepared.solve(problem=problem, guess=guess)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Distance(Measured):
    """The geodesic distance from origins: read, saved and drawn as a solution.

    Attributes
    ----------
    solution : Solution
        The distance on splines of the lattice, smooth at the origins where the distance has a tip.
    origins : Origins
        Points and curves from which it is measured.
    rounds : int
        Number of rounds of transport.
    pieces : Pieces
        Connected pieces of the manifold.
    reached : (count,) bool
        Which pieces have an origin.
    """

    origins: Origins
    rounds: int
    pieces: Pieces
    reached: Bools

    def evaluate(self, points: Any) -> Floats:
        """Return the distance (n,), zero or above, at the points of the manifold nearest to ``points`` (n, d).

        Within two spacings of an origin it is the straight distance; on pieces without an origin it is infinite.
        """
        surface, h = self.solution.scene.surface, self.solution.spacing
        at = as_points(points, surface.dim)
        distance = self.solution.evaluate(at)
        feet = surface.closest_point(at).points
        straight = self.origins.closest(feet)[0]
        at_tip = (straight < 2 * h) & (distance < PRESCRIBED_SPACINGS * h)  # splines round the tip off
        distance = np.where(at_tip, straight, np.maximum(distance, 0.0))
        if self.reached.all():
            return distance
        return np.where(self.reached[self.pieces.numbers_at(self.solution.discretized, feet)], distance, np.inf)

    def path(self, start: Any) -> list[Floats]:
        """Return the shortest path (m, d) to the origins from each of the points ``start`` (k, d) or (d,), by descent.

        Raises
        ------
        ResolutionError
            If a point is on a piece without an origin, or a path is caught at a barrier.
        """
        points = np.atleast_2d(np.asarray(start, dtype=np.float64))
        return descend(self, as_points(points, self.solution.scene.surface.dim))


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
    origins : (k, d) array, whole numbers, ClosestPointSource, or a sequence of these
        Points, vertices of a mesh by their numbers, and curves; the distance is that from the nearest origin.
    spacing : float
        Spacing of the lattice, in the scene's unit; not for a prepared scene. In its place ``tolerance``, the accepted
        error as a share of the largest distance, ``seconds`` or ``memory``, as for :func:`cpmkit.solve`.
    method : {"transport", "heat"}
        ``heat`` takes two linear solves, and little for further origins on a prepared scene. ``transport`` reduces its
        error on meshes by rounds that cost several times as much: on Spot with 19,000 unknowns from 1.1 percent of the
        mean distance to 0.2.
    rounds : int
        Number of rounds of transport.
    **options
        Options of :func:`cpmkit.prepare`.

    Returns
    -------
    Distance

    Raises
    ------
    InputError, SceneError
        If an argument is not accepted, or a boundary of the scene is no barrier.

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
    if method not in METHODS:
        raise InputError(f"method must be {' or '.join(METHODS)}, got {shown(method)}.")
    rounds = whole(rounds, "rounds", 1, 100) if method == "transport" else 0
    sources = origins_of(origins, manifold_of(surface))
    return measure_to_target(surface, spacing, options, lambda prepared: _measure(prepared, sources, rounds))


def _measure(prepared: Prepared, origins: Origins, rounds: int) -> Distance:
    """Return the distance on a prepared scene: by heat, then by ``rounds`` of transport."""
    points = prepared.discretized.points  # a local, so that all fields below share the array
    pieces = pieces_of(prepared)
    nearest, reached = _nearest_origins(prepared, origins, pieces, points)
    field, phi = _distance_by_heat(prepared, origins, nearest, pieces)
    transport = transport_solver(prepared)
    unreached = ~reached[pieces.of_point]
    for _ in range(rounds):
        phi = _transport_round(transport, nearest, unreached, field, phi)
        field = prepared.field(phi).gradient().map(lambda _, slopes: np.where(unreached[:, None], 0.0, unit(slopes)))
    return Distance(
        solution=_warn_unreached(phi, reached), origins=origins, rounds=rounds, pieces=pieces, reached=reached
    )


class _Nearest(NamedTuple):
    """Straight distances (p,) from the points of a prepared scene to the nearest origins, and their numbers (p,)."""

    straight: Floats
    number: Ints


def _nearest_origins(prepared: Prepared, origins: Origins, pieces: Pieces, points: Floats) -> tuple[_Nearest, Bools]:
    """Return the nearest origin of each of ``points`` (p, d), and which pieces (count,) have an origin.

    An origin on another piece than the point is infinitely far.
    """
    form = prepared.discretized
    straight, number = origins.distances(points)
    if pieces.count == 1:
        return _Nearest(straight, number), np.ones(1, dtype=bool)
    places, owner = origins.samples(form.spacing)
    piece = pieces.numbers_at(form, places)
    lies_on = np.zeros((owner.max() + 1, pieces.count), dtype=bool)
    lies_on[owner, piece] = True
    straight = np.where(lies_on[number, pieces.of_point], straight, np.inf)
    return _Nearest(straight, number), np.asarray(lies_on.any(axis=0))


def _warn_unreached(phi: Solution, reached: Bools) -> Solution:
    """Return ``phi`` with a warning, which is also issued, if pieces have no origin; else ``phi`` unchanged."""
    if reached.all():
        return phi
    text = (
        f"{np.count_nonzero(~reached)} of {len(reached)} pieces of the {type(phi.scene.surface).__name__} have no "
        "origin: distances are infinite there, and the solution, which is saved and drawn, is zero."
    )
    warn_each([text])
    return replace(phi, warnings=(*phi.warnings, text))


def _distance_by_heat(
    prepared: Prepared, origins: Origins, nearest: _Nearest, pieces: Pieces
) -> tuple[ck.Field, Solution]:
    """Return X (p, d), the unit directions away from the origins, and the distance by the heat method.

    A constant is added to the distance on each piece so that it is the straight distance beside the origins.
    """
    field = heat_directions(prepared, origins, everywhere=False)
    phi = heat_solver(prepared).solve(problem=ck.Poisson(field.divergence(-1.0)))
    shifts = np.zeros(pieces.count)
    for piece in range(pieces.count):
        rows = np.flatnonzero(pieces.of_point == piece)
        if np.isfinite(nearest.straight[rows]).any():
            shifts[piece] = _shift_at_origins(phi, nearest, rows)
    return field, replace(phi, values=phi.values + shifts[pieces.of_unknown][:, None])


def _shift_at_origins(phi: Solution, nearest: _Nearest, piece: Ints) -> float:
    """Return the constant by which ``phi`` differs from the straight distance beside the origins of a piece.

    ``piece`` (k,) are the indices of its points.

    Raises
    ------
    SceneError
        If origins need different constants, as on pieces that are not connected.
    """
    h, straight = phi.spacing, nearest.straight[piece]
    near_origin = (straight > h) & (straight < PRESCRIBED_SPACINGS * h)
    near_origin = near_origin if near_origin.any() else straight <= straight.min() + h
    rows = piece[near_origin]
    difference = nearest.straight[rows] - phi.discretized.at_points(phi.values, rows)[:, 0]
    numbers, label = np.unique(nearest.number[rows], return_inverse=True)
    constants = np.bincount(label, difference) / np.bincount(label)
    if len(numbers) > 1 and np.ptp(constants) > PRESCRIBED_SPACINGS * h:
        raise SceneError(
            f"distances beside {len(numbers)} origins differ by {np.ptp(constants):.3g}: they lie on pieces of the "
            "manifold that are not connected; measure piece by piece."
        )
    return float(np.median(difference))


def _transport_round(
    prepared: Prepared, nearest: _Nearest, unreached: Bools, field: ck.Field, previous: Solution
) -> Solution:
    """Return the distance after one round of transport along ``field``.

    Near the origins, it is the straight distance, and zero at the points that are ``unreached`` (p,).
    """
    h = prepared.discretized.spacing
    # The previous distance along the manifold must be small, too: the opposite side of a thin part is not prescribed.
    near_origin = np.maximum(prepared.field(previous).values, nearest.straight) < PRESCRIBED_SPACINGS * h
    target = np.where(near_origin, nearest.straight, 0.0)
    return transport_distance(prepared, field, near_origin | unreached, target, guess=previous)


def descend(distance: Distance, start: Floats) -> list[Floats]:
    """Return the path (m, d) from each of ``start`` (k, d) down to the origins, by the midpoint rule for all at once.

    Raises
    ------
    ResolutionError
        If a point lies on a piece without an origin, or a path does not arrive.
    """
    surface, h = distance.solution.scene.surface, distance.solution.spacing
    at = surface.closest_point(start).points
    paths, step = [[point.copy()] for point in at], STEP_SPACINGS * h
    left = distance.evaluate(at) if len(at) else np.zeros(0)
    if not np.isfinite(left).all():
        lost = place(start[int(np.argmin(np.isfinite(left)))])
        raise ResolutionError(f"no path leads from {lost} to an origin: its piece of the manifold has none.")
    moving = np.flatnonzero(left > ARRIVED_SPACINGS * h)
    most = int(STEPS_OVER_LEAST * (left.max(initial=0.0) / step + 10))
    for _ in range(most):
        if not len(moving):
            break
        here = at[moving]
        middle = surface.closest_point(here - 0.5 * step * unit(distance.gradient(here))).points
        at[moving] = surface.closest_point(here - step * unit(distance.gradient(middle))).points
        for number in moving:
            paths[number].append(at[number].copy())
        moving = moving[distance.evaluate(at[moving]) > ARRIVED_SPACINGS * h]
    if len(moving):
        raise ResolutionError(
            f"{len(moving)} of {len(start)} paths did not arrive within {most} steps, the first from "
            f"{start[moving[0]]}; they are caught at a barrier, or where the distance is not resolved: use a smaller "
            "spacing."
        )
    ends = distance.origins.closest(at)[1]
    return [np.array([*path, end]) for path, end in zip(paths, ends, strict=True)]
