"""Boundaries that lie on each other, in whole or in part, or so close that they must be kept apart with care."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.meshing.insertion.polylines import in_space
from cpmkit.protocols import Bools, Floats, Ints

#: A boundary lies on an earlier one where it is nearer to it than this share of the spacing.
SAME_SHARE = 1e-8
#: It does so, too, where it stays nearer than this share of the spacing and changes sides so often: the same curve
#: drawn with other vertices. A parallel never does.
ENTWINED_SHARE, ENTWINED_CROSSINGS = 0.02, 3
#: Places on each segment at which that is looked for.
PLACES = 4
#: Boundaries nearer to each other than this share of the spacing are inserted without bends towards vertices.
CLOSE_SHARE = 0.05


def on_earlier(points: Floats, curve: LocalSource, earlier: Sequence[LocalSource], spacing: float) -> Ints:
    """Return the earlier boundary (n,) on which each of the ``points`` (n, d) along a curve lies, -1 for none."""
    found = np.full(len(points), -1)
    share = np.arange(PLACES)[:, None] / PLACES
    between = (points[:-1, None] + share * np.diff(points, axis=0)[:, None]).reshape(-1, points.shape[1])
    places: Floats | None = None  # of the curve itself: a chord may cross what lies beside its arc
    for number in _met(points, earlier, spacing):
        if places is None:
            places = curve.closest_point(np.concatenate([between, points[-1:]])).points
        off = places - earlier[number].closest_point(places).points
        same = norms(off[::PLACES]) <= SAME_SHARE * spacing
        entwined = _entwined(off, np.diff(points, axis=0), ENTWINED_SHARE * spacing)
        found[entwined[::PLACES] | (same & (same.sum() > 1))] = number
    return found


def _entwined(off: Floats, chords: Floats, reach: float) -> Bools:
    """Return which places of a chain with offsets ``off`` (n, d) from a curve lie on stretches that wind about it.

    ``chords`` (m, d) are the chain's: offsets turn with these round a corner.
    """
    near = norms(off) < reach
    stretch = np.cumsum(np.diff(near, prepend=near[:1]))
    ways = unit(in_space(np.append(np.repeat(chords, PLACES, axis=0), chords[-1:], axis=0)))
    crosses = (dots(in_space(off)[1:], _turned(in_space(off)[:-1], ways[:-1], ways[1:])) < 0) & near[1:] & near[:-1]
    crossings = np.bincount(stretch[1:], crosses, minlength=stretch[-1] + 1)
    return np.asarray(near & (crossings[stretch] >= ENTWINED_CROSSINGS))


def _turned(vectors: Floats, start: Floats, end: Floats) -> Floats:
    """Return ``vectors`` (n, 3) turned as the unit vectors ``start`` (n, 3) are turned to ``end`` (n, 3)."""
    axis, cosine = np.cross(start, end), dots(start, end)
    once = np.cross(axis, vectors)
    return np.asarray(vectors + once + np.cross(axis, once) / np.maximum(1 + cosine, 1e-9)[:, None])


def runs_close(points: Floats, others: Sequence[LocalSource], spacing: float) -> bool:
    """Return whether some of the points of a curve lie very near to another boundary, but not on it."""
    for number in _met(points, others, spacing):
        distance = norms(points - others[number].closest_point(points).points)
        if ((distance > SAME_SHARE * spacing) & (distance < CLOSE_SHARE * spacing)).sum() > 1:
            return True
    return False


def _met(points: Floats, others: Sequence[LocalSource], spacing: float) -> Iterable[int]:
    """Yield the number of each boundary to which some points may be near."""
    low, high = points.min(axis=0) - spacing, points.max(axis=0) + spacing
    for number, other in enumerate(others):
        if (other.bounds[0] <= high).all() and (other.bounds[1] >= low).all():
            yield number
