"""Compiled: nearest samples, components of touching patches, distances from flat cells, path lengths on a mesh."""

from __future__ import annotations

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints


@compiled
def group_touching_patches(patches: Ints, pairs: Ints, count: int) -> Ints:
    """Return the connected components (k, q) of the ``patches`` (k, q) in each row, as the first column of each.

    Two patches of a row are connected if they touch. ``pairs`` (t,) are the ascending codes ``first * count + second``
    of patches that touch, first < second; ``count`` is the number of patches.
    """
    rows, width = patches.shape
    group = np.empty((rows, width), dtype=np.int64)
    for row in range(rows):
        component = group[row]
        for j in range(width):
            component[j] = j
            for i in range(j):
                if component[i] == component[j]:
                    continue
                first, second = min(patches[row, i], patches[row, j]), max(patches[row, i], patches[row, j])
                touch = first == second
                if not touch:
                    code = first * count + second
                    at = np.searchsorted(pairs, code)
                    touch = at < len(pairs) and pairs[at] == code
                if touch:
                    low, high = min(component[i], component[j]), max(component[i], component[j])
                    for m in range(j + 1):
                        if component[m] == high:
                            component[m] = low
    return group


@compiled
def distances_to_cells(points: Floats, vertices: Floats, cells: Ints) -> Floats:
    """Return the distances (k, q) of ``points`` (k, d) from flat cells near each point.

    ``cells`` (k, q, c) are the numbers of the cells' corners among ``vertices`` (n, d): c = 2 for segments, 3 for
    triangles.
    """
    rows, width, corners = cells.shape
    distance = np.empty((rows, width))
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
            distance[row, j] = np.sqrt(least)
    return distance


@compiled
def path_lengths_to_corners(
    points: Floats, cells: Ints, group: Ints, ends: Ints, reach: Floats, vertices: Floats, starts: Ints, others: Ints
) -> Floats:
    """Return the total length (k, q) of the shortest paths from a point over the cells of a group to all ``ends``.

    All cells of a group have the same length; the length of cells left out is infinite.

    Parameters
    ----------
    points : (k, d) float64
        The points.
    cells : (k, q, c) int64
        The vertices at the corners of the cells near each point.
    group : (k, q) int64
        Number of the group of each cell; -1 for cells that are left out.
    ends : (k, c) int64
        The vertices at which the paths of each point end, -1 for none.
    reach : (k,) float64
        Paths are followed up to this length; longer ones count as infinite.
    vertices : (n, d) float64
        The vertices of the mesh.
    starts, others : (n + 1,) and (2 e,) int64
        The neighbours of each vertex over edges, in compressed rows.
    """
    rows, width, corners = cells.shape
    lengths = np.full((rows, width), -1.0)
    distance = np.full(len(vertices), np.inf)
    waiting = np.zeros(len(vertices), dtype=np.bool_)
    for row in range(rows):
        for first in range(width):
            component = group[row, first]
            if component < 0 or lengths[row, first] >= 0:
                continue
            reached = [np.int64(0) for _ in range(0)]
            queue = [np.int64(0) for _ in range(0)]
            for j in range(first, width):
                if group[row, j] != component:
                    continue
                for i in range(corners):
                    at = np.int64(cells[row, j, i])
                    if distance[at] == np.inf:
                        off = vertices[at] - points[row]
                        distance[at] = np.sqrt((off * off).sum())
                        waiting[at] = True
                        reached.append(at)
                        queue.append(at)
            done = 0
            while done < len(queue):
                at = queue[done]
                done += 1
                waiting[at] = False
                for place in range(starts[at], starts[at + 1]):
                    to = np.int64(others[place])
                    step = vertices[to] - vertices[at]
                    candidate = distance[at] + np.sqrt((step * step).sum())
                    if candidate < distance[to] and candidate <= reach[row]:
                        if distance[to] == np.inf:
                            reached.append(to)
                        distance[to] = candidate
                        if not waiting[to]:
                            waiting[to] = True
                            queue.append(to)
            total = 0.0
            for i in range(ends.shape[1]):
                if ends[row, i] >= 0:
                    total += distance[ends[row, i]]
            for at in reached:
                distance[at] = np.inf
            for j in range(first, width):
                if group[row, j] == component:
                    lengths[row, j] = total
    return np.where(lengths < 0, np.inf, lengths)


@compiled
def nearest_in_cells(
    points: Floats, around: Ints, lower: Ints, strides: Ints, codes: Ints, starts: Ints, samples: Floats, count: int
) -> tuple[Floats, Ints, Bools]:
    """Return the nearest samples of each point among the samples in its lattice cell and the neighbouring cells.

    Parameters
    ----------
    points : (k, d) float64
        The points, in units of the spacing.
    around : (3^d, d) int64
        Offsets of neighbouring cells, the cell itself first and the farthest last.
    lower, strides : (d,) int64
        The cell whose code is zero, and the increment of the code along each axis. Cells outside the numbered box,
        which contain no samples, may have the code of another cell.
    codes, starts : (p,) and (p + 1,) int64
        Codes of cells that contain samples, ascending, and the first sample of each.
    samples : (q, d) float64
        The samples, in units of the spacing, ordered by cell.
    count : int
        Number of samples to return for each point.

    Returns
    -------
    squares, numbers : (k, count) float64 and int64
        Squared distances, ascending, and numbers of samples.
    complete : (k,) bool
        Whether no nearer sample can lie outside the neighbouring cells.
    """
    d = points.shape[1]
    squares, numbers = np.full((len(points), count), np.inf), np.zeros((len(points), count), dtype=np.int64)
    complete = np.zeros(len(points), dtype=np.bool_)
    for k in range(len(points)):
        for step in around:
            apart, code = 0.0, 0
            for axis in range(d):
                cell = np.int64(np.floor(points[k, axis] + 0.5))
                to_plane = 0.5 - step[axis] * (points[k, axis] - cell)
                apart += abs(step[axis]) * to_plane * to_plane
                code += (cell + step[axis] - lower[axis]) * strides[axis]
            if apart >= squares[k, count - 1]:
                continue
            row = np.searchsorted(codes, code)
            while row < len(codes) and codes[row] == code:
                for q in range(starts[row], starts[row + 1]):
                    square = 0.0
                    for axis in range(d):
                        square += (points[k, axis] - samples[q, axis]) ** 2
                    if square < squares[k, count - 1]:
                        insert_sample(squares[k], numbers[k], square, q)
                row += 1
        complete[k] = squares[k, count - 1] <= 1.0
    return squares, numbers, complete


@compiled
def insert_sample(squares: Floats, numbers: Ints, square: float, q: int) -> None:
    """Insert sample ``q`` with squared distance ``square`` into the lists of the nearest samples; drop the farthest.

    ``squares`` and ``numbers`` (count,) are ascending in the squared distance.
    """
    at = len(numbers) - 1
    while at > 0 and squares[at - 1] > square:
        squares[at], numbers[at] = squares[at - 1], numbers[at - 1]
        at -= 1
    squares[at], numbers[at] = square, q
