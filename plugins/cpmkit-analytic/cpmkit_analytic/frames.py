"""Directions, rotations and right-handed frames, read from what a user gives."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.arrays import as_vector
from cpmkit.errors import InputError
from cpmkit.protocols import Floats


def as_position(x: Any, what: str) -> Floats:
    """Return ``x`` as (2,) or (3,) float64.

    Raises
    ------
    InputError
        If it is not 2 or 3 finite numbers.
    """
    if np.shape(x) not in ((2,), (3,)):
        raise InputError(f"{what} must be 2 or 3 numbers, got {x!r}.")
    return as_vector(x, len(x), what)


def as_direction(x: Any, dim: int, what: str) -> Floats:
    """Return ``x`` as a (dim,) unit vector.

    Raises
    ------
    InputError
        If it is not ``dim`` finite numbers, or all are zero.
    """
    vector = as_vector(x, dim, what)
    largest = np.abs(vector).max()
    if largest == 0:
        raise InputError(f"{what} must have a direction, got the zero vector.")
    vector = vector / largest
    direction: Floats = vector / np.linalg.norm(vector)
    return direction


def plane_frame(x_axis: Any = None) -> Floats:
    """Return the (2, 2) frame whose first axis is along ``x_axis``."""
    x, y = as_direction((1.0, 0.0) if x_axis is None else x_axis, 2, "x_axis")
    return np.array([[x, -y], [y, x]])


def space_frame(z_axis: Any, x_axis: Any = None, what: str = "axis") -> Floats:
    """Return the (3, 3) right-handed frame with its third axis along ``z_axis``.

    Parameters
    ----------
    z_axis : (3,) numbers
        Any length but zero.
    x_axis : (3,) numbers, optional
        The first axis is its part across ``z_axis``. Without it, that of the coordinate axis
        farthest from ``z_axis``: the frame of (0, 0, 1) is the identity.
    what : str
        The name of ``z_axis`` in errors.

    Raises
    ------
    InputError
        If an axis is zero, or the two are parallel.
    """
    z = as_direction(z_axis, 3, what)
    towards = np.eye(3)[np.argmin(np.abs(z))] if x_axis is None else as_direction(x_axis, 3, "x_axis")
    across = towards - (towards @ z) * z
    if np.linalg.norm(across) < 1e-9:
        raise InputError(f"x_axis must not be parallel to the {what}, got {x_axis!r}.")
    x = across / np.linalg.norm(across)
    x = x - (x @ z) * z  # a second time: the first leaves round-off of its length before scaling
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


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
    accepted = "an angle or a 2 x 2 matrix" if dim == 2 else "a vector of 3 numbers or a 3 x 3 matrix"
    short: tuple[int, ...] = () if dim == 2 else (3,)
    try:
        given = np.zeros(short) if rotation is None else np.array(rotation, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"rotation must be {accepted}, got {rotation!r}.") from error
    if given.shape not in (short, (dim, dim)) or not np.isfinite(given).all():
        raise InputError(f"rotation must be {accepted} of finite numbers, got {rotation!r}.")
    if given.shape == (dim, dim):
        return _checked(given)
    return _plane_rotation(float(given)) if dim == 2 else _rodrigues(given)


def _checked(matrix: Floats) -> Floats:
    excess = np.abs(matrix @ matrix.T - np.eye(len(matrix))).max()
    if excess > 1e-12 or np.linalg.det(matrix) < 0:
        raise InputError(
            f"rotation must be orthogonal with determinant +1, got one that is off by {excess:.1e} with determinant "
            f"{np.linalg.det(matrix):.6g}; give a rotation vector or an angle if its digits are rounded."
        )
    return matrix


def _plane_rotation(angle: float) -> Floats:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _rodrigues(vector: Floats) -> Floats:
    """Return exp of the cross product matrix of ``vector`` (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Floats = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
    return rotation
