"""Compiled: which of a cell's crossings hang together, found by pairs."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.disjoint_sets import find


@compiled
def unite_flat(
    start: Ints, member: Ints, points: Floats, normals: Floats, sine: float, cosine: float, lost: float, group: Ints
) -> None:
    """Unite entries of ``group`` (k,) inside each cell whose chord is flat; entry i is the crossing ``member[i]``."""
    for cell in range(len(start) - 1):
        for i in range(start[cell], start[cell + 1]):
            for j in range(start[cell], i):
                square = along_a = along_b = alike = 0.0
                for k in range(points.shape[1]):
                    chord = points[member[i], k] - points[member[j], k]
                    square += chord * chord
                    along_a += chord * normals[member[i], k]
                    along_b += chord * normals[member[j], k]
                    alike += normals[member[i], k] * normals[member[j], k]
                reach = sine * np.sqrt(square) + lost
                if 0.5 * (abs(along_a) + abs(along_b)) <= reach and abs(alike) > cosine:
                    group[find(group, i)] = find(group, j)
    for i in range(len(group)):
        group[i] = find(group, i)


@compiled
def unite(first: Ints, second: Ints, group: Ints) -> None:
    """Unite the given pairs of entries of ``group``."""
    for i in range(len(first)):
        group[find(group, first[i])] = find(group, second[i])
    for i in range(len(group)):
        group[i] = find(group, i)


@compiled
def nearest_pairs(start: Ints, member: Ints, points: Floats, group: Ints, pairs: Ints) -> int:
    """Write the nearest pair of entries of every two groups of a cell to ``pairs``, and return how many there are.

    With ``pairs`` (0, 2) they are counted alone.
    """
    count = 0
    for cell in range(len(start) - 1):
        for a in range(start[cell], start[cell + 1]):
            if group[a] != a:
                continue
            for b in range(start[cell], a):
                if group[b] != b:
                    continue
                if len(pairs):
                    best = -1.0
                    for i in range(start[cell], start[cell + 1]):
                        for j in range(start[cell], start[cell + 1]):
                            if group[i] == a and group[j] == b:
                                square = 0.0
                                for k in range(points.shape[1]):
                                    square += (points[member[i], k] - points[member[j], k]) ** 2
                                if best < 0.0 or square < best:
                                    best = square
                                    pairs[count, 0] = i
                                    pairs[count, 1] = j
                count += 1
    return count
