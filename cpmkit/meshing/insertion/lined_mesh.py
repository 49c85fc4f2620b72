"""A triangulation with boundaries on some of its edges, into which points are put."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

from cpmkit.meshing.insertion.triangulation import Edge, Triangulation, edge_of
from cpmkit.meshing.insertion.triples import (
    Triple,
    apart,
    between,
    cross,
    dot,
    length,
    less,
    share_along,
)

#: Nearer than this, in L, to a vertex or an edge a point is there.
AT_SHARE = 1e-3
#: The same where vertices are moved later, along the surface, and those of curves onto these; ends of curves are not.
AT_MOVABLE_SHARE = 0.02
#: The same for vertices and edges of other boundaries.
AT_OTHER_SHARE = 1e-7
#: The same for edges and vertices on a rim.
AT_RIM_SHARE = 0.02
#: The largest of these.
FARTHEST_SHARE = max(AT_SHARE, AT_MOVABLE_SHARE, AT_OTHER_SHARE, AT_RIM_SHARE)
#: A boundary that coincides with an earlier one is put on what of it lies within this share of L.
SAME_LINE_SHARE = 0.1


class Line(NamedTuple):
    """An edge on a boundary, in its direction of travel; ``extends`` where it goes on past a tip."""

    tail: int
    head: int
    owner: int
    beyond_tip: bool = False


@dataclass(eq=False)
class LinedMesh:
    """A triangulation that knows which edges boundaries lie on.

    Attributes
    ----------
    net : Triangulation
    point_share : float
        How near, in L, to a vertex or an edge a point is there.
    owner : int
        The number of the boundary that is being inserted.
    at_end : bool
        Whether what is inserted is the end of a curve, which stays where it is.
    close : frozenset of int
        Boundaries that run so close to others that a line is not to be bent towards vertices.
    cut : dict
        What lies on the edges of boundaries.
    lines : dict
        Owners of the boundaries at each vertex.
    """

    net: Triangulation
    point_share: float = AT_SHARE
    owner: int = 0
    at_end: bool = False
    close: frozenset[int] = frozenset()
    cut: dict[Edge, Line] = field(default_factory=dict)
    lines: dict[int, set[int]] = field(default_factory=dict)

    def inserted(self, root: int, place: Triple) -> int:
        """Return the vertex at a point of a root, a new one unless one lies there."""
        net = self.net
        cell = self._part(root, place)
        size = float(net.sizes[root])
        for a, b in self._lines_first(root, cell):
            share = share_along(place, net.at(a), net.at(b))
            gap = apart(place, between(net.at(a), net.at(b), share))
            if gap < FARTHEST_SHARE * size and gap < self._reach(a, b) * size:
                return self.on_edge(a, b, share, size)
        return net.split_cell(cell, place)

    def _part(self, root: int, place: Triple) -> int:
        """Return the part of a root that holds a point."""
        parts = self.net.parts(root)
        return parts[0] if len(parts) == 1 else max(parts, key=lambda part: _within(self.net, part, place))

    def on_line(self, root: int, place: Triple, owner: int) -> int | None:
        """Return the vertex, a new one unless one lies there, of a boundary near a point of a root, if there is one."""
        net, size = self.net, self.net.sizes[root]
        edges = edges_within(net, [self._part(root, place)], place, SAME_LINE_SHARE * size)
        gaps = {}
        for a, b in edges:
            line = self.cut.get(edge_of(a, b))
            if line is not None and line.owner == owner:
                share = share_along(place, net.at(a), net.at(b))
                gaps[apart(place, between(net.at(a), net.at(b), share))] = (a, b, share)
        return self.on_edge(*gaps[min(gaps)], size) if gaps else None

    def _lines_first(self, root: int, cell: int) -> list[Edge]:
        """Return the edges at which a point in ``cell`` may lie: boundaries and rims of the root, then its own."""
        net, rim = self.net, root in self.net.roots_on_rim
        edges = [edge for part in net.parts(root) for edge in _edges(net.corners(part))]
        lines = [edge for edge in edges if edge_of(*edge) in self.cut or (rim and net.rim_edge(*edge))]
        return lines + _edges(net.corners(cell))

    def _reach(self, a: int, b: int) -> float:
        line = self.cut.get(edge_of(a, b))
        if line is not None and line.owner != self.owner:
            return AT_OTHER_SHARE
        return AT_RIM_SHARE if self.net.rim_edge(a, b) else self._at_share

    def _at_vertex(self, vertex: int) -> float:
        """Return how near, in L, a point is at a vertex; lines of others stay apart as far as can be."""
        owners = self.lines.get(vertex)
        return AT_OTHER_SHARE if owners and self.owner not in owners else self._at_share

    @property
    def _at_share(self) -> float:
        """How near, in L, a point is at a vertex or an edge."""
        if self.owner in self.close:
            return AT_OTHER_SHARE
        return AT_SHARE if self.at_end else self.point_share

    def on_edge(self, a: int, b: int, share: float, size: float) -> int:
        """Return the vertex at ``share`` of the way from a to b: one of them, or a new one."""
        whole = apart(self.net.at(a), self.net.at(b))
        near_a, near_b = share * whole, (1 - share) * whole
        at_a, at_b = (self._at_vertex(vertex) * size for vertex in (a, b))
        if near_a <= near_b and near_a < at_a:
            return a
        if near_b < at_b:
            return b
        if near_a < at_a:
            return a
        return self.split(a, b, share)

    def split(self, a: int, b: int, share: float) -> int:
        """Return the new vertex at ``share`` of the way from a to b; an edge on a boundary stays on it."""
        new, line = self.net.split_edge(a, b, share), self.cut.pop(edge_of(a, b), None)
        if line is not None:
            self.mark([line.tail, new, line.head], line.owner, line.beyond_tip)
        return new

    def mark(self, path: list[int], owner: int, extends: bool = False) -> None:
        """Put the edges of a path on a boundary; those that lie on one already stay there."""
        for a, b in pairwise(path):
            self.cut.setdefault(edge_of(a, b), Line(a, b, owner, extends))
            for vertex in (a, b):
                self.lines.setdefault(vertex, set()).add(owner)


def edges_within(net: Triangulation, cells: list[int], place: Triple, reach: float) -> set[Edge]:
    """Return the edges within ``reach`` of a point, of triangles that hang together with ``cells`` there."""
    todo, seen, found = list(cells), set(cells), set[Edge]()
    while todo:
        for p, q in _edges(net.corners(todo.pop())):
            near = between(net.at(p), net.at(q), share_along(place, net.at(p), net.at(q)))
            if apart(place, near) < reach and edge_of(p, q) not in found:
                found.add(edge_of(p, q))
                fresh = set(net.cells_at(p, q)) - seen
                seen |= fresh
                todo += fresh
    return found


def _edges(corners: tuple[int, int, int]) -> list[Edge]:
    a, b, c = corners
    return [(a, b), (b, c), (c, a)]


def _within(net: Triangulation, cell: int, place: Triple) -> float:
    """Return how far inside a triangle a point of its plane is: the least distance from an edge, below 0 outside."""
    corners, normal = net.corners(cell), net.normal(cell)
    distances = []
    for a, b in _edges(corners):
        way = less(net.at(b), net.at(a))
        distances.append(dot(normal, cross(way, less(place, net.at(a)))) / (length(way) or 1.0))
    return min(distances)
