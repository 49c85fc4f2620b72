"""The ends of curves inside a surface: stray ones are joined or pruned, true ones extended."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

from cpmkit.meshing.insertion.lined_mesh import Line, edges_within
from cpmkit.meshing.insertion.triangulation import edge_of
from cpmkit.meshing.insertion.triples import Triple, along, apart, between, direction, length, less, share_along
from cpmkit.meshing.insertion.walk import Walker

#: Tips nearer than this share of L to a curve or a rim are joined to it; shorter tails are pruned.
STRAY_SHARE = 0.1
#: Edges so many times as near along the curve are its own end, which a tip is not joined to.
OWN_END = 3.0
#: A curve's direction at its tip is read from so many L of it.
DIRECTION_SIZES = 1.0

Links = dict[int, set[int]]


def mend(walker: Walker, told: Counter[str]) -> None:
    """Prune tails and join tips that lie at a curve or a rim; counted as ``pruned`` and ``joined``."""
    links = _links(walker)
    for tip in _tips(walker, links):
        end, way = _tail(walker, links, tip, STRAY_SHARE * walker.net.size(tip))
        if end is not None and len(links[end]) > 1:  # else it is all of a short curve
            told["pruned"] += 1
            for a, b in pairwise(way):
                del walker.lined.cut[edge_of(a, b)]
            links = _links(walker)
    for tip in _tips(walker, links):
        told["joined"] += _joined(walker, links, tip)


def extend(walker: Walker, reach: float, told: Counter[str]) -> None:
    """Go on straight past each tip, over ``reach`` or until a rim or a curve; counted as ``tips``."""
    links = _links(walker)
    for tip in _tips(walker, links):
        told["tips"] += 1
        line = _last_line(walker, tip)
        if line is not None:
            walker.lined.owner = line.owner
            path = _straight_on(walker, tip, _heading(walker, links, tip), reach)
            walker.lined.mark(path if line.head == tip else path[::-1], line.owner, extends=True)


def _links(walker: Walker) -> Links:
    """Return the neighbours along boundaries of each vertex."""
    links: Links = {}
    for a, b in walker.lined.cut:
        links.setdefault(a, set()).add(b)
        links.setdefault(b, set()).add(a)
    return links


def _last_line(walker: Walker, tip: int) -> Line | None:
    """Return the edge that ends at a tip; None where others have met it since."""
    edges = (edge_of(tip, other) for other in walker.net.neighbours(tip))
    lines = [walker.lined.cut[edge] for edge in edges if edge in walker.lined.cut]
    return lines[0] if len(lines) == 1 else None


def _tips(walker: Walker, links: Links) -> list[int]:
    return [vertex for vertex, others in links.items() if len(others) == 1 and not walker.net.on_rim(vertex)]


def _tail(walker: Walker, links: Links, tip: int, limit: float) -> tuple[int | None, list[int]]:
    """Return where the curve that ends at ``tip`` meets others or ends within ``limit``, if so, and the way there."""
    path, left = [tip], limit
    while True:
        ahead = [other for other in links[path[-1]] if len(path) < 2 or other != path[-2]]
        if len(path) > 1 and len(ahead) != 1:
            return path[-1], path
        left -= apart(walker.net.at(path[-1]), walker.net.at(ahead[0]))
        path.append(ahead[0])
        if left < 0:
            return None, path


def _joined(walker: Walker, links: Links, tip: int) -> bool:
    """Join a tip to the nearest curve or rim within reach."""
    net, here = walker.net, walker.net.at(tip)
    reach = STRAY_SHARE * net.size(tip)
    own = set(_tail(walker, links, tip, OWN_END * reach)[1])
    best, nearest = None, reach
    for a, b in edges_within(net, net.fan(tip), here, reach):
        if not own & {a, b} and (edge_of(a, b) in walker.lined.cut or net.rim_edge(a, b)):
            share = share_along(here, net.at(a), net.at(b))
            gap = apart(here, between(net.at(a), net.at(b), share))
            if gap < nearest:
                best, nearest = (a, b, share), gap
    line = _last_line(walker, tip)
    if best is None or line is None:
        return False
    walker.lined.owner = line.owner
    way = walker.way(tip, walker.lined.on_edge(*best, net.size(tip)))
    if way is None:
        return False
    walker.lined.mark(way if line.head == tip else way[::-1], line.owner)
    return True


def _heading(walker: Walker, links: Links, tip: int) -> Triple:
    """Return the direction in which a curve reaches its tip: that of the parabola through three places on its end."""
    net, reach = walker.net, DIRECTION_SIZES * walker.net.size(tip)
    _, path = _tail(walker, links, tip, reach)
    ways = [0.0]
    for a, b in pairwise(path):
        ways.append(ways[-1] + apart(net.at(a), net.at(b)))
    reach = min(reach, ways[-1])
    middle, end = (_place(walker, path, ways, share * reach) for share in (0.5, 1.0))
    secant, first = less(net.at(tip), end), less(net.at(tip), middle)
    return direction(less(along(first, 3.0, first), secant))


def _place(walker: Walker, path: list[int], ways: list[float], way: float) -> Triple:
    row = next(k for k in range(1, len(ways)) if ways[k] >= way or k == len(ways) - 1)
    step = ways[row] - ways[row - 1]
    return between(walker.net.at(path[row - 1]), walker.net.at(path[row]), min(1.0, (way - ways[row - 1]) / step))


def _straight_on(walker: Walker, tip: int, heading: Triple, reach: float) -> list[int]:
    """Return the path from a tip straight on over the surface."""
    net, path, left = walker.net, [tip], reach
    while True:
        here = path[-1]
        hit = walker.hit(here, heading, net.vertex_normal(here))
        if hit is None:
            return path
        goal = between(net.at(hit.a), net.at(hit.b), hit.share)
        heading = less(goal, net.at(here))
        step = length(heading)
        if step > left:
            root = net.root(next(cell for cell in net.cells_at(hit.a, hit.b) if here in net.corners(cell)))
            last = walker.lined.inserted(root, between(net.at(here), goal, left / step))
            return path + (walker.way(here, last) or [here])[1:]
        following = walker.lined.on_edge(hit.a, hit.b, hit.share, net.size(here))
        if following in path:
            return path
        path.append(following)
        left -= step
        if following in walker.lined.lines or net.on_rim(following):
            return path
