"""Polylines of curves matched to a surface: each point is projected onto the sheet that the curve follows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from cpmkit.grid.lattice import cell_levels
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import Rows
from cpmkit.manifold.vector_algebra import in_three_dimensions, nearest_barycentric, norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.mixed_cells import Polyline, chain_segments
from cpmkit.meshing.contouring.curve_graph import trace_curve
from cpmkit.meshing.insertion.split_triangulation import SplitTriangulation, Vector, distance
from cpmkit.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Projections(Rows):
    """Projections of points onto triangles, sorted by point and then by distance."""

    point: Ints  #: (k,): the row of the projected point.
    cell: Ints  #: (k,): the triangle on which the projection lies.
    shares: Floats  #: (k, 3): barycentric coordinates of the projection in this triangle; zeros are exact on edges.
    distance: Floats  #: (k,): distance between the point and its projection.

    def positions(self, triangulation: SplitTriangulation) -> Floats:
        """Return the positions (k, 3) of the projections on the original triangles of a triangulation."""
        return np.asarray(
            np.einsum(
                "nk,nkd->nd", self.shares, triangulation.original.vertices[triangulation.original.cells[self.cell]]
            )
        )


@dataclass(frozen=True, eq=False)
class ProjectionSearch:
    """Flat triangles onto which points are projected."""

    mesh: Mesh
    #: (m,): the local edge length L of each triangle: projections up to L farther than the nearest one are candidates.
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
        """Return the local edge length (n,) of the triangle with the nearest centroid, and its distance (n,).

        This distance is an upper bound of the distance from the triangles.
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
        if not len(points):
            none = np.zeros(0, dtype=np.int64)
            return Projections(none, none, np.zeros((0, 3)), np.zeros(0))
        size, reach = self._nearest_centroid(points)
        projections = self._projections(points, size + reach)
        first = np.flatnonzero(np.diff(projections.point, prepend=-1))
        least = np.repeat(projections.distance[first], np.diff(np.append(first, len(projections.point))))
        projections = projections.take(projections.distance <= least + size[projections.point])
        return projections.take(self._are_local_minima(projections))

    def nearest(self, points: Floats) -> Projections:
        """Return the nearest projection of each of ``points`` (n, 3)."""
        if not len(points):
            return self.candidates(points)
        projections = self._projections(points, self._nearest_centroid(points)[1])
        return projections.take(np.flatnonzero(np.diff(projections.point, prepend=-1)))

    def _projections(self, points: Floats, reach: Floats) -> Projections:
        """Return the projections of ``points`` (n, 3) on triangles within ``reach`` (n,), the nearest of each first."""
        point, cell = self._near_pairs(points, reach)
        corners = self.mesh.vertices[self.mesh.cells[cell]]
        shares = nearest_barycentric(points[point], corners)
        away = norms(points[point] - np.einsum("nk,nkd->nd", shares, corners))
        return Projections(point, cell, shares, away).take(np.lexsort((cell, away, point)))

    def _near_pairs(self, points: Floats, reach: Floats) -> tuple[Ints, Ints]:
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


def barycentric_position(triangulation: SplitTriangulation, root: int, shares: Floats) -> Vector:
    """Return the position of the point with barycentric coordinates ``shares`` (3,) in original triangle ``root``."""
    x, y, z = (shares @ triangulation.original.vertices[triangulation.original.cells[root]]).tolist()
    return x, y, z


def match_to_surface(triangulation: SplitTriangulation, points: Floats, candidates: Projections) -> Projections:
    """Return one of the ``candidates`` for each of consecutive ``points`` (n, 3), so that the curve stays on its sheet.

    The sequence has the least total cost. Each projection costs its distance. Each step between triangles without a
    common vertex costs path - 1.5 (chord + L), at least 0 and at most 6 L, where path is the length of the shortest
    path over edges and L the local edge length. Candidates are those of :meth:`ProjectionSearch.candidates`, at least
    one per point.
    """
    first = np.flatnonzero(np.diff(candidates.point, prepend=-1))
    counts = np.diff(np.append(first, len(candidates.point)))
    several = np.flatnonzero(counts > 1)
    pick = first.copy()
    # runs of points between two points with a single candidate are decided separately
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

    For costs see :func:`match_to_surface`; a step between triangles with a common vertex costs nothing.
    """
    corners = set(triangulation.original.cells[candidates.cell[row]].tolist())
    costs = {int(b): 0.0 for b in there}
    far = [b for b in costs if not corners & set(triangulation.original.cells[candidates.cell[b]].tolist())]
    if not far:
        return costs
    size = float(triangulation.sizes[candidates.cell[row]])
    chord = float(np.linalg.norm(points[candidates.point[far[0]]] - points[candidates.point[row]]))
    free, most = 1.5 * (chord + size), 6.0 * size
    here = barycentric_position(triangulation, int(candidates.cell[row]), candidates.shares[row])
    lengths = triangulation.shortest_paths({v: distance(here, triangulation.position(v)) for v in corners}, free + most)
    for b in far:
        place = barycentric_position(triangulation, int(candidates.cell[b]), candidates.shares[b])
        cell = triangulation.original.cells[candidates.cell[b]].tolist()
        length = min(lengths.get(v, (np.inf, v))[0] + distance(place, triangulation.position(v)) for v in cell)
        costs[b] = min(max(0.0, length - free), most)
    return costs


def polylines_of_source(source: LocalSource, length: float) -> list[Polyline] | None:
    """Return the refined polylines of the curve's own mesh for the edge ``length``; None without a mesh of segments."""
    if not isinstance(source.source, HasMesh):
        return None
    vertices, cells = source.source.mesh(length)
    if cells.shape[1] != 2:
        return None
    vertices = np.asarray(vertices, dtype=np.float64) - source.shift
    return [refine_polyline(source, line, length) for line in chain_segments(vertices, cells)]


