"""The nine kinds: keyword arguments are the keys of a scene file.

``rotation``, ``translation`` and ``scale``, which all take, act after the others and about the origin.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, as_vector, shown
from cpmkit.plugin import length as as_length
from cpmkit_analytic.curves import FULL_TURN, Arc, Circle, Point, Segment
from cpmkit_analytic.frames import as_direction, as_point, as_position, plane_frame, space_frame
from cpmkit_analytic.placed import Placed, place_shape
from cpmkit_analytic.solids import Box
from cpmkit_analytic.surfaces import Cap, Cylinder, Sphere, Torus

DEFAULT_CENTRE = (0.0, 0.0, 0.0)
DEFAULT_NORMAL = (0.0, 0.0, 1.0)
#: Ends of an arc that are nearer, as a share of a turn, are one point.
CLOSED_ARC_TURNS = 1e-12


def point(*, at: Any, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Placed:
    """Return the point ``at``.

    It then moves from x to ``translation + scale * rotation @ x``; ``rotation`` is an angle (plane) or a rotation
    vector (space) in radians, or a matrix (d, d), ``translation`` d numbers, ``scale`` above zero. Raise InputError if
    a value is not as stated.

    Parameters
    ----------
    at : 2 or 3 numbers
        Its coordinates.
    """
    center = as_position(at, "at")
    return place_shape(Point(len(center)), center, np.eye(len(center))).move(rotation, translation, scale)


def segment(*, start: Any, end: Any, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Placed:
    """Return the segment from ``start`` (end 0) to ``end`` (end 1), each 2 or 3 numbers.

    Its points x then move to ``translation + scale * rotation @ x``; ``rotation`` is an angle (plane) or a rotation
    vector (space) in radians, or a matrix (d, d), ``translation`` d numbers, ``scale`` above zero. Raise InputError if
    a value is not as stated, or both ends are one point.

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
    return place_shape(shape, origin, axes).move(rotation, translation, scale)


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

    It runs counterclockwise, in space about ``normal``. Its points x then move to
    ``translation + scale * rotation @ x``; ``rotation`` is an angle (plane) or a rotation vector (space) in radians, or
    a matrix (d, d), ``translation`` d numbers, ``scale`` above zero. Raise InputError if a value is not as stated, or
    ``normal`` is given with a ``center`` of 2 numbers.

    Parameters
    ----------
    center : 2 or 3 numbers, optional
        The origin unless given.
    radius : number
        Above zero.
    normal : (3,) numbers, optional
        Of the plane of a circle in space, of any length; (0, 0, 1) unless given.
    """
    middle, axes = _centre_and_axes(center, normal, None)
    shape = Circle(len(middle), as_length(radius, "radius"))
    return place_shape(shape, middle, axes).move(rotation, translation, scale)


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
    """Return the arc of a circle from the angle ``start`` (end 0) counterclockwise to the angle ``end`` (end 1).

    Its points x then move to ``translation + scale * rotation @ x``; ``rotation`` is an angle (plane) or a rotation
    vector (space) in radians, or a matrix (d, d), ``translation`` d numbers, ``scale`` above zero. It lies in space if
    ``normal`` or a ``center`` of 3 numbers is given. Raise InputError if a value is not as stated, the angles are equal
    or differ by a full turn or more, ``x_axis`` is parallel to ``normal``, or a ``center`` of 2 numbers has a
    ``normal``.

    Parameters
    ----------
    start : number
        The angle of its end 0, in radians.
    end : number
        The angle of its end 1, in radians.
    center : 2 or 3 numbers, optional
        Of the circle, the origin unless given.
    radius : number
        Above zero.
    normal : (3,) numbers, optional
        Of the plane of an arc in space, of any length; (0, 0, 1) unless given.
    x_axis : (d,) numbers, optional
        The direction of the angle zero, of any length, projected on the arc's plane. Unless given, it is (1, 0), and in
        space the coordinate axis at the largest angle to the normal, the first of equals.
    """
    middle, axes = _centre_and_axes(center, normal, x_axis)
    first, last = as_vector([start, end], 2, "[start, end]")
    sweep = float((last - first) % FULL_TURN)
    if not (abs(last - first) < FULL_TURN and CLOSED_ARC_TURNS < sweep / FULL_TURN < 1 - CLOSED_ARC_TURNS):
        raise InputError(
            f"end must differ from start by less than a full turn and not be equal to it, got {shown(start)} and "
            f"{shown(end)}; analytic.circle is the full turn."
        )
    shape = Arc(len(middle), as_length(radius, "radius"), start=float(first), sweep=sweep)
    return place_shape(shape, middle, axes).move(rotation, translation, scale)


def sphere(
    *, center: Any = DEFAULT_CENTRE, radius: Any = 1.0, rotation: Any = None, translation: Any = None, scale: Any = 1.0
) -> Placed:
    """Return a sphere; around a ``center`` of 2 numbers, the circle.

    Its points x then move to ``translation + scale * rotation @ x``; ``rotation`` is an angle (plane) or a rotation
    vector (space) in radians, or a matrix (d, d), ``translation`` d numbers, ``scale`` above zero. Raise InputError if
    a value is not as stated.

    Parameters
    ----------
    center : 2 or 3 numbers
        The origin of space unless given.
    radius : number
        Above zero.
    """
    middle, length = as_position(center, "center"), as_length(radius, "radius")
    shape = Circle(2, length) if len(middle) == 2 else Sphere(length)
    return place_shape(shape, middle, np.eye(len(middle))).move(rotation, translation, scale)


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

    The rim is edge loop 0. Points x then move to ``translation + scale * rotation @ x``; ``rotation`` is a rotation
    vector (3,) in radians or a matrix (3, 3), ``translation`` 3 numbers, ``scale`` above zero. Raise InputError if a
    value is not as stated.

    Parameters
    ----------
    center : (3,) numbers
        Of the sphere, the origin unless given.
    radius : number
        Above zero.
    axis : (3,) numbers
        A direction, of any length; (0, 0, 1) unless given.
    height : number
        A length between -radius and radius, from the centre along the axis; 0 for the half sphere.
    """
    length, offset = as_length(radius, "radius"), float(as_vector([height], 1, "height")[0])
    if not abs(offset) < length:
        raise InputError(
            f"height must lie between -radius and radius, got {shown(height)} with the radius {shown(radius)}."
        )
    shape = Cap(length, height=offset)
    return place_shape(shape, as_point(center, 3, "center"), space_frame(axis)).move(rotation, translation, scale)


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

    They then move from x to ``translation + scale * rotation @ x``; ``rotation`` is a rotation vector (3,) in radians
    or a matrix (3, 3), ``translation`` 3 numbers, ``scale`` above zero. Raise InputError if a value is not as stated.

    Parameters
    ----------
    center : (3,) numbers
        Of the circle, the origin unless given.
    axis : (3,) numbers
        A direction, of any length; (0, 0, 1) unless given.
    major : number
        Radius of the circle in the middle of the tube.
    minor : number
        Radius of the tube, above zero and smaller than ``major``.
    """
    shape = Torus(as_length(major, "major"), as_length(minor, "minor"))
    if not shape.minor < shape.major:
        raise InputError(f"minor must be smaller than major, got {shown(minor)} and {shown(major)}.")
    return place_shape(shape, as_point(center, 3, "center"), space_frame(axis)).move(rotation, translation, scale)


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
    """Return the lateral surface of a cylinder, open at both ends.

    Edge loop 0 is the rim at the end that ``axis`` points away from, 1 the rim that it points to. Points x then move to
    ``translation + scale * rotation @ x``; ``rotation`` is a rotation vector (3,) in radians or a matrix (3, 3),
    ``translation`` 3 numbers, ``scale`` above zero. Raise InputError if a value is not as stated.

    Parameters
    ----------
    center : (3,) numbers
        The point of the axis halfway between the rims, the origin unless given.
    axis : (3,) numbers
        A direction, of any length; (0, 0, 1) unless given.
    radius : number
        Above zero.
    length : number
        Along the axis from rim to rim, above zero.
    """
    shape = Cylinder(as_length(radius, "radius"), as_length(length, "length"))
    return place_shape(shape, as_point(center, 3, "center"), space_frame(axis)).move(rotation, translation, scale)


def box(*, lower: Any, upper: Any, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Placed:
    """Return a full rectangle in the plane or cuboid in space, between the corners ``lower`` and ``upper``.

    Its sides are the edges: 0 and 1 where x is least and greatest, 2 and 3 where y is, 4 and 5 where z is, before
    motion. Beyond several sides, a query has the edge that it is farthest out of. Points x then move to
    ``translation + scale * rotation @ x``; ``rotation`` is an angle (plane) or a rotation vector (space) in radians, or
    a matrix (d, d), ``translation`` d numbers, ``scale`` above zero. Raise InputError if a value is not as stated.

    Parameters
    ----------
    lower : 2 or 3 numbers
        The corner with the least coordinates.
    upper : 2 or 3 numbers
        The corner with the greatest coordinates, each above that of ``lower``.
    """
    low = as_position(lower, "lower")
    high = as_point(upper, len(low), "upper")
    if not (high > low).all():
        raise InputError(f"upper must be above lower in every coordinate, got {shown(lower)} and {shown(upper)}.")
    return place_shape(Box(0.5 * (high - low)), 0.5 * (low + high), np.eye(len(low))).move(rotation, translation, scale)


def _centre_and_axes(center: Any, normal: Any, x_axis: Any) -> tuple[Floats, Floats]:
    """Return the centre (d,) of a plane curve and its frame (d, d), axes in columns, from values of :func:`arc`.

    The last axis of a frame in space is the normal. Raise InputError if ``normal`` is given with a centre of 2 numbers.
    """
    if center is None:
        center = (0.0, 0.0) if normal is None else DEFAULT_CENTRE
    middle = as_position(center, "center")
    if len(middle) == 3:
        return middle, space_frame(DEFAULT_NORMAL if normal is None else normal, x_axis, "normal")
    if normal is not None:
        raise InputError(f"normal belongs to a center of 3 numbers, got the center {shown(center)}.")
    return middle, plane_frame(x_axis)
