"""A polyline matched to a surface: the projection of each of its points onto the sheet that the curve follows."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.insertion.split_triangulation import SplitTriangulation, Vector, distance
from cpmkit.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Projections:
    """Projections of points onto triangles, sorted by point and then by distance.

    Attributes
    ----------
    point : (k,) int64
        The row of the projected point.
    cell : (k,) int64
        The triangle on which the projection lies.
    shares : (k, 3) float64
        Barycentric coordinates of the projection in this triangle; zeros are exact on edges.
    distance : (k,) float64
        Distance between the point and its projection.
    """

    point: Ints
    cell: Ints
    shares: Floats
    distance: Floats

    def take(self, rows: Ints | Bools) -> Projections:
        """Return the projections at ``rows``, integers or a mask."""
        return Projections(self.point[rows], self.cell[rows], self.shares[rows], self.distance[rows])

    @classmethod
    def concatenate(cls, parts: list[Projections]) -> Projections:
        """Return the projections of all ``parts``, one part after the other."""
        return cls(*(np.concatenate([getattr(part, column.name) for part in parts]) for column in fields(cls)))

    def places(self, triangulation: SplitTriangulation) -> Floats:
        """Return the positions (k, 3) of the projections on the original triangles of a triangulation."""
        return np.asarray(
            np.einsum(
                "nk,nkd->nd", self.shares, triangulation.original.vertices[triangulation.original.cells[self.cell]]
            )
        )


@dataclass(frozen=True, eq=False)
class TriangleSearch:
    """Flat triangles onto which points are projected.

    Attributes
    ----------
    mesh : Mesh
    sizes : (m,) float64
        The local edge length L of each triangle: projections up to L farther than the nearest one are candidates.
    """

    mesh: Mesh
    sizes: Floats

    @cached_property
    def _size_classes(self) -> list[tuple[float, Ints, Any]]:
        """The largest radius, the triangles (k,) and the k-d tree of centroids of each class of similar size."""
        from scipy.spatial import cKDTree

        a, b, c = (self.mesh.vertices[self.mesh.cells[:, k]] for k in range(3))
        centroids = (a + b + c) / 3
        radii = np.maximum(np.maximum(norms(a - centroids), norms(b - centroids)), norms(c - centroids))
        exponent = np.frexp(radii)[1]
        members = [np.flatnonzero(exponent == value) for value in np.unique(exponent)]
        trees = [cKDTree(centroids[cells], balanced_tree=False, compact_nodes=False) for cells in members]
        return [(float(radii[cells].max()), cells, tree) for cells, tree in zip(members, trees, strict=True)]

    def local_size(self, points: Floats) -> Floats:
        """Return the local edge length L (n,) of the triangle with the centroid nearest to each point (n, 3)."""
        return self._nearest_centroid(points)[0]

    def _nearest_centroid(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the local edge length (n,) of the triangle with the nearest centroid, and the distance (n,) of that.

        The distance of the centroid is an upper bound of the distance from the triangles.
        """
        nearest, size = np.full(len(points), np.inf), np.zeros(len(points))
        for _, cells, tree in self._size_classes:
            distances, row = tree.query(points)
            nearer = distances < nearest
            nearest[nearer], size[nearer] = distances[nearer], self.sizes[cells[row[nearer]]]
        return size, nearest

    def candidates(self, points: Floats) -> Projections:
        """Return the projections of ``points`` (n, 3) at local minima of the distance, up to L above the least one.

        L is the local edge length, see ``sizes``.
        """
        size, reach = self._nearest_centroid(points)
        point, cell = self._pairs_within(points, size + reach)
        shares = nearest_barycentric(points[point], self.mesh.vertices[self.mesh.cells[cell]])
        away = norms(points[point] - np.einsum("nk,nkd->nd", shares, self.mesh.vertices[self.mesh.cells[cell]]))
        order = np.lexsort((cell, away, point))
        projections = Projections(point, cell, shares, away).take(order)
        first = np.flatnonzero(np.diff(projections.point, prepend=-1))
        least = np.repeat(projections.distance[first], np.diff(np.append(first, len(order))))
        projections = projections.take(projections.distance <= least + size[projections.point])
        return projections.take(self._are_local_minima(projections))

    def nearest(self, points: Floats) -> Projections:
        """Return the nearest projection of each of ``points`` (n, 3)."""
        projections = self.candidates(points)
        return projections.take(np.flatnonzero(np.diff(projections.point, prepend=-1)))

    def _pairs_within(self, points: Floats, reach: Floats) -> tuple[Ints, Ints]:
        """Return the points (p,) and the triangles (p,) of all pairs that may be within the point's ``reach`` (n,)."""
        rows, cells = [], []
        for radius, members, tree in self._size_classes:
            lists = tree.query_ball_point(points, reach + radius)
            rows.append(np.repeat(np.arange(len(points)), [len(hits) for hits in lists]))
            cells.append(members[np.concatenate([np.asarray(hits, dtype=np.int64) for hits in lists])])
        return np.concatenate(rows), np.concatenate(cells)

    def _are_local_minima(self, projections: Projections) -> Bools:
        """Return for each projection (k,) whether it is a local minimum of the distance from its point.

        No triangle with a common vertex then has a nearer projection of the point. Projections are sorted by distance.
        """
        rank = np.arange(len(projections.point))
        keys = projections.point[:, None] * len(self.mesh.vertices) + self.mesh.cells[projections.cell]
        _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        lowest: Bools = (first[inverse].reshape(keys.shape) // 3 >= rank[:, None]).all(axis=1)
        return lowest


def nearest_barycentric(points: Floats, corners: Floats) -> Floats:
    """Return the barycentric coordinates (n, 3) of the point of each triangle (n, 3, d) nearest to ``points`` (n, d).

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
    zero, unity = np.zeros(len(points)), np.ones(len(points))
    cases = [
        ((d1 <= 0) & (d2 <= 0), (unity, zero, zero)),
        ((d3 >= 0) & (d4 <= d3), (zero, unity, zero)),
        ((d6 >= 0) & (d5 <= d6), (zero, zero, unity)),
        ((vc <= 0) & (d1 >= 0) & (d3 <= 0), (1 - on_ab, on_ab, zero)),
        ((vb <= 0) & (d2 >= 0) & (d6 <= 0), (1 - on_ac, zero, on_ac)),
        ((va <= 0) & (d4 >= d3) & (d5 >= d6), (zero, 1 - on_bc, on_bc)),
    ]
    conditions = [condition[:, None] for condition, _ in cases]
    return np.select(conditions, [np.stack(shares, axis=1) for _, shares in cases], inside)


def position_on(triangulation: SplitTriangulation, root: int, shares: Floats) -> Vector:
    """Return the position of the point with barycentric coordinates ``shares`` (3,) in an original triangle."""
    x, y, z = (shares @ triangulation.original.vertices[triangulation.original.cells[root]]).tolist()
    return x, y, z


def match_to_surface(triangulation: SplitTriangulation, points: Floats, candidates: Projections) -> Projections:
    """Return one projection for each of consecutive ``points`` (n, 3), chosen so that the curve stays on its sheet.

    The sequence of ``candidates`` has least total cost: the distances of the projections plus, for each step, the
    length of the path over the surface in excess of 1.5 chords and 1.5 local edge lengths, at most 6 of these.
    """
    first = np.flatnonzero(np.diff(candidates.point, prepend=-1))
    counts = np.diff(np.append(first, len(candidates.point)))
    several = np.flatnonzero(counts > 1)
    pick = first.copy()
    # What lies between two points of one candidate each is decided separately.
    for run in np.split(several, np.flatnonzero(np.diff(several) > 1) + 1) if len(several) else []:
        rows = range(max(run[0] - 1, 0), min(run[-1] + 2, len(points)))
        stages = [np.arange(first[i], first[i] + counts[i]) for i in rows]
        pick[rows.start : rows.stop] = _cheapest_sequence(triangulation, points, candidates, stages)
    return candidates.take(pick)


def _cheapest_sequence(
    triangulation: SplitTriangulation, points: Floats, candidates: Projections, stages: list[Ints]
) -> list[int]:
    """Return one row of ``candidates`` from each stage, with the least total cost (dynamic programming).

    A stage contains the rows of the candidates of one point.
    """
    cost = {int(row): float(candidates.distance[row]) for row in stages[0]}
    back: list[dict[int, int]] = []
    for here, there in pairwise(stages):
        steps = {int(row): _step_costs(triangulation, points, candidates, int(row), there) for row in here}
        best = {b: min((cost[a] + costs[b], a) for a, costs in steps.items()) for b in there.tolist()}
        back.append({b: a for b, (_, a) in best.items()})
        cost = {b: reached + float(candidates.distance[b]) for b, (reached, _) in best.items()}
    path = [min(cost, key=lambda row: cost[row])]
    for came_from in reversed(back):
        path.append(came_from[path[-1]])
    return path[::-1]


def _step_costs(
    triangulation: SplitTriangulation, points: Floats, candidates: Projections, row: int, there: Ints
) -> dict[int, float]:
    """Return the cost of the step from candidate ``row`` to each candidate of the next point, the rows ``there``.

    See :func:`match_to_surface`; the step between triangles with a common vertex is free.
    """
    corners = set(triangulation.original.cells[candidates.cell[row]].tolist())
    costs = {int(b): 0.0 for b in there}
    far = [b for b in costs if not corners & set(triangulation.original.cells[candidates.cell[b]].tolist())]
    if not far:
        return costs
    size = float(triangulation.sizes[candidates.cell[row]])
    chord = float(np.linalg.norm(points[candidates.point[far[0]]] - points[candidates.point[row]]))
    free, most = 1.5 * (chord + size), 6.0 * size
    here = position_on(triangulation, int(candidates.cell[row]), candidates.shares[row])
    lengths = triangulation.shortest_paths({v: distance(here, triangulation.at(v)) for v in corners}, free + most)
    for b in far:
        place = position_on(triangulation, int(candidates.cell[b]), candidates.shares[b])
        cell = triangulation.original.cells[candidates.cell[b]].tolist()
        length = min(lengths.get(v, (np.inf, v))[0] + distance(place, triangulation.at(v)) for v in cell)
        costs[b] = min(max(0.0, length - free), most)
    return costs
