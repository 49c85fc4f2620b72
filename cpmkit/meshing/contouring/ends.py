"""Where a curve that enters a cell ends in it."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms, unit
from cpmkit.protocols import Bools, Floats, Ints

#: Steps along the curve, in spacings, and how many of them.
PACE, MOST_PACES = 0.1, 40
#: A step that leads on by less than this share of its length has come to a point that the curve does not pass.
STALLED = 0.05
#: That much in units of the noise of feet at least.
STALLED_NOISES = 5.0


def ends_in_cells(
    source: LocalSource, points: Floats, tangents: Floats, cells: Ints, spacing: float
) -> tuple[Floats, Bools, Bools]:
    """Return the ends (n, d) of the curve that its strands through ``points`` have in ``cells`` (n, d).

    The first mask tells where there is one, the second where the strand enters the cell at all.
    """
    least = STALLED_NOISES * source.noise
    after, enters = points.copy(), np.zeros(len(points), dtype=bool)
    end, ended = points.copy(), np.zeros(len(points), dtype=bool)
    for sign in (1.0, -1.0):
        answer = source.closest_point(points + sign * 0.5 * PACE * spacing * tangents)
        moved = norms(answer.points - points) > max(1e-3 * PACE * spacing, least)
        new = ~enters & moved & _inside(answer.points, cells, spacing)
        after[new], enters[new] = answer.points[new], True
        stops = new & (answer.edge >= 0)
        end[stops], ended[stops] = answer.points[stops], True
    rows = np.flatnonzero(enters & ~ended)
    before, now = points[rows], after[rows]
    for _ in range(MOST_PACES):
        if not len(rows):
            break
        answer = source.closest_point(now + PACE * spacing * unit(now - before))
        inside = _inside(answer.points, cells[rows], spacing)
        # A walk that stays where it is has come to an end, or to a cusp, where another one comes too.
        stops = inside & ((answer.edge >= 0) | (norms(answer.points - now) < max(STALLED * PACE * spacing, least)))
        end[rows[stops]], ended[rows[stops]] = answer.points[stops], True
        go = inside & ~stops
        rows, before, now = rows[go], now[go], answer.points[go]
    return end, ended, enters


def _inside(points: Floats, cells: Ints, spacing: float) -> Bools:
    return np.asarray((np.abs(points / spacing - cells) <= 0.5 + 1e-9).all(axis=1))
