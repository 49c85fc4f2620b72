"""Curves on a surface made edges of its triangles."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from cpmkit.forms.galerkin.insertion.feet import Triangles
from cpmkit.forms.galerkin.insertion.polylines import Polyline, simplified
from cpmkit.forms.galerkin.insertion.rims import Run, runs
from cpmkit.forms.galerkin.insertion.route import chosen
from cpmkit.forms.galerkin.insertion.triangulation import Triangulation
from cpmkit.forms.galerkin.insertion.triples import apart
from cpmkit.forms.galerkin.insertion.walk import Walker
from cpmkit.protocols import Floats

#: A curve is simplified as far as it stays within this share of L, and cut into pieces of at most so many L.
SIMPLE_SHARE, LONGEST_PIECE_SIZES = 0.01, 2.0
#: A curve's own loops shorter than so many L are no part of it: spikes of feet, swallowtails, jitter of a drawing.
SHORTEST_LOOP_SIZES = 2.0


def insert_curve(walker: Walker, line: Polyline, told: Counter[str]) -> None:
    """Make a polyline edges of the triangulation.

    Parameters
    ----------
    walker : Walker
    line : Polyline
        In space.
    told : Counter
        What there is to tell is counted here: ``erased`` loops, ``parted`` curves whose feet do not hang together.
    """
    points = pieces(walker.triangles, line)
    feet = chosen(walker.net, points, walker.triangles.feet(points))
    for run in runs(walker.net, walker.triangles, points, feet, line.closed):
        for path in _walked(walker, run, told):
            walker.mark(without_loops(walker.net, walker.net.expanded(path), told), walker.owner)


def pieces(triangles: Triangles, line: Polyline) -> Floats:
    """Return the points (n, 3) of a polyline, simplified and then no farther apart than a few L."""
    points = np.concatenate([line.points, line.points[:1]]) if line.closed else line.points
    size, _ = triangles.nearest_size(points)
    kept = simplified(points, SIMPLE_SHARE * size)
    points, size = points[kept], size[kept]
    while True:
        chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
        parts = np.ceil(chord / (LONGEST_PIECE_SIZES * np.minimum(size[:-1], size[1:])))
        long = np.flatnonzero(parts > 1)
        if not len(long):
            return points[:-1] if line.closed else points
        middle = 0.5 * (points[long] + points[long + 1])
        points = np.insert(points, long + 1, middle, axis=0)
        size = np.insert(size, long + 1, triangles.nearest_size(middle)[0])


def _walked(walker: Walker, run: Run, told: Counter[str]) -> Iterable[list[int]]:
    """Yield the paths of a run: one, unless its feet do not hang together."""
    targets = list(zip(run.cells.tolist(), run.places.tolist(), strict=True))
    first = walker.inserted(targets[0][0], tuple(targets[0][1]))
    path = [first]
    for cell, place in targets[1:]:
        vertex = walker.inserted(cell, tuple(place))
        way = walker.way(path[-1], vertex)
        if way is None:
            told["parted"] += 1
            yield path
            path = [vertex]
        else:
            path += way[1:]
    if run.closed and (way := walker.way(path[-1], first)) is not None:
        path += way[1:]
    yield path


def without_loops(net: Triangulation, path: list[int], told: Counter[str]) -> list[int]:
    """Return a path with its short loops erased, those through the start of a closed one too."""
    path = _erased(net, path, told)
    if len(path) > 2 and path[0] == path[-1]:
        half = len(path) // 2
        path = _erased(net, path[half:] + path[1 : half + 1], told)
    return path


def _erased(net: Triangulation, path: list[int], told: Counter[str]) -> list[int]:
    kept, way = path[:1], [0.0]
    place = {path[0]: 0}
    for vertex in path[1:]:
        if vertex == kept[-1]:
            continue
        reached = way[-1] + apart(net.at(kept[-1]), net.at(vertex))
        before = place.get(vertex)
        if before is not None and reached - way[before] < SHORTEST_LOOP_SIZES * net.size(vertex):
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
