"""A triangulation some of whose edges lie on boundaries, into which points of boundaries are inserted."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

from cpmkit.meshing.insertion.split_triangulation import (
    Edge,
    SplitTriangulation,
    Vector,
    cross,
    distance,
    dot,
    edge_key,
    interpolate,
    nearest_share_on_segment,
    norm,
    subtract,
)

#: A point nearer than this, in local edge lengths L, to a vertex or an edge is put there.
SNAP_SHARE = 1e-3
#: The same if vertices are moved onto their curves later; ends of curves are not moved.
MOVABLE_SNAP_SHARE = 0.02
#: The same for vertices and edges of other boundaries.
OTHER_SNAP_SHARE = 1e-7
#: The same for edges on a rim.
RIM_SNAP_SHARE = 0.02


class BoundaryEdge(NamedTuple):
    """An edge on a boundary, in its direction; ``beyond_tip`` where it extends the boundary past a tip."""

    tail: int
    head: int
    owner: int
    beyond_tip: bool = False


@dataclass(eq=False)
class ConstrainedTriangulation:
    """A triangulation, its edges on boundaries, and the state of the insertion."""

    triangulation: SplitTriangulation
    snap_share: float = SNAP_SHARE  #: A point nearer than this, in L, to a vertex or an edge is put there.
    owner: int = 0  #: The number of the boundary that is being inserted.
    at_end: bool = False  #: Whether the point being inserted is the end of a curve, which stays where it is.
    #: set of int: boundaries so close to others that their points are not snapped.
    close: set[int] = field(default_factory=set)
    edges: dict[Edge, BoundaryEdge] = field(default_factory=dict)  #: The boundary edge of each edge on a boundary.
    owners_at: dict[int, set[int]] = field(default_factory=dict)  #: The numbers of the boundaries at each vertex.

    def insert_point(self, root: int, place: Vector) -> int:
        """Return the vertex at a point ``place`` of the original triangle ``root``: a near old vertex, or a new vertex.

        A point near an edge splits that edge. Near means within ``SNAP_SHARE`` and the constants after it.
        """
        net = self.triangulation
        cell = self._containing_part(root, place)
        size = float(net.sizes[root])
        farthest = max(SNAP_SHARE, MOVABLE_SNAP_SHARE, RIM_SNAP_SHARE) * size
        for a, b in self._candidate_edges(root, cell):
            share = nearest_share_on_segment(place, net.position(a), net.position(b))
            gap = distance(place, interpolate(net.position(a), net.position(b), share))
            if gap < farthest:
                edge = self.edges.get(edge_key(a, b))
                snap_share = RIM_SNAP_SHARE if net.is_rim_edge(a, b) else self._free_snap_share
                if gap < size * (OTHER_SNAP_SHARE if edge is not None and edge.owner != self.owner else snap_share):
                    return self.insert_on_edge(a, b, share, size)
        return net.split_cell(cell, place)

    def _containing_part(self, root: int, place: Vector) -> int:
        """Return the part of the original triangle ``root`` that contains the point ``place``."""
        parts = self.triangulation.parts(root)
        return parts[0] if len(parts) == 1 else max(parts, key=lambda part: self._depth_inside(part, place))

    def _depth_inside(self, cell: int, place: Vector) -> float:
        """Return the least signed distance of ``place`` from the lines of the edges of ``cell``, positive inside."""
        net = self.triangulation
        normal, depths = net.normal(cell), []
        for a, b in _edges_of_triangle(net.corners(cell)):
            way = subtract(net.position(b), net.position(a))
            depths.append(dot(normal, cross(way, subtract(place, net.position(a)))) / (norm(way) or 1.0))
        return min(depths)

    def insert_on_boundary(self, root: int, place: Vector, owner: int) -> int | None:
        """Return the vertex on boundary ``owner`` nearest to the point ``place`` of the original triangle ``root``.

        The vertex is inserted if need be. None if the boundary is not within .1 local edge lengths of the point.
        """
        net, size = self.triangulation, self.triangulation.sizes[root]
        gaps = {}
        for a, b in self.edges_within([self._containing_part(root, place)], place, 0.1 * size):
            edge = self.edges.get(edge_key(a, b))
            if edge is not None and edge.owner == owner:
                share = nearest_share_on_segment(place, net.position(a), net.position(b))
                gaps[distance(place, interpolate(net.position(a), net.position(b), share))] = (a, b, share)
        return self.insert_on_edge(*gaps[min(gaps)], size) if gaps else None

    def _candidate_edges(self, root: int, cell: int) -> list[Edge]:
        """Return the edges onto which a point in ``cell`` may be snapped.

        Edges on boundaries and rims in the whole original triangle ``root`` come first, then the edges of ``cell``.
        """
        net, at_rim = self.triangulation, root in self.triangulation.roots_on_rim
        edges = [edge for part in net.parts(root) for edge in _edges_of_triangle(net.corners(part))]
        fixed = [edge for edge in edges if edge_key(*edge) in self.edges or (at_rim and net.is_rim_edge(*edge))]
        return fixed + _edges_of_triangle(net.corners(cell))

    @property
    def _free_snap_share(self) -> float:
        """The distance, in local edge lengths, below which a point is put at a vertex or edge off other boundaries."""
        if self.owner in self.close:
            return OTHER_SNAP_SHARE
        return SNAP_SHARE if self.at_end else self.snap_share

    def insert_on_edge(self, a: int, b: int, share: float, size: float) -> int:
        """Return the vertex at ``share`` of the way from a to b: a or b if near, else a new vertex.

        ``size`` is the local edge length L. A new vertex splits the edge, and the boundary edge on it.
        """
        net = self.triangulation
        length = distance(net.position(a), net.position(b))
        to_a, to_b = share * length, (1 - share) * length
        others = (self.owners_at.get(vertex, {self.owner}) for vertex in (a, b))
        snap_a, snap_b = (size * (self._free_snap_share if self.owner in at else OTHER_SNAP_SHARE) for at in others)
        if to_a <= to_b and to_a < snap_a:
            return a
        if to_b < snap_b:
            return b
        if to_a < snap_a:
            return a
        new, edge = net.split_edge(a, b, share), self.edges.pop(edge_key(a, b), None)
        if edge is not None:
            self.constrain_path([edge.tail, new, edge.head], edge.owner, edge.beyond_tip)
        return new

    def constrain_path(self, path: list[int], owner: int, beyond_tip: bool = False) -> None:
        """Put the edges of a path, in the boundary's direction, on boundary ``owner``, unless they are on another."""
        for a, b in pairwise(path):
            self.edges.setdefault(edge_key(a, b), BoundaryEdge(a, b, owner, beyond_tip))
            for vertex in (a, b):
                self.owners_at.setdefault(vertex, set()).add(owner)

    def edges_within(self, cells: list[int], place: Vector, reach: float) -> set[Edge]:
        """Return the edges within the length ``reach`` of a point, by a search from ``cells`` across such edges."""
        net = self.triangulation
        waiting, seen, edges = list(cells), set(cells), set[Edge]()
        while waiting:
            for p, q in _edges_of_triangle(net.corners(waiting.pop())):
                start, end = net.position(p), net.position(q)
                nearest_point = interpolate(start, end, nearest_share_on_segment(place, start, end))
                if distance(place, nearest_point) < reach and edge_key(p, q) not in edges:
                    edges.add(edge_key(p, q))
                    fresh = set(net.cells_of_edge(p, q)) - seen
                    seen |= fresh
                    waiting += fresh
        return edges


def _edges_of_triangle(corners: tuple[int, int, int]) -> list[Edge]:
    """Return the three edges of a triangle, in its orientation."""
    a, b, c = corners
    return [(a, b), (b, c), (c, a)]
