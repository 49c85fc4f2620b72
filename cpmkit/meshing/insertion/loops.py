"""Short loops of a curve over a mesh that no one drew: spikes of feet, swallowtails, the jitter of a drawing."""

from __future__ import annotations

from collections import Counter

from cpmkit.meshing.insertion.triangulation import Triangulation
from cpmkit.meshing.insertion.triples import apart

#: Loops of a curve through itself that are shorter than so many L are no part of it.
SHORTEST_LOOP_SIZES = 2.0
#: The same for loops on which feet go back while the curve goes on: it is drawn off the surface there.
SHORTEST_BACKWARD_SIZES = 4.0


def without_loops(net: Triangulation, path: list[int], backward: set[int], told: Counter[str]) -> list[int]:
    """Return a path with its short loops erased, those through the start of a closed one too; counted as ``erased``.

    ``backward`` are the vertices between which feet go back while the curve goes on.
    """
    path = _erased(net, path, backward, told)
    if len(path) > 2 and path[0] == path[-1]:
        half = len(path) // 2
        path = _erased(net, path[half:] + path[1 : half + 1], backward, told)
    return path


def _erased(net: Triangulation, path: list[int], backward: set[int], told: Counter[str]) -> list[int]:
    kept, way = path[:1], [0.0]
    place = {path[0]: 0}
    for vertex in path[1:]:
        if vertex == kept[-1]:
            continue
        reached = way[-1] + apart(net.at(kept[-1]), net.at(vertex))
        before = place.get(vertex)
        if before is not None and reached - way[before] < _shortest(net, kept[before:], backward):
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


def _shortest(net: Triangulation, loop: list[int], backward: set[int]) -> float:
    sizes = SHORTEST_LOOP_SIZES if backward.isdisjoint(loop) else SHORTEST_BACKWARD_SIZES
    return sizes * net.size(loop[0])
