"""Vectors of space as tuples of three numbers: a walk along a curve handles one at a time, where arrays are slow."""

from __future__ import annotations

from math import sqrt

Triple = tuple[float, float, float]


def less(a: Triple, b: Triple) -> Triple:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def along(a: Triple, t: float, b: Triple) -> Triple:
    """Return a + t b."""
    return a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]


def between(a: Triple, b: Triple, t: float) -> Triple:
    """Return the point that is the share ``t`` of the way from a to b."""
    return a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])


def dot(a: Triple, b: Triple) -> float:
    """Return the inner product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Triple, b: Triple) -> Triple:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def length(a: Triple) -> float:
    """Return the length."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def apart(a: Triple, b: Triple) -> float:
    """Return the distance of two points."""
    return length(less(a, b))


def direction(a: Triple) -> Triple:
    """Return ``a`` at length one; zero stays zero."""
    size = length(a)
    return (a[0] / size, a[1] / size, a[2] / size) if size > 0 else a


def share_along(p: Triple, a: Triple, b: Triple) -> float:
    """Return which share of the way from a to b is nearest to p, from 0 to 1."""
    way = less(b, a)
    square = dot(way, way)
    return min(1.0, max(0.0, dot(less(p, a), way) / square)) if square > 0 else 0.0
