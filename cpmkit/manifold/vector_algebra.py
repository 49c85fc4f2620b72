"""Inner products, lengths and rotations of rows, by components, so that a result does not depend on other rows."""

from __future__ import annotations

from functools import reduce
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.types import Bools, Floats


def dots(a: Floats, b: Floats) -> Floats:
    """Return the inner products (...) of ``a`` and ``b`` (..., d) along the last axis."""
    total = a[..., 0] * b[..., 0]
    for k in range(1, a.shape[-1]):
        total = total + a[..., k] * b[..., k]
    return np.asarray(total)


def norms(a: Floats) -> Floats:
    """Return the Euclidean lengths (...) of ``a`` (..., d) along the last axis."""
    return np.sqrt(dots(a, a))


def every(flags: Bools) -> Bools:
    """Return whether (...) all ``flags`` (..., d) along the last axis are set: for few of them faster than NumPy's."""
    return np.asarray(reduce(np.logical_and, np.moveaxis(flags, -1, 0)))


def unit(a: Floats) -> Floats:
    """Return the vectors ``a`` (..., d) scaled to length one; vectors of length zero, or with NaN, become zero."""
    length = norms(a)[..., None]
    if (length > 0).all():
        return np.asarray(a / length)
    with np.errstate(all="ignore"):
        return np.where(length > 0, a / length, 0.0)


def nearest_shares(offsets: Floats, along: Floats) -> Floats:
    """Return the shares (...), 0 to 1, of the segments ``along`` (..., d) at which they are nearest to points.

    The points are at ``offsets`` (..., d) from the starts of their segments. The share of a segment of length zero is
    0.
    """
    return np.asarray(np.clip(dots(offsets, along) / np.maximum(dots(along, along), np.finfo(float).tiny), 0.0, 1.0))


def nearest_barycentric(points: Floats, corners: Floats) -> Floats:
    """Return the barycentric coordinates (n, 3) of the point of each triangle (n, 3, d) nearest to ``points`` (n, d).

    Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    a, b, c = (corners[:, k] for k in range(3))
    ab, ac = b - a, c - a
    d1, d2 = dots(ab, points - a), dots(ac, points - a)
    d3, d4 = dots(ab, points - b), dots(ac, points - b)
    d5, d6 = dots(ab, points - c), dots(ac, points - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    with np.errstate(all="ignore"):
        on_ab, on_ac = d1 / (d1 - d3), d2 / (d2 - d6)
        on_bc = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        inside = np.stack([va, vb, vc], axis=1) / (va + vb + vc)[:, None]
    zero, unity = np.zeros(len(points)), np.ones(len(points))
    cases = [
        ((d1 <= 0) & (d2 <= 0), (unity, zero, zero)),
        ((d3 >= 0) & (d4 <= d3), (zero, unity, zero)),
        ((d6 >= 0) & (d5 <= d6), (zero, zero, unity)),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), (1 - on_ab, on_ab, zero)),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), (1 - on_ac, zero, on_ac)),
        ((va <= 0) & (d4 >= d3) & (d5 >= d6), (zero, 1 - on_bc, on_bc)),
    ]
    conditions = [condition[:, None] for condition, _ in cases]
    return np.select(conditions, [np.stack(shares, axis=1) for _, shares in cases], inside)


def normal_frames(tangents: Floats) -> Floats:
    """Return orthonormal bases (n, d - 1, d) of the spaces perpendicular to nonzero ``tangents`` (n, d), d = 2 or 3.

    In the plane it is the normal on the right; in space the first normal x the second points along the tangent.
    """
    t = unit(tangents)
    if t.shape[1] == 2:
        return np.stack([t[:, 1], -t[:, 0]], axis=1)[:, None]
    # The axis with the largest angle to the tangent: in the worst case 54 degrees.
    axis = np.eye(3)[np.argmin(np.abs(t), axis=1)]
    first = unit(np.cross(t, axis))
    return np.stack([first, np.cross(t, first)], axis=1)


def in_three_dimensions(points: Floats) -> Floats:
    """Return ``points`` (n, 2 or 3) as (n, 3), with a third coordinate of zero for points of the plane."""
    return points if points.shape[1] == 3 else np.hstack([points, np.zeros((len(points), 1))])


def as_rotation(rotation: Any, dim: int) -> Floats:
    """Return a rotation, in any of the forms that users give, as a (dim, dim) matrix.

    ``rotation`` is an angle in radians in the plane; in space a vector (3,) along the axis, as long as the angle; an
    orthogonal matrix (dim, dim); or None for no rotation. ``dim`` is 2 or 3. Raises InputError if it is none of these,
    or a matrix that is not orthogonal with determinant +1 to 1e-12.
    """
    if rotation is None:
        return np.eye(dim)
    accepted = "an angle or a 2 x 2 matrix" if dim == 2 else "a vector of 3 numbers or a 3 x 3 matrix"
    try:
        array = np.array(rotation, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"rotation must be {accepted}, got {shown(rotation)}.") from error
    if array.shape not in (() if dim == 2 else (3,), (dim, dim)) or not np.isfinite(array).all():
        raise InputError(f"rotation must be {accepted} of finite numbers, got {shown(rotation)}.")
    if array.shape == (dim, dim):
        excess = np.abs(array @ array.T - np.eye(dim)).max()
        if excess > 1e-12 or np.linalg.det(array) < 0:
            raise InputError(
                f"rotation must be orthogonal with determinant +1, got one that is off by {excess:.1e} with "
                f"determinant {np.linalg.det(array):.6g}; give a rotation vector or an angle if its digits are rounded."
            )
        return array
    if dim == 2:
        return np.array([[np.cos(array), -np.sin(array)], [np.sin(array), np.cos(array)]])
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(array).as_matrix())


def rotate(rotation: Floats, vectors: Floats) -> Floats:
    """Return ``rotation @ v`` (n, d), with a matrix ``rotation`` (d, d), for the rows v of ``vectors`` (n, d)."""
    return np.asarray(np.einsum("ij,nj->ni", rotation, vectors))
