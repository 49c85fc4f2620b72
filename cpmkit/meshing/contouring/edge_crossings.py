"""Points at which lattice edges cross a surface, found from closest points without a sign."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.meshing.contouring.contour_nodes import (
    NORMAL_NOISES,
    OFFSET_NOISES,
    PLANE_COSINE,
    LatticeNodes,
    closest_points_and_normals,
)
from cpmkit.types import Bools, Floats, Ints

#: At points nearer to the surface than this, in lengths of the ray, the crossing is that with the tangent plane at the
#: closest point.
NEAR_SHARE = 0.02
#: Such a crossing is at most this far ahead, in lengths of the ray. Crossings nearer than this to an end of a ray are
#: found from that end alone, so that none is found twice.
END_SHARE = 0.05
#: For noisy closest points both are larger: the first is at least so many times the noise.
NEAR_NOISES = 5.0
#: A ray grazes the surface if the sine of their angle is below this: such crossings are dropped.
GRAZING_SINE = 0.02
#: Crossings of one edge found from both ends are at least this share of it apart if they are two.
APART_SHARE = 0.1
#: Crossings of one edge found by marches of different steps are the same up to this share of it.
SAME_SHARE = 0.005


@dataclass(frozen=True, eq=False)
class Crossings:
    """Points at which lattice edges cross the surface."""

    node: Ints  #: (c, 3): the lower end of the edge.
    axis: Ints  #: (c,): the direction of the edge.
    #: points, normals (c, 3): the crossing, and the unit normal of the surface there, of either sign.
    points: Floats
    normals: Floats


@dataclass(frozen=True, eq=False)
class Observation:
    """Distances of n points from the surface, and normals there."""

    distance: Floats  #: (n,): the distances.
    normal: Floats  #: (n, 3): the unit vector from the closest point to the point.
    interior: Bools  #: (n,): whether the closest point lies off rims.

    def take(self, rows: Bools | Ints) -> Observation:
        """Return the observations at ``rows``, integers or a mask."""
        return Observation(self.distance[rows], self.normal[rows], self.interior[rows])

    def put(self, rows: Bools, new: Observation) -> None:
        """Replace the observations at ``rows`` (n,), a mask, by ``new`` in place."""
        self.distance[rows], self.normal[rows], self.interior[rows] = new.distance, new.normal, new.interior


def _observe_surface(source: LocalSource, points: Floats, known_normals: Floats, length: float) -> Observation:
    """Return distance and normal of the surface at ``points`` (n, 3), and whether the closest points lie off rims.

    Points on the surface get the ``known_normals`` (n, 3); ``length`` is the length to which tolerances refer.
    """
    answer = source.closest_point(points)
    away = points - answer.points
    distance = norms(away)
    readable = distance[:, None] > max(1e-7 * length, NORMAL_NOISES * source.noise)
    return Observation(distance, np.where(readable, unit(away), known_normals), answer.edge < 0)


def _ranges(source: LocalSource, length: float) -> tuple[float, float]:
    """Return ``NEAR_SHARE`` and ``END_SHARE`` for rays of this length, enlarged where closest points are noisy."""
    factor = max(1.0, NEAR_NOISES * source.noise / (NEAR_SHARE * length))
    return NEAR_SHARE * factor, END_SHARE * factor


def edge_crossings(source: LocalSource, nodes: LatticeNodes) -> Crossings:
    """Return the points at which edges between ``nodes`` cross the surface, with unit normals of the surface there.

    Where the surface is planar, an edge is intersected with its plane; other edges are marched from one end, if needed
    from the other too. An edge of two lattice faces or more with an odd number of crossings is sphere traced again.
    """
    tail, head, axis = _candidate_edges(nodes, 2 * NEAR_NOISES * source.noise)
    s, near_share = nodes.spacing, _ranges(source, nodes.spacing)[0]
    along = np.eye(3)[axis]
    t, normal = np.full(len(tail), np.nan), np.zeros((len(tail), 3))
    planar = ~nodes.nonplanar[tail, axis]
    through = planar & (dots(nodes.normals[tail], nodes.normals[head]) < 0)
    rows = np.flatnonzero(through & (dots(nodes.normals[tail], along) < 0))
    t[rows], normal[rows] = _cross_plane(source, nodes, tail[rows], head[rows], along[rows])
    rows = np.flatnonzero(np.isnan(t) & (~planar | through))
    t[rows], normal[rows] = _march_edges(source, nodes, tail[rows], head[rows], along[rows], np.full(len(rows), s))
    # An edge whose ends lie on both sides crosses the surface even where it only grazes; else a hole would be left.
    grazing = np.flatnonzero(np.isnan(t) & through)
    t[grazing] = s * nodes.distance[tail[grazing]] / (nodes.distance[tail[grazing]] + nodes.distance[head[grazing]])
    normal[grazing] = nodes.normals[tail[grazing]]
    explained = _predicts_head(nodes, head[rows], along[rows], t[rows], normal[rows])
    none_left = np.isnan(t[rows]) & ~((nodes.distance[head[rows]] < near_share * s) & ~nodes.on_rim[head[rows]])
    none_left &= source.noise == 0  # where closest points are noisy, rays along the surface may pass it
    back = rows[~explained & ~none_left & ~planar[rows]]
    reach = np.where(np.isnan(t[back]), s, s - t[back] + APART_SHARE * s)
    t_back, normal_back = _march_edges(source, nodes, head[back], tail[back], -along[back], np.minimum(reach, s))
    with np.errstate(invalid="ignore"):
        close = np.abs(s - t_back - t[back]) < APART_SHARE * s
    cosine, same_cosine = dots(normal[back], normal_back), 0.95 if source.noise == 0 else 0.0
    t[back[close & (cosine > same_cosine)]] = np.nan  # a bulge goes out and in again: both crossings are dropped
    t_back[close & (np.abs(cosine) > same_cosine)] = np.nan
    tails, axes = np.concatenate([tail, tail[back]]), np.concatenate([axis, axis[back]])
    times, normals = np.concatenate([t, s - t_back]), np.concatenate([normal, normal_back])
    incomplete = _single_in_odd_faces(nodes, tails, axes, times)[rows]
    again = rows[incomplete & ~np.isnan(t[rows]) & (source.noise == 0)]
    further = [
        _other_crossings(source, nodes, tail[again], head[again], axis[again], t[again], flip) for flip in (False, True)
    ]
    with np.errstate(invalid="ignore"):
        further[1][0][np.abs(further[1][0] - further[0][0]) < SAME_SHARE * s] = np.nan
    tails, axes = np.concatenate([tails, tail[again], tail[again]]), np.concatenate([axes, axis[again], axis[again]])
    times, normals = (np.concatenate(parts) for parts in zip((times, normals), *further, strict=True))
    crossed = np.flatnonzero(~np.isnan(times))
    points = nodes.positions[tails[crossed]] + times[crossed, None] * np.eye(3)[axes[crossed]]
    normals = normals[crossed]
    if OFFSET_NOISES * source.noise > 0.01 * s:  # normals along the edges are read off points that near
        points, normals = closest_points_and_normals(source, points, normals, s)
    return Crossings(nodes.index[tails[crossed]], axes[crossed], points, normals)


def _candidate_edges(nodes: LatticeNodes, uncertainty: float) -> tuple[Ints, Ints, Ints]:
    """Return the tail, the head and the axis, each (c,), of the lattice edges that may cross the surface.

    The distances of the ends of such an edge from the surface sum to at most its length, plus the ``uncertainty``.
    """
    tails, heads, axes = [], [], []
    for axis, stride in enumerate(nodes.codes.strides):
        head = find_codes(nodes.table, nodes.table + stride)
        reach = nodes.distance + np.where(head >= 0, nodes.distance[head], np.inf)
        tail = np.flatnonzero(reach <= nodes.spacing * (1 + 1e-9) + uncertainty)
        tails.append(tail)
        heads.append(head[tail])
        axes.append(np.full(len(tail), axis))
    return np.concatenate(tails), np.concatenate(heads), np.concatenate(axes)


def _cross_plane(
    source: LocalSource, nodes: LatticeNodes, tail: Ints, head: Ints, along: Floats
) -> tuple[Floats, Floats]:
    """Return the positions (n,) at which edges cross a nearly planar piece of the surface, and the normals (n, 3).

    The ends of each edge lie on both sides of the piece; positions are lengths from the tail. The position is the root
    of the Hermite cubic of the signed distance along the edge, corrected by one query near it. It is NaN if that query
    contradicts the plane.
    """
    s, (near_share, end_share) = nodes.spacing, _ranges(source, nodes.spacing)
    d0, d1 = nodes.distance[tail] / s, -nodes.distance[head] / s
    m0, m1 = dots(nodes.normals[tail], along), -dots(nodes.normals[head], along)
    offset = max(0.01, OFFSET_NOISES * source.noise / s) / np.maximum(np.abs(m0), 0.1)
    a, b = 2 * d0 - 2 * d1 + m0 + m1, -3 * d0 + 3 * d1 - 2 * m0 - m1
    low, high = np.zeros(len(tail)), np.ones(len(tail))
    for _ in range(16):  # bisection: Newton's steps diverge where the edge grazes the surface
        t = 0.5 * (low + high)
        before = ((a * t + b) * t + m0) * t + d0 > 0
        low, high = np.where(before, t, low), np.where(before, high, t)
    target = np.maximum(low - offset, 0.0) * s
    there = _observe_surface(source, nodes.positions[tail] + target[:, None] * along, nodes.normals[tail], s)
    slope = dots(there.normal, along)
    with np.errstate(all="ignore"):
        t = target - there.distance / slope
    good = there.interior & (np.abs(slope) > GRAZING_SINE)
    good &= np.abs(t - target) < np.maximum(4 * end_share, 2 * offset) * s
    good &= (t > -near_share * s) & (t < (1 + near_share) * s) & (np.abs(dots(there.normal, nodes.normals[tail])) > 0.7)
    return np.where(good, np.clip(t, 0.0, s), np.nan), there.normal


def _march_edges(
    source: LocalSource, nodes: LatticeNodes, tail: Ints, head: Ints, along: Floats, reach: Floats
) -> tuple[Floats, Floats]:
    """Return the length (n,) from the tail to the first crossing of each edge, and the unit normal (n, 3) there.

    Only crossings within ``reach`` (n,) count, and the march ends before the crossings that a march from the head
    finds; without a crossing the length is NaN.
    """
    s, (near_share, end_share) = nodes.spacing, _ranges(source, nodes.spacing)
    first = Observation(nodes.distance[tail], nodes.normals[tail], ~nodes.on_rim[tail])
    ahead = nodes.distance[head]
    head_is_near = (ahead < near_share * s) & ~nodes.on_rim[head]
    stop = np.where(head_is_near, (1 - end_share) * s, np.minimum(s, s - ahead + end_share * s))
    return _first_hits(source, nodes.positions[tail], along, s, first, np.minimum(stop, reach))


def _first_hits(
    source: LocalSource,
    start: Floats,
    along: Floats,
    length: float,
    first: Observation,
    stop: Floats,
    newton: bool = True,
) -> tuple[Floats, Floats]:
    """Return the length (n,) at which each ray first meets the surface, and the unit normal (n, 3) there.

    The normal points back along the ray. The length is NaN, the normal zero, if a ray meets nothing up to its stop.
    Crossings do not count where the ray grazes the surface or the closest point is on a rim. Near a start that is near
    the surface (``END_SHARE``) only crossings found in the first round count. A step goes to the tangent plane of the
    closest point (Newton) as long as the distance falls and the normal hardly changes; else over the empty sphere
    around the last safe point (sphere tracing), by at least 6 % of ``length``, which may skip a crossing.

    ``start``, ``along`` (n, 3): starts and unit directions of rays. ``length``: the length to which tolerances refer.
    ``first``: observations at the starts. ``stop`` (n,): lengths of the rays.
    ``newton``: whether Newton's steps are tried. They may miss a sheet where two sheets cross.
    """
    hit, normal = np.full(len(start), np.nan), np.zeros_like(start)
    rows = np.arange(len(start))
    low = np.zeros(len(start))  # the ray meets nothing before
    t, base_t, follows_plane = np.zeros(len(start)), np.zeros(len(start)), np.ones(len(start), dtype=bool)
    now, base = first.take(rows), first.take(rows)
    near_share, end_share = _ranges(source, length)
    start_is_near = first.interior & (first.distance < near_share * length)
    floor = np.zeros(len(start))
    for _ in range(40):  # a limit; rays end at hits or at their stops
        slope = dots(now.normal, along[rows])
        steep = np.abs(slope) >= GRAZING_SINE
        with np.errstate(all="ignore"):
            target = np.where(steep, t - now.distance / slope, np.nan)
        ready = now.interior & (now.distance < near_share * length) & (np.abs(target - t) <= end_share * length)
        arrived = ready & (target >= np.maximum(low - near_share * length, floor[rows])) & (target <= stop[rows])
        hit[rows[arrived]], normal[rows[arrived]] = target[arrived], now.normal[arrived]
        normal[rows[arrived]] *= -np.sign(slope[arrived])[:, None]
        tries_plane = newton & follows_plane & (target > low) & (target <= stop[rows]) & now.interior
        # A sheet that runs along the ray leaves small spheres: steps are at least this share of the ray.
        sphere = base_t + np.maximum(base.distance, 0.06 * length)
        t_next = np.where(tries_plane, target, sphere)
        go = ~arrived & (t_next <= stop[rows])
        if not go.any():
            break
        floor[start_is_near] = end_share * length  # crossings nearer to the start were found in the first round
        rows, low, t, base_t, follows_plane = rows[go], low[go], t[go], base_t[go], follows_plane[go]
        now, base, tries_plane, t_next = now.take(go), base.take(go), tries_plane[go], t_next[go]
        new = _observe_surface(source, start[rows] + t_next[:, None] * along[rows], now.normal, length)
        same_sheet = np.abs(dots(new.normal, now.normal)) > 0.7
        converges = tries_plane & same_sheet & (new.distance <= 0.5 * now.distance)
        follows_plane = converges | ~tries_plane
        took_sphere = ~tries_plane
        low = np.where(took_sphere, np.maximum(low, base_t + base.distance), low)
        t, base_t = np.where(follows_plane, t_next, t), np.where(took_sphere, t_next, base_t)
        now.put(follows_plane, new.take(follows_plane))
        base.put(took_sphere, new.take(took_sphere))
    return hit, normal


def _predicts_head(nodes: LatticeNodes, head: Ints, along: Floats, t: Floats, normal: Floats) -> Bools:
    """Return for each edge (n,) whether the plane through its crossing predicts the closest point of its head.

    The plane has the ``normal`` (n, 3) and crosses the edge, of unit direction ``along`` (n, 3), at length ``t`` (n,).
    """
    s = nodes.spacing
    slope, cosine = dots(normal, along), dots(nodes.normals[head], normal)
    height = np.abs(s - t) * np.abs(slope)
    same = (np.abs(height - nodes.distance[head]) < 0.1 * s) & (np.abs(cosine) > PLANE_COSINE)
    return np.asarray(same & (cosine * slope > 0))


def _single_in_odd_faces(nodes: LatticeNodes, tail: Ints, axis: Ints, t: Floats) -> Bools:
    """Return whether (n,) each edge crosses the surface, and two lattice faces or more there are crossed oddly often.

    A closed sheet crosses the border of a face an even number of times. Faces with closest points on rims do not count.
    ``t`` (n,) is the length to the crossing of each edge, NaN without one.
    """
    count = np.zeros(nodes.index.shape, dtype=np.int64)
    np.add.at(count, (tail[~np.isnan(t)], axis[~np.isnan(t)]), 1)
    beyond = [find_codes(nodes.table, nodes.table + stride) for stride in nodes.codes.strides]
    odd = np.zeros_like(count)
    for u, v in ((0, 1), (1, 2), (2, 0)):
        face = np.flatnonzero((beyond[u] >= 0) & (beyond[v] >= 0) & nodes.nonplanar[:, u])
        right, up = beyond[u][face], beyond[v][face]
        sides = ((face, u), (face, v), (right, v), (up, u))
        at_rim = nodes.on_rim[face] | nodes.on_rim[right] | nodes.on_rim[up]
        is_odd = sum(count[side] for side in sides) % 2 * ~at_rim
        for rows, along in sides:
            np.add.at(odd[:, along], rows, is_odd)
    return np.asarray((count[tail, axis] == 1) & (odd[tail, axis] > 1))


def _other_crossings(
    source: LocalSource, nodes: LatticeNodes, tail: Ints, head: Ints, axis: Ints, t: Floats, flip: bool
) -> tuple[Floats, Floats]:
    """Return a crossing (n,) of each edge different from that at ``t`` (n,), and its normal (n, 3); NaN without one.

    The edge is marched by sphere tracing alone, from its head if ``flip``; crossings are lengths from the tail.
    """
    s, along = nodes.spacing, (-1.0 if flip else 1.0) * np.eye(3)[axis]
    start, known = (head, s - t) if flip else (tail, t)
    first = Observation(nodes.distance[start], nodes.normals[start], ~nodes.on_rim[start])
    hit, normal = _first_hits(source, nodes.positions[start], along, s, first, np.full(len(start), s), newton=False)
    with np.errstate(invalid="ignore"):
        hit = np.where(np.abs(hit - known) > SAME_SHARE * s, hit, np.nan)
    return (s - hit if flip else hit), normal
