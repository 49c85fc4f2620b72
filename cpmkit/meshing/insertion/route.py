"""Which foot of each point of a polyline is meant: a curve stays on its sheet of the surface."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np

from cpmkit.meshing.insertion.feet import Feet
from cpmkit.meshing.insertion.triangulation import Triangulation
from cpmkit.meshing.insertion.triples import Triple, apart
from cpmkit.protocols import Floats, Ints

#: A way over the surface costs what is longer than so many chords and so many L.
FREE_CHORDS, FREE_SIZES = 1.5, 1.5
#: What it costs at most, in L: beyond it two feet do not hang together.
DEAREST_SIZES = 6.0


def chosen(net: Triangulation, points: Floats, feet: Feet) -> Feet:
    """Return one foot of each of consecutive ``points`` (n, 3).

    The shortest path over the candidates, with the cost distance + max(0, way - 1.5 chord - 1.5 L).
    """
    first = np.flatnonzero(np.diff(feet.point, prepend=-1))
    counts = np.diff(np.append(first, len(feet.point)))
    several = np.flatnonzero(counts > 1)
    pick = first.copy()
    # what lies between two points of one foot each is decided apart from the rest
    for run in np.split(several, np.flatnonzero(np.diff(several) > 1) + 1) if len(several) else []:
        stages = [
            np.arange(first[i], first[i] + counts[i]) for i in range(max(run[0] - 1, 0), min(run[-1] + 2, len(points)))
        ]
        pick[max(run[0] - 1, 0) : min(run[-1] + 2, len(points))] = _shortest(net, points, feet, stages)
    return feet.take(pick)


def _shortest(net: Triangulation, points: Floats, feet: Feet, stages: list[Ints]) -> list[int]:
    cost = {int(row): float(feet.distance[row]) for row in stages[0]}
    back: list[dict[int, int]] = []
    for here, there in pairwise(stages):
        steps = {int(row): _step_costs(net, points, feet, int(row), there) for row in here}
        best = {b: min((cost[a] + costs[b], a) for a, costs in steps.items()) for b in there.tolist()}
        back.append({b: a for b, (_, a) in best.items()})
        cost = {b: reached + float(feet.distance[b]) for b, (reached, _) in best.items()}
    path = [min(cost, key=lambda row: cost[row])]
    for came_from in reversed(back):
        path.append(came_from[path[-1]])
    return path[::-1]


def _step_costs(net: Triangulation, points: Floats, feet: Feet, row: int, there: Ints) -> dict[int, float]:
    """Return what the ways from one foot to those of the next point cost."""
    corners = set(net.cells[feet.cell[row]].tolist())
    costs = {int(b): 0.0 for b in there}
    far = [b for b in costs if not corners & set(net.cells[feet.cell[b]].tolist())]
    if not far:
        return costs
    size = float(net.sizes[feet.cell[row]])
    chord = float(np.linalg.norm(points[feet.point[far[0]]] - points[feet.point[row]]))
    free, dearest = FREE_CHORDS * chord + FREE_SIZES * size, DEAREST_SIZES * size
    here = place_of(net, int(feet.cell[row]), feet.shares[row])
    ways = ways_over_edges(net, {v: apart(here, net.at(v)) for v in corners}, free + dearest)
    for b in far:
        place = place_of(net, int(feet.cell[b]), feet.shares[b])
        way = min(ways.get(v, (np.inf, v))[0] + apart(place, net.at(v)) for v in net.cells[feet.cell[b]].tolist())
        costs[b] = min(max(0.0, way - free), dearest)
    return costs


def place_of(net: Triangulation, cell: int, shares: Floats) -> Triple:
    """Return the position of barycentric coordinates (3,) on a root."""
    x, y, z = (shares @ net.vertices[net.cells[cell]]).tolist()
    return x, y, z


def ways_over_edges(
    net: Triangulation,
    start: dict[int, float],
    limit: float,
    goal: int | None = None,
    beside: Callable[[int], Iterable[int]] | None = None,
) -> dict[int, tuple[float, int]]:
    """Return the length of the shortest way over edges to each vertex within ``limit``, and the vertex before it.

    Parameters
    ----------
    net : Triangulation
    start : dict
        How far the way already is at vertices where it may start.
    limit : float
    goal : int, optional
        Where the search may stop.
    beside : callable, optional
        Gives the vertices to which ways lead from a vertex; by default over all edges.
    """
    beside = beside or net.neighbours
    done: dict[int, tuple[float, int]] = {}
    heap = [(way, vertex, vertex) for vertex, way in start.items()]
    heap.sort()
    while heap:
        way, vertex, before = heappop(heap)
        if vertex in done:
            continue
        done[vertex] = way, before
        if vertex == goal:
            break
        here = net.at(vertex)
        for other in beside(vertex):
            if other not in done and (reached := way + apart(here, net.at(other))) <= limit:
                heappush(heap, (reached, other, vertex))
    return done


def way_back(ways: dict[int, tuple[float, int]], goal: int) -> list[int] | None:
    """Return the vertices of the way that was found to ``goal``, from its start on; None if there is none."""
    if goal not in ways:
        return None
    path = [goal]
    while (before := ways[path[-1]][1]) != path[-1]:
        path.append(before)
    return path[::-1]
