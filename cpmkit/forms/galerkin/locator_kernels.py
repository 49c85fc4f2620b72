"""Compiled: groups of patches that touch, distances to flat cells, and ways along the edges of a mesh."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints


@compiled
def grouped(patches: Ints, pairs: Ints, count: int) -> Ints:
    """Return groups (k, q) of the ``patches`` (k, q) of each row that touch, by the first place of each.

    ``pairs`` (t,) are ``first * count + second`` of patches that touch, first < second, ascending.
    """
    rows, width = patches.shape
    group = np.empty((rows, width), dtype=np.int64)
    for row in range(rows):
        own = group[row]
        for j in range(width):
            own[j] = j
            for i in range(j):
                if own[i] == own[j]:
                    continue
                first, second = min(patches[row, i], patches[row, j]), max(patches[row, i], patches[row, j])
                touch = first == second
                if not touch:
                    code = first * count + second
                    at = np.searchsorted(pairs, code)
                    touch = at < len(pairs) and pairs[at] == code
                if touch:
                    kept, gone = min(own[i], own[j]), max(own[i], own[j])
                    for m in range(j + 1):
                        if own[m] == gone:
                            own[m] = kept
    return group


@compiled
def distances_to_cells(points: Floats, vertices: Floats, cells: Ints) -> Floats:
    """Return the distances (k, q) of ``points`` (k, d) from flat ``cells`` (k, q, 2 or 3), by their ``vertices``."""
    rows, width, corners = cells.shape
    found = np.empty((rows, width))
    for row in range(rows):
        for j in range(width):
            a = vertices[cells[row, j, 0]]
            least = np.inf
            if corners == 3:
                u, v, w = vertices[cells[row, j, 1]] - a, vertices[cells[row, j, 2]] - a, points[row] - a
                uu, uv, vv, uw, vw = (u * u).sum(), (u * v).sum(), (v * v).sum(), (u * w).sum(), (v * w).sum()
                area = uu * vv - uv * uv
                s, t = vv * uw - uv * vw, uu * vw - uv * uw
                if area > 0 and s >= 0 and t >= 0 and s + t <= area:
                    off = w - (s * u + t * v) / area
                    least = (off * off).sum()
            for i in range(corners if corners == 3 else 1):
                start, end = vertices[cells[row, j, i]], vertices[cells[row, j, (i + 1) % corners]]
                along, from_start = end - start, points[row] - start
                length = (along * along).sum()
                share = min(max((along * from_start).sum() / length, 0.0), 1.0) if length > 0 else 0.0
                off = from_start - share * along
                least = min(least, (off * off).sum())
            found[row, j] = np.sqrt(least)
    return found


@compiled
def ways_to_corners(
    points: Floats, cells: Ints, group: Ints, ends: Ints, reach: Floats, vertices: Floats, starts: Ints, others: Ints
) -> Floats:
    """Return how long the ways (k, q) from ``points`` over each group's ``cells`` to all of ``ends`` are together.

    Parameters
    ----------
    points : (k, d) float64
    cells : (k, q, c) int64
        The corners of cells near each.
    group : (k, q) int64
        Cells of one group have one number; -1 for cells that are left out.
    ends : (k, c) int64
        Vertices, -1 for none.
    reach : (k,) float64
        Ways are followed so far: a longer one is infinite.
    vertices : (n, d) float64
    starts, others : (n + 1,) and (2 e,) int64
        The vertices that share an edge with each.
    """
    rows, width, corners = cells.shape
    found = np.full((rows, width), -1.0)
    way = np.full(len(vertices), np.inf)
    waiting = np.zeros(len(vertices), dtype=np.bool_)
    for row in range(rows):
        for first in range(width):
            own = group[row, first]
            if own < 0 or found[row, first] >= 0:
                continue
            seen = [np.int64(0) for _ in range(0)]
            queue = [np.int64(0) for _ in range(0)]
            for j in range(first, width):
                if group[row, j] != own:
                    continue
                for i in range(corners):
                    at = np.int64(cells[row, j, i])
                    if way[at] == np.inf:
                        off = vertices[at] - points[row]
                        way[at] = np.sqrt((off * off).sum())
                        waiting[at] = True
                        seen.append(at)
                        queue.append(at)
            done = 0
            while done < len(queue):
                at = queue[done]
                done += 1
                waiting[at] = False
                for place in range(starts[at], starts[at + 1]):
                    to = np.int64(others[place])
                    step = vertices[to] - vertices[at]
                    longer = way[at] + np.sqrt((step * step).sum())
                    if longer < way[to] and longer <= reach[row]:
                        if way[to] == np.inf:
                            seen.append(to)
                        way[to] = longer
                        if not waiting[to]:
                            waiting[to] = True
                            queue.append(to)
            total = 0.0
            for i in range(ends.shape[1]):
                if ends[row, i] >= 0:
                    total += way[ends[row, i]]
            for at in seen:
                way[at] = np.inf
            for j in range(first, width):
                if group[row, j] == own:
                    found[row, j] = total
    return np.where(found < 0, np.inf, found)


@compiled
def nearest_in_cells(
    points: Floats, around: Ints, lower: Ints, strides: Ints, codes: Ints, starts: Ints, samples: Floats, count: int
) -> tuple[Floats, Ints, Bools]:
    """Return the nearest samples of points among those in the lattice cells around each.

    Parameters
    ----------
    points : (k, d) float64
        In spacings.
    around : (3^d, d) int64
        Steps to the cells around one, itself first and the farthest last.
    lower, strides : (d,) int64
        The cell whose code is zero, and what a step along each axis adds: of cells beyond the numbered box, which hold
        no samples, the code may be another's.
    codes, starts : (p,) and (p + 1,) int64
        Of cells that hold samples, ascending, and where those of each begin.
    samples : (q, d) float64
        In spacings, cell after cell.
    count : int
        How many are wanted.

    Returns
    -------
    squares, near : (k, count) float64 and int64
        Squared distances, ascending, and numbers of samples.
    complete : (k,) bool
        Of which points these are the nearest of all: of others some are farther than the cells around reach.
    """
    d = points.shape[1]
    squares, near = np.full((len(points), count), np.inf), np.zeros((len(points), count), dtype=np.int64)
    complete = np.zeros(len(points), dtype=np.bool_)
    for k in range(len(points)):
        for step in around:
            apart, code = 0.0, 0
            for axis in range(d):
                own = np.int64(np.floor(points[k, axis] + 0.5))
                to_plane = 0.5 - step[axis] * (points[k, axis] - own)
                apart += abs(step[axis]) * to_plane * to_plane
                code += (own + step[axis] - lower[axis]) * strides[axis]
            if apart >= squares[k, count - 1]:
                continue
            row = np.searchsorted(codes, code)
            while row < len(codes) and codes[row] == code:
                for q in range(starts[row], starts[row + 1]):
                    square = 0.0
                    for axis in range(d):
                        square += (points[k, axis] - samples[q, axis]) ** 2
                    if square < squares[k, count - 1]:
                        insert(squares[k], near[k], square, q)
                row += 1
        complete[k] = squares[k, count - 1] <= 1.0
    return squares, near, complete


@compiled
def insert(squares: Floats, near: Ints, square: float, q: int) -> None:
    """Put a sample in its place among those found, ascending by distance, the farthest of which is dropped."""
    at = len(near) - 1
    while at > 0 and squares[at - 1] > square:
        squares[at], near[at] = squares[at - 1], near[at - 1]
        at -= 1
    squares[at], near[at] = square, q
