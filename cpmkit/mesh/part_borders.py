"""Edges of a mesh split where the parts of a boundary meet, so that no edge lies in two parts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.mesh.subdivision import halve_edges, split_segments
from cpmkit.types import Floats, Ints

#: Parts that meet nearer to an end of an edge than this share of its length count as meeting at the end.
LEAST_SHARE = 0.01
#: Bisections of an edge: to rounding.
BISECTIONS = 50


#: Returns the number (n,) of the part of a boundary at points (n, d), relative to the lattice's origin.
PartAt = Callable[[Floats], Ints]


def split_at_parts(mesh: Mesh, edges: Ints, part_at: PartAt, geometry: CellGeometry, source: LocalSource) -> Mesh:
    """Return a flat mesh with ``edges`` (k,), or segments, ascending, split where the part changes along them.

    ``part_at`` gives the part of a boundary at a point. An edge whose ends lie in one part stays whole, and so do all
    edges if ``geometry`` is "normals". If it is "closest_point", the part of a point is that of its closest point on
    the ``source``.
    """
    if geometry == "normals":
        return mesh
    is_curve = mesh.manifold_dim == 1
    ends = (mesh.cells if is_curve else mesh.edges.ends)[edges]
    a, b = mesh.vertices[ends].transpose(1, 0, 2)

    def part_along(rows: Ints, share: Floats | float) -> Ints:
        """Return the part (r,) at a ``share`` (r, 1) of the edges ``rows`` (r,) of those given."""
        points = a[rows] + share * (b - a)[rows]
        return part_at(points if geometry == "flat" else source.closest_point(points).points)

    rows = np.arange(len(edges))
    first = part_along(rows, LEAST_SHARE)
    rows = np.flatnonzero(first != part_along(rows, 1 - LEAST_SHARE))
    if not len(rows):
        return mesh
    low, high = np.full((len(rows), 1), LEAST_SHARE), np.full((len(rows), 1), 1 - LEAST_SHARE)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        before = (part_along(rows, middle) == first[rows])[:, None]
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    points = a[rows] + 0.5 * (low + high) * (b - a)[rows]
    if is_curve:
        return split_segments(mesh, edges[rows], points)
    vertex = np.full(len(mesh.edges.ends), -1)
    vertex[edges[rows]] = len(mesh.vertices) + np.arange(len(rows))
    return halve_edges(mesh, vertex, points)
