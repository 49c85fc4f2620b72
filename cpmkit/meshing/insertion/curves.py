"""Curves on a surface made edges of its triangles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.mixed_cells import Polyline
from cpmkit.meshing.insertion.alongside import Chain
from cpmkit.meshing.insertion.feet import Triangles
from cpmkit.meshing.insertion.loops import without_loops
from cpmkit.meshing.insertion.polylines import simplified
from cpmkit.meshing.insertion.rims import Run, runs
from cpmkit.meshing.insertion.route import chosen
from cpmkit.meshing.insertion.triples import Triple, along, less
from cpmkit.meshing.insertion.walk import Placed, Walker
from cpmkit.protocols import Floats, Ints

#: A curve is simplified as far as it stays within this share of L, and cut into pieces of at most so many L.
SIMPLE_SHARE, LONGEST_PIECE_SIZES = 0.01, 2.0


class Course(NamedTuple):
    """A boundary's curve as it is inserted: points (n, 3) that follow one another, and what of it is another's too.

    ``on`` (n,) is the earlier boundary on which each lies, -1 where it lies on none; ``beside`` (n, 2) the number of an
    earlier course that nearly coincides, and its point there, -1 where there is none. ``number`` is the course's own,
    ``rows`` are its points that a chain gave, all others lie between.
    """

    points: Floats
    closed: bool
    on: Ints
    beside: Ints
    number: int
    rows: Ints


def course(triangles: Triangles, chain: Chain, shared: Ints, earlier: Sequence[Course] = ()) -> Course:
    """Return a curve with points no farther apart than a few L; beside an earlier one where that has its points.

    ``shared`` are the earlier boundaries on which points of its loop lie; added points lie where both neighbours do.
    """
    points, given = chain.loop, np.arange(len(chain.loop)) % len(chain.points)
    beside = chain.beside[given]
    for row in np.flatnonzero(beside[:, 0] >= 0).tolist():
        beside[row, 1] = earlier[beside[row, 0]].rows[beside[row, 1]]
    fresh = [_between(points[k : k + 2], beside[k : k + 2], earlier) for k in range(len(points) - 1)]
    at = np.repeat(np.arange(1, len(points)), [len(places) for places, _ in fresh])
    points = np.insert(points, at, np.concatenate([places for places, _ in fresh]), axis=0)
    beside = np.insert(beside, at, np.concatenate([pairs for _, pairs in fresh]), axis=0)
    shared, given = (np.insert(of, at, -1) for of in (shared, given))
    size, _ = triangles.nearest_size(points)
    while True:
        chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
        long = np.flatnonzero(chord > LONGEST_PIECE_SIZES * np.minimum(size[:-1], size[1:]))
        if not len(long):
            whole = slice(len(points) - chain.closed)
            rows = np.flatnonzero(given[whole] >= 0)
            return Course(points[whole], chain.closed, shared[whole], beside[whole], len(earlier), rows)
        middle = 0.5 * (points[long] + points[long + 1])
        points = np.insert(points, long + 1, middle, axis=0)
        size = np.insert(size, long + 1, triangles.nearest_size(middle)[0])
        both = np.where(shared[long] == shared[long + 1], shared[long], -1)
        shared, given = np.insert(shared, long + 1, both), np.insert(given, long + 1, -1)
        beside = np.insert(beside, long + 1, -1, axis=0)


def _between(ends: Floats, beside: Ints, earlier: Sequence[Course]) -> tuple[Floats, Ints]:
    """Return points (k, 3) between two of a curve, and beside which of an earlier course each lies, (k, 2)."""
    none = np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64)
    number = int(beside[0, 0])
    if number < 0 or beside[1, 0] != number:
        return none
    line = earlier[number]
    start, end = (int(np.searchsorted(line.rows, row)) for row in beside[:, 1])
    count = len(line.rows)
    forward = end == (start + 1) % count if line.closed else end == start + 1
    backward = start == (end + 1) % count if line.closed else start == end + 1
    if not (forward or backward) or start == end:
        return none
    low, high = (beside[:, 1] if forward else beside[::-1, 1]).tolist()
    inner = np.arange(low + 1, high if high > low else len(line.points))
    inner = inner if forward else inner[::-1]
    way = line.points[beside[:, 1]]
    share = np.linalg.norm(line.points[inner] - way[0], axis=1) / np.linalg.norm(way[1] - way[0])
    places = ends[0] + share[:, None] * (ends[1] - ends[0])
    return places, np.stack([np.full(len(inner), number), inner], axis=1)


def chain_of(triangles: Triangles, line: Polyline, curve: LocalSource, owner: int) -> Chain:
    """Return a polyline in space, simplified."""
    points = np.concatenate([line.points, line.points[:1]]) if line.closed else line.points
    size, _ = triangles.nearest_size(points)
    kept = simplified(points, SIMPLE_SHARE * size)
    return Chain.of(points[kept[:-1] if line.closed else kept], line.closed, curve, owner)


def insert_curve(walker: Walker, line: Course, told: Counter[str]) -> float:
    """Make a curve edges of the triangulation, and return how far off it lies at most, but for what passes its rim.

    What there is to tell is counted: ``erased`` loops, ``disconnected`` curves whose feet do not hang together.
    """
    gap = 0.0
    feet = chosen(walker.net, line.points, walker.triangles.feet(line.points))
    for run in runs(walker.net, walker.triangles, line.points, feet, line.closed):
        stops = _stops(walker, run, line)
        backward = _backward(line.points, run, stops)
        gap = max(gap, float(feet.distance[run.points[run.points >= 0]].max(initial=0.0)))
        for path in _walked(walker, stops, run.closed, told):
            walker.lined.mark(without_loops(walker.net, walker.net.expanded(path), backward, told), walker.lined.owner)
    return gap


class Stop(NamedTuple):
    """A vertex at a foot of a curve, the earlier boundary on which it lies, and the vertex beside which it lies.

    -1 where there is none.
    """

    vertex: int
    on: int
    beside: int


def _stops(walker: Walker, run: Run, line: Course) -> list[Stop]:
    """Return the vertices at the feet of a run, and note them for curves that nearly coincide with it."""
    last = len(run.points) - 1
    found = []
    for k, (point, cell, (x, y, z)) in enumerate(zip(run.points, run.cells.tolist(), run.places.tolist(), strict=True)):
        if point < 0:
            found.append(Stop(_stop(walker, cell, (x, y, z), -1, not run.closed and k in (0, last)), -1, -1))
            continue
        owner, where = int(line.on[point]), tuple(line.points[point].tolist())
        beside = walker.stops.get(tuple(line.beside[point].tolist()))
        if beside is None:
            vertex = _stop(walker, cell, (x, y, z), owner, not run.closed and k in (0, last))
        else:
            vertex = walker.at_foot(along(walker.net.at(beside.vertex), 1.0, less(where, beside.place)))
        walker.stops[line.number, int(point)] = Placed(vertex, where)
        found.append(Stop(vertex, owner, -1 if beside is None else beside.vertex))
    return found


def _backward(points: Floats, run: Run, stops: list[Stop]) -> set[int]:
    """Return the vertices between which feet go back while the curve goes on, as they do where it is drawn off."""
    known = (run.points[1:] >= 0) & (run.points[:-1] >= 0)
    ahead = np.einsum("nd,nd->n", np.diff(points[run.points], axis=0), np.diff(run.places, axis=0))
    return {stops[row + k].vertex for row in np.flatnonzero(known & (ahead < 0)).tolist() for k in (0, 1)}


def _walked(walker: Walker, stops: list[Stop], closed: bool, told: Counter[str]) -> Iterable[list[int]]:
    """Yield the paths of a run: one, unless its feet do not hang together."""
    path = [stops[0].vertex]
    for start, goal in pairwise(stops + stops[:1] if closed else stops):
        way = walker.along_line(start.vertex, goal.vertex, {goal.on}) if start.on == goal.on >= 0 else None
        if way is None and start.beside >= 0 and goal.beside >= 0:
            way = walker.beside_line((start.vertex, start.beside), (goal.vertex, goal.beside))
        way = way or walker.way(start.vertex, goal.vertex)
        if way is None:
            told["disconnected"] += 1
            yield path
            path = [goal.vertex]
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
