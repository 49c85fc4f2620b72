"""Polygons of a file, cut into triangles."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from cpmkit.plugin import Floats, InputError, Ints, dots, norms, shown, unit

#: A fan from the first corner is taken if its least triangle has at least this share of the mean triangle's area.
FIRST_FAN_AREA_SHARE = 1e-3
#: Rounding of areas, as a share of the mean triangle's, or of the square of the polygon's size.
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


def as_polygons(faces: Any) -> Polygons:
    """Return ``faces``, an array (m, c) of vertex numbers or a sequence of sequences of them, as polygons.

    Raise InputError if they are neither, are not whole numbers, there are none, or a face has fewer than three corners.
    """
    accepted = "faces must be whole numbers, indices of vertices, three or more a face"
    rows = np.asarray(faces) if hasattr(faces, "__array__") else faces
    try:
        if isinstance(rows, np.ndarray) and rows.ndim == 2:
            counts, corners = np.full(len(rows), rows.shape[1], dtype=np.int64), rows.ravel()
        else:
            counts = np.fromiter(map(len, rows), dtype=np.int64)
            corners = np.asarray(list(chain.from_iterable(rows)))
    except (TypeError, ValueError) as error:
        raise InputError(f"{accepted}, got {shown(faces)}.") from error
    if not len(counts) or counts.min() < 3:
        raise InputError(f"{accepted}, got " + (f"a face of {counts.min()} corners." if len(counts) else "no faces."))
    if corners.ndim != 1 or corners.dtype.kind not in "iuf" or not np.array_equal(corners, np.floor(corners)):
        raise InputError(f"{accepted}, got {shown(faces)}.")
    return Polygons(counts, np.ascontiguousarray(corners, dtype=np.int64))


def triangulate(vertices: Floats, polygons: Polygons) -> Ints:
    """Return (k, 3) the triangles of ``polygons`` in their order: of each a fan around a corner, or ears.

    ``vertices`` (n, 3) are positions. The first corner is taken at which the least triangle of the fan has a share
    :data:`FIRST_FAN_AREA_SHARE` of the mean triangle's area; without one, the corner at which this share is largest. If
    each fan folds over, ears are clipped. Raise InputError if that fails, since the polygon crosses itself, seen along
    its mean normal, or has no mean normal though it has area.
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
    """Return (m, c - 2, 3) the triangles of polygons ``corners`` (m, c), whose numbers, for errors, are ``which`` (m,).

    ``vertices`` (n, 3) are positions; the rule is that of :func:`triangulate`. Raise InputError if one crosses itself.
    """
    count = corners.shape[1]
    best, least = _fan(corners, 0), _least_area_share(vertices, _fan(corners, 0))
    for start in range(1, count):
        rows = np.flatnonzero(least < FIRST_FAN_AREA_SHARE)  # NaN, of vertices that are none, is left to later checks
        if not len(rows):
            break
        fan = _fan(corners[rows], start)
        share = _least_area_share(vertices, fan)
        better = share > least[rows] + AREA_ROUNDING_SHARE
        best[rows[better]], least[rows[better]] = fan[better], share[better]
    folded = np.flatnonzero(least < -AREA_ROUNDING_SHARE)
    if len(folded):
        best[folded] = _clip_ears(vertices, corners[folded], which[folded])
    return best


def _clip_ears(vertices: Floats, corners: Ints, which: Ints) -> Ints:
    """Return (m, c - 2, 3) the triangles of polygons ``corners`` (m, c), by clipping ears along their mean normals.

    ``vertices`` (n, 3) are positions, ``which`` (m,) the polygons' numbers. Raise InputError if one crosses itself.
    """
    from cpmkit_mesh.ear_kernels import clip_ears

    around = vertices[corners] - vertices[corners].mean(axis=1, keepdims=True)
    around /= np.abs(around).max(axis=(1, 2), keepdims=True)
    normal = unit(np.cross(around, np.roll(around, -1, axis=1)).sum(axis=1))
    across = unit(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)]))
    flat = np.stack([dots(around, across[:, None]), dots(around, np.cross(normal, across)[:, None])], axis=2)
    ears, good = np.empty((*corners[:, 2:].shape, 3), dtype=np.int64), np.empty(len(corners), dtype=np.bool_)
    clip_ears(np.ascontiguousarray(flat), ears, good)
    if not good.all():
        first = which[np.argmin(good)] + 1
        raise InputError(
            f"face {first} is a polygon of {corners.shape[1]} corners that crosses itself, one of "
            f"{int((~good).sum())}; cut such polygons into triangles."
        )
    return np.take_along_axis(corners[:, None], ears, axis=2)


def _fan(corners: Ints, start: int) -> Ints:
    """Return (m, c - 2, 3) the triangles, wound alike, of polygons ``corners`` (m, c) that share corner ``start``."""
    flipped = np.roll(corners, -start, axis=1)
    middle = np.arange(1, corners.shape[1] - 1)
    return np.stack(np.broadcast_arrays(flipped[:, :1], flipped[:, middle], flipped[:, middle + 1]), axis=2)


def _least_area_share(vertices: Floats, fan: Ints) -> Floats:
    """Return (m,) the least signed area in each fan of triangles (m, t, 3) over their mean; negative if it folds over.

    It is -1 where areas above zero cancel, 0 where all are zero or vertices are not finite.
    """
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        a, b, c = (vertices[fan[:, :, k]] for k in range(3))
        size = np.abs(np.stack([b - a, c - a])).max(axis=(0, 2, 3))[:, None, None]
        areas = np.cross((b - a) / size, (c - a) / size)
        total = areas.sum(axis=1)
        signed = np.einsum("mtk,mk->mt", areas, total)
        mean = np.einsum("mk,mk->m", total, total) / fan.shape[1]
        shares = np.where(mean > 0.0, signed.min(axis=1) / mean, 0.0)
        cancelled = (norms(areas).max(axis=1) > AREA_ROUNDING_SHARE) & (norms(total) <= AREA_ROUNDING_SHARE)
        return np.where(cancelled, -1.0, shares)
