"""Paths over a triangulation from vertex to vertex, made of edges by splitting triangles; removal of short loops."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cpmkit.meshing.insertion.constrained_triangulation import ConstrainedTriangulation
from cpmkit.meshing.insertion.split_triangulation import (
    SplitTriangulation,
    Vector,
    add_scaled,
    cross,
    distance,
    dot,
    edge_key,
    interpolate,
    norm,
    normalize,
    subtract,
)
from cpmkit.meshing.insertion.surface_matching import ProjectionSearch, barycentric_position


class FanExit(NamedTuple):
    """The point where a plane through a vertex leaves the triangles around it: at ``share`` of the way from a to b.

    ``ahead`` is the cosine between the direction to this point and the heading, times the length of the heading.
    """

    ahead: float
    a: int
    b: int
    share: float


class InsertedPoint(NamedTuple):
    """A point of a curve, and the vertex at its projection."""

    vertex: int
    place: Vector


@dataclass(eq=False)
class PathFinder:
    """Finds paths over a triangulation, and splits the triangles that they cross."""

    constrained: ConstrainedTriangulation
    search: ProjectionSearch  #: Search over the roots, the original triangles.
    #: The points of curves inserted so far; keys are the numbers of the curve and of the point.
    inserted: dict[tuple[int, ...], InsertedPoint] = field(default_factory=dict)

    @property
    def triangulation(self) -> SplitTriangulation:
        """The triangulation."""
        return self.constrained.triangulation

    def path(self, v: int, w: int) -> list[int] | None:
        """Return the vertices of a path over edges from v to w, both included; None if no path is short enough.

        The path is as straight as possible: in the plane of the mean normal of its ends, else through the projection of
        its midpoint, else in the plane of the normal at v or at w; triangles that it crosses are split. If none of
        these exists, it is the shortest path over edges, of at most 6 times the distance plus 12 local edge lengths.
        """
        path, net = self._bisected_path(v, w, 4), self.triangulation
        if path is None:
            path = self._planar_path(v, w, net.vertex_normal(v)) or self._planar_path(v, w, net.vertex_normal(w))
        longest = 6.0 * distance(net.position(v), net.position(w)) + 12.0 * net.size(v)
        return path or net.shortest_path(v, w, longest)

    def _bisected_path(self, v: int, w: int, bisections: int) -> list[int] | None:
        """Return the path in the plane of the mean normal, else two paths that meet at the projection of the midpoint.

        Such midpoints are inserted at up to ``bisections`` nested levels; None if no path is found.
        """
        if v == w:
            return [v]
        net = self.triangulation
        n, other = net.vertex_normal(v), net.vertex_normal(w)
        path = self._planar_path(v, w, normalize(add_scaled(n, 1.0 if dot(n, other) >= 0 else -1.0, other)))
        if path is not None or not bisections:
            return path
        middle = self.insert_projection(interpolate(net.position(v), net.position(w), 0.5))
        if middle in (v, w):
            return None
        first = self._bisected_path(v, middle, bisections - 1)
        second = first and self._bisected_path(middle, w, bisections - 1)
        return first + second[1:] if first and second else None

    def insert_projection(self, place: Vector) -> int:
        """Return the vertex at the projection of ``place`` onto the surface, a new vertex unless one is near."""
        nearest = self.search.nearest(np.array([place]))
        root = int(nearest.cell[0])
        return self.constrained.insert_point(root, barycentric_position(self.triangulation, root, nearest.shares[0]))

    def _planar_path(self, v: int, w: int, normal: Vector) -> list[int] | None:
        """Return the path from v to w in planes of ``normal`` and the direction to w; None at a rim or if too long."""
        net, goal = self.triangulation, self.triangulation.position(w)
        left = self._detour_length(v, w)
        path = [v]
        while path[-1] != w:
            here = path[-1]
            if net.cells_of_edge(here, w):
                path.append(w)
                break
            fan_exit = self.leave_fan(here, subtract(goal, net.position(here)), normal)
            if fan_exit is None:
                return None
            following = self._exit_vertex(here, fan_exit, w)
            left -= distance(net.position(here), net.position(following))
            if left < 0 or following in path:
                return None
            path.append(following)
        return path

    def _detour_length(self, v: int, w: int) -> float:
        """Return the length above which a path from v to w is rejected as a detour."""
        net = self.triangulation
        return 1.6 * distance(net.position(v), net.position(w)) + 0.5 * net.size(v)

    def _exit_vertex(self, here: int, fan_exit: FanExit, goal: int) -> int:
        """Return the vertex at which a path from ``here`` to ``goal`` leaves the triangles around ``here``.

        The point is snapped to near vertices as any other point, but with the tolerance for ends of curves if the path
        would otherwise lead along a rim although ``here`` or ``goal`` lies inside.
        """
        net, constrained = self.triangulation, self.constrained
        place = fan_exit.a, fan_exit.b, fan_exit.share, net.size(here)
        vertex = constrained.insert_on_edge(*place)
        if vertex not in (fan_exit.a, fan_exit.b):
            return vertex
        ends_on_rim = net.is_rim_edge(vertex, goal) and not net.is_on_rim(here)
        starts_on_rim = net.is_rim_edge(here, vertex) and not net.is_on_rim(goal)
        if ends_on_rim or starts_on_rim:
            constrained.at_end = True
            vertex = constrained.insert_on_edge(*place)
            constrained.at_end = False
        return vertex

    def leave_fan(self, vertex: int, heading: Vector, normal: Vector) -> FanExit | None:
        """Return the edge at which a path from a ``vertex`` leaves the triangles around it.

        It is where the plane of ``heading`` and ``normal`` crosses an edge opposite the vertex. Of several such edges
        the one in the direction nearest to ``heading`` is returned; None if none is ahead. The vectors may have any
        length.
        """
        net, here, across = self.triangulation, self.triangulation.position(vertex), cross(normal, heading)
        best: FanExit | None = None
        for cell in net.fan(vertex):
            a, b = (corner for corner in net.corners(cell) if corner != vertex)
            side_a, side_b = dot(across, subtract(net.position(a), here)), dot(across, subtract(net.position(b), here))
            if side_a * side_b > 0 or side_a == side_b:
                continue
            share = side_a / (side_a - side_b)
            way = subtract(interpolate(net.position(a), net.position(b), share), here)
            ahead = dot(way, heading) / (norm(way) or 1.0)
            if ahead > 0 and (best is None or ahead > best.ahead):
                best = FanExit(ahead, a, b, share)
        return best

    def path_along_boundaries(self, v: int, w: int, owners: Set[int]) -> list[int] | None:
        """Return the vertices of the shortest path from v to w along edges of boundaries; None if none is short enough.

        ``owners``: the numbers of the boundaries. The path includes v and w; its limit is :meth:`_detour_length`.
        """

        def neighbours(vertex: int) -> list[int]:
            """Return the neighbours of a vertex along edges of these boundaries."""
            edges = self.constrained.edges
            lines = ((other, edges.get(edge_key(vertex, other))) for other in self.triangulation.neighbours(vertex))
            return [other for other, line in lines if line is not None and line.owner in owners]

        return self.triangulation.shortest_path(v, w, self._detour_length(v, w), neighbours)

    def path_beside_boundary(self, start: tuple[int, int], goal: tuple[int, int]) -> list[int] | None:
        """Return a path between two vertices that runs parallel to a boundary; None if none is short enough.

        ``start``, ``goal`` (int, int): a vertex of the path, and the vertex of the boundary beside it.
        """
        net, owners = self.triangulation, self.constrained.owners_at
        (v, at), (w, to) = start, goal
        line = self.path_along_boundaries(at, to, owners.get(at, set()) & owners.get(to, set()))
        if line is None:
            return None
        lengths = np.cumsum([0.0] + [distance(net.position(a), net.position(b)) for a, b in pairwise(line)])
        first, last = subtract(net.position(v), net.position(at)), subtract(net.position(w), net.position(to))
        path = [v]
        for vertex, share in zip(line[1:-1], (lengths[1:-1] / (lengths[-1] or 1.0)).tolist(), strict=True):
            place = add_scaled(net.position(vertex), 1.0, interpolate(first, last, share))
            part = self.path(path[-1], self.insert_projection(place))
            if part is None:
                return None
            path += part[1:]
        part = self.path(path[-1], w)
        return part and path + part[1:]


def erase_short_loops(triangulation: SplitTriangulation, path: list[int], backward: set[int]) -> list[int]:
    """Return a path without loops shorter than two local edge lengths, or four at ``backward`` vertices.

    Such loops come from projections that jump, from cusps of offset curves and from noise in polylines.
    ``path``: vertices; a closed path ends where it starts, and is returned from another of its vertices on.
    ``backward``: the vertices between which projections go back while the curve, off the surface there, continues.
    """
    path = _erase_inner_loops(triangulation, path, backward)
    if len(path) > 2 and path[0] == path[-1]:
        half = len(path) // 2  # loops through the start of a closed path are found when the path starts elsewhere
        path = _erase_inner_loops(triangulation, path[half:] + path[1 : half + 1], backward)
    return path


def _erase_inner_loops(triangulation: SplitTriangulation, path: list[int], backward: set[int]) -> list[int]:
    """Return a path without its short loops (:func:`erase_short_loops`); a loop through its start stays."""
    simple, lengths = path[:1], [0.0]
    place = {path[0]: 0}
    for vertex in path[1:]:
        if vertex == simple[-1]:
            continue
        length = lengths[-1] + distance(triangulation.position(simple[-1]), triangulation.position(vertex))
        before = place.get(vertex)
        # longer loops, than twice the local edge length or four times where projections go back, are parts of the curve
        factor = 2.0 if before is None or backward.isdisjoint(simple[before:]) else 4.0
        if before is not None and length - lengths[before] < factor * triangulation.size(vertex):
            for erased in simple[before + 1 :]:
                if place[erased] > before:
                    del place[erased]
            del simple[before + 1 :], lengths[before + 1 :]
        else:
            place[vertex] = len(simple)
            simple.append(vertex)
            lengths.append(length)
    return simple
