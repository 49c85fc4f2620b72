"""Directed segments, as curves draw themselves, put together to polylines."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cpmkit.protocols import Floats, Ints


class Polyline(NamedTuple):
    """Points (n, d) in the order of travel; a closed one goes on from the last to the first."""

    points: Floats
    closed: bool


def polylines_of(vertices: Floats, segments: Ints) -> list[Polyline]:
    """Return the polylines that directed segments (m, 2) between vertices (v, d) make up.

    They end where a vertex does not end one segment and start one.
    """
    return [Polyline(vertices[order], closed) for order, closed in _chains(segments)]


def _chains(segments: Ints) -> list[tuple[Ints, bool]]:
    """Return the vertices along each chain of segments, and whether it is closed."""
    starts, ends = segments.T
    count = int(segments.max(initial=-1)) + 1
    through = (np.bincount(starts, minlength=count) == 1) & (np.bincount(ends, minlength=count) == 1)
    following = np.full(count, -1)
    following[starts] = ends
    found, seen = [], np.zeros(count, dtype=bool)
    rest = [[start, end] for start, end in segments.tolist() if not through[start]]
    for chain in rest:
        while through[chain[-1]]:
            seen[chain[-1]] = True
            chain.append(int(following[chain[-1]]))
        closed = chain[0] == chain[-1]
        found.append((np.array(chain[:-1] if closed else chain), closed))
    for first in np.flatnonzero(through).tolist():
        if not seen[first]:
            chain = [first]
            while not seen[chain[-1]]:
                seen[chain[-1]] = True
                chain.append(int(following[chain[-1]]))
            found.append((np.array(chain[:-1]), True))
    return found
