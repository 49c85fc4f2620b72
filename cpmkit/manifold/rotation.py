"""Rotations of the plane and of space, read from what a user gives, and applied row by row."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.protocols import Floats

#: Its corner (d, d) is the rotation that turns nothing.
UNTURNED = np.eye(3)


def as_rotation(rotation: Any, dim: int) -> Floats:
    """Return a rotation as a (dim, dim) matrix.

    Parameters
    ----------
    rotation : None, angle, (3,) vector or (dim, dim) matrix
        An angle in radians in the plane; in space a vector along the axis, as long as the angle.
    dim : int
        2 or 3.

    Raises
    ------
    InputError
        If it is none of these, or a matrix that is not orthogonal with determinant +1 to 1e-12.
    """
    if rotation is None:
        return np.eye(dim)
    accepted = "an angle or a 2 x 2 matrix" if dim == 2 else "a vector of 3 numbers or a 3 x 3 matrix"
    short: tuple[int, ...] = () if dim == 2 else (3,)
    try:
        given = np.array(rotation, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"rotation must be {accepted}, got {shown(rotation)}.") from error
    if given.shape not in (short, (dim, dim)) or not np.isfinite(given).all():
        raise InputError(f"rotation must be {accepted} of finite numbers, got {shown(rotation)}.")
    if given.shape == (dim, dim):
        return _checked(given)
    if dim == 2:
        return np.array([[np.cos(given), -np.sin(given)], [np.sin(given), np.cos(given)]])
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(given).as_matrix())


def _checked(matrix: Floats) -> Floats:
    excess = np.abs(matrix @ matrix.T - np.eye(len(matrix))).max()
    if excess > 1e-12 or np.linalg.det(matrix) < 0:
        raise InputError(
            f"rotation must be orthogonal with determinant +1, got one that is off by {excess:.1e} with determinant "
            f"{np.linalg.det(matrix):.6g}; give a rotation vector or an angle if its digits are rounded."
        )
    return matrix


def rotate(rotation: Floats, vectors: Floats) -> Floats:
    """Return ``rotation @ v`` for the rows v of ``vectors``.

    Written out by columns: the result of a row then never depends on the size of the batch, which
    a matrix product does not promise.
    """
    if (rotation == UNTURNED[: len(rotation), : len(rotation)]).all():
        return vectors
    rotated = vectors[:, :1] * rotation[:, 0]
    for k in range(1, len(rotation)):
        rotated += vectors[:, k : k + 1] * rotation[:, k]
    return rotated
