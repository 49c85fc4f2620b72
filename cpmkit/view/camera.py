"""The parallel projection of a picture, fitted to what it shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import InputError
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.arrays import as_vector

#: Three numbers, or what is usual.
Direction = tuple[float, ...] | None

#: Where the camera stands unless asked: a three-quarter view from the front, the right and above.
VIEW_DIRECTION = (0.55, -1.0, 0.6)
CAMERA_UP = (0.0, 0.0, 1.0)

#: Free space around the model, as a share of the picture's half width.
MARGIN_SHARE = 0.04

#: Least and greatest height of a picture as a share of its width.
ASPECT_BOUNDS = (0.4, 1.4)


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection.

    Attributes
    ----------
    centre : (3,) float64
        The point in the middle of the picture.
    axes : (3, 3) float64
        Rows: to the right, up, and towards the viewer; orthonormal.
    half : (2,) float64
        Half the width and half the height that the picture shows, in the scene's unit of length.
    pixels : (2,) int
        Width and height of the picture.
    """

    centre: Floats
    axes: Floats
    half: Floats
    pixels: Ints

    def project(self, points: Floats) -> Floats:
        """Return (n, 3): to the right of the centre, above it, and in front of it."""
        return np.asarray((points - self.centre) @ self.axes.T)


def fit(points: Floats, width: int, view: Direction = None, up: Direction = None) -> Camera:
    """Return the camera that shows all ``points`` (n, 3) as large as ``width`` pixels allow.

    Parameters
    ----------
    points : (n, 3) float64
        What must be seen.
    width : int
        Width of the picture in pixels; its height follows from the model.
    view : three numbers, optional
        The direction from the model to the camera; its length has no meaning.
    up : three numbers, optional
        What points upwards in the picture, as far as ``view`` allows.

    Raises
    ------
    InputError
        If ``view`` or ``up`` is not three numbers, or the two are parallel.
    """
    axes = axes_of(view, up)
    projected = points @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    extent = (high - low) / 2
    size = extent.max() if extent.max() > 0 else 1.0
    margin = MARGIN_SHARE * size
    half_width = max(extent[0] + margin, (extent[1] + margin) / ASPECT_BOUNDS[1])
    half_height = max(extent[1] + margin, ASPECT_BOUNDS[0] * half_width)
    height = round(width * half_height / half_width)
    return Camera((low + high) / 2 @ axes, axes, np.array([half_width, half_height]), np.array([width, height]))


def axes_of(view: Direction, up: Direction) -> Floats:
    """Return the axes (3, 3) of a camera: rows to the right, up, and towards the viewer.

    Raises
    ------
    InputError
        As :func:`fit` does.
    """
    toward = _unit(as_vector(VIEW_DIRECTION if view is None else view, 3, "view"), "view")
    upward = _unit(as_vector(CAMERA_UP if up is None else up, 3, "up"), "up")
    if up is None and abs(toward @ upward) > 0.999:
        upward = np.array([0.0, 1.0, 0.0])  # seen from above or below
    right = np.cross(upward, toward)
    if np.linalg.norm(right) < 1e-6:
        raise InputError(f"view and up must not be parallel, got {toward.tolist()} and {upward.tolist()}.")
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _unit(vector: Floats, what: str) -> Floats:
    largest = np.abs(vector).max()
    if largest == 0:
        raise InputError(f"{what} must be a direction, got three zeros.")
    scaled = vector / largest
    return np.asarray(scaled / np.linalg.norm(scaled), dtype=np.float64)
