"""Compiled: triangles without area removed, and loops filled by triangles of least area."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Bools, Floats, Ints
from cpmkit.runtime.compilation import compiled


@compiled
def remove_flaps(candidates: Ints, of: Ints, count: Ints, on_rim: Bools, alive: Bools) -> int:
    """Remove those of ``candidates`` (c,) that hang on an edge of three or more, or on one edge alone, until none does.

    A flap has an edge ``of`` (m, 3) with one triangle off rims and one with three or more, or two of the former, or
    two with one triangle anywhere and one with three or more; the most open go first. ``count`` (e,) and ``alive``
    (m,) follow; edges that become open count as on a rim. The number that was removed is returned.
    """
    removed = 0
    while True:
        best, most = -1, 0
        for cell in candidates:
            if not alive[cell]:
                continue
            alone = off_rim = crowded = 0
            for j in range(3):
                edge = of[cell, j]
                alone += count[edge] == 1
                off_rim += count[edge] == 1 and not on_rim[edge]
                crowded += count[edge] > 2
            ear = off_rim > 1 or (alone > 1 and crowded > 0)
            if (ear or (off_rim > 0 and crowded > 0)) and alone > most:
                best, most = cell, alone
        if best < 0:
            return removed
        alive[best] = False
        removed += 1
        for j in range(3):
            edge = of[best, j]
            count[edge] -= 1
            if count[edge] == 1:
                on_rim[edge] = True  # not known: it is looked at in the next round


@compiled
def _area(points: Floats, i: int, j: int, k: int) -> float:
    ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    area: float = 0.5 * np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
    return area


@compiled
def least_area(points: Floats) -> Ints:
    """Return the triangles (n - 2, 3) on a closed polygon (n, 3) with the least area in sum (Barequet, Sharir 1995)."""
    n = len(points)
    cost, via = np.zeros((n, n)), np.zeros((n, n), dtype=np.int64)
    for width in range(2, n):
        for i in range(n - width):
            j = i + width
            cost[i, j] = np.inf
            for k in range(i + 1, j):
                total = cost[i, k] + cost[k, j] + _area(points, i, k, j)
                if total < cost[i, j]:
                    cost[i, j], via[i, j] = total, k
    triangles = np.empty((n - 2, 3), dtype=np.int64)
    stack = np.empty((n, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, n - 1
    depth, made = 1, 0
    while depth > 0:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        if j - i < 2:
            continue
        k = via[i, j]
        triangles[made, 0], triangles[made, 1], triangles[made, 2] = i, k, j
        made += 1
        stack[depth, 0], stack[depth, 1] = i, k
        stack[depth + 1, 0], stack[depth + 1, 1] = k, j
        depth += 2
    return triangles
