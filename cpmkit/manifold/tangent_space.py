"""Normals, tangents and conormals, from the source or from closest points alone; feet found by walks along a sheet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.orientation import Orientation
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.types import Bools, Floats, Ints


def jacobian(source: LocalSource, points: Floats, step: float) -> Floats:
    """Return the symmetrised Jacobian (n, d, d) of the closest point map at ``points``, by central differences.

    At smooth ``points`` (n, d) of the manifold off its edge it is, to second order in the length ``step`` by which
    queries are shifted, the projection on the tangent space (Maerz and Macdonald 2012).
    King et al. (2024), section 4.7, interpolates it from the nodes; here it is evaluated at the feet themselves.
    """
    ahead, behind = np.split(_feet_around(source, points, step), 2, axis=1)
    columns = (ahead - behind) / (2 * step)
    return 0.5 * (columns + columns.transpose(0, 2, 1))


def _feet_around(source: LocalSource, points: Floats, step: float) -> Floats:
    """Return the feet (n, 2 d, d) of the points at distance ``step`` from ``points`` (n, d) along the axes.

    Points in the positive directions of all axes come first, then those in the negative directions.
    """
    shifts = step * np.concatenate([np.eye(source.dim), -np.eye(source.dim)])
    feet = source.closest_point((points[:, None] + shifts).reshape(-1, source.dim))
    return feet.points.reshape(-1, *shifts.shape)


def unit_normals(surface: LocalSource, feet: ClosestPoints, step: float) -> Floats:
    """Return unit normals (n, d) of a hypersurface at ``feet``: its own, or from the Jacobian with arbitrary signs.

    ``step`` is the length of the differences of closest points.
    """

    def member_normals(member: LocalSource, member_feet: ClosestPoints, _: Ints) -> Floats:
        """Return the unit normals of one member at its feet."""
        if member.has_normals:
            return member.normals(member_feet)
        return np.linalg.eigh(jacobian(member, member_feet.points, step))[1][:, :, 0]

    return _compute_by_member(surface, feet, member_normals)


def unit_tangents(curve: LocalSource, feet: ClosestPoints, step: float) -> Floats:
    """Return unit tangents (n, d) of a curve at ``feet``: its own, or with any signs from differences over ``step``."""
    return tangents_and_corners(curve, feet, step)[0]


def tangents_and_corners(curve: LocalSource, feet: ClosestPoints, step: float) -> tuple[Floats, Bools]:
    """Return unit tangents (n, d) of a curve at ``feet`` (:func:`unit_tangents`), and a mask (n,) of corners and ends.

    Corners and ends are detected only on curves without tangents of their own: there the two largest eigenvalues of the
    Jacobian, which are 1 and 0 on a smooth curve, differ by less than 0.7. ``step`` is the step of its differences.
    """
    corner = np.zeros(len(feet), dtype=bool)

    def member_tangents(member: LocalSource, member_feet: ClosestPoints, rows: Ints) -> Floats:
        """Return unit tangents of one member at its feet; without its own, mark corners in ``corner`` at ``rows``."""
        if member.has_tangents:
            return member.tangents(member_feet)
        values, axes = np.linalg.eigh(jacobian(member, member_feet.points, step))
        corner[rows] = values[:, -1] - values[:, -2] < 0.7
        return np.asarray(axes[:, :, -1])

    return _compute_by_member(curve, feet, member_tangents), corner


def project_tangent(surface: LocalSource, feet: ClosestPoints, vectors: Floats, step: float) -> Floats:
    """Return ``vectors`` (n, d) projected on the tangent spaces at ``feet``, by differences over ``step`` if needed."""

    def project_on_member(member: LocalSource, member_feet: ClosestPoints, rows: Ints) -> Floats:
        """Return the vectors at ``rows`` projected on the tangent spaces of one member at its feet."""
        of_rows = vectors[rows]
        if member.manifold_dim == member.dim:
            return of_rows
        if member.manifold_dim == 2:
            n = unit_normals(member, member_feet, step)
            return np.asarray(of_rows - np.sum(of_rows * n, axis=1, keepdims=True) * n)
        if member.manifold_dim == 1:
            t = unit_tangents(member, member_feet, step)
            return np.asarray(np.sum(of_rows * t, axis=1, keepdims=True) * t)
        values, axes = np.linalg.eigh(jacobian(member, member_feet.points, step))
        components = np.einsum("nij,ni->nj", axes, of_rows) * (values > 0.5)  # 1 along the manifold
        return np.asarray(np.einsum("nij,nj->ni", axes, components))

    return _compute_by_member(surface, feet, project_on_member)


def outward_conormals(surface: LocalSource, edge: ClosestPoints, step: float) -> Floats:
    """Return the outward unit conormals (n, d) at feet ``edge`` on the edge of an open manifold.

    ``b = -unit of T sum_k [cp(y + h e_k) + cp(y - h e_k) - 2 y]``, T the tangent projection: inside a manifold the
    closest points around y average to y, at an edge they lean inwards, and curvature adds a normal part that T removes.
    Second order in the step h. At feet off the edge the direction is arbitrary, or zero.
    """

    def member_conormals(member: LocalSource, member_edge: ClosestPoints, _: Ints) -> Floats:
        """Return the outward unit conormals of one member at its feet on the edge."""
        y = member_edge.points
        lean = -unit((_feet_around(member, y, step) - y[:, None]).sum(axis=1))
        if member.has_normals or member.has_tangents:
            return unit(project_tangent(member, member_edge, lean, step))
        # differences across the edge would cause an error O(h) in T, which is extrapolated from two points inside
        inside = (member.closest_point(y - distance * step * lean) for distance in (2, 4))
        near, far = (unit(project_tangent(member, feet, lean, step)) for feet in inside)
        return unit(2 * near - far)

    return _compute_by_member(surface, edge, member_conormals)


def _compute_by_member(
    surface: LocalSource, feet: ClosestPoints, compute: Callable[[LocalSource, ClosestPoints, Ints], Floats]
) -> Floats:
    """Return the vectors (n, d) that ``compute`` returns for the ``feet`` on each member of a union.

    ``compute`` gets a member, its feet and their rows (k,), so that other members near by have no influence.
    """
    vectors = np.empty_like(feet.points)
    for member, rows, member_feet in surface.feet_by_member(feet):
        vectors[rows] = compute(member, member_feet, rows)
    return vectors


def left_conormals(
    source: LocalSource,
    surface: LocalSource,
    signs: Orientation,
    on_surface: ClosestPoints,
    feet: ClosestPoints,
    step: float,
) -> Floats:
    """Return the unit conormals v = n x t (n, d) to the left of a boundary, or those that its source gives.

    Here n is the normal of the manifold, in an area of the plane the third axis, and t the tangent of the boundary. At
    a point on a curve, v is -t with t the tangent of the curve; on a surface in a solid it is the normal of the
    surface; at a corner or end (:func:`tangents_and_corners`) the mean of the samples near by, if there are any.
    King et al. (2024), section 4.7, eq. 11 and eq. 18: v is the normal of S_perp, and the binormal b.

    ``source``, ``surface``: the boundary, all of one dimension, one less than the manifold's there, and the manifold.
    ``signs``: the conormals at samples of the boundary; without samples the signs of the sources' own directions are
        used.
    ``on_surface``, ``feet``: the closest points on the manifold and on the boundary of the same points.
    ``step``: step of the differences of closest points.
    """
    dimension = (source.manifold_dim or 0) + 1
    left = np.empty_like(on_surface.points)
    for member, rows, member_feet in source.feet_by_member(feet):
        if member.has_left:
            left[rows] = member.leftward(member_feet)
            continue
        on_member, corner = on_surface.take(rows), np.zeros(len(rows), dtype=bool)
        if dimension == 1:
            conormals = -unit_tangents(surface, on_member, step)
        elif dimension == 3:
            conormals = unit_normals(member, member_feet, step)
        else:
            tangents, corner = tangents_and_corners(member, member_feet, step)
            if surface.dim == 2:
                conormals = np.stack([-tangents[:, 1], tangents[:, 0]], axis=1)
            else:
                conormals = unit(np.cross(unit_normals(surface, on_member, step), tangents))
        left[rows] = signs.orient_directions(on_member.points, conormals)
        if signs.points is not None and corner.any():  # the bisector
            left[rows[corner]] = signs.mean_directions(on_member.points[corner])
    return left


#: Longest step of a walk, in spacings: shorter than the distance to the next sheet.
STRIDE_SPACINGS = 0.5
#: A walk ends where a step moves the foot by less than this, in spacings.
ARRIVED_SPACINGS = 1e-7


def feet_on_sheets(
    source: LocalSource, goal: Floats, start: ClosestPoints, spacing: float
) -> tuple[Ints, ClosestPoints]:
    """Return candidates for the feet of ``goal`` (n, d) on the sheets of ``start``: rows (k,), ascending, and feet.

    ``start`` is a point of the manifold for each goal. A source with local minima gives all its feet no farther than
    this point, on any sheet. Feet of other sources, and one in place of the doubtful feet of a row, are found by
    walking along the sheet from ``start``, in steps of at most half the lattice's ``spacing``.
    """
    if not source.has_local_minima:
        return np.arange(len(goal)), walk(source, goal, start, spacing, give_up=True).feet
    reach = norms(goal - start.points)
    rows, feet = source.local_minima(goal, float(reach.max()))
    within_reach = feet.distance <= reach[rows]
    rows, feet = rows[within_reach], feet.take(within_reach)
    if feet.doubtful is None:
        return rows, feet
    unsure, sure = np.unique(rows[feet.doubtful]), ~feet.doubtful
    walked = walk(source, goal[unsure], start.take(unsure), spacing, give_up=True).feet
    rows = np.concatenate([rows[sure], unsure])
    order = np.argsort(rows, kind="stable")
    return rows[order], ClosestPoints.join([feet.take(sure), walked]).take(order)


@dataclass(frozen=True, eq=False)
class Walk:
    """The feet at the ends of walks, and the unit vectors (n, d) of their last long steps.

    A step is long if it is over half as long as a step may be; without such a step the vector is zero.
    """

    feet: ClosestPoints
    last: Floats


def walk(
    source: LocalSource,
    goal: Floats,
    start: ClosestPoints,
    spacing: float,
    *,
    give_up: bool = False,
    lengthened: bool = True,
) -> Walk:
    """Return the walk by steps along the source from ``start`` to feet at which ``goal`` (n, d) lies along the normal.

    A jump to the foot of the goal's projection could land on another sheet. Each step follows the tangential part of
    the vector to the goal. This part shrinks by ``1 - height * curvature`` times the step; the length of a step, at
    most 4 times this part, is chosen from how much it shrank in the last step (Barzilai and Borwein 1988). A walk ends
    after 60 steps wherever it is; on points there are no steps.

    ``start``: one point of the manifold for each goal.
    ``spacing``: spacing of the lattice; a step is at most half of it.
    ``give_up``: whether a walk ends if the tangential part grows over 4 steps: around a bend of smaller radius than the
        goal's height there is no foot.
    ``lengthened``: if false, a step is the tangential part itself: a fifth more steps, which follow sharper folds.
    """
    feet, strides, walking = start, np.zeros_like(goal), np.arange(len(goal))
    if source.manifold_dim == 0:
        return Walk(feet, strides)
    checked, steps = np.full(len(goal), np.inf), np.ones((len(goal), 1))
    last: tuple[Floats, Floats] | None = None
    for count in range(60):  # a node is within a stencil's reach of the foot where the walk starts
        current = feet.take(walking)
        ahead = project_tangent(source, current, goal[walking] - current.points, 0.5 * spacing)
        length = np.linalg.norm(ahead, axis=1, keepdims=True)
        if last is not None and lengthened:
            walked, shrunk = current.points - last[0], last[1] - ahead
            slope = np.sum(walked * shrunk, axis=1, keepdims=True) / np.sum(walked * walked, axis=1, keepdims=True)
            steps = np.asarray(1 / np.clip(slope, 0.25, None))
        step = np.minimum(steps, STRIDE_SPACINGS * spacing / np.maximum(length, ARRIVED_SPACINGS * spacing)) * ahead
        reached = source.closest_point(current.points + step)
        moves = reached.points - current.points
        distance = norms(moves)
        whole = distance > 0.5 * STRIDE_SPACINGS * spacing
        strides[walking[whole]] = moves[whole] / distance[whole, None]
        feet, going = feet.replace_rows(walking, reached), distance > ARRIVED_SPACINGS * spacing
        if give_up and count % 4 == 0:
            going &= length[:, 0] <= checked[walking]
            checked[walking] = length[:, 0]
        last = (current.points[going], ahead[going])
        steps = steps[going]
        walking = walking[going]
        if not len(walking):
            break
    return Walk(feet, strides)


def nearest_points_on_sheet(
    source: LocalSource, start: ClosestPoints | None, goal: Floats, spacing: float
) -> ClosestPoints:
    """Return the points of a source nearest to ``goal`` (n, d); with ``start``, those that a :func:`walk` reaches."""
    return source.closest_point(goal) if start is None else walk(source, goal, start, spacing).feet
