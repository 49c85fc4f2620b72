"""Where lattice edges cross a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.lattice import find
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots
from cpmkit.meshing.contouring.marching import (
    ARRIVED_NOISES,
    BESIDE_NOISES,
    GRAZING,
    Seen,
    arrival,
    feet_and_normals,
    first_hits,
    look,
)
from cpmkit.meshing.contouring.nodes import ALIKE_COSINE, Nodes
from cpmkit.protocols import Bools, Floats, Ints

#: A plane through a crossing explains what is seen at the edge's other end up to this share of the edge.
EXPLAINED = 0.1
#: Crossings of one edge are this share of it apart, or their normals have a cosine below that: two sheets that meet.
APART, SAME_COSINE = 0.1, 0.95
#: Crossings of one edge found twice are the same up to this share of it.
SAME_POINT = 0.005
#: Where the surface looks plane it is asked this far, as a share of the edge, beside the crossing: for the normal.
BESIDE = 0.01
#: Halvings that find the root of the cubic between two nodes.
HERMITE_HALVINGS = 16


@dataclass(frozen=True, eq=False)
class Crossings:
    """Points at which lattice edges cross the surface.

    Attributes
    ----------
    node : (c, 3) int64
        The lower end of the edge.
    axis : (c,) int64
        The edge's axis.
    points, normals : (c, 3) float64
        Where it crosses the surface, and the unit normal there, of either sign.
    """

    node: Ints
    axis: Ints
    points: Floats
    normals: Floats


def crossings(source: LocalSource, nodes: Nodes) -> Crossings:
    """Return where edges between ``nodes`` cross the surface: at most twice an edge, once from either end."""
    tail, head, axis = _candidates(nodes, 2 * ARRIVED_NOISES * source.noise)
    s, arrived = nodes.spacing, arrival(source, nodes.spacing)[0]
    along = np.eye(3)[axis]
    t, normal = np.full(len(tail), np.nan), np.zeros((len(tail), 3))
    plane = ~nodes.unlike[tail, axis]
    through = plane & (dots(nodes.normals[tail], nodes.normals[head]) < 0)
    rows = np.flatnonzero(through & (dots(nodes.normals[tail], along) < 0))
    t[rows], normal[rows] = _through_plane(source, nodes, tail[rows], head[rows], along[rows])
    rows = np.flatnonzero(np.isnan(t) & (~plane | through))
    t[rows], normal[rows] = _marched(source, nodes, tail[rows], head[rows], along[rows], np.full(len(rows), s))
    grazed = np.flatnonzero(np.isnan(t) & through)  # it crosses all the same, and a hole would be left
    t[grazed] = s * nodes.distance[tail[grazed]] / (nodes.distance[tail[grazed]] + nodes.distance[head[grazed]])
    normal[grazed] = nodes.normals[tail[grazed]]
    explained = _explained(nodes, head[rows], along[rows], t[rows], normal[rows])
    none_left = np.isnan(t[rows]) & ~((nodes.distance[head[rows]] < arrived * s) & ~nodes.rim[head[rows]])
    none_left &= source.noise == 0  # rays along the surface pass it where feet are noisy
    back = rows[~explained & ~none_left & ~plane[rows]]
    room = np.where(np.isnan(t[back]), s, s - t[back] + APART * s)
    t_back, normal_back = _marched(source, nodes, head[back], tail[back], -along[back], np.minimum(room, s))
    with np.errstate(invalid="ignore"):
        near = np.abs(s - t_back - t[back]) < APART * s
    alike, cosine = dots(normal[back], normal_back), SAME_COSINE if source.noise == 0 else 0.0
    t[back[near & (alike > cosine)]] = np.nan  # a bulge goes out and in again: neither is kept
    t_back[near & (np.abs(alike) > cosine)] = np.nan
    tails, axes = np.concatenate([tail, tail[back]]), np.concatenate([axis, axis[back]])
    times, normals = np.concatenate([t, s - t_back]), np.concatenate([normal, normal_back])
    lone = _lone_in_odd_faces(nodes, tails, axes, times)[rows]
    at = rows[lone & ~np.isnan(t[rows]) & (source.noise == 0)]
    found = [_other_crossings(source, nodes, tail[at], head[at], axis[at], t[at], flip) for flip in (False, True)]
    with np.errstate(invalid="ignore"):
        found[1][0][np.abs(found[1][0] - found[0][0]) < SAME_POINT * s] = np.nan
    tails, axes = np.concatenate([tails, tail[at], tail[at]]), np.concatenate([axes, axis[at], axis[at]])
    t, normal = (np.concatenate(parts) for parts in zip((times, normals), *found, strict=True))
    axis = axes
    kept = np.flatnonzero(~np.isnan(t))
    points = nodes.positions[tails[kept]] + t[kept, None] * np.eye(3)[axis[kept]]
    normal = normal[kept]
    if BESIDE_NOISES * source.noise > BESIDE * s:
        points, normal = feet_and_normals(source, points, normal, s)
    return Crossings(nodes.index[tails[kept]], axis[kept], points, normal)


def _candidates(nodes: Nodes, lost: float) -> tuple[Ints, Ints, Ints]:
    """Return the ends and axes of the edges that distances at the ends, known up to ``lost``, let cross the surface."""
    tails, heads, axes = [], [], []
    for axis, stride in enumerate(nodes.codes.strides):
        head = find(nodes.table, nodes.table + stride)
        reach = nodes.distance + np.where(head >= 0, nodes.distance[head], np.inf)
        tail = np.flatnonzero(reach <= nodes.spacing * (1 + 1e-9) + lost)
        tails.append(tail)
        heads.append(head[tail])
        axes.append(np.full(len(tail), axis))
    return np.concatenate(tails), np.concatenate(heads), np.concatenate(axes)


def _through_plane(source: LocalSource, nodes: Nodes, tail: Ints, head: Ints, along: Floats) -> tuple[Floats, Floats]:
    """Return the crossing of edges whose ends lie on both sides of what looks like one plane; NaN where it was not."""
    s, (arrived, told) = nodes.spacing, arrival(source, nodes.spacing)
    d0, d1 = nodes.distance[tail] / s, -nodes.distance[head] / s
    m0, m1 = dots(nodes.normals[tail], along), -dots(nodes.normals[head], along)
    beside = max(BESIDE, BESIDE_NOISES * source.noise / s) / np.maximum(np.abs(m0), 0.1)
    a, b = 2 * d0 - 2 * d1 + m0 + m1, -3 * d0 + 3 * d1 - 2 * m0 - m1
    low, high = np.zeros(len(tail)), np.ones(len(tail))
    for _ in range(HERMITE_HALVINGS):  # of Hermite's cubic; Newton's steps go astray where the edge grazes
        t = 0.5 * (low + high)
        before = ((a * t + b) * t + m0) * t + d0 > 0
        low, high = np.where(before, t, low), np.where(before, high, t)
    target = np.maximum(low - beside, 0.0) * s
    seen = look(source, nodes.positions[tail] + target[:, None] * along, nodes.normals[tail], s)
    slope = dots(seen.normal, along)
    with np.errstate(all="ignore"):
        t = target - seen.distance / slope
    good = seen.inner & (np.abs(slope) > GRAZING) & (np.abs(t - target) < np.maximum(4 * told, 2 * beside) * s)
    good &= (t > -arrived * s) & (t < (1 + arrived) * s) & (np.abs(dots(seen.normal, nodes.normals[tail])) > 0.7)
    return np.where(good, np.clip(t, 0.0, s), np.nan), seen.normal


def _marched(
    source: LocalSource, nodes: Nodes, tail: Ints, head: Ints, along: Floats, room: Floats
) -> tuple[Floats, Floats]:
    s, (arrived, reported_at) = nodes.spacing, arrival(source, nodes.spacing)
    seen = Seen(nodes.distance[tail], nodes.normals[tail], ~nodes.rim[tail])
    ahead = nodes.distance[head]
    told = (ahead < arrived * s) & ~nodes.rim[head]
    stop = np.where(told, (1 - reported_at) * s, np.minimum(s, s - ahead + reported_at * s))
    return first_hits(source, nodes.positions[tail], along, s, seen, np.minimum(stop, room))


def _lone_in_odd_faces(nodes: Nodes, tail: Ints, axis: Ints, t: Floats) -> Bools:
    """Return which edges cross the surface once, and have two lattice faces or more with an odd number of crossings.

    Closed sheets cross the border of a face an even number of times; where feet lie on rims that need not be.
    """
    count = np.zeros(nodes.index.shape, dtype=np.int64)
    np.add.at(count, (tail[~np.isnan(t)], axis[~np.isnan(t)]), 1)
    beyond = [find(nodes.table, nodes.table + stride) for stride in nodes.codes.strides]
    odd = np.zeros_like(count)
    for u, v in ((0, 1), (1, 2), (2, 0)):
        face = np.flatnonzero((beyond[u] >= 0) & (beyond[v] >= 0) & nodes.unlike[:, u])
        right, up = beyond[u][face], beyond[v][face]
        sides = ((face, u), (face, v), (right, v), (up, u))
        is_odd = sum(count[side] for side in sides) % 2 * ~(nodes.rim[face] | nodes.rim[right] | nodes.rim[up])
        for rows, along in sides:
            np.add.at(odd[:, along], rows, is_odd)
    return np.asarray((count[tail, axis] == 1) & (odd[tail, axis] > 1))


def _other_crossings(
    source: LocalSource, nodes: Nodes, tail: Ints, head: Ints, axis: Ints, t: Floats, flip: bool
) -> tuple[Floats, Floats]:
    """Return a crossing of each edge but for that at ``t``, by short steps from one end; NaN where there is none."""
    s, along = nodes.spacing, (-1.0 if flip else 1.0) * np.eye(3)[axis]
    start, known = (head, s - t) if flip else (tail, t)
    seen = Seen(nodes.distance[start], nodes.normals[start], ~nodes.rim[start])
    hit, normal = first_hits(source, nodes.positions[start], along, s, seen, np.full(len(start), s), False)
    with np.errstate(invalid="ignore"):
        hit = np.where(np.abs(hit - known) > SAME_POINT * s, hit, np.nan)
    return (s - hit if flip else hit), normal


def _explained(nodes: Nodes, head: Ints, along: Floats, t: Floats, normal: Floats) -> Bools:
    """Return whether the head of an edge sees nothing but the other side of the plane through the crossing at ``t``."""
    s = nodes.spacing
    slope, alike = dots(normal, along), dots(nodes.normals[head], normal)
    height = np.abs(s - t) * np.abs(slope)
    same = (np.abs(height - nodes.distance[head]) < EXPLAINED * s) & (np.abs(alike) > ALIKE_COSINE)
    return np.asarray(same & (alike * slope > 0))
