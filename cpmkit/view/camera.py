"""The parallel projection of a picture, fitted to the model, and the vertical axis of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import InputError
from cpmkit.runtime.arrays import as_vector
from cpmkit.types import Floats, Ints


def upward_axis(points: Floats) -> int:
    """Return the axis that points up: 1 if points (n, 3) stand on their lowest y and less stably on z, else 2."""
    y, z = (stability(points, axis) for axis in (1, 2))
    return 1 if y > 0.08 and y > 2 * z else 2


def stability(points: Floats, axis: int) -> float:
    """Return the distance of the mean of points (n, 3) to the rim of their base, over their breadth.

    The base are the points in the lowest 3 percent of the height. The result is zero or negative if the points would
    fall over with ``axis`` up.
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


#: Three numbers; None for the default.
Direction = tuple[float, ...] | None
#: Three numbers or the letter of an axis; None for the axis that the model stands on.
Upward = str | Direction

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
#: Default direction to the camera for each axis that is up: a three-quarter view from the front, right and above.
#: Models with y up face along z.
VIEW_DIRECTIONS = {"x": (0.6, 0.55, -1.0), "y": (0.55, 0.6, 1.0), "z": (0.55, -1.0, 0.6)}

#: Directions with a greater cosine are taken for parallel.
PARALLEL_COSINE = 0.999


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection.

    Attributes
    ----------
    centre : (3,) float64
        The point in the middle of the picture.
    axes : (3, 3) float64
        Orthonormal rows: to the right, up, and towards the viewer.
    half : (2,) float64
        Half the width and half the height that the picture shows, in the scene's unit of length.
    pixels : (2,) int
        Width and height of the picture.
    description : str
        The direction of the view and the vertical axis, in words.
    """

    centre: Floats
    axes: Floats
    half: Floats
    pixels: Ints
    description: str = ""

    def project(self, points: Floats) -> Floats:
        """Return coordinates (n, 3) of points (n, 3): to the right of the centre, above it, and in front of it."""
        return np.asarray((points - self.centre) @ self.axes.T)


def fit(
    points: Floats,
    width: int,
    view: Direction = None,
    up: Upward = None,
    planar: bool = False,
    more: Floats | None = None,
) -> Camera:
    """Return the camera that shows all ``points`` (n, 3) as large as ``width`` pixels allow.

    Parameters
    ----------
    points : (n, 3) float64
        The model.
    width : int
        Width of the picture in pixels; its height follows from the model.
    view : three numbers, optional
        The direction from the model to the camera; its length has no meaning.
    up : "x", "y", "z" or three numbers, optional
        The direction that is vertical in the picture, as far as ``view`` allows. By default y or z, the axis on which
        the model stands.
    planar : bool
        Whether the model lies in the plane, which is seen from above.
    more : (k, 3) float64, optional
        Further points that must be visible.

    Raises
    ------
    InputError
        If ``view`` or ``up`` is not three numbers, or the two are parallel.
    """
    plane = axes_of(AXES["z"], AXES["y"]), "the plane from above"
    axes, description = plane if planar else choose_axes(points, view, up)
    projected = (points if more is None else np.concatenate([points, more])) @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    extent = (high - low) / 2
    size = extent.max() if extent.max() > 0 else 1.0
    margin = 0.04 * size
    half_width = max(extent[0] + margin, (extent[1] + margin) / 1.4)  # the height is 0.4 to 1.4 times the width
    half_height = max(extent[1] + margin, 0.4 * half_width)
    height = round(width * half_height / half_width)
    pixels = np.array([width, height])
    return Camera((low + high) / 2 @ axes, axes, np.array([half_width, half_height]), pixels, description)


def choose_axes(points: Floats, view: Direction, up: Upward) -> tuple[Floats, str]:
    """Return the axes (3, 3) of a camera that looks at points (n, 3), and their description in words."""
    chosen: Upward = up
    if up is None:
        axis = upward_axis(points)
        if view is not None and abs(_unit(np.array(view), "view")[axis]) > PARALLEL_COSINE:
            axis = 3 - axis  # seen from above or below
        chosen = "xyz"[axis]
    axes = axes_of(view, chosen)
    upwards = chosen if isinstance(chosen, str) else _as_text(chosen or ())
    guessed = ", on which the model stands" if up is None and chosen == "y" else ""
    return axes, f"seen from {_as_text(axes[2].tolist())}, {upwards} up{guessed}"


def axes_of(view: Direction, up: Upward) -> Floats:
    """Return the axes (3, 3) of a camera: rows to the right, up, and towards the viewer.

    Raises
    ------
    InputError
        If ``view`` or ``up`` is not three numbers, or the two are parallel.
    """
    vector = AXES.get(up, up) if isinstance(up, str) else AXES["z"] if up is None else up
    upward = _unit(as_vector(vector, 3, "up"), "up")
    along = [letter for letter, axis in AXES.items() if abs(upward @ axis) > PARALLEL_COSINE]
    toward = _unit(as_vector(VIEW_DIRECTIONS[along[0] if along else "z"] if view is None else view, 3, "view"), "view")
    right = np.cross(upward, toward)
    if np.linalg.norm(right) < 1e-6:
        raise InputError(f"view and up must not be parallel, got {toward.tolist()} and {upward.tolist()}.")
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _as_text(vector: Sequence[float]) -> str:
    """Return a vector in words, with two digits."""
    return "(" + ", ".join(f"{entry:.2g}" for entry in vector) + ")"


def _unit(vector: Floats, label: str) -> Floats:
    """Return the unit vector (3,) of a vector; raise InputError, which names it as ``label``, if it is zero."""
    if not vector.any():
        raise InputError(f"{label} must be a direction, got three zeros.")
    scaled = vector / np.abs(vector).max()
    return np.asarray(scaled / np.linalg.norm(scaled), dtype=np.float64)
