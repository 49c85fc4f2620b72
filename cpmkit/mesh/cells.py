"""Cells of mixed dimension in one array: triangles, segments and points, where shorter rows end in -1."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cpmkit.protocols import Ints


def with_corners(cells: Ints, corners: int) -> Ints:
    """Return those of ``cells`` (m, k) that have so many corners, as (n, corners).

    Examples
    --------
    >>> import numpy as np
    >>> cells = np.array([[0, 1, 2], [3, 4, -1], [5, -1, -1]])
    >>> with_corners(cells, 2).tolist(), with_corners(cells, 3).tolist()
    ([[3, 4]], [[0, 1, 2]])
    """
    if corners > cells.shape[1]:
        return np.zeros((0, corners), dtype=np.int64)
    return cells[(cells >= 0).sum(axis=1) == corners, :corners]


def padded(parts: Iterable[Ints]) -> Ints:
    """Return cells of several numbers of corners as one array; it is as wide as the widest part that has cells."""
    kept = [part for part in parts if len(part)]
    width = max((part.shape[1] for part in kept), default=1)
    rows = [np.pad(part, ((0, 0), (0, width - part.shape[1])), constant_values=-1) for part in kept]
    return np.concatenate(rows) if rows else np.zeros((0, width), dtype=np.int64)


def renumbered(cells: Ints, number: Ints) -> Ints:
    """Return ``cells`` with ``number[v]`` in place of each vertex v."""
    return np.where(cells >= 0, number[cells], -1)


def edges_of(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the (e, 2) edges of triangles or of segments among ``count`` vertices, and the edges' numbers by cell.

    Edge k of a cell joins its corners k and k + 1; a segment has one, a point none.
    """
    corners = cells.shape[1]
    ends = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1)[:, : corners if corners > 2 else corners - 1]
    low, high = ends.min(axis=-1), ends.max(axis=-1)
    keys, cell_edges = np.unique(low * count + high, return_inverse=True)
    return np.stack([keys // count, keys % count], axis=1), cell_edges.reshape(low.shape)
