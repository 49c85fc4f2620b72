"""The part of a mesh where a function is negative: cells that its zero crosses are cut."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, number_edges, rotate_triangles


def clipped(vertices: Floats, cells: Ints, values: Floats, onto: Callable[[Floats], Floats]) -> tuple[Floats, Ints]:
    """Return the vertices and cells of the part where ``values`` are negative.

    Parameters
    ----------
    vertices : (v, d) float64
    cells : (m, k) int64
        Segments or triangles.
    values : (v,) float64
        At the vertices.
    onto : callable
        Moves points (n, d), zeros of the linear interpolation, to where the part ends.
    """
    kept = values < 0
    edges, cell_edges = number_edges(cells, len(vertices))
    a, b = edges.T
    crossed = np.flatnonzero(kept[a] != kept[b])
    a, b = a[crossed], b[crossed]
    with np.errstate(all="ignore"):
        share = np.clip(np.nan_to_num(values[a] / (values[a] - values[b]), nan=0.5), 0.0, 1.0)[:, None]
    number = np.full(len(edges), -1)
    number[crossed] = len(vertices) + np.arange(len(crossed))
    points = np.concatenate([vertices, onto((1 - share) * vertices[a] + share * vertices[b])])
    split = _segments if cells.shape[1] == 2 else _triangles
    cells = split(cells, number[cell_edges], kept[cells])
    used, cells = np.unique(cells, return_inverse=True)
    return points[used], cells.reshape(-1, cells.shape[-1]).astype(np.int64)


def _segments(cells: Ints, crossings: Ints, kept: Bools) -> Ints:
    half = kept.sum(axis=1) == 1
    cut = np.where(kept[half], cells[half], crossings[half])
    return np.concatenate([cells[kept.all(axis=1)], cut])


def _triangles(cells: Ints, crossings: Ints, kept: Bools) -> Ints:
    """Return whole triangles, corners where one vertex is kept, and halves of the quadrangles where two are."""
    count = kept.sum(axis=1)
    one, two = count == 1, count == 2
    (a, _, _), (ab, _, ca) = rotate_triangles(cells[one], crossings[one], kept[one].argmax(axis=1))
    corner = np.stack([a, ab, ca], axis=1)
    # the vertex that goes comes first
    (_, b, c), (ab, _, ca) = rotate_triangles(cells[two], crossings[two], kept[two].argmin(axis=1))
    halves = [np.stack([ab, b, c], axis=1), np.stack([ab, c, ca], axis=1)]
    return np.concatenate([cells[count == 3], corner, *halves])
