"""From one vertex to another over the triangulation, made edges on the way."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cpmkit.meshing.insertion.feet import Triangles
from cpmkit.meshing.insertion.lined_mesh import LinedMesh
from cpmkit.meshing.insertion.route import place_of, way_back, ways_over_edges
from cpmkit.meshing.insertion.triangulation import Triangulation, edge_of
from cpmkit.meshing.insertion.triples import Triple, along, apart, between, cross, direction, dot, length, less

#: A walk is at most so many chords and so many L long; else it went astray.
MOST_CHORDS, MOST_SIZES = 1.6, 0.5
#: How often a way is halved where a walk goes astray.
MOST_HALVINGS = 4
#: The shortest way over edges is taken if it is no longer than so many chords and L.
MOST_DETOUR_CHORDS, MOST_DETOUR_SIZES = 6.0, 12.0


class Hit(NamedTuple):
    """Where a plane through a vertex leaves its fan: at ``share`` of the way from vertex ``a`` to ``b``."""

    ahead: float
    a: int
    b: int
    share: float


class Placed(NamedTuple):
    """The vertex at the foot of a curve's point, and that point."""

    vertex: int
    place: Triple


@dataclass(eq=False)
class Walker:
    """Leads curves over a mesh.

    Attributes
    ----------
    lined : LinedMesh
    triangles : Triangles
        The roots, asked for feet.
    stops : dict
        Where points of curves are, by the numbers of the curve and the point.
    """

    lined: LinedMesh
    triangles: Triangles
    stops: dict[tuple[int, ...], Placed] = field(default_factory=dict)

    @property
    def net(self) -> Triangulation:
        """The triangulation."""
        return self.lined.net

    def way(self, v: int, w: int, halvings: int = MOST_HALVINGS) -> list[int] | None:
        """Return the vertices of a way over edges from v to w, both with it; None if they do not hang together."""
        found = self._straight(v, w, halvings)
        if found is None:
            found = self._walk(v, w, self.net.vertex_normal(v)) or self._walk(v, w, self.net.vertex_normal(w))
        return found or self._over_edges(v, w)

    def _straight(self, v: int, w: int, halvings: int) -> list[int] | None:
        """Walk in the plane of the mean normal; where that goes astray by way of the foot of the middle."""
        if v == w:
            return [v]
        n, other = self.net.vertex_normal(v), self.net.vertex_normal(w)
        found = self._walk(v, w, direction(along(n, 1.0 if dot(n, other) >= 0 else -1.0, other)))
        if found is not None or not halvings:
            return found
        middle = self._middle(v, w)
        if middle in (v, w):
            return None
        first = self._straight(v, middle, halvings - 1)
        second = first and self._straight(middle, w, halvings - 1)
        return first + second[1:] if first and second else None

    def _middle(self, v: int, w: int) -> int:
        return self.at_foot(between(self.net.at(v), self.net.at(w), 0.5))

    def at_foot(self, place: Triple) -> int:
        """Return the vertex at the foot of a point, a new one unless one lies there."""
        foot = self.triangles.nearest(np.array([place]))
        root = int(foot.cell[0])
        return self.lined.inserted(root, place_of(self.net, root, foot.shares[0]))

    def _walk(self, v: int, w: int, normal: Triple) -> list[int] | None:
        net, goal = self.net, self.net.at(w)
        left = self._longest(v, w)
        path = [v]
        while path[-1] != w:
            here = path[-1]
            if net.cells_at(here, w):
                path.append(w)
                break
            hit = self.hit(here, less(goal, net.at(here)), normal)
            if hit is None:
                return None
            following = self._met(here, hit, w)
            left -= apart(net.at(here), net.at(following))
            if left < 0 or following in path:
                return None
            path.append(following)
        return path

    def _met(self, here: int, hit: Hit, goal: int) -> int:
        """Return the vertex at a hit, one beside it as of any line, unless it leads along the rim to or from inside.

        The other end is that of a curve then, which is put apart from a vertex that is as near to it.
        """
        net, lined, place = self.net, self.lined, (hit.a, hit.b, hit.share, self.net.size(here))
        found = lined.on_edge(*place)
        if found not in (hit.a, hit.b):
            return found
        ends_beside = net.rim_edge(found, goal) and not net.on_rim(here)
        starts_beside = net.rim_edge(here, found) and not net.on_rim(goal)
        if ends_beside or starts_beside:
            lined.at_end = True
            found = lined.on_edge(*place)
            lined.at_end = False
        return found

    def hit(self, vertex: int, heading: Triple, normal: Triple) -> Hit | None:
        """Return where the plane of ``heading`` and ``normal`` at a vertex leaves its fan, as far ahead as can be."""
        net, here, across = self.net, self.net.at(vertex), cross(normal, heading)
        best: Hit | None = None
        for cell in net.fan(vertex):
            a, b = (corner for corner in net.corners(cell) if corner != vertex)
            from_a, from_b = dot(across, less(net.at(a), here)), dot(across, less(net.at(b), here))
            if from_a * from_b > 0 or from_a == from_b:
                continue
            share = from_a / (from_a - from_b)
            way = less(between(net.at(a), net.at(b), share), here)
            ahead = dot(way, heading) / (length(way) or 1.0)
            if ahead > 0 and (best is None or ahead > best.ahead):
                best = Hit(ahead, a, b, share)
        return best

    def _over_edges(self, v: int, w: int) -> list[int] | None:
        net = self.net
        limit = MOST_DETOUR_CHORDS * apart(net.at(v), net.at(w)) + MOST_DETOUR_SIZES * net.size(v)
        return way_back(ways_over_edges(net, {v: 0.0}, limit, w), w)

    def along_line(self, v: int, w: int, owners: Set[int]) -> list[int] | None:
        """Return the way from v to w along boundaries, if there is a short one."""
        limit = self._longest(v, w)

        def beside(vertex: int) -> list[int]:
            lines = ((other, self.lined.cut.get(edge_of(vertex, other))) for other in self.net.neighbours(vertex))
            return [other for other, line in lines if line is not None and line.owner in owners]

        return way_back(ways_over_edges(self.net, {v: 0.0}, limit, w, beside), w)

    def beside_line(self, start: tuple[int, int], goal: tuple[int, int]) -> list[int] | None:
        """Return the way between two vertices at the side of a line that runs from beside the one to the other.

        Parameters
        ----------
        start, goal : (int, int)
            A vertex of the way, and that of the line beside it.
        """
        net = self.net
        (v, at), (w, to) = start, goal
        line = self.along_line(at, to, self.lined.lines.get(at, set()) & self.lined.lines.get(to, set()))
        if line is None:
            return None
        ways = np.cumsum([0.0] + [apart(net.at(a), net.at(b)) for a, b in pairwise(line)])
        first, last = less(net.at(v), net.at(at)), less(net.at(w), net.at(to))
        path = [v]
        for vertex, share in zip(line[1:-1], (ways[1:-1] / (ways[-1] or 1.0)).tolist(), strict=True):
            way = self.way(path[-1], self.at_foot(along(net.at(vertex), 1.0, between(first, last, share))))
            if way is None:
                return None
            path += way[1:]
        way = self.way(path[-1], w)
        return way and path + way[1:]

    def _longest(self, v: int, w: int) -> float:
        return MOST_CHORDS * apart(self.net.at(v), self.net.at(w)) + MOST_SIZES * self.net.size(v)
