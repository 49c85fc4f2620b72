"""Runs of points along curves put together where one goes on from another's end round a corner."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.manifold.vectors import norms
from cpmkit.protocols import Bools, Floats, Ints

#: Ends of runs that coincide to this share of what the points there stand for are one corner: on straight sides they
#: coincide to rounding, on curved ones to the square of that length over the radius.
SAME_CORNER_SHARE = 0.25


def joined_at_corners(
    runs: Sequence[Ints], closed: Sequence[bool], points: Floats, tangents: Floats, weights: Floats
) -> tuple[list[Ints], tuple[bool, ...]]:
    """Return runs put together, and which of these are closed.

    The points of a polyline's sides do not show that its sides hang together where it turns by a right angle: the ends
    of the sides do. Where three ends meet, or one is as near to two others, nothing is put together.

    Parameters
    ----------
    runs : sequence of (k,) int64
        Numbers of points in the order of travel.
    closed : sequence of bool
        Which of them are closed.
    points, tangents : (n, d) float64
        The latter of unit length, the way the curves run.
    weights : (n,) float64
        The length that each point stands for, half of it on either side.
    """
    opened = [run for run, is_closed in zip(runs, closed, strict=True) if not is_closed]
    if not opened:
        return list(runs), tuple(closed)
    last, first = (np.array([run[place] for run in opened]) for place in (-1, 0))
    arriving = points[last] + 0.5 * weights[last, None] * tangents[last]
    leaving = points[first] - 0.5 * weights[first, None] * tangents[first]
    ends, scale = np.concatenate([arriving, leaving]), weights[np.concatenate([last, first])]
    apart = norms(ends[:, None] - ends[None])
    meet = apart <= SAME_CORNER_SHARE * np.minimum(scale[:, None], scale[None])
    count = len(opened)
    alone = meet.sum(axis=1) == 2  # itself and one other
    follows: Bools = meet[:count, count:] & alone[:count, None] & alone[None, count:]
    return _followed(opened, follows, [run for run, is_closed in zip(runs, closed, strict=True) if is_closed])


def _followed(opened: Sequence[Ints], follows: Bools, others: Sequence[Ints]) -> tuple[list[Ints], tuple[bool, ...]]:
    """Return closed runs ``others``, and open ones, each with those behind it that ``follows`` (i, j) it."""
    following = np.where(follows.any(axis=1), follows.argmax(axis=1), -1)
    joined, are_closed, left = list(others), [True] * len(others), np.ones(len(opened), dtype=bool)
    starts = [*np.flatnonzero(~follows.any(axis=0)), *np.flatnonzero(follows.any(axis=0))]  # loops begin anywhere
    for start in starts:
        chain, at = [], start
        while at >= 0 and left[at]:
            left[at] = False
            chain.append(opened[at])
            at = following[at]
        if chain:
            joined.append(np.concatenate(chain))
            are_closed.append(bool(at == start))
    return joined, tuple(are_closed)
