"""Curves as polylines that follow them closely, in the direction of travel."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms
from cpmkit.mesh.mixed_cells import Polyline, chain_segments
from cpmkit.protocols import Floats, HasMesh, Ints

#: A chord is halved where its middle is farther than this share of ``length`` from the curve.
CHORD_ERROR_SHARE = 2e-3
#: A foot farther than this share of the chord from its middle lies on another branch.
OTHER_BRANCH_SHARE = 0.3
#: Rounds of halving.
MOST_ROUNDS = 12


def drawn(source: LocalSource, length: float) -> list[Polyline] | None:
    """Return a curve as it draws itself, closer than ``CHORD_ERROR_SHARE * length``; None where it does not."""
    if not isinstance(source.source, HasMesh):
        return None
    vertices, cells = source.source.mesh(length)
    if cells.shape[1] != 2:
        return None
    vertices = np.asarray(vertices, dtype=np.float64) - source.shift
    return [followed(source, line, length) for line in chain_segments(vertices, cells)]


def followed(source: LocalSource, line: Polyline, length: float) -> Polyline:
    """Return a polyline on a curve with chords halved until they lie close to it."""
    points = np.concatenate([line.points, line.points[:1]]) if line.closed else line.points
    fresh = np.ones(len(points) - 1, dtype=bool)
    for _ in range(MOST_ROUNDS):
        rows = np.flatnonzero(fresh)
        if not len(rows):
            break
        chord = norms(points[rows + 1] - points[rows])
        middle = 0.5 * (points[rows] + points[rows + 1])
        feet = source.closest_point(middle).points
        off = norms(feet - middle)
        split = (off > CHORD_ERROR_SHARE * length) & (off < OTHER_BRANCH_SHARE * chord)
        points = np.insert(points, rows[split] + 1, feet[split], axis=0)
        halved = np.zeros(len(fresh), dtype=bool)
        halved[rows[split]] = True
        fresh = np.repeat(halved, np.where(halved, 2, 1))
    return Polyline(points[:-1] if line.closed else points, line.closed)


def simplified(points: Floats, tolerance: Floats) -> Ints:
    """Return the rows to keep of a chain ``points`` (n, d): all lie within ``tolerance`` (n,) of the chain of them.

    Douglas and Peucker (1973).
    """
    kept = np.zeros(len(points), dtype=bool)
    kept[[0, -1]] = True
    todo = [(0, len(points) - 1)]
    while todo:
        first, last = todo.pop()
        if last - first < 2:
            continue
        inner = points[first + 1 : last] - points[first]
        chord = points[last] - points[first]
        square = float(chord @ chord)
        share = np.minimum(np.maximum(inner @ chord / square, 0.0), 1.0) if square > 0 else np.zeros(len(inner))
        excess = norms(inner - share[:, None] * chord) / tolerance[first + 1 : last]
        worst = first + 1 + int(excess.argmax())
        if excess[worst - first - 1] > 1:
            kept[worst] = True
            todo += [(first, worst), (worst, last)]
    return np.flatnonzero(kept)


def in_space(points: Floats) -> Floats:
    """Return (n, 3) points, those of the plane with a third coordinate of zero."""
    return points if points.shape[1] == 3 else np.hstack([points, np.zeros((len(points), 1))])
