"""Curves on a surface made edges of its triangles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cpmkit.forms.galerkin.insertion.feet import Triangles
from cpmkit.forms.galerkin.insertion.polylines import Polyline, simplified
from cpmkit.forms.galerkin.insertion.rims import Run, runs
from cpmkit.forms.galerkin.insertion.route import chosen
from cpmkit.forms.galerkin.insertion.triangulation import Triangulation
from cpmkit.forms.galerkin.insertion.triples import Triple, apart
from cpmkit.forms.galerkin.insertion.walk import Walker
from cpmkit.protocols import Floats, Ints

#: A curve is simplified as far as it stays within this share of L, and cut into pieces of at most so many L.
SIMPLE_SHARE, LONGEST_PIECE_SIZES = 0.01, 2.0
#: A curve's own loops shorter than so many L are no part of it: spikes of feet, swallowtails, jitter of a drawing.
#: One that is drawn off the surface has longer ones: by so many times its distance, up to L.
SHORTEST_LOOP_SIZES, SHORTEST_LOOP_DISTANCES = 2.0, 2.0


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


def insert_curve(walker: Walker, line: Course, told: Counter[str]) -> None:
    """Make a curve edges of the triangulation.

    What there is to tell is counted: ``erased`` loops, ``parted`` curves whose feet do not hang together.
    """
    feet = chosen(walker.net, line.points, walker.triangles.feet(line.points))
    off = float(feet.distance.max())
    for run in runs(walker.net, walker.triangles, line.points, feet, line.closed):
        for path in _walked(walker, run, line.on, told):
            walker.mark(without_loops(walker.net, walker.net.expanded(path), off, told), walker.owner)


def _walked(walker: Walker, run: Run, on: Ints, told: Counter[str]) -> Iterable[list[int]]:
    """Yield the paths of a run: one, unless its feet do not hang together."""
    owners = np.where(run.points >= 0, on[run.points], -1).tolist()
    stops = [
        (_stop(walker, cell, (x, y, z), owner), owner)
        for cell, (x, y, z), owner in zip(run.cells.tolist(), run.places.tolist(), owners, strict=True)
    ]
    path = [stops[0][0]]
    for (start, before), (goal, owner) in pairwise(stops + stops[:1] if run.closed else stops):
        along = walker.along_line(start, goal, owner) if before == owner >= 0 else None
        way = along or walker.way(start, goal)
        if way is None:
            told["parted"] += 1
            yield path
            path = [goal]
        else:
            path += way[1:]
    yield path


def _stop(walker: Walker, cell: int, place: Triple, owner: int) -> int:
    vertex = walker.on_line(cell, place, owner) if owner >= 0 else None
    return walker.inserted(cell, place) if vertex is None else vertex


def without_loops(net: Triangulation, path: list[int], off: float, told: Counter[str]) -> list[int]:
    """Return a path with its short loops erased, those through the start of a closed one too.

    ``off`` is how far from the surface the curve is drawn.
    """
    path = _erased(net, path, off, told)
    if len(path) > 2 and path[0] == path[-1]:
        half = len(path) // 2
        path = _erased(net, path[half:] + path[1 : half + 1], off, told)
    return path


def _erased(net: Triangulation, path: list[int], off: float, told: Counter[str]) -> list[int]:
    kept, way = path[:1], [0.0]
    place = {path[0]: 0}
    for vertex in path[1:]:
        if vertex == kept[-1]:
            continue
        reached = way[-1] + apart(net.at(kept[-1]), net.at(vertex))
        before = place.get(vertex)
        size = net.size(vertex)
        shortest = SHORTEST_LOOP_SIZES * size + SHORTEST_LOOP_DISTANCES * min(off, size)
        if before is not None and reached - way[before] < shortest:
            told["erased"] += 1
            for gone in kept[before + 1 :]:
                if place[gone] > before:
                    del place[gone]
            del kept[before + 1 :], way[before + 1 :]
        else:
            place[vertex] = len(kept)
            kept.append(vertex)
            way.append(reached)
    return kept
