"""A triangulation whose triangles can be split at points and edges, at a cost that does not depend on their number.

Positions are tuples of three numbers, since arrays are slow for single vertices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from heapq import heapify, heappop, heappush
from math import sqrt

import numpy as np

from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.runtime.index_sets import inverse_index
from cpmkit.types import Bools, Floats, Ints

Vector = tuple[float, float, float]
Edge = tuple[int, int]


def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def add_scaled(a: Vector, t: float, b: Vector) -> Vector:
    """Return a + t b."""
    return a[0] + t * b[0], a[1] + t * b[1], a[2] + t * b[2]


def interpolate(a: Vector, b: Vector, t: float) -> Vector:
    """Return the point at the share ``t`` of the way from a to b."""
    return a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2])


def dot(a: Vector, b: Vector) -> float:
    """Return the inner product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product of a and b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def norm(a: Vector) -> float:
    """Return the Euclidean norm of a vector."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def distance(a: Vector, b: Vector) -> float:
    """Return the distance between two points."""
    return norm(subtract(a, b))


def normalize(a: Vector) -> Vector:
    """Return ``a`` over its norm; zero stays zero."""
    size = norm(a)
    return (a[0] / size, a[1] / size, a[2] / size) if size > 0 else a


def nearest_share_on_segment(p: Vector, a: Vector, b: Vector) -> float:
    """Return the share, from 0 to 1, of the way from a to b of the point nearest to p."""
    way = subtract(b, a)
    square = dot(way, way)
    return min(1.0, max(0.0, dot(subtract(p, a), way) / square)) if square > 0 else 0.0


def edge_key(a: int, b: int) -> Edge:
    """Return the edge between two vertices without its direction: the lower number first."""
    return (a, b) if a < b else (b, a)


@dataclass(eq=False)
class SplitTriangulation:
    """A triangulation that is being split. An original triangle is the *root* of the triangles that it contains."""

    original: Mesh  #: The original triangles, with vertices in space.
    longest: float  #: An upper bound of :meth:`size`.
    midvertices: dict[Edge, int] = field(default_factory=dict)  #: The vertex at which each former edge was split.
    _points: dict[int, Vector] = field(default_factory=dict)
    _corners: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    _fans: dict[int, list[int]] = field(default_factory=dict)
    _root: dict[int, int] = field(default_factory=dict)
    _parts: dict[int, list[int]] = field(default_factory=dict)
    _normals: dict[int, Vector] = field(default_factory=dict)
    _vertex_normals: dict[int, Vector] = field(default_factory=dict)
    _vertex_count: int = 0
    _cell_count: int = 0

    def __post_init__(self) -> None:
        self._vertex_count, self._cell_count = len(self.original.vertices), len(self.original.cells)

    @cached_property
    def sizes(self) -> Floats:
        """(m,) local edge length L: the mean edge of each original triangle, at most ``longest``."""
        a, b, c = self.original.vertices[self.original.cells].transpose(1, 0, 2)
        return np.asarray(np.minimum((norms(b - a) + norms(c - b) + norms(a - c)) / 3, self.longest))

    @cached_property
    def _roots_of_vertices(self) -> tuple[Ints, Ints]:
        """(v + 1,) starts of the lists of original triangles at each vertex, and (3 m,) these lists joined."""
        starts, places = inverse_index(self.original.cells.ravel(), len(self.original.vertices))
        return starts, places // 3

    def position(self, vertex: int) -> Vector:
        """Return the position of a vertex."""
        place = self._points.get(vertex)
        if place is None:
            x, y, z = self.original.vertices[vertex].tolist()
            place = self._points[vertex] = (x, y, z)
        return place

    def corners(self, cell: int) -> tuple[int, int, int]:
        """Return the vertices of a triangle."""
        corners = self._corners.get(cell)
        if corners is None:
            a, b, c = self.original.cells[cell].tolist()
            corners = self._corners[cell] = (a, b, c)
        return corners

    def fan(self, vertex: int) -> list[int]:
        """Return the triangles at a vertex, in no order: the internal list, which callers must not change."""
        fan = self._fans.get(vertex)
        if fan is None:
            start, roots = self._roots_of_vertices
            fan = self._fans[vertex] = roots[start[vertex] : start[vertex + 1]].tolist()
        return fan

    def cells_of_edge(self, a: int, b: int) -> list[int]:
        """Return the triangles at an edge: one on a rim, two or more inside, none where there is no edge."""
        return [cell for cell in self.fan(a) if b in self.corners(cell)]

    def neighbours(self, vertex: int) -> set[int]:
        """Return the other ends of the edges at a vertex."""
        return {other for cell in self.fan(vertex) for other in self.corners(cell)} - {vertex}

    def root(self, cell: int) -> int:
        """Return the root of a triangle: the original triangle that contains it."""
        return self._root.get(cell, cell)

    def parts(self, root: int) -> list[int]:
        """Return the triangles into which an original triangle, the ``root``, is split."""
        return self._parts.get(root, [root])

    def size(self, vertex: int) -> float:
        """Return the local edge length L at a vertex: that of an original triangle there, see ``sizes``."""
        return float(self.sizes[self.root(self.fan(vertex)[0])])

    def normal(self, cell: int) -> Vector:
        """Return the unit normal of a triangle, which is that of the original triangle that contains it."""
        root = self.root(cell)
        normal = self._normals.get(root)
        if normal is None:
            a, b, c = (self.position(corner) for corner in self.original.cells[root].tolist())
            normal = self._normals[root] = normalize(cross(subtract(b, a), subtract(c, a)))
        return normal

    def vertex_normal(self, vertex: int) -> Vector:
        """Return the unit normal at a vertex: the normalised sum of the normals of the original triangles there.

        A normal that points against the sum of the preceding normals is flipped. Splits do not change the result.
        """
        normal = self._vertex_normals.get(vertex)
        if normal is None:
            total: Vector = (0.0, 0.0, 0.0)
            for root in sorted({self.root(cell) for cell in self.fan(vertex)}):
                n = self.normal(root)
                total = add_scaled(total, 1.0 if dot(total, n) >= 0 else -1.0, n)
            normal = self._vertex_normals[vertex] = normalize(total)
        return normal

    def is_on_rim(self, vertex: int) -> bool:
        """Return whether the vertex lies on a rim: an edge there has only one triangle."""
        times: dict[int, int] = {}
        for cell in self.fan(vertex):
            for other in self.corners(cell):
                times[other] = times.get(other, 0) + 1
        return 1 in times.values()

    def is_rim_edge(self, a: int, b: int) -> bool:
        """Return whether the edge between two vertices lies on a rim: it has only one triangle."""
        return len(self.cells_of_edge(a, b)) == 1

    @cached_property
    def rim_edges(self) -> Bools:
        """(m, 3) whether the edge opposite to each corner of an original triangle belongs to this triangle only."""
        connectivity = self.original.connectivity
        return connectivity.on_rim[connectivity.facet_numbers]

    @cached_property
    def roots_on_rim(self) -> frozenset[int]:
        """Numbers of the original triangles with an edge on the rim."""
        return frozenset(np.flatnonzero(self.rim_edges.any(axis=1)).tolist())

    def split_edge(self, a: int, b: int, share: float) -> int:
        """Split an edge and all its triangles at ``share`` of the way from a to b, and return the new vertex."""
        new = self._new_vertex(interpolate(self.position(a), self.position(b), share))
        self.midvertices[edge_key(a, b)] = new
        for cell in self.cells_of_edge(a, b):
            corners = self.corners(cell)
            far = self._new_cell(cell, _replace_corner(corners, a, new))
            self._corners[cell] = _replace_corner(corners, b, new)
            fan = self.fan(b)
            fan[fan.index(cell)] = far
            self.fan(sum(corners) - a - b).append(far)
            self.fan(new).extend((cell, far))
        return new

    def split_cell(self, cell: int, place: Vector) -> int:
        """Split a triangle in three at a point inside it, and return the new vertex."""
        new = self._new_vertex(place)
        a, b, c = self.corners(cell)
        second, third = self._new_cell(cell, (b, c, new)), self._new_cell(cell, (c, a, new))
        self._corners[cell] = (a, b, new)
        self.fan(a).append(third)
        self.fan(b).append(second)
        fan = self.fan(c)
        fan[fan.index(cell)] = second
        fan.append(third)
        self.fan(new).extend((cell, second, third))
        return new

    def refine_path(self, path: list[int]) -> list[int]:
        """Return a path over edges, with the vertices at which its edges have been split since."""
        refined = path[:1]
        for goal in path[1:]:
            waiting = [goal]
            while waiting:
                middle = self.midvertices.get(edge_key(refined[-1], waiting[-1]))
                if middle is None:
                    refined.append(waiting.pop())
                else:
                    waiting.append(middle)
        return refined

    def mesh(self, dim: int) -> Mesh:
        """Return the current triangles as a mesh with the first ``dim`` coordinates, without boundaries."""
        old = self.original
        new = [self._points[vertex] for vertex in range(len(old.vertices), self._vertex_count)]
        vertices = np.concatenate([old.vertices, np.array(new).reshape(-1, 3)])[:, :dim]
        cells = np.concatenate([old.cells, np.empty((self._cell_count - len(old.cells), 3), dtype=np.int64)])
        known = list(self._corners)
        cells[known] = np.array([self._corners[cell] for cell in known], dtype=np.int64).reshape(-1, 3)
        return Mesh.of(np.ascontiguousarray(vertices), cells)

    def _new_vertex(self, place: Vector) -> int:
        """Return a new vertex at the point ``place``, which no triangle has yet."""
        new = self._vertex_count
        self._vertex_count += 1
        self._points[new], self._fans[new] = place, []
        return new

    def _new_cell(self, part_of: int, corners: tuple[int, int, int]) -> int:
        """Return the number of a new triangle with ``corners``; its root is that of the triangle ``part_of``."""
        new, root = self._cell_count, self.root(part_of)
        self._cell_count += 1
        self._corners[new], self._root[new] = corners, root
        self._parts.setdefault(root, [root]).append(new)
        return new

    def shortest_paths(
        self,
        start: dict[int, float],
        limit: float,
        goal: int | None = None,
        neighbours: Callable[[int], Iterable[int]] | None = None,
    ) -> dict[int, tuple[float, int]]:
        """Return the length of the shortest path over edges to each vertex, and the vertex before it (Dijkstra).

        Vertices out of reach are left out. The vertex before a start is the start itself.
        ``start``: the vertices where paths may start, and the length with which a path starts at each.
        ``limit``: largest length of a path. ``goal``: a vertex at which the search stops; farther ones are left out.
        ``neighbours``: returns the vertices to which paths lead from a vertex; by default over all edges.
        """
        neighbours = neighbours or self.neighbours
        done: dict[int, tuple[float, int]] = {}
        heap = [(length, vertex, vertex) for vertex, length in start.items()]
        heapify(heap)
        while heap:
            length, vertex, before = heappop(heap)
            if vertex in done:
                continue
            done[vertex] = length, before
            if vertex == goal:
                break
            here = self.position(vertex)
            for other in neighbours(vertex):
                if other not in done and (reached := length + distance(here, self.position(other))) <= limit:
                    heappush(heap, (reached, other, vertex))
        return done

    def shortest_path(
        self, start: int, goal: int, limit: float, neighbours: Callable[[int], Iterable[int]] | None = None
    ) -> list[int] | None:
        """Return the vertices of the shortest path over edges, not longer than ``limit``; None if there is none.

        ``neighbours`` as in :meth:`shortest_paths`.
        """
        paths = self.shortest_paths({start: 0.0}, limit, goal, neighbours)
        if goal not in paths:
            return None
        path = [goal]
        while (before := paths[path[-1]][1]) != path[-1]:
            path.append(before)
        return path[::-1]


def _replace_corner(corners: tuple[int, int, int], old: int, new: int) -> tuple[int, int, int]:
    """Return the ``corners`` with vertex ``new`` in place of ``old``."""
    a, b, c = corners
    return new if a == old else a, new if b == old else b, new if c == old else c
