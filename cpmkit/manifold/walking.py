"""The foot of a point on the sheet that one stands on: by the source's own search, or by walking along the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.protocols import ClosestPoints, Floats, Ints

#: Longest stride (spacings) towards a foot on a sheet: shorter than the distance to the next sheet.
STRIDE_SPACINGS = 0.5
#: A step of more than this share of a stride tells in which direction one came.
WHOLE = 0.5
#: Most strides; a node is within a stencil's reach of the foot from which the walk starts.
MOST_STRIDES = 60
#: A walk that moves less than this many spacings has arrived.
ARRIVED_SPACINGS = 1e-7
#: A walk that may have no foot to reach is checked each so many strides, and given up if it has come no nearer: around
#: a bend of smaller radius than the goal's height there is none.
STRIDES_PER_CHECK = 4
#: A step is at most this multiple of the remaining way.
LONGEST_STEP_FACTOR = 4.0


def feet_from(source: LocalSource, goal: Floats, start: ClosestPoints, spacing: float) -> tuple[Ints, ClosestPoints]:
    """Return feet of ``goal`` (n, d) and whose they are, those of one row by their distance.

    By the source's own search where it has one, no farther than ``start`` lies, for that is a point of the sheet; by
    walking along the sheet from there where it has none, and in the place of feet that it does not vouch for.
    """
    if not source.has_local_minima:
        return np.arange(len(goal)), walk(source, goal, start, spacing, give_up=True).feet
    reach = np.linalg.norm(goal - start.points, axis=1)
    rows, feet = source.local_minima(goal, float(reach.max()))
    near = feet.distance <= reach[rows]
    rows, feet = rows[near], feet.take(near)
    return (rows, feet) if feet.doubtful is None else _with_doubtful_walked(source, goal, start, spacing, rows, feet)


def _with_doubtful_walked(
    source: LocalSource, goal: Floats, start: ClosestPoints, spacing: float, rows: Ints, feet: ClosestPoints
) -> tuple[Ints, ClosestPoints]:
    """Return the feet with doubtful ones replaced by those that walking leads to."""
    assert feet.doubtful is not None
    unsure, sure = np.unique(rows[feet.doubtful]), ~feet.doubtful
    walked = walk(source, goal[unsure], start.take(unsure), spacing, give_up=True).feet
    rows = np.concatenate([rows[sure], unsure])
    order = np.argsort(rows, kind="stable")
    return rows[order], ClosestPoints.join([feet.take(sure), walked]).take(order)


@dataclass(frozen=True, eq=False)
class Walk:
    """Feet that were walked to, and the unit vectors (n, d) of the last whole strides; zero where none was made."""

    feet: ClosestPoints
    last: Floats


def walk(
    source: LocalSource,
    goal: Floats,
    start: ClosestPoints,
    spacing: float,
    *,
    give_up: bool = False,
    lengthened: bool = True,
) -> Walk:
    """Return the feet reached from ``start`` by walking along the source until ``goal`` (n, d) lies straight above.

    A leap to the foot of the goal's projection could land on another sheet, and past an end of the surface it would.
    The way ahead is the tangential part of what is left to the goal; as it shrinks by ``1 - height * curvature`` times
    what is walked, the step is chosen from how much it shrank in the last one (Barzilai and Borwein 1988).
    Not ``lengthened``, steps are the way ahead itself, a fifth more of them: they go round sharper folds.
    """
    feet, strides, walking = start, np.zeros_like(goal), np.arange(len(goal))
    if source.manifold_dim == 0:
        return Walk(feet, strides)
    checked, steps = np.full(len(goal), np.inf), np.ones((len(goal), 1))
    last: tuple[Floats, Floats] | None = None
    for count in range(MOST_STRIDES):
        current = feet.take(walking)
        ahead = project_tangent(source, current, goal[walking] - current.points, 0.5 * spacing)
        length = np.linalg.norm(ahead, axis=1, keepdims=True)
        if last is not None and lengthened:
            walked, shrunk = current.points - last[0], last[1] - ahead
            slope = np.sum(walked * shrunk, axis=1, keepdims=True) / np.sum(walked * walked, axis=1, keepdims=True)
            steps = np.asarray(1 / np.clip(slope, 1 / LONGEST_STEP_FACTOR, None))
        step = np.minimum(steps, STRIDE_SPACINGS * spacing / np.maximum(length, ARRIVED_SPACINGS * spacing)) * ahead
        reached = source.closest_point(current.points + step)
        taken = reached.points - current.points
        moved = np.linalg.norm(taken, axis=1)
        whole = moved > WHOLE * STRIDE_SPACINGS * spacing
        strides[walking[whole]] = taken[whole] / moved[whole, None]
        feet, going = feet.replaced(walking, reached), moved > ARRIVED_SPACINGS * spacing
        if give_up and count % STRIDES_PER_CHECK == 0:
            going &= length[:, 0] <= checked[walking]
            checked[walking] = length[:, 0]
        last = (current.points[going], ahead[going])
        steps = steps[going]
        walking = walking[going]
        if not len(walking):
            break
    return Walk(feet, strides)


def nearest_on_sheet(source: LocalSource, start: ClosestPoints | None, goal: Floats, spacing: float) -> ClosestPoints:
    """Return the points of a source nearest to ``goal`` (n, d), on the sheets of its points ``start`` if given."""
    return source.closest_point(goal) if start is None else walk(source, goal, start, spacing).feet
