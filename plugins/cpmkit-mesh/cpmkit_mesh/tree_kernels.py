"""Compiled: the nearest of a tree's triangles and segments to each query, and the local minima of the distance.

A query walks the tree with a stack of its own. Triangles stand in the order of the leaves, each as a
corner and the two edges that leave it. Arguments carry no types: numba infers them.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled, inlined
from cpmkit_mesh.building_kernels import STACK_NODES

#: How a primitive is measured: a triangle, a triangle too thin for plain formulas, a segment.
TRIANGLE_KIND, SLIVER_KIND, SEGMENT_KIND = 0, 1, 2
#: A foot with a barycentric coordinate below this lies on the edge opposite that corner.
ON_SIDE_COORDINATE = 1e-12
#: What rounding may take from a square.
SQUARE_ROUNDING = 1e-12
#: Normals that miss the query by no more than this, of cosines, may miss it by the rounding of angles.
CONE_SLACK_COSINE = 1e-7


@compiled
def nearest(x, start, stop, boxes, nodes, frames, shape, slot, local, foot, distance):
    """Answer the queries ``x[start:stop]`` (n, 3) from ``frames`` (m, 3, 3): a corner and the two edges that leave it.

    Writes the place ``slot`` (n,) of the nearest primitive in the order of the leaves, the
    coordinates ``local`` (n, 2) of the foot along its first two edges, ``foot`` (n, 3) and
    ``distance`` (n,). Ties go to the primitive met first, the same in every run.
    """
    waiting_node = np.empty(STACK_NODES, dtype=np.uint64)
    waiting_square = np.empty(STACK_NODES)
    for i in range(start, stop):
        px, py, pz = x[i, 0], x[i, 1], x[i, 2]
        best, best_slot, best_v, best_w = np.inf, np.uint64(0), 0.0, 0.0
        waiting_node[0] = 0
        waiting_square[0] = 0.0
        waiting = 1
        while waiting:
            waiting -= 1
            if waiting_square[waiting] >= best:
                continue
            node = waiting_node[waiting]
            while nodes[node, 0] == 0:
                near = nodes[node, 1]
                far = near + np.uint64(1)
                near_square = _box_square(px, py, pz, boxes, near)
                far_square = _box_square(px, py, pz, boxes, far)
                if far_square < near_square:
                    near, far = far, near
                    near_square, far_square = far_square, near_square
                if far_square < best:
                    waiting_node[waiting] = far
                    waiting_square[waiting] = far_square
                    waiting += 1
                if near_square >= best:
                    break
                node = near
            else:
                first = nodes[node, 1]
                for s in range(first, first + nodes[node, 0]):
                    square, v, w = _measure(px, py, pz, frames, s, shape[s])
                    if square < best:
                        best, best_slot, best_v, best_w = square, s, v, w
        slot[i] = best_slot
        _write(x, i, best_slot, best_v, best_w, frames, local, foot, distance)


@compiled
def nearest_in(x, start, stop, frames, shape, slot, local, foot, distance):
    """Answer as ``nearest`` does, from the primitives that ``slot`` (n,) names."""
    for i in range(start, stop):
        s = np.uint64(slot[i])
        _, v, w = _measure(x[i, 0], x[i, 1], x[i, 2], frames, s, shape[s])
        _write(x, i, s, v, w, frames, local, foot, distance)


@compiled
def minima(x, start, stop, radius, boxes, nodes, frames, shape, patches, cones):
    """Find the local minima, up to ``radius``, of the distance from ``x[start:stop]`` over the whole surface.

    ``patches`` holds the vertices (m, 3) of each slot, and by vertex where its slots begin and which they are;
    ``cones`` (nodes, 5) bound the normals in each box, and a box to which none of them leads is left out.
    Returns for each minimum its row in ``x`` and its slot, in the order of rows; and how many were measured.
    """
    rows, slots = np.empty(64, dtype=np.int64), np.empty(64, dtype=np.int64)
    waiting_node = np.empty(STACK_NODES, dtype=np.uint64)
    count, measured, limit = 0, 0, radius * radius * (1.0 + SQUARE_ROUNDING)
    for i in range(start, stop):
        px, py, pz = x[i, 0], x[i, 1], x[i, 2]
        waiting_node[0] = 0
        waiting = 1
        while waiting:
            waiting -= 1
            node = waiting_node[waiting]
            if _box_square(px, py, pz, boxes, node) > limit or _turned_away(px, py, pz, boxes, cones, node):
                continue
            begin = nodes[node, 1]
            if nodes[node, 0] == 0:
                waiting_node[waiting], waiting_node[waiting + 1] = begin, begin + np.uint64(1)
                waiting += 2
                continue
            for s in range(begin, begin + nodes[node, 0]):
                square, v, w = _measure(px, py, pz, frames, s, shape[s])
                measured += 1
                if square > limit:
                    continue
                undercut, tried = _undercut(px, py, pz, frames, shape, patches, s, square, v, w)
                measured += tried
                if undercut:
                    continue
                if count == len(rows):
                    rows, slots = np.concatenate((rows, rows)), np.concatenate((slots, slots))
                rows[count], slots[count] = i, s
                count += 1
    return rows[:count], slots[:count], measured


@inlined
def _turned_away(px, py, pz, boxes, cones, node):
    """Tell whether no point of the box sees the query along a normal in the node's cone (Johnson and Cohen 2001).

    At a local minimum the way to the query is a normal there, or between those of the triangles around. From the
    ball around the box it leads into a cone about the way from its centre, with the sine radius over distance.
    """
    dx = px - 0.5 * (boxes[node, 0] + boxes[node, 3])
    dy = py - 0.5 * (boxes[node, 1] + boxes[node, 4])
    dz = pz - 0.5 * (boxes[node, 2] + boxes[node, 5])
    wx, wy, wz = boxes[node, 3] - boxes[node, 0], boxes[node, 4] - boxes[node, 1], boxes[node, 5] - boxes[node, 2]
    ball, square = 0.25 * (wx * wx + wy * wy + wz * wz), dx * dx + dy * dy + dz * dz
    if ball >= square:
        return False
    cosine = cones[node, 3] * np.sqrt(square - ball) - cones[node, 4] * np.sqrt(ball)
    along = dx * cones[node, 0] + dy * cones[node, 1] + dz * cones[node, 2]
    return cosine > 0.0 and abs(along) < cosine - CONE_SLACK_COSINE * np.sqrt(square)


@compiled
def _undercut(px, py, pz, frames, shape, patches, s, square, v, w):
    """Tell whether a triangle that shares the edge or corner of slot s on which its foot lies has a nearer one.

    Triangles are convex, and so is the distance over each: where none of them has a nearer foot, this one is a
    local minimum. Of equals the lowest slot counts as the nearest. Also returns how many were measured.
    """
    vertices, first, around = patches
    corner, other, parts = -1, -1, 0
    for k in range(3):
        share = 1.0 - v - w if k == 0 else (v if k == 1 else w)
        if share > ON_SIDE_COORDINATE:
            parts += 1
            corner, other = vertices[s, k], corner
    if parts == 3:
        return False, 0
    tried = 0
    for place in range(first[corner], first[corner + 1]):
        beside = around[place]
        shares = vertices[beside, 0] == other or vertices[beside, 1] == other or vertices[beside, 2] == other
        if beside == np.int64(s) or (parts == 2 and not shares):
            continue
        tried += 1
        there, _, _ = _measure(px, py, pz, frames, np.uint64(beside), shape[beside])
        if there < square or (there == square and beside < np.int64(s)):
            return True, tried
    return False, tried


@compiled
def distinct(rows, points, distance, near, tiny, kept):
    """Mark in ``kept`` (k,) the first of the ``points`` (k, 3) of each of ``rows`` (k,), ascending, at each place.

    Those nearer to each other than ``near`` times the distance, and ``tiny``, are one.
    """
    begin = 0
    for i in range(len(rows)):
        if rows[i] != rows[begin]:
            begin = i
        allowed = (near * distance[i] + tiny) ** 2
        kept[i] = True
        for j in range(begin, i):
            square = 0.0
            for k in range(3):
                square += (points[i, k] - points[j, k]) ** 2
            if kept[j] and square <= allowed:
                kept[i] = False
                break


@inlined
def _write(x, i, s, v, w, frames, local, foot, distance):
    local[i, 0] = v
    local[i, 1] = w
    square = 0.0
    for k in range(3):
        foot[i, k] = frames[s, 0, k] + (v * frames[s, 1, k] + w * frames[s, 2, k])
        square += (x[i, k] - foot[i, k]) ** 2
    distance[i] = np.sqrt(square)


@inlined
def _box_square(px, py, pz, boxes, node):
    dx = max(max(boxes[node, 0] - px, px - boxes[node, 3]), 0.0)
    dy = max(max(boxes[node, 1] - py, py - boxes[node, 4]), 0.0)
    dz = max(max(boxes[node, 2] - pz, pz - boxes[node, 5]), 0.0)
    return dx * dx + dy * dy + dz * dz


@inlined
def _measure(px, py, pz, frames, s, shape):
    """Return the squared distance to primitive ``s`` and the foot's coordinates along its edges."""
    qx, qy, qz = px - frames[s, 0, 0], py - frames[s, 0, 1], pz - frames[s, 0, 2]
    bx, by, bz = frames[s, 1, 0], frames[s, 1, 1], frames[s, 1, 2]
    cx, cy, cz = frames[s, 2, 0], frames[s, 2, 1], frames[s, 2, 2]
    if shape == TRIANGLE_KIND:
        v, w = _foot_in_triangle(qx, qy, qz, bx, by, bz, cx, cy, cz)
    elif shape == SEGMENT_KIND:
        v, w = _foot_on_edge(qx, qy, qz, bx, by, bz), 0.0
    else:
        v, w = _foot_in_sliver(qx, qy, qz, bx, by, bz, cx, cy, cz)
    rx, ry, rz = qx - v * bx - w * cx, qy - v * by - w * cy, qz - v * bz - w * cz
    return rx * rx + ry * ry + rz * rz, v, w


