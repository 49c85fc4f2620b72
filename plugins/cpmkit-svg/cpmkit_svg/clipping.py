"""The pieces of curves inside the canvas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats


@dataclass(frozen=True, eq=False)
class PolylinePiece:
    """A piece of a curve: points (n, 2), and the shares (n,) of the whole curve's length at which they lie."""

    points: Floats
    shares: Floats


def clip_polyline(points: Floats, lower: Floats, upper: Floats) -> list[PolylinePiece]:
    """Return the pieces of the polyline ``points`` (n, 2) in a box, in its order; an empty list if it misses the box.

    ``lower`` and ``upper`` (2,) are the box's corners; the polyline has a length above zero. A closed polyline that
    starts in the box and leaves it has a piece at its start and one at its end. The method is that of Liang and Barsky,
    segment by segment.
    """
    start, step = points[:-1], np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    before = np.concatenate([[0.0], np.cumsum(length)])
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = np.stack([(lower - start) / step, (upper - start) / step])
    parallel = step == 0
    outside = parallel & ((start < lower) | (start > upper))
    enters = np.where(parallel, 0.0, crossings.min(axis=0)).max(axis=1, initial=0.0)
    leaves = np.where(parallel, 1.0, crossings.max(axis=0)).min(axis=1, initial=1.0)
    inside = (enters < leaves) & ~outside.any(axis=1)
    pieces: list[PolylinePiece] = []
    runs = np.flatnonzero(inside)
    breaks = np.flatnonzero((np.diff(runs) > 1) | (leaves[runs[:-1]] < 1) | (enters[runs[1:]] > 0)) + 1
    for run in np.split(runs, breaks):
        if len(run):
            t = np.stack([enters[run], leaves[run]], axis=1)
            ends = start[run, None] + t[:, :, None] * step[run, None]
            along = before[run, None] + t * length[run, None]
            pieces.append(
                PolylinePiece(
                    np.clip(np.concatenate([ends[:1, 0], ends[:, 1]]), lower, upper),
                    np.concatenate([along[:1, 0], along[:, 1]]) / before[-1],
                )
            )
    return pieces
