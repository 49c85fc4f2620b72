"""Polygons of a file, cut into triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints

#: A fan whose least triangle has this share of the mean one's area is taken from the first corner, as it is written.
FIRST_FAN_AREA_SHARE = 1e-3
#: Rounding of areas, as a share of the mean triangle's.
AREA_ROUNDING_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Polygons:
    """Faces of any number of corners.

    Attributes
    ----------
    counts : (m,) int64
        How many corners each face has, three or more.
    corners : (sum of counts,) int64
        Vertices, those of one face after those of another.
    """

    counts: Ints
    corners: Ints


def as_triangles(vertices: Floats, polygons: Polygons) -> Ints:
    """Return (k, 3) the triangles of ``polygons``, in their order: of each a fan around one of its corners.

    The first corner whose triangles all turn one way is taken: a fan around another would fold over where the polygon
    is not convex.

    Raises
    ------
    InputError
        If a polygon has no such corner.
    """
    counts = polygons.counts
    starts = np.cumsum(counts) - counts
    place = np.cumsum(counts - 2) - (counts - 2)  # of each polygon's first triangle
    faces = np.empty((int((counts - 2).sum()), 3), dtype=np.int64)
    for count in np.unique(counts):
        which = np.flatnonzero(counts == count)
        corners = polygons.corners[starts[which, None] + np.arange(count)]
        fans = corners[:, None] if count == 3 else _best_fans(vertices, corners, which)
        faces[place[which, None] + np.arange(count - 2)] = fans
    return faces


def _best_fans(vertices: Floats, corners: Ints, which: Ints) -> Ints:
    """Return (m, c - 2, 3) the triangles of polygons ``corners`` (m, c), whose numbers are ``which``."""
    count = corners.shape[1]
    best, least = _fan(corners, 0), _least_share(vertices, _fan(corners, 0))
    for start in range(1, count):
        rows = np.flatnonzero(least < FIRST_FAN_AREA_SHARE)  # NaN, of vertices that are none, is left to later checks
        if not len(rows):
            break
        fan = _fan(corners[rows], start)
        share = _least_share(vertices, fan)
        better = share > least[rows] + AREA_ROUNDING_SHARE
        best[rows[better]], least[rows[better]] = fan[better], share[better]
    folded = np.flatnonzero(least < -AREA_ROUNDING_SHARE)
    if len(folded):
        raise InputError(
            f"face {which[folded[0]] + 1} is a polygon of {count} corners that no fan of triangles around a corner "
            f"fills, one of {len(folded)}; cut such polygons into triangles."
        )
    return best


def _fan(corners: Ints, start: int) -> Ints:
    turned = np.roll(corners, -start, axis=1)
    middle = np.arange(1, corners.shape[1] - 1)
    return np.stack(np.broadcast_arrays(turned[:, :1], turned[:, middle], turned[:, middle + 1]), axis=2)


def _least_share(vertices: Floats, fan: Ints) -> Floats:
    """Return (m,) the least area of a fan's triangles over their mean, negative where one folds back."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        a, b, c = (vertices[fan[:, :, k]] for k in range(3))
        size = np.abs(np.stack([b - a, c - a])).max(axis=(0, 2, 3))[:, None, None]
        areas = np.cross((b - a) / size, (c - a) / size)
        total = areas.sum(axis=1)
        signed = np.einsum("mtk,mk->mt", areas, total)
        mean = np.einsum("mk,mk->m", total, total) / fan.shape[1]
        return np.where(mean > 0.0, signed.min(axis=1) / mean, 0.0)
