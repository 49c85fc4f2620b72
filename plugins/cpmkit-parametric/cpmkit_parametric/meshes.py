"""Meshes on a grid of parameters, closed where ends are glued."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_parametric.domain import Domain, Sides
from cpmkit_parametric.maps import UnitMap


def curve_mesh(map: UnitMap, domain: Domain, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, d) on the curve and segments (m, 2) of about equal arcs up to ``spacing``, along it.

    A closed curve has at least three segments.
    """
    s, arc = map.arc_lengths
    closed = bool(domain.periodic[0])
    count = max(int(np.ceil(arc[-1] / spacing)), 3 if closed else 1)
    at = np.interp(np.linspace(0, arc[-1], count + 1), arc, s)
    at[-1] = 1.0
    first = np.arange(count, dtype=np.int64)
    if closed:
        return map.value(at[:-1, None]), np.stack([first, (first + 1) % count], axis=1)
    return map.value(at[:, None]), np.stack([first, first + 1], axis=1)


def surface_mesh(map: UnitMap, domain: Domain, sides: Sides, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, 3) and triangles (m, 3), with legs along u and v up to about ``spacing``.

    Normals of the triangles are along x_u x x_v; on a flipped domain they change sides where its ends are glued.
    """
    least = np.where(domain.periodic, 3, 1 + sides.collapsed.all(axis=1))
    counts = [_count_intervals(map, axis, spacing, int(least[axis])) for axis in (0, 1)]
    n, m = counts
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij"))
    number = _vertex_numbers(i, j, counts, domain, sides).reshape(n + 1, m + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    ordered = np.sort(triangles, axis=1)
    triangles = triangles[(ordered[:, 1:] > ordered[:, :-1]).all(axis=1)]
    used, triangles = np.unique(triangles, return_inverse=True)
    vertices = map.value(np.stack([i[used] / n, j[used] / m], axis=1))
    return vertices, triangles.reshape(-1, 3).astype(np.int64)


def _vertex_numbers(i: Ints, j: Ints, counts: list[int], domain: Domain, sides: Sides) -> Ints:
    """Return the number (k,) of the vertex at each corner ``i``, ``j`` (k,) of a grid of ``counts`` (2) cells.

    Corners that are glued, or on the same pole, have one number.
    """
    n, m = counts
    if domain.periodic[0]:
        across = i == n
        i = np.where(across, 0, i)
        j = np.where(across & domain.flip, m - j, j)
    if domain.periodic[1]:
        j = j % m
    for end in (0, 1):
        j = np.where(sides.collapsed[0, end] & (i == end * n), 0, j)
        i = np.where(sides.collapsed[1, end] & (j == end * m), 0, i)
    return i * (m + 1) + j


def _count_intervals(map: UnitMap, axis: int, spacing: float, least: int) -> int:
    """Return the number, at least ``least``, of intervals of a parameter whose images are up to ``spacing`` long."""
    return max(int(np.ceil(map.largest_speeds[axis] / spacing)), least)
