"""The projection of a boundary to its manifold, which replaces a boundary that is slightly off the manifold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import tangents_and_corners
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.types import Floats, Ints

#: A boundary nearer to the manifold than this share of its largest side counts as on it.
ON_MANIFOLD_SHARE = 1e-9
#: If a curve is farther off the manifold than this share of the step of differences, the tangents of its projection are
#: computed separately.
OFF_STEPS = 0.01
#: Step of the differences for these tangents, as a share of the distance from the manifold.
STEP_SHARE = 0.01
#: Most rounds of the search: each reduces the error by the square of the sine of the angle to the manifold, or more.
MOST_ROUNDS = 30


def nearest_on_projection(
    boundary: LocalSource, manifold: LocalSource, points: Floats
) -> tuple[ClosestPoints, ClosestPoints]:
    """Return points c of the boundary whose projections y = cp_S(c) are nearest to ``points`` z (n, d), and the y.

    The search starts at c = cp_C(z) and repeats c = cp_C(c + a (z - y)), a by secants, as long as y comes nearer to z.
    If z is a projection of the boundary then y = z, which cp_S(cp_C(z)) is not where C is inclined to the manifold.
    """
    feet = boundary.closest_point(points)
    on = manifold.closest_point(feet.points)
    least = ON_MANIFOLD_SHARE * float(np.ptp(manifold.bounds, axis=0).max())
    rows = np.flatnonzero(norms(on.points - feet.points) > least)
    factor = np.ones((len(rows), 1))
    for count in range(MOST_ROUNDS):
        if not len(rows):
            break
        start, before = feet.points[rows], on.points[rows]
        offset = points[rows] - before
        trial = boundary.closest_point(start + factor * offset)
        reached = manifold.closest_point(trial.points)
        nearer = norms(points[rows] - reached.points) < norms(offset)
        moved = trial.points - start
        square = dots(moved, moved)
        share = dots(moved, reached.points - before) / np.where(square > 0, square, 1.0)
        feet, on = (whole.replace_rows(rows[nearer], new.take(nearer)) for whole, new in ((feet, trial), (on, reached)))
        going = (nearer | (count == 0)) & (square > 0)  # the first step may be too long
        rows, factor = rows[going], 1 / np.clip(share[going, None], 0.25, 4.0)
    return replace(feet, distance=norms(points - feet.points)), on


def tangents_of_projection(
    curve: LocalSource, manifold: LocalSource, feet: ClosestPoints, on_manifold: ClosestPoints, step: float
) -> tuple[Ints, Floats]:
    """Return the rows (k,) at which a curve is off the manifold, and the unit tangents (k, d) of its projection there.

    ``feet`` and ``on_manifold`` are those of :func:`nearest_on_projection`; ``step`` is the length of the differences
    for curves without tangents of their own. Rows at corners of such a curve, or where the projection does not move
    along the curve, are left out.
    """
    gap = norms(on_manifold.points - feet.points)
    rows = np.flatnonzero(gap > OFF_STEPS * step)
    if not len(rows):
        return rows, feet.points[rows]
    tangents, corner = tangents_and_corners(curve, feet.take(rows), step)
    way = STEP_SHARE * gap[rows, None] * tangents
    ahead, behind = (manifold.closest_point(feet.points[rows] + sign * way).points for sign in (1, -1))
    moves = ~corner & (norms(ahead - behind) > 0.1 * norms(2 * way))
    return rows[moves], unit((ahead - behind)[moves])
