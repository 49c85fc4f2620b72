"""Tips, the ends of curves inside a surface: stray tips are joined or pruned, and true tips are extended."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np

from cpmkit.manifold.vector_algebra import norms
from cpmkit.meshing.insertion.constrained_triangulation import BoundaryEdge
from cpmkit.meshing.insertion.split_triangulation import (
    Vector,
    distance,
    edge_key,
    interpolate,
    nearest_share_on_segment,
    norm,
    normalize,
    subtract,
)
from cpmkit.meshing.insertion.surface_paths import PathFinder

#: Tips nearer than this share of the local edge length L to a curve or rim are joined to it; tails (parts of a curve
#: between a tip and another curve) shorter than this are pruned.
STRAY_SHARE = 0.1

Links = dict[int, set[int]]


def join_stray_tips(finder: PathFinder, counts: Counter[str]) -> None:
    """Prune short tails of curves, and join tips to a curve or rim near by; increase counts ``pruned``, ``joined``."""
    links = _boundary_links(finder)
    for tip in _tips(finder, links):
        end, path = _tail(finder, links, tip, STRAY_SHARE * finder.triangulation.size(tip))
        if end is not None and len(links[end]) > 1:  # else it is all of a short curve
            counts["pruned"] += 1
            for a, b in pairwise(path):
                del finder.constrained.edges[edge_key(a, b)]
            links = _boundary_links(finder)
    for tip in _tips(finder, links):
        counts["joined"] += _join_tip(finder, links, tip)


def extend_tips(finder: PathFinder, reach: float, counts: Counter[str]) -> None:
    """Extend curves straight past their tips by a length ``reach``, or up to a rim or curve; count the ``tips``."""
    links = _boundary_links(finder)
    for tip in _tips(finder, links):
        counts["tips"] += 1
        edge = _last_edge(finder, tip)
        if edge is not None:
            finder.constrained.owner = edge.owner
            path = _straight_path(finder, tip, _tip_direction(finder, links, tip), reach)
            finder.constrained.constrain_path(path if edge.head == tip else path[::-1], edge.owner, beyond_tip=True)


def _boundary_links(finder: PathFinder) -> Links:
    """Return for each vertex on boundaries the set of its neighbours along boundaries."""
    links: Links = {}
    for a, b in finder.constrained.edges:
        links.setdefault(a, set()).add(b)
        links.setdefault(b, set()).add(a)
    return links


def _last_edge(finder: PathFinder, tip: int) -> BoundaryEdge | None:
    """Return the boundary edge that ends at a tip; None if there is no longer exactly one."""
    edges = (edge_key(tip, other) for other in finder.triangulation.neighbours(tip))
    lines = [finder.constrained.edges[edge] for edge in edges if edge in finder.constrained.edges]
    return lines[0] if len(lines) == 1 else None


def _tips(finder: PathFinder, links: Links) -> list[int]:
    """Return the tips: the vertices off rims that have one neighbour along boundaries."""
    return [v for v, others in links.items() if len(others) == 1 and not finder.triangulation.is_on_rim(v)]


def _tail(finder: PathFinder, links: Links, tip: int, limit: float) -> tuple[int | None, list[int]]:
    """Return the vertex where the curve that ends at ``tip`` meets others or ends, and the path from the tip to it.

    The vertex is None if the path is longer than ``limit``; the path then ends with the first vertex beyond the limit.
    """
    path, left = [tip], limit
    while True:
        ahead = [other for other in links[path[-1]] if len(path) < 2 or other != path[-2]]
        if len(path) > 1 and len(ahead) != 1:
            return path[-1], path
        left -= distance(finder.triangulation.position(path[-1]), finder.triangulation.position(ahead[0]))
        path.append(ahead[0])
        if left < 0:
            return None, path


def _join_tip(finder: PathFinder, links: Links, tip: int) -> bool:
    """Join a tip to the nearest curve or rim within ``STRAY_SHARE`` by boundary edges; return whether it did."""
    net, constrained, here = finder.triangulation, finder.constrained, finder.triangulation.position(tip)
    reach = STRAY_SHARE * net.size(tip)
    own_end = set(_tail(finder, links, tip, 3.0 * reach)[1])  # a tip is not joined to the end of its own curve
    best, nearest = None, reach
    for a, b in constrained.edges_within(net.fan(tip), here, reach):
        if not own_end & {a, b} and (edge_key(a, b) in constrained.edges or net.is_rim_edge(a, b)):
            share = nearest_share_on_segment(here, net.position(a), net.position(b))
            gap = distance(here, interpolate(net.position(a), net.position(b), share))
            if gap < nearest:
                best, nearest = (a, b, share), gap
    edge = _last_edge(finder, tip)
    if best is None or edge is None:
        return False
    constrained.owner = edge.owner
    path = finder.path(tip, constrained.insert_on_edge(*best, net.size(tip)))
    if path is None:
        return False
    constrained.constrain_path(path if edge.head == tip else path[::-1], edge.owner)
    return True


def _tip_direction(finder: PathFinder, links: Links, tip: int) -> Vector:
    """Return the unit direction of a curve at its tip, outwards, from the parabola through three points of its end.

    The points are the tip and those half a local edge length and a whole one before it, or nearer on a short curve.
    """
    net, reach = finder.triangulation, finder.triangulation.size(tip)
    _, path = _tail(finder, links, tip, reach)
    points = np.array([net.position(vertex) for vertex in path])
    lengths = np.append(0.0, np.cumsum(norms(np.diff(points, axis=0))))
    reach = min(reach, float(lengths[-1]))
    middle, end = (np.array([np.interp(share * reach, lengths, axis) for axis in points.T]) for share in (0.5, 1.0))
    x, y, z = (4 * (points[0] - middle) - (points[0] - end)).tolist()
    return normalize((x, y, z))


def _straight_path(finder: PathFinder, tip: int, heading: Vector, reach: float) -> list[int]:
    """Return the vertices of the straight path over the surface from a tip in direction ``heading``.

    The path is ``reach`` long, or ends where it meets a rim, a curve or itself; it has vertices where it crosses edges.
    """
    net, constrained, path, left = finder.triangulation, finder.constrained, [tip], reach
    while True:
        here = path[-1]
        fan_exit = finder.leave_fan(here, heading, net.vertex_normal(here))
        if fan_exit is None:
            return path
        _, a, b, share = fan_exit
        goal = interpolate(net.position(a), net.position(b), share)
        heading = subtract(goal, net.position(here))
        step = norm(heading)
        if step > left:
            root = net.root(next(cell for cell in net.cells_of_edge(a, b) if here in net.corners(cell)))
            last = constrained.insert_point(root, interpolate(net.position(here), goal, left / step))
            return path + (finder.path(here, last) or [here])[1:]
        following = constrained.insert_on_edge(a, b, share, net.size(here))
        if following in path:
            return path
        path.append(following)
        left -= step
        if following in constrained.owners_at or net.is_on_rim(following):
            return path
