"""The parallel projection of a picture, fitted to the model, and the vertical axis of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.errors import InputError
from cpmkit.scenefile.look import Look
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection."""

    centre: Floats  #: (3,): the point in the middle of the picture.
    axes: Floats  #: (3, 3): orthonormal rows: to the right, up, and towards the viewer.
    half: Floats  #: (2,): half the width and half the height that the picture shows, in the scene's unit of length.
    pixels: Ints  #: (2,) int: width and height of the picture.
    description: str = ""  #: The direction of the view and the vertical axis, in words.

    def project(self, points: Floats) -> Floats:
        """Return coordinates (n, 3) of points (n, 3): to the right of the centre, above it, and in front of it."""
        return np.asarray((points - self.centre) @ self.axes.T)


def make_camera(points: Floats, more: Floats, width: int, look: Look) -> Camera:
    """Return the camera that shows the model ``points`` (n, d) and ``more`` (k, 3) as large as ``width`` pixels allow.

    In the plane the model is seen from above, else from ``look.view``, with ``look.up`` vertical as far as the view
    allows; by default y is up if the model stands on its lowest y, else z. The height of the picture follows from the
    model. Raises InputError if ``view`` and ``up`` of the look are parallel, or either is zero.
    """
    if points.shape[1] == 2:
        points = np.pad(points, ((0, 0), (0, 1)))
        axes, description = axes_of((0.0, 0.0, 1.0), "y"), "the plane from above"
    else:
        up, guessed = look.up, ""
        if up is None:  # y if the model stands on its lowest y and less stably on its lowest z, else z
            y, z = (stability(points, axis) for axis in (1, 2))
            up = "y" if y > 0.08 and y > 2 * z else "z"
            if look.view is not None and abs(_unit(look.view, "view")["xyz".index(up)]) > 0.999:  # from above or below
                up = "z" if up == "y" else "y"
            guessed = ", on which the model stands" if up == "y" else ""
        axes = axes_of(look.view, up)
        description = f"seen from {_as_text(axes[2])}, {up if isinstance(up, str) else _as_text(up)} up{guessed}"
    projected = np.concatenate([points, more]) @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    extent = (high - low) / 2
    margin = 0.04 * (extent.max() or 1.0)
    half_width = max(extent[0] + margin, (extent[1] + margin) / 1.4)  # the height is 0.4 to 1.4 times the width
    half_height = max(extent[1] + margin, 0.4 * half_width)
    pixels = np.array([width, round(width * half_height / half_width)])
    return Camera((low + high) / 2 @ axes, axes, np.array([half_width, half_height]), pixels, description)


def stability(points: Floats, axis: int) -> float:
    """Return how stably a model ``points`` (n, 3) stands with ``axis`` up: zero or negative if it would fall over.

    It is the distance of the horizontal mean of the points from the rim of the base, over the diagonal of their
    horizontal bounds. The base is the convex hull of the points in the lowest 3 percent of the height; if it has no
    area, the result is zero. ``axis`` is 0, 1 or 2.
    """
    from scipy.spatial import ConvexHull, QhullError

    height = points[:, axis]
    flat = np.delete(points, axis, axis=1)
    ground = flat[height <= height.min() + 0.03 * np.ptp(height)]
    breadth = float(np.linalg.norm(np.ptp(flat, axis=0)))
    if len(ground) < 3 or breadth == 0:
        return 0.0
    try:
        sides = ConvexHull(ground).equations
    except QhullError:  # the ground is a point or a line
        return 0.0
    return float(-(sides[:, :2] @ flat.mean(axis=0) + sides[:, 2]).max() / breadth)


def axes_of(view: Any, up: Any) -> Floats:
    """Return the axes (3, 3) of a camera: rows to the right, up, and towards the viewer.

    ``view`` (3,) points from the model to the camera; None: from the front, right and above, where the front of a model
    with y up is along z. ``up`` is "x", "y", "z" or (3,); None is z. Raises InputError if a vector is zero, or the two
    are parallel.
    """
    upward = _unit(np.eye(3)["xyz".index(up)] if isinstance(up, str) else up or (0.0, 0.0, 1.0), "up")
    axis = int(np.abs(upward).argmax()) if np.abs(upward).max() > 0.999 else 2
    default = ((0.6, 0.55, -1.0), (0.55, 0.6, 1.0), (0.55, -1.0, 0.6))[axis]
    toward = _unit(default if view is None else view, "view")
    right = np.cross(upward, toward)
    if np.linalg.norm(right) < 1e-6:
        raise InputError(f"view and up must not be parallel, got {toward.tolist()} and {upward.tolist()}.")
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _as_text(vector: Sequence[float] | Floats) -> str:
    """Return a vector in words, with two digits."""
    return "(" + ", ".join(f"{entry:.2g}" for entry in vector) + ")"


def _unit(direction: Any, label: str) -> Floats:
    """Return the unit vector (3,) of a direction; raise InputError, which names it as ``label``, if it is zero."""
    vector = np.array(direction, dtype=np.float64)
    if not vector.any():
        raise InputError(f"{label} must be a direction, got three zeros.")
    scaled = vector / np.abs(vector).max()
    return np.asarray(scaled / np.linalg.norm(scaled))
