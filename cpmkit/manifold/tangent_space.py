"""Normals, tangents and conormals at points of a manifold, from the source itself or from its closest points alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.orientation import Orientation
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.vector_algebra import unit
from cpmkit.types import Bools, Floats, Ints

#: An eigenvalue of the closest point map's Jacobian above this belongs to a tangent direction: 0 off, 1 along.
TANGENT_EIGENVALUE = 0.5
#: A curve has a corner where the Jacobian's largest eigenvalue exceeds the next by less than this.
CORNER_EIGENVALUE_GAP = 0.7


def jacobian(source: LocalSource, points: Floats, step: float) -> Floats:
    """Return the Jacobian (n, d, d) of the closest point map at ``points`` (n, d), by central differences, symmetrised.

    On a manifold it is the projection on the tangent space (Maerz and Macdonald 2012).
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

    ``step`` is that of the differences of closest points.
    """

    def of_member(member: LocalSource, member_feet: ClosestPoints, _: Ints) -> Floats:
        """Return the unit normals of one member at its feet."""
        if member.has_normals:
            return member.normals(member_feet)
        return np.linalg.eigh(jacobian(member, member_feet.points, step))[1][:, :, 0]

    return _by_member(surface, feet, of_member)


def unit_tangents(curve: LocalSource, feet: ClosestPoints, step: float) -> Floats:
    """Return unit tangents (n, d) of a curve at ``feet``: its own, or from the Jacobian with arbitrary signs."""
    return tangents_and_corners(curve, feet, step)[0]


def tangents_and_corners(curve: LocalSource, feet: ClosestPoints, step: float) -> tuple[Floats, Bools]:
    """Return unit tangents (n, d) of a curve at ``feet``, and a mask (n,) of the feet at corners.

    Corners are found, from the eigenvalues of the Jacobian, only on curves without tangents of their own.
    """
    corner = np.zeros(len(feet), dtype=bool)

    def of_member(member: LocalSource, member_feet: ClosestPoints, rows: Ints) -> Floats:
        """Return the unit tangents of one member at its feet, and mark its corners in ``corner`` at ``rows``."""
        if member.has_tangents:
            return member.tangents(member_feet)
        values, axes = np.linalg.eigh(jacobian(member, member_feet.points, step))
        corner[rows] = values[:, -1] - values[:, -2] < CORNER_EIGENVALUE_GAP
        return np.asarray(axes[:, :, -1])

    return _by_member(curve, feet, of_member), corner


def project_tangent(surface: LocalSource, feet: ClosestPoints, vectors: Floats, step: float) -> Floats:
    """Return ``vectors`` (n, d) projected on the tangent spaces of ``surface`` at ``feet``."""
    return _by_member(
        surface, feet, lambda member, member_feet, rows: _project_member(member, member_feet, vectors[rows], step)
    )


def _project_member(surface: LocalSource, feet: ClosestPoints, vectors: Floats, step: float) -> Floats:
    """Return ``vectors`` (n, d) projected on the tangent spaces at ``feet`` of a source that is no union."""
    if surface.manifold_dim == surface.dim:
        return vectors
    if surface.manifold_dim == 2:
        n = unit_normals(surface, feet, step)
        return np.asarray(vectors - np.sum(vectors * n, axis=1, keepdims=True) * n)
    if surface.manifold_dim == 1:
        t = unit_tangents(surface, feet, step)
        return np.asarray(np.sum(vectors * t, axis=1, keepdims=True) * t)
    values, axes = np.linalg.eigh(jacobian(surface, feet.points, step))
    components = np.einsum("nij,ni->nj", axes, vectors) * (values > TANGENT_EIGENVALUE)
    return np.asarray(np.einsum("nij,nj->ni", axes, components))


def outward_conormals(surface: LocalSource, edge: ClosestPoints, step: float) -> Floats:
    """Return the outward unit conormals (n, d) at feet ``edge`` on the edge of an open manifold.

    ``b = -unit of T sum_k [cp(y + h e_k) + cp(y - h e_k) - 2 y]``, T the tangent projection: inside a manifold the
    closest points around y average to y, at an edge they lean inwards, and curvature adds a normal part that T removes.
    Second order in the step h.
    """
    return _by_member(surface, edge, lambda member, member_feet, _: _outward_of_member(member, member_feet, step))


def _outward_of_member(surface: LocalSource, edge: ClosestPoints, step: float) -> Floats:
    """Return the outward unit conormals (n, d) at feet ``edge`` of a single member, see :func:`outward_conormals`."""
    y = edge.points
    lean = -unit((_feet_around(surface, y, step) - y[:, None]).sum(axis=1))
    if surface.has_normals or surface.has_tangents:
        return unit(project_tangent(surface, edge, lean, step))
    # Differences across the edge would bend T by O(h): it is extrapolated from two points inside.
    inside = (surface.closest_point(y - distance * step * lean) for distance in (2, 4))
    near, far = (unit(project_tangent(surface, feet, lean, step)) for feet in inside)
    return unit(2 * near - far)


def _by_member(
    surface: LocalSource, feet: ClosestPoints, compute: Callable[[LocalSource, ClosestPoints, Ints], Floats]
) -> Floats:
    """Return the vectors (n, d) that ``compute`` returns for the feet on each member of a union.

    ``compute`` gets a member, its feet and their rows (k,), so that other members near by have no influence.
    """
    vectors = np.empty_like(feet.points)
    for member, rows, member_feet in surface.by_member(feet):
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
    """Return the unit conormals v = n x t (n, d) to the left of a boundary.

    Here n is the normal of the manifold, in an area of the plane the third axis, and t the tangent of the boundary. Of
    a point on a curve v is -t, t the tangent of the curve; of a surface in a solid it is the normal of the surface.
    King et al. (2024), section 4.7, eq. 11 and eq. 18: v is the normal of S_perp, and the binormal b.

    Parameters
    ----------
    source, surface : LocalSource
        The boundary, of one dimension less than the manifold there, and the manifold.
    signs : Orientation
        The conormals at samples of the boundary; without samples the signs of the sources' own directions are used.
    on_surface, feet : ClosestPoints
        The closest points on the manifold and on the boundary of the same points.
    step : float
        Step of the differences of closest points.
    """
    dimension = (source.manifold_dim or 0) + 1
    left = np.empty_like(on_surface.points)
    for member, rows, member_feet in source.by_member(feet):
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
        left[rows] = signs.apply(on_member.points, conormals)
        if signs.points is not None and corner.any():  # the bisector
            left[rows[corner]] = signs.mean(on_member.points[corner])
    return left
