"""Vertices at one place, and cells that repeat others, without comparing all with all."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def places(vertices: Floats, along: Floats, order: Ints, tolerance: float) -> Ints:
    """Return (v,) the first vertex that each hangs together with over steps of at most ``tolerance``.

    Parameters
    ----------
    vertices : (v, d) float64
    along : (v,) float64
        Their coordinates along some direction of unit length: those farther apart in it are not near.
    order : (v,) int64
        By which those ascend.
    """
    first = np.arange(len(vertices))
    for i in range(len(order)):
        vertex = order[i]
        for j in range(i + 1, len(order)):
            other = order[j]
            if along[other] - along[vertex] > tolerance:
                break
            squared = 0.0
            for k in range(vertices.shape[1]):
                squared += (vertices[vertex, k] - vertices[other, k]) ** 2
            if squared <= tolerance * tolerance:
                a, b = vertex, other
                while first[a] != a:
                    a = first[a]
                while first[b] != b:
                    b = first[b]
                first[max(a, b)] = min(a, b)
    for vertex in range(len(first)):  # what a vertex leads to has a smaller number, and is done
        first[vertex] = first[first[vertex]]
    return first


@compiled
def distinct(corners: Ints, count: int) -> Bools:
    """Return which cells (m,), given by their corners in ascending order, repeat neither a corner nor another cell.

    Every one of the ``count`` vertices keeps a list of the cells of which it is the lowest corner.
    """
    head, following = np.full(count, -1, np.int64), np.empty(len(corners), np.int64)
    kept = np.ones(len(corners), np.bool_)
    for cell in range(len(corners)):
        for k in range(1, corners.shape[1]):
            if corners[cell, k] == corners[cell, k - 1]:
                kept[cell] = False
        other = head[corners[cell, 0]]
        while kept[cell] and other >= 0:
            same = True
            for k in range(1, corners.shape[1]):
                same = same and corners[cell, k] == corners[other, k]
            kept[cell] = not same
            other = following[other]
        if kept[cell]:
            following[cell], head[corners[cell, 0]] = head[corners[cell, 0]], cell
    return kept
