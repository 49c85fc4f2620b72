"""Normals and tangents at points of a manifold, from the source itself or from its closest points alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints

#: An eigenvalue of the closest point map's Jacobian above this belongs to a tangent direction.
TANGENT_EIGENVALUE = 0.5
#: Where that of a curve's direction is not above the next by so much, the curve has a corner there.
CORNER_EIGENVALUE_GAP = 0.7


def jacobian(source: LocalSource, points: Floats, step: float) -> Floats:
    """Return the Jacobian (n, d, d) of the closest point map at ``points``, by central differences, symmetrised.

    On a manifold it is the projection on the tangent space (Maerz and Macdonald 2012).
    King et al. (2024), section 4.7, interpolates it from the nodes; here it is taken at the feet themselves.
    """
    ahead, behind = np.split(_feet_around(source, points, step), 2, axis=1)
    columns = (ahead - behind) / (2 * step)
    return 0.5 * (columns + columns.transpose(0, 2, 1))


def _feet_around(source: LocalSource, points: Floats, step: float) -> Floats:
    """Return the feet (n, 2 d, d) of points a ``step`` ahead of ``points`` along each axis, then of those behind."""
    shifts = step * np.concatenate([np.eye(source.dim), -np.eye(source.dim)])
    feet = source.closest_point((points[:, None] + shifts).reshape(-1, source.dim))
    return feet.points.reshape(-1, *shifts.shape)


def unit_normals(surface: LocalSource, feet: ClosestPoints, step: float) -> Floats:
    """Return unit normals (n, d) of a hypersurface at ``feet``; a source without its own gives them any sign."""

    def of_member(member: LocalSource, member_feet: ClosestPoints, _: Ints) -> Floats:
        if member.has_normals:
            return member.normals(member_feet)
        return np.linalg.eigh(jacobian(member, member_feet.points, step))[1][:, :, 0]

    return _by_member(surface, feet, of_member)


def unit_tangents(curve: LocalSource, feet: ClosestPoints, step: float) -> Floats:
    """Return unit tangents (n, d) of a curve at ``feet``; a source without its own gives them any sign."""
    return tangents_and_corners(curve, feet, step)[0]


def tangents_and_corners(curve: LocalSource, feet: ClosestPoints, step: float) -> tuple[Floats, Bools]:
    """Return the same, and where (n,) a source without tangents of its own has a corner, and thus no direction."""
    corner = np.zeros(len(feet), dtype=bool)

    def of_member(member: LocalSource, member_feet: ClosestPoints, rows: Ints) -> Floats:
        if member.has_tangents:
            return member.tangents(member_feet)
        values, axes = np.linalg.eigh(jacobian(member, member_feet.points, step))
        corner[rows] = values[:, -1] - values[:, -2] < CORNER_EIGENVALUE_GAP
        return np.asarray(axes[:, :, -1])

    return _by_member(curve, feet, of_member), corner


def project_tangent(surface: LocalSource, feet: ClosestPoints, vectors: Floats, step: float) -> Floats:
    """Return ``vectors`` (n, d) projected on the tangent space at ``feet``."""
    return _by_member(
        surface, feet, lambda member, member_feet, rows: _projected(member, member_feet, vectors[rows], step)
    )


def _projected(surface: LocalSource, feet: ClosestPoints, vectors: Floats, step: float) -> Floats:
    if surface.manifold_dim == surface.dim:
        return vectors
    if surface.manifold_dim == 2:
        n = unit_normals(surface, feet, step)
        return np.asarray(vectors - np.sum(vectors * n, axis=1, keepdims=True) * n)
    if surface.manifold_dim == 1:
        t = unit_tangents(surface, feet, step)
        return np.asarray(np.sum(vectors * t, axis=1, keepdims=True) * t)
    values, axes = np.linalg.eigh(jacobian(surface, feet.points, step))
    kept = np.einsum("nij,ni->nj", axes, vectors) * (values > TANGENT_EIGENVALUE)
    return np.asarray(np.einsum("nij,nj->ni", axes, kept))


def outward_conormals(surface: LocalSource, edge: ClosestPoints, step: float) -> Floats:
    """Return the outward conormals (n, d) at feet ``edge`` on an open manifold's edge."""
    return _by_member(surface, edge, lambda member, member_feet, _: _outward(member, member_feet, step))


def _outward(surface: LocalSource, edge: ClosestPoints, step: float) -> Floats:
    """Return the outward conormals of one member.

    ``b = -unit of T sum_k [cp(y + h e_k) + cp(y - h e_k) - 2 y]``, T the tangent projection: inside a
    manifold the closest points around y average to y, at an edge they lean inwards, and curvature adds a
    normal part that T removes. Second order in the step h.
    """
    y = edge.points
    lean = -_unit((_feet_around(surface, y, step) - y[:, None]).sum(axis=1))
    if surface.has_normals or surface.has_tangents:
        return _unit(project_tangent(surface, edge, lean, step))
    # Differences across the edge would bend T by O(h): it is extrapolated from two points inside.
    inside = (surface.closest_point(y - distance * step * lean) for distance in (2, 4))
    near, far = (_unit(project_tangent(surface, feet, lean, step)) for feet in inside)
    return _unit(2 * near - far)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _by_member(
    surface: LocalSource, feet: ClosestPoints, ask: Callable[[LocalSource, ClosestPoints, Ints], Floats]
) -> Floats:
    """Ask the members of a union for vectors (n, d), each at its own feet: others near by do not disturb it."""
    answers = np.empty_like(feet.points)
    for member, rows, member_feet in surface.by_member(feet):
        answers[rows] = ask(member, member_feet, rows)
    return answers
