"""The nine kinds: keyword arguments are the keys of a scene file.

Every kind takes three more keys: ``rotation`` (an angle in the plane, a rotation vector or a
matrix), ``translation`` and ``scale``. They act after the others and about the origin:
x becomes translation + scale * rotation @ x. Angles are in radians. What is not accepted raises
:class:`~cpmkit.errors.InputError` with the key's name.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, as_vector, shown
from cpmkit.plugin import length as as_length
from cpmkit_analytic.curves import FULL_TURN, Arc, Circle, Point, Segment
from cpmkit_analytic.frames import as_direction, as_point, as_position, plane_frame, space_frame
from cpmkit_analytic.placed import Placed, place
from cpmkit_analytic.solids import Box
from cpmkit_analytic.surfaces import Cap, Cylinder, Sphere, Torus

DEFAULT_CENTRE = (0.0, 0.0, 0.0)
DEFAULT_NORMAL = (0.0, 0.0, 1.0)
#: Ends of an arc that are nearer, as a share of a turn, are one point.
CLOSED_ARC_TURNS = 1e-12


def point(*, at: Any, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Placed:
    """Return the point ``at``, 2 or 3 numbers.

    Parameters
    ----------
    at : 2 or 3 numbers
        Where it is.
    """
    center = as_position(at, "at")
    return place(Point(len(center)), center, np.eye(len(center))).move(rotation, translation, scale)


def segment(*, start: Any, end: Any, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Placed:
    """Return the segment from ``start`` (end 0) to ``end`` (end 1), each 2 or 3 numbers.

    Parameters
    ----------
    start : 2 or 3 numbers
        Its end 0.
    end : 2 or 3 numbers
        Its end 1.
    """
    origin = as_position(start, "start")
    across = as_point(end, len(origin), "end") - origin
    if not across.any():
        raise InputError(f"start and end must differ, got {shown(start)} twice.")
    along = as_direction(across, len(origin), "end - start")
    # x, y, z and y, z, x turn the same way, so this frame is right-handed with its first axis along
    axes = plane_frame(along) if len(origin) == 2 else space_frame(along)[:, [2, 0, 1]]
    shape = Segment(len(origin), float(across @ along))
    return place(shape, origin, axes).move(rotation, translation, scale)


def circle(
    *,
    center: Any = None,
    radius: Any = 1.0,
    normal: Any = None,
    rotation: Any = None,
    translation: Any = None,
    scale: Any = 1.0,
) -> Placed:
    """Return a circle: in the plane, or in space if ``normal`` or a ``center`` of 3 numbers is given.

    It runs counterclockwise about ``normal``, which is (0, 0, 1) unless given.

    Parameters
    ----------
    center : 2 or 3 numbers, optional
        Its middle, the origin unless given.
    radius : number
        Above zero.
    normal : (3,) numbers, optional
        In space, what it runs counterclockwise about.
    """
    middle, axes = _plane_of(center, normal, None)
    shape = Circle(len(middle), as_length(radius, "radius"))
    return place(shape, middle, axes).move(rotation, translation, scale)


def arc(
    *,
    start: Any,
    end: Any,
    center: Any = None,
    radius: Any = 1.0,
    normal: Any = None,
    x_axis: Any = None,
    rotation: Any = None,
    translation: Any = None,
    scale: Any = 1.0,
) -> Placed:
    """Return the arc from the angle ``start`` (end 0) counterclockwise to the angle ``end`` (end 1).

    Angles are counted about ``normal`` from the part of ``x_axis`` across it; unless given, that is the
    coordinate axis farthest from the normal, the first of equals. Plane or space as for :func:`circle`.

    Parameters
    ----------
    start : number
        The angle of its end 0, in radians.
    end : number
        The angle of its end 1, in radians.
    center : 2 or 3 numbers, optional
        Its middle, the origin unless given.
    radius : number
        Above zero.
    normal : (3,) numbers, optional
        In space, what angles are counted about.
    x_axis : (d,) numbers, optional
        The direction of the angle zero.
    """
    middle, axes = _plane_of(center, normal, x_axis)
    first, last = as_vector([start, end], 2, "[start, end]")
    sweep = float((last - first) % FULL_TURN)
    if not (abs(last - first) < FULL_TURN and CLOSED_ARC_TURNS < sweep / FULL_TURN < 1 - CLOSED_ARC_TURNS):
        raise InputError(
            f"end must differ from start by less than a full turn and not be equal to it, got {shown(start)} and "
            f"{shown(end)}; analytic.circle is the full turn."
        )
    shape = Arc(len(middle), as_length(radius, "radius"), start=float(first), sweep=sweep)
    return place(shape, middle, axes).move(rotation, translation, scale)


def sphere(
    *, center: Any = DEFAULT_CENTRE, radius: Any = 1.0, rotation: Any = None, translation: Any = None, scale: Any = 1.0
) -> Placed:
    """Return a sphere; around a ``center`` of 2 numbers, the circle.

    Parameters
    ----------
    center : (d,) numbers
        Its middle.
    radius : number
        Above zero.
    """
    middle, length = as_position(center, "center"), as_length(radius, "radius")
    shape = Circle(2, length) if len(middle) == 2 else Sphere(length)
    return place(shape, middle, np.eye(len(middle))).move(rotation, translation, scale)


def cap(
    *,
    center: Any = DEFAULT_CENTRE,
    radius: Any = 1.0,
    axis: Any = DEFAULT_NORMAL,
    height: Any = 0.0,
    rotation: Any = None,
    translation: Any = None,
    scale: Any = 1.0,
) -> Placed:
    """Return the points x of a sphere with (x - center) . axis >= height, ``axis`` scaled to length one.

    ``height`` is a length, 0 for the half sphere, and smaller than the radius in size. The rim is edge loop 0.

    Parameters
    ----------
    center : (d,) numbers
        Its middle.
    radius : number
        Above zero.
    axis : (3,) numbers
        A direction, of any length.
    height : number
        Where the sphere is cut along the axis, a length from the centre.
    """
    length, offset = as_length(radius, "radius"), float(as_vector([height], 1, "height")[0])
    if not abs(offset) < length:
        raise InputError(
            f"height must lie between -radius and radius, got {shown(height)} with the radius {shown(radius)}."
        )
    shape = Cap(length, height=offset)
    return place(shape, as_point(center, 3, "center"), space_frame(axis)).move(rotation, translation, scale)


def torus(
    *,
    center: Any = DEFAULT_CENTRE,
    axis: Any = DEFAULT_NORMAL,
    major: Any = 1.0,
    minor: Any = 0.4,
    rotation: Any = None,
    translation: Any = None,
    scale: Any = 1.0,
) -> Placed:
    """Return the points at the distance ``minor`` from a circle of radius ``major`` around ``axis``.

    Parameters
    ----------
    center : (3,) numbers
        Its middle.
    axis : (3,) numbers
        A direction, of any length.
    major : number
        Radius of the circle in the middle of the tube.
    minor : number
        Radius of the tube, smaller than ``major``.
    """
    shape = Torus(as_length(major, "major"), as_length(minor, "minor"))
    if not shape.minor < shape.major:
        raise InputError(f"minor must be smaller than major, got {shown(minor)} and {shown(major)}.")
    return place(shape, as_point(center, 3, "center"), space_frame(axis)).move(rotation, translation, scale)


def cylinder(
    *,
    center: Any = DEFAULT_CENTRE,
    axis: Any = DEFAULT_NORMAL,
    radius: Any = 1.0,
    length: Any = 2.0,
    rotation: Any = None,
    translation: Any = None,
    scale: Any = 1.0,
) -> Placed:
    """Return the open lateral surface of a cylinder, ``center`` in its middle.

    Edge loop 0 is the rim at the end that ``axis`` points away from, 1 the rim that it points to.

    Parameters
    ----------
    center : (3,) numbers
        Its middle.
    axis : (3,) numbers
        A direction, of any length.
    radius : number
        Above zero.
    length : number
        Along the axis.
    """
    shape = Cylinder(as_length(radius, "radius"), as_length(length, "length"))
    return place(shape, as_point(center, 3, "center"), space_frame(axis)).move(rotation, translation, scale)


def box(*, lower: Any, upper: Any, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Placed:
    """Return a full rectangle in the plane or cuboid in space, between the corners ``lower`` and ``upper``.

    Its sides are the edges: 0 and 1 where x is least and greatest, 2 and 3 where y is, 4 and 5 where z is, before
    any rotation. Beyond a corner or a cuboid's edge, a point belongs to the side that it is farthest out of.

    Parameters
    ----------
    lower : 2 or 3 numbers
        The corner with the least coordinates.
    upper : 2 or 3 numbers
        The corner with the greatest coordinates.
    """
    low = as_position(lower, "lower")
    high = as_point(upper, len(low), "upper")
    if not (high > low).all():
        raise InputError(f"upper must be above lower in every coordinate, got {shown(lower)} and {shown(upper)}.")
    return place(Box(0.5 * (high - low)), 0.5 * (low + high), np.eye(len(low))).move(rotation, translation, scale)


def _plane_of(center: Any, normal: Any, x_axis: Any) -> tuple[Floats, Floats]:
    """Return the centre and the frame of a plane curve: (2,) and (2, 2) in the plane, (3,) and (3, 3) in space."""
    if center is None:
        center = (0.0, 0.0) if normal is None else DEFAULT_CENTRE
    middle = as_position(center, "center")
    if len(middle) == 3:
        return middle, space_frame(DEFAULT_NORMAL if normal is None else normal, x_axis, "normal")
    if normal is not None:
        raise InputError(f"normal belongs to a center of 3 numbers, got the center {shown(center)}.")
    return middle, plane_frame(x_axis)
