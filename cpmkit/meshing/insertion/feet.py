"""Feet on flat triangles: all local minima of the distance to them that may be meant."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.manifold.vectors import dots, norms
from cpmkit.protocols import Bools, Floats, Ints

#: Points that are looked up at a time.
POINTS_AT_A_TIME = 20_000


@dataclass(frozen=True, eq=False)
class Feet:
    """Feet of points on triangles, sorted by point and then by distance.

    Attributes
    ----------
    point : (k,) int64
        Which point each is a foot of.
    cell : (k,) int64
        The triangle it lies on.
    shares : (k, 3) float64
        Its barycentric coordinates there; zeros are exact on edges.
    distance : (k,) float64
    """

    point: Ints
    cell: Ints
    shares: Floats
    distance: Floats

    def take(self, rows: Ints | Bools) -> Feet:
        """Return some of them."""
        return Feet(self.point[rows], self.cell[rows], self.shares[rows], self.distance[rows])


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles that are asked for feet.

    Attributes
    ----------
    vertices : (v, 3) float64
    cells : (m, 3) int64
    sizes : (m,) float64
        L of each: feet up to so much farther than the nearest count.
    """

    vertices: Floats
    cells: Ints
    sizes: Floats

    @cached_property
    def _classes(self) -> list[tuple[float, Ints, Any]]:
        """The radius, the triangles and the tree over centroids of each class of about one size."""
        from scipy.spatial import cKDTree

        a, b, c = (self.vertices[self.cells[:, k]] for k in range(3))
        centroids = (a + b + c) / 3
        radii = np.maximum(np.maximum(norms(a - centroids), norms(b - centroids)), norms(c - centroids))
        number = np.frexp(radii)[1]
        members = [np.flatnonzero(number == one) for one in np.unique(number)]
        trees = [cKDTree(centroids[own], balanced_tree=False, compact_nodes=False) for own in members]
        return [(float(radii[own].max()), own, tree) for own, tree in zip(members, trees, strict=True)]

    def nearest_size(self, points: Floats) -> tuple[Floats, Floats]:
        """Return L where each of ``points`` (n, 3) is, and the distance (n,) to a centroid, above that to the mesh."""
        distance, size = np.full(len(points), np.inf), np.zeros(len(points))
        for _, cells, tree in self._classes:
            found, row = tree.query(points)
            nearer = found < distance
            distance[nearer], size[nearer] = found[nearer], self.sizes[cells[row[nearer]]]
        return size, distance

    def feet(self, points: Floats) -> Feet:
        """Return the feet of ``points`` (n, 3), of each the nearest and others up to L farther."""
        found = [self._feet(points, start) for start in range(0, len(points), POINTS_AT_A_TIME)]
        return Feet(*(np.concatenate(columns) for columns in zip(*[_columns(part) for part in found], strict=True)))

    def nearest(self, points: Floats) -> Feet:
        """Return the nearest foot of each of ``points`` (n, 3)."""
        found = self.feet(points)
        return found.take(np.flatnonzero(np.diff(found.point, prepend=-1)))

    def _feet(self, points: Floats, start: int) -> Feet:
        part = points[start : start + POINTS_AT_A_TIME]
        size, reach = self.nearest_size(part)
        point, cell = self._pairs(part, size + reach)
        shares = barycentric(part[point], self.vertices[self.cells[cell]])
        distance = norms(part[point] - np.einsum("nk,nkd->nd", shares, self.vertices[self.cells[cell]]))
        order = np.lexsort((cell, distance, point))
        found = Feet(point, cell, shares, distance).take(order)
        first = np.flatnonzero(np.diff(found.point, prepend=-1))
        nearest = np.repeat(found.distance[first], np.diff(np.append(first, len(order))))
        found = found.take(found.distance <= nearest + size[found.point])
        found = found.take(self._lowest(found))
        return Feet(found.point + start, found.cell, found.shares, found.distance)

    def _pairs(self, points: Floats, reach: Floats) -> tuple[Ints, Ints]:
        """Return points and triangles that may be within ``reach`` (n,)."""
        rows, cells = [], []
        for radius, own, tree in self._classes:
            lists = tree.query_ball_point(points, reach + radius)
            rows.append(np.repeat(np.arange(len(points)), [len(one) for one in lists]))
            cells.append(own[np.concatenate([np.asarray(one, dtype=np.int64) for one in lists])])
        return np.concatenate(rows), np.concatenate(cells)

    def _lowest(self, feet: Feet) -> Bools:
        """Return which feet no triangle with a common vertex has a nearer one beside; they come sorted."""
        rank = np.arange(len(feet.point))
        keys = feet.point[:, None] * len(self.vertices) + self.cells[feet.cell]
        _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        lowest: Bools = (first[inverse].reshape(keys.shape) // 3 >= rank[:, None]).all(axis=1)
        return lowest


def _columns(feet: Feet) -> tuple[Any, ...]:
    return feet.point, feet.cell, feet.shares, feet.distance


def barycentric(points: Floats, corners: Floats) -> Floats:
    """Return the barycentric coordinates (n, 3) of the points of triangles (n, 3, d) nearest to ``points`` (n, d).

    Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    a, b, c = (corners[:, k] for k in range(3))
    ab, ac = b - a, c - a
    d1, d2 = dots(ab, points - a), dots(ac, points - a)
    d3, d4 = dots(ab, points - b), dots(ac, points - b)
    d5, d6 = dots(ab, points - c), dots(ac, points - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    with np.errstate(all="ignore"):
        on_ab, on_ac = d1 / (d1 - d3), d2 / (d2 - d6)
        on_bc = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        inside = np.stack([va, vb, vc], axis=1) / (va + vb + vc)[:, None]
    zero, one = np.zeros(len(points)), np.ones(len(points))
    cases = [
        ((d1 <= 0) & (d2 <= 0), (one, zero, zero)),
        ((d3 >= 0) & (d4 <= d3), (zero, one, zero)),
        ((d6 >= 0) & (d5 <= d6), (zero, zero, one)),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), (1 - on_ab, on_ab, zero)),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), (1 - on_ac, zero, on_ac)),
        ((va <= 0) & (d4 >= d3) & (d5 >= d6), (zero, 1 - on_bc, on_bc)),
    ]
    conditions = [condition[:, None] for condition, _ in cases]
    return np.select(conditions, [np.stack(shares, axis=1) for _, shares in cases], inside)
