"""The parallel projection of a picture, fitted to what it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import InputError
from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.arrays import as_vector
from cpmkit.view.standing import upward_axis

#: Three numbers, or what is usual.
Direction = tuple[float, ...] | None
#: Three numbers, the letter of an axis, or what the model stands on.
Upward = str | Direction

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
#: Where the camera stands unless asked, by what is up: a three-quarter view from the front, the right and above. Models
#: that are drawn with y up look along z.
VIEW_DIRECTIONS = {"x": (0.6, 0.55, -1.0), "y": (0.55, 0.6, 1.0), "z": (0.55, -1.0, 0.6)}

#: Directions of a greater cosine are the same, or opposite.
PARALLEL_COSINE = 0.999

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
    told : str
        From where it looks and what is up, and whether that was guessed.
    """

    centre: Floats
    axes: Floats
    half: Floats
    pixels: Ints
    told: str = ""

    def project(self, points: Floats) -> Floats:
        """Return (n, 3): to the right of the centre, above it, and in front of it."""
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
        What points upwards in the picture, as far as ``view`` allows. Unless given y or z, on which the model stands.
    planar : bool
        Whether the model lies in the plane, which is seen from above.
    more : (k, 3) float64, optional
        What else must be seen.

    Raises
    ------
    InputError
        If ``view`` or ``up`` is not three numbers, or the two are parallel.
    """
    axes, told = (axes_of(AXES["z"], AXES["y"]), "the plane from above") if planar else aimed(points, view, up)
    projected = (points if more is None else np.concatenate([points, more])) @ axes.T
    low, high = projected.min(axis=0), projected.max(axis=0)
    extent = (high - low) / 2
    size = extent.max() if extent.max() > 0 else 1.0
    margin = MARGIN_SHARE * size
    half_width = max(extent[0] + margin, (extent[1] + margin) / ASPECT_BOUNDS[1])
    half_height = max(extent[1] + margin, ASPECT_BOUNDS[0] * half_width)
    height = round(width * half_height / half_width)
    pixels = np.array([width, height])
    return Camera((low + high) / 2 @ axes, axes, np.array([half_width, half_height]), pixels, told)


def aimed(points: Floats, view: Direction, up: Upward) -> tuple[Floats, str]:
    """Return the axes of the camera that looks at points (n, 3), and a sentence's part on what was chosen."""
    chosen: Upward = up
    if up is None:
        axis = upward_axis(points)
        if view is not None and abs(_unit(np.array(view), "view")[axis]) > PARALLEL_COSINE:
            axis = 3 - axis  # seen from above or below
        chosen = "xyz"[axis]
    axes = axes_of(view, chosen)
    upwards = chosen if isinstance(chosen, str) else _written(chosen or ())
    guessed = ", on which the model stands" if up is None and chosen == "y" else ""
    return axes, f"seen from {_written(axes[2].tolist())}, {upwards} up{guessed}"


def axes_of(view: Direction, up: Upward) -> Floats:
    """Return the axes (3, 3) of a camera: rows to the right, up, and towards the viewer.

    Raises
    ------
    InputError
        As :func:`fit` does.
    """
    given = AXES.get(up, up) if isinstance(up, str) else AXES["z"] if up is None else up
    upward = _unit(as_vector(given, 3, "up"), "up")
    along = [letter for letter, axis in AXES.items() if abs(upward @ axis) > PARALLEL_COSINE]
    toward = _unit(as_vector(VIEW_DIRECTIONS[along[0] if along else "z"] if view is None else view, 3, "view"), "view")
    right = np.cross(upward, toward)
    if np.linalg.norm(right) < 1e-6:
        raise InputError(f"view and up must not be parallel, got {toward.tolist()} and {upward.tolist()}.")
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def _written(vector: Sequence[float]) -> str:
    return "(" + ", ".join(f"{entry:.2g}" for entry in vector) + ")"


def _unit(vector: Floats, what: str) -> Floats:
    largest = np.abs(vector).max()
    if largest == 0:
        raise InputError(f"{what} must be a direction, got three zeros.")
    scaled = vector / largest
    return np.asarray(scaled / np.linalg.norm(scaled), dtype=np.float64)
