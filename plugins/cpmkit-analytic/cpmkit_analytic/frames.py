"""Directions and right-handed frames from user input."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, as_positions, as_vector, shown


def as_position(x: Any, label: str) -> Floats:
    """Return ``x``, a list, tuple or array of 2 or 3 numbers, as a (2,) or (3,) float64 point.

    Raise InputError, whose message begins with ``label``, if it is not, or a coordinate is not finite or above 1e50.
    """
    if (
        not isinstance(x, (list, tuple, np.ndarray))
        or np.ndim(x if isinstance(x, np.ndarray) else []) != 1
        or len(x) not in (2, 3)
    ):
        raise InputError(f"{label} must be 2 or 3 numbers, got {shown(x)}.")
    return as_point(x, len(x), label)


def as_point(x: Any, dim: int, label: str) -> Floats:
    """Return ``x`` as a (dim,) float64 point.

    Raise InputError, whose message begins with ``label``, if it is not ``dim`` finite numbers, or a coordinate is
    larger in size than 1e50 (``LARGEST_LENGTH``).
    """
    return as_positions(as_vector(x, dim, label)[None], dim, label)[0]


def as_direction(x: Any, dim: int, label: str) -> Floats:
    """Return ``x``, ``dim`` finite numbers that are not all zero, as a unit vector; raise InputError if it is not."""
    vector = as_vector(x, dim, label)
    largest = np.abs(vector).max()
    if largest == 0:
        raise InputError(f"{label} must have a direction, got the zero vector.")
    vector = vector / largest
    direction: Floats = vector / np.linalg.norm(vector)
    return direction


def plane_frame(x_axis: Any = None) -> Floats:
    """Return the right-handed frame (2, 2), axes in columns, with the first along ``x_axis``, 2 numbers, or (1, 0).

    Raise InputError if ``x_axis`` is zero, not finite or of another length.
    """
    x, y = as_direction((1.0, 0.0) if x_axis is None else x_axis, 2, "x_axis")
    return np.array([[x, -y], [y, x]])


def space_frame(z_axis: Any, x_axis: Any = None, label: str = "axis") -> Floats:
    """Return the right-handed frame (3, 3), axes in columns, with its third axis along ``z_axis``.

    Raise InputError if an axis is zero, or the sine of the angle between the two is below 1e-9.

    Parameters
    ----------
    z_axis : (3,) numbers
        Any length but zero.
    x_axis : (3,) numbers, optional
        The first axis is its part across ``z_axis``. Without it, that of the coordinate axis at the largest angle to
        ``z_axis``: the frame of (0, 0, 1) is the identity.
    label : str
        The name of ``z_axis`` in errors.
    """
    z = as_direction(z_axis, 3, label)
    towards = np.eye(3)[np.argmin(np.abs(z))] if x_axis is None else as_direction(x_axis, 3, "x_axis")
    across = towards - (towards @ z) * z
    if np.linalg.norm(across) < 1e-9:
        raise InputError(f"x_axis must not be parallel to the {label}, got {shown(x_axis)}.")
    x = across / np.linalg.norm(across)
    x = x - (x @ z) * z  # a second time: the first leaves round-off of its length before scaling
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
