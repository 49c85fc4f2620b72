"""Triangles that can be split at points and at edges; what is far from every curve is never touched."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from cpmkit.manifold.vectors import norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.insertion.triples import Triple, along, between, cross, direction, dot, less
from cpmkit.protocols import Bools, Floats, Ints

Edge = tuple[int, int]


def edge_of(a: int, b: int) -> Edge:
    """Return the edge between two vertices, whatever its direction."""
    return (a, b) if a < b else (b, a)


@dataclass(eq=False)
class Triangulation:
    """A mesh of triangles that is being split. Rows of it are read when they are first asked for.

    Attributes
    ----------
    vertices : (v, 3) float64
        The vertices given.
    cells : (m, 3) int64
        The triangles given, the *roots* of those into which they are split.
    longest : float
        What :meth:`size` is at most.
    halves : dict
        The vertex at which an edge was split; an edge that was split is none any more.
    """

    vertices: Floats
    cells: Ints
    longest: float
    halves: dict[Edge, int] = field(default_factory=dict)
    _points: dict[int, Triple] = field(default_factory=dict)
    _corners: dict[int, tuple[int, int, int]] = field(default_factory=dict)
    _fans: dict[int, list[int]] = field(default_factory=dict)
    _root: dict[int, int] = field(default_factory=dict)
    _parts: dict[int, list[int]] = field(default_factory=dict)
    _normals: dict[int, Triple] = field(default_factory=dict)
    _vertex_normals: dict[int, Triple] = field(default_factory=dict)
    _vertex_count: int = 0
    _cell_count: int = 0

    def __post_init__(self) -> None:
        self._vertex_count, self._cell_count = len(self.vertices), len(self.cells)

    @cached_property
    def sizes(self) -> Floats:
        """(m,) the mean edge of each root, but no more than ``longest``."""
        a, b, c = (self.vertices[self.cells[:, k]] for k in range(3))
        return np.asarray(np.minimum((norms(b - a) + norms(c - b) + norms(a - c)) / 3, self.longest))

    @cached_property
    def _given_fans(self) -> tuple[Ints, Ints]:
        """Where the triangles of each vertex start in the list of them, and the list."""
        from cpmkit.runtime.inverse_index import inverse_index

        starts, places = inverse_index(self.cells.ravel(), len(self.vertices))
        return starts, places // 3

    def _given_fan(self, vertex: int) -> list[int]:
        start, cells = self._given_fans
        found: list[int] = cells[start[vertex] : start[vertex + 1]].tolist()
        return found

    def at(self, vertex: int) -> Triple:
        """Return the position of a vertex."""
        place = self._points.get(vertex)
        if place is None:
            x, y, z = self.vertices[vertex].tolist()
            place = self._points[vertex] = (x, y, z)
        return place

    def corners(self, cell: int) -> tuple[int, int, int]:
        """Return the vertices of a triangle."""
        found = self._corners.get(cell)
        if found is None:
            a, b, c = self.cells[cell].tolist()
            found = self._corners[cell] = (a, b, c)
        return found

    def fan(self, vertex: int) -> list[int]:
        """Return the triangles at a vertex."""
        found = self._fans.get(vertex)
        if found is None:
            found = self._fans[vertex] = self._given_fan(vertex)
        return found

    def cells_at(self, a: int, b: int) -> list[int]:
        """Return the triangles at an edge: two inside, one on a rim, none where there is no edge."""
        return [cell for cell in self.fan(a) if b in self.corners(cell)]

    def neighbours(self, vertex: int) -> set[int]:
        """Return the other ends of the edges at a vertex."""
        return {other for cell in self.fan(vertex) for other in self.corners(cell)} - {vertex}

    def root(self, cell: int) -> int:
        """Return the triangle given that a triangle is part of."""
        return self._root.get(cell, cell)

    def parts(self, root: int) -> list[int]:
        """Return the triangles into which a root is split."""
        return self._parts.get(root, [root])

    def size(self, vertex: int) -> float:
        """Return L, the mean edge of a root at the vertex."""
        return float(self.sizes[self.root(self.fan(vertex)[0])])

    def normal(self, cell: int) -> Triple:
        """Return the unit normal of a triangle, that of its root."""
        root = self.root(cell)
        found = self._normals.get(root)
        if found is None:
            a, b, c = (self.at(corner) for corner in self.cells[root].tolist())
            found = self._normals[root] = direction(cross(less(b, a), less(c, a)))
        return found

    def vertex_normal(self, vertex: int) -> Triple:
        """Return the mean of the roots' normals at a vertex, of the sign of the first; splits do not change it."""
        found = self._vertex_normals.get(vertex)
        if found is None:
            total: Triple = (0.0, 0.0, 0.0)
            for root in sorted({self.root(cell) for cell in self.fan(vertex)}):
                n = self.normal(root)
                total = along(total, 1.0 if dot(total, n) >= 0 else -1.0, n)
            found = self._vertex_normals[vertex] = direction(total)
        return found

    def on_rim(self, vertex: int) -> bool:
        """Return whether an edge at the vertex has one triangle only."""
        times: dict[int, int] = {}
        for cell in self.fan(vertex):
            for other in self.corners(cell):
                times[other] = times.get(other, 0) + 1
        return 1 in times.values()

    def rim_edge(self, a: int, b: int) -> bool:
        """Return whether an edge has one triangle only."""
        return len(self.cells_at(a, b)) == 1

    @cached_property
    def rims(self) -> Bools:
        """(m, 3) which edges of roots, by the corners opposite to them, have no other root beside them."""
        from cpmkit.mesh.mesh_kernels import number_edges

        of_cells = number_edges(np.ascontiguousarray(self.cells), len(self.vertices))[1]
        return np.asarray(np.bincount(of_cells.ravel())[of_cells] == 1)

    @cached_property
    def roots_on_rim(self) -> frozenset[int]:
        """The roots that have such an edge."""
        return frozenset(np.flatnonzero(self.rims.any(axis=1)).tolist())

    def split_edge(self, a: int, b: int, share: float) -> int:
        """Return a new vertex on an edge, at ``share`` of the way from a to b; all its triangles are split there."""
        new = self._new_vertex(between(self.at(a), self.at(b), share))
        self.halves[edge_of(a, b)] = new
        for cell in self.cells_at(a, b):
            corners = self.corners(cell)
            far = self._new_cell(cell, _with(corners, a, new))
            self._corners[cell] = _with(corners, b, new)
            fan = self.fan(b)
            fan[fan.index(cell)] = far
            self.fan(sum(corners) - a - b).append(far)
            self.fan(new).extend((cell, far))
        return new

    def split_cell(self, cell: int, place: Triple) -> int:
        """Return a new vertex inside a triangle, which is split in three."""
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

    def expanded(self, path: list[int]) -> list[int]:
        """Return a path over vertices with all at which its edges were split since."""
        found = path[:1]
        for goal in path[1:]:
            todo = [goal]
            while todo:
                middle = self.halves.get(edge_of(found[-1], todo[-1]))
                if middle is None:
                    found.append(todo.pop())
                else:
                    todo.append(middle)
        return found

    def mesh(self, dim: int) -> Mesh:
        """Return the triangles as they are now, in ``dim`` coordinates; no boundary cuts them yet."""
        new = [self._points[vertex] for vertex in range(len(self.vertices), self._vertex_count)]
        vertices = np.concatenate([self.vertices, np.array(new).reshape(-1, 3)])[:, :dim]
        cells = np.concatenate([self.cells, np.empty((self._cell_count - len(self.cells), 3), dtype=np.int64)])
        known = list(self._corners)
        cells[known] = np.array([self._corners[cell] for cell in known], dtype=np.int64).reshape(-1, 3)
        return Mesh.of(np.ascontiguousarray(vertices), cells)

    def _new_vertex(self, place: Triple) -> int:
        new = self._vertex_count
        self._vertex_count += 1
        self._points[new], self._fans[new] = place, []
        return new

    def _new_cell(self, part_of: int, corners: tuple[int, int, int]) -> int:
        new, root = self._cell_count, self.root(part_of)
        self._cell_count += 1
        self._corners[new], self._root[new] = corners, root
        self._parts.setdefault(root, [root]).append(new)
        return new


def _with(corners: tuple[int, int, int], old: int, new: int) -> tuple[int, int, int]:
    a, b, c = corners
    return new if a == old else a, new if b == old else b, new if c == old else c