def refine_polyline(source: LocalSource, line: Polyline, length: float) -> Polyline:
    """Return a polyline with chords halved at points of the curve until midpoints are within .002 ``length`` of it.

    A closest point farther than .3 chords from the midpoint is on another branch, and does not count. A chord is halved
    up to twelve times, after which it may deviate by more.
    """
    points = np.concatenate([line.points, line.points[:1]]) if line.closed else line.points
    fresh = np.ones(len(points) - 1, dtype=bool)
    for _ in range(12):  # a limit: chords are halved so often
        rows = np.flatnonzero(fresh)
        if not len(rows):
            break
        chord = norms(points[rows + 1] - points[rows])
        middle = 0.5 * (points[rows] + points[rows + 1])
        closest = source.closest_point(middle).points
        off = norms(closest - middle)
        split = (off > 2e-3 * length) & (off < 0.3 * chord)
        points = np.insert(points, rows[split] + 1, closest[split], axis=0)
        halved = np.zeros(len(fresh), dtype=bool)
        halved[rows[split]] = True
        fresh = np.repeat(halved, np.where(halved, 2, 1))
    return Polyline(points[:-1] if line.closed else points, line.closed)


def simplify_polyline(points: Floats, tolerance: Floats) -> Ints:
    """Return rows (k,) of ``points`` (n, d) whose polyline passes every point within its ``tolerance`` (n,), a length.

    Rows ascend, from 0 to n - 1. Douglas and Peucker (1973).
    """
    used = np.zeros(len(points), dtype=bool)
    used[[0, -1]] = True
    waiting = [(0, len(points) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        inner = points[first + 1 : last] - points[first]
        chord = points[last] - points[first]
        square = float(chord @ chord)
        share = np.minimum(np.maximum(inner @ chord / square, 0.0), 1.0) if square > 0 else np.zeros(len(inner))
        excess = norms(inner - share[:, None] * chord) / tolerance[first + 1 : last]
        worst = first + 1 + int(excess.argmax())
        if excess[worst - first - 1] > 1:
            used[worst] = True
            waiting += [(first, worst), (worst, last)]
    return np.flatnonzero(used)


def trace_polylines(source: LocalSource, search: ProjectionSearch, spacing: float) -> list[Polyline]:
    """Return polylines on all pieces of a curve that is known by closest points alone.

    Traces start at the closest points of cells of half a spacing that the curve may meet, and continue in steps of .15
    L, where L is the local edge length of the triangles of ``search``. Polylines end at junctions, and have the
    direction of the curve's tangents, if any.
    """
    cells = next(blocks for side, blocks in cell_levels(source, 0.5 * spacing, 0.5) if side == 1)
    seeds = source.closest_point(np.asarray(cells * (0.5 * spacing), dtype=np.float64)).points
    size = float(np.median(search.local_size(in_three_dimensions(seeds))))
    graph = trace_curve(source, seeds, 0.15 * size)
    winding = Mesh.of(graph.vertices, graph.segments).winding
    segments = np.where((winding < 0)[:, None], graph.segments[:, ::-1], graph.segments)
    lines = chain_segments(graph.vertices, segments)
    return [refine_polyline(source, _orient_by_tangents(source, line), size) for line in lines]


def _orient_by_tangents(source: LocalSource, line: Polyline) -> Polyline:
    """Return ``line``, or its reverse if the curve's tangents have the opposite direction in its middle."""
    middle = len(line.points) // 2
    if source.has_tangents:
        tangent = source.tangents(source.closest_point(line.points[middle : middle + 1]))[0]
        if tangent @ (line.points[middle] - line.points[middle - 1]) < 0:
            return Polyline(line.points[::-1], line.closed)
    return line
