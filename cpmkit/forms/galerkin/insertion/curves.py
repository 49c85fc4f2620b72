"""Curves on a surface made edges of its triangles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cpmkit.forms.galerkin.insertion.feet import Triangles
from cpmkit.forms.galerkin.insertion.loops import without_loops
from cpmkit.forms.galerkin.insertion.polylines import simplified
from cpmkit.forms.galerkin.insertion.rims import Run, runs
from cpmkit.forms.galerkin.insertion.route import chosen
from cpmkit.forms.galerkin.insertion.triples import Triple
from cpmkit.forms.galerkin.insertion.walk import Walker
from cpmkit.meshes.polylines import Polyline
from cpmkit.protocols import Floats, Ints

#: A curve is simplified as far as it stays within this share of L, and cut into pieces of at most so many L.
SIMPLE_SHARE, LONGEST_PIECE_SIZES = 0.01, 2.0


class Course(NamedTuple):
    """A boundary's curve as it is inserted: points (n, 3) that follow one another, and what of it is another's too.

    ``on`` (n,) is the earlier boundary on which each lies, -1 where it lies on none.
    """

    points: Floats
    closed: bool
    on: Ints


def course(triangles: Triangles, line: Polyline, on: Callable[[Floats], Ints]) -> Course:
    """Return a polyline in space, simplified and then with points no farther apart than a few L.

    ``on`` tells on which earlier boundary points of the curve lie; added points lie where both their neighbours do.
    """
    points = np.concatenate([line.points, line.points[:1]]) if line.closed else line.points
    size, _ = triangles.nearest_size(points)
    kept = simplified(points, SIMPLE_SHARE * size)
    points, size = points[kept], size[kept]
    shared = on(points)
    while True:
        chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
        long = np.flatnonzero(chord > LONGEST_PIECE_SIZES * np.minimum(size[:-1], size[1:]))
        if not len(long):
            whole = len(points) - line.closed
            return Course(points[:whole], line.closed, shared[:whole])
        middle = 0.5 * (points[long] + points[long + 1])
        points = np.insert(points, long + 1, middle, axis=0)
        size = np.insert(size, long + 1, triangles.nearest_size(middle)[0])
        both = np.where(shared[long] == shared[long + 1], shared[long], -1)
        shared = np.insert(shared, long + 1, both)


def insert_curve(walker: Walker, line: Course, told: Counter[str]) -> float:
    """Make a curve edges of the triangulation, and return how far off it lies at most, but for what passes its rim.

    What there is to tell is counted: ``erased`` loops, ``parted`` curves whose feet do not hang together.
    """
    gap = 0.0
    feet = chosen(walker.net, line.points, walker.triangles.feet(line.points))
    for run in runs(walker.net, walker.triangles, line.points, feet, line.closed):
        stops = _stops(walker, run, line.on)
        backward = _backward(line.points, run, stops)
        gap = max(gap, float(feet.distance[run.points[run.points >= 0]].max(initial=0.0)))
        for path in _walked(walker, stops, run.closed, told):
            walker.lined.mark(without_loops(walker.net, walker.net.expanded(path), backward, told), walker.lined.owner)
    return gap


def _stops(walker: Walker, run: Run, on: Ints) -> list[tuple[int, int]]:
    """Return the vertex at each foot of a run, and the earlier boundary on which it lies."""
    owners = np.where(run.points >= 0, on[run.points], -1).tolist()
    feet = list(zip(run.cells.tolist(), run.places.tolist(), owners, strict=True))
    last = len(feet) - 1
    return [
        (_stop(walker, cell, (x, y, z), owner, not run.closed and k in (0, last)), owner)
        for k, (cell, (x, y, z), owner) in enumerate(feet)
    ]


def _backward(points: Floats, run: Run, stops: list[tuple[int, int]]) -> set[int]:
    """Return the vertices between which feet go back while the curve goes on, as they do where it is drawn off."""
    known = (run.points[1:] >= 0) & (run.points[:-1] >= 0)
    ahead = np.einsum("nd,nd->n", np.diff(points[run.points], axis=0), np.diff(run.places, axis=0))
    return {stops[row + k][0] for row in np.flatnonzero(known & (ahead < 0)).tolist() for k in (0, 1)}


def _walked(walker: Walker, stops: list[tuple[int, int]], closed: bool, told: Counter[str]) -> Iterable[list[int]]:
    """Yield the paths of a run: one, unless its feet do not hang together."""
    path = [stops[0][0]]
    for (start, before), (goal, owner) in pairwise(stops + stops[:1] if closed else stops):
        along = walker.along_line(start, goal, owner) if before == owner >= 0 else None
        way = along or walker.way(start, goal)
        if way is None:
            told["parted"] += 1
            yield path
            path = [goal]
        else:
            path += way[1:]
    yield path


def _stop(walker: Walker, cell: int, place: Triple, owner: int, is_end: bool) -> int:
    lined = walker.lined
    vertex = lined.on_line(cell, place, owner) if owner >= 0 else None
    if vertex is not None:
        return vertex
    lined.at_end = is_end
    vertex = lined.inserted(cell, place)
    lined.at_end = False
    return vertex
