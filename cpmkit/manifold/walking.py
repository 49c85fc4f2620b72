"""The foot of a point on one sheet of the manifold: by the source's local minima, or by walking along the sheet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.types import Floats, Ints

#: Longest step of a walk, in spacings: shorter than the distance to the next sheet.
STRIDE_SPACINGS = 0.5
#: A step of more than this share of the longest step determines the direction of the walk.
WHOLE_STRIDE_SHARE = 0.5
#: Largest number of steps: a node is within a stencil's reach of the foot where the walk starts.
MOST_STRIDES = 60
#: A walk ends where a step moves the foot by less than this, in spacings.
ARRIVED_SPACINGS = 1e-7
#: A walk that may be given up is checked each so many steps, and ends if it has not come nearer: around a bend of
#: smaller radius than the goal's height there is no foot.
STRIDES_PER_CHECK = 4
#: A step is at most this multiple of the tangential distance to the goal.
LONGEST_STEP_FACTOR = 4.0


def feet_on_sheets(
    source: LocalSource, goal: Floats, start: ClosestPoints, spacing: float
) -> tuple[Ints, ClosestPoints]:
    """Return the rows (k,) of ``goal`` (n, d) and their feet on the sheets that contain ``start``, nearest feet first.

    A source with local minima returns its feet no farther than ``start``; doubtful feet, and feet of other sources, are
    found by walking along the sheet from ``start``.
    """
    if not source.has_local_minima:
        return np.arange(len(goal)), walk(source, goal, start, spacing, give_up=True).feet
    reach = np.linalg.norm(goal - start.points, axis=1)
    rows, feet = source.local_minima(goal, float(reach.max()))
    within_reach = feet.distance <= reach[rows]
    rows, feet = rows[within_reach], feet.take(within_reach)
    if feet.doubtful is None:
        return rows, feet
    unsure, sure = np.unique(rows[feet.doubtful]), ~feet.doubtful
    walked = walk(source, goal[unsure], start.take(unsure), spacing, give_up=True).feet
    rows = np.concatenate([rows[sure], unsure])
    order = np.argsort(rows, kind="stable")
    return rows[order], ClosestPoints.join([feet.take(sure), walked]).take(order)


@dataclass(frozen=True, eq=False)
class Walk:
    """The feet at the ends of walks, and the unit vectors (n, d) of their last long steps, zero without a long step."""

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
    """Return the feet reached from ``start`` by moving along the source until ``goal`` (n, d) lies along the normal.

    A jump to the foot of the goal's projection could land on another sheet. Each step follows the tangential part of
    the vector to the goal; this part shrinks by ``1 - height * curvature`` times the step, so the length of a step is
    chosen from how much it shrank in the last step (Barzilai and Borwein 1988).

    Parameters
    ----------
    source : LocalSource
    goal : (n, d) float64
    start : ClosestPoints
        One point of the manifold for each goal.
    spacing : float
        Spacing of the lattice.
    give_up : bool
        Whether a walk ends where it comes no nearer to its goal.
    lengthened : bool
        If false, a step is the tangential part itself: a fifth more steps, which follow sharper folds.
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
        moves = reached.points - current.points
        distance = np.linalg.norm(moves, axis=1)
        whole = distance > WHOLE_STRIDE_SHARE * STRIDE_SPACINGS * spacing
        strides[walking[whole]] = moves[whole] / distance[whole, None]
        feet, going = feet.replace_rows(walking, reached), distance > ARRIVED_SPACINGS * spacing
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
    """Return the points of a source nearest to ``goal`` (n, d), on the sheets that contain ``start`` if it is given."""
    return source.closest_point(goal) if start is None else walk(source, goal, start, spacing).feet
