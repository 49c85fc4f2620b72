"""Normals at the vertices of triangles, also where these are not wound alike, as on surfaces with one side."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import unit
from cpmkit.protocols import Bools, Floats, Ints


def vertex_normals(points: Floats, triangles: Ints) -> Floats:
    """Return (v, 3) unit normals at the vertices: the mean of the triangles around, weighted by area.

    At an edge whose two triangles are wound against each other their normals would cancel: there those of all
    triangles around a vertex are turned to the side of the first.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    twice_area = np.cross(b - a, c - a)
    at_corners = np.repeat(twice_area, 3, axis=0)  # (3 t, 3)
    vertices = triangles.ravel()
    turned = np.flatnonzero(on_turned_edges(triangles, len(points))[vertices])
    if len(turned):
        found, first = np.unique(vertices[turned], return_index=True)
        reference = np.zeros(len(points), dtype=np.int64)
        reference[found] = turned[first]
        along = np.einsum("ij,ij->i", at_corners[turned], at_corners[reference[vertices[turned]]])
        at_corners[turned[along < 0]] *= -1
    total = np.empty_like(points)
    for axis in range(3):
        total[:, axis] = np.bincount(vertices, at_corners[:, axis], minlength=len(points))
    return unit(total)


def on_turned_edges(triangles: Ints, count: int) -> Bools:
    """Tell which of ``count`` vertices (v,) lie on an edge that two triangles pass the same way."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    passed, times = np.unique(starts * np.int64(count) + ends, return_counts=True)
    found = np.zeros(count, dtype=bool)
    for side in np.divmod(passed[times > 1], count):
        found[side] = True
    return found