@inlined
def _foot_in_triangle(qx, qy, qz, bx, by, bz, cx, cy, cz):
    """Classify q against the regions of corners, edges and face (Ericson, Real-Time Collision Detection, 5.1.5)."""
    bb = bx * bx + by * by + bz * bz
    bc = bx * cx + by * cy + bz * cz
    cc = cx * cx + cy * cy + cz * cz
    d1 = bx * qx + by * qy + bz * qz
    d2 = cx * qx + cy * qy + cz * qz
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0
    d3, d4 = d1 - bb, d2 - bc
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0
    area_c = d1 * d4 - d3 * d2
    if area_c <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return d1 / bb, 0.0
    d5, d6 = d1 - bc, d2 - cc
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0
    area_b = d5 * d2 - d1 * d6
    if area_b <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / cc
    area_a = d3 * d6 - d5 * d4
    if area_a <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - w, w
    total = area_a + area_b + area_c
    return area_b / total, area_c / total


@compiled
def _foot_on_edge(qx, qy, qz, ex, ey, ez):
    square = ex * ex + ey * ey + ez * ez
    t = (qx * ex + qy * ey + qz * ez) / square if square > 0.0 else 0.0
    return min(max(t, 0.0), 1.0)


@compiled
def _foot_in_sliver(qx, qy, qz, bx, by, bz, cx, cy, cz):
    """Take the best of the three edges and, in an orthonormal frame along the longer side, the inside.

    The plain formulas divide by the squared area, which a sliver loses to cancellation.
    """
    v, w = _foot_on_edge(qx, qy, qz, bx, by, bz), 0.0
    best = (qx - v * bx) ** 2 + (qy - v * by) ** 2 + (qz - v * bz) ** 2
    t = _foot_on_edge(qx, qy, qz, cx, cy, cz)
    square = (qx - t * cx) ** 2 + (qy - t * cy) ** 2 + (qz - t * cz) ** 2
    if square < best:
        best, v, w = square, 0.0, t
    ex, ey, ez = cx - bx, cy - by, cz - bz
    t = _foot_on_edge(qx - bx, qy - by, qz - bz, ex, ey, ez)
    square = (qx - bx - t * ex) ** 2 + (qy - by - t * ey) ** 2 + (qz - bz - t * ez) ** 2
    if square < best:
        best, v, w = square, 1.0 - t, t
    long_b = bx * bx + by * by + bz * bz >= cx * cx + cy * cy + cz * cz
    ux, uy, uz, sx, sy, sz = (bx, by, bz, cx, cy, cz) if long_b else (cx, cy, cz, bx, by, bz)
    length = np.sqrt(ux * ux + uy * uy + uz * uz)
    if length == 0.0:
        return v, w
    ux, uy, uz = ux / length, uy / length, uz / length
    along = sx * ux + sy * uy + sz * uz
    hx, hy, hz = sx - along * ux, sy - along * uy, sz - along * uz
    again = hx * ux + hy * uy + hz * uz
    hx, hy, hz = hx - again * ux, hy - again * uy, hz - again * uz
    height = np.sqrt(hx * hx + hy * hy + hz * hz)
    if height <= 1e-15 * length:
        return v, w
    second = (qx * hx + qy * hy + qz * hz) / (height * height)
    first = (qx * ux + qy * uy + qz * uz - second * along) / length
    if first >= 0.0 and second >= 0.0 and first + second <= 1.0:
        return (first, second) if long_b else (second, first)
    return v, w
