"""Compiled: the nearest of a tree's triangles and segments to each query, and local minima of the distance.

A query traverses the tree with a stack of its own. Triangles are in the order of the leaves, each as a corner and the
two edges from it. Arguments have no type annotations: numba infers the types.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled, inlined
from cpmkit_mesh.box_tree_kernels import STACK_NODES

#: The formula of the distance: of a triangle, of a triangle too thin for the usual formula, of a segment.
TRIANGLE_KIND, SLIVER_KIND, SEGMENT_KIND = 0, 1, 2
#: A nearest point with a barycentric coordinate below this lies on the edge opposite that corner.
ON_SIDE_COORDINATE = 1e-12
#: The relative rounding of a squared distance.
SQUARE_ROUNDING = 1e-12
#: The rounding of cosines in the test whether a cone of normals leads to the query.
CONE_SLACK_COSINE = 1e-7


@compiled
def fill_nearest(x, start, stop, boxes, nodes, frames, shape, slot, local, point, distance):
    """Find the nearest primitive, a triangle or segment, of each query ``x[start:stop]`` (n, 3).

    ``boxes``, ``nodes``, ``frames`` and ``shape`` are those of a ``BoxTree``. Written in rows start to stop are the
    ``slot`` (n,) of the nearest primitive, the coordinates ``local`` (n, 2) of the nearest point along its two edges,
    the ``point`` (n, 3) and its ``distance`` (n,). Ties go to the primitive reached first, which is the same in every
    run.
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
                near_node = nodes[node, 1]
                far_node = near_node + np.uint64(1)
                near_square = _box_square(px, py, pz, boxes, near_node)
                far_square = _box_square(px, py, pz, boxes, far_node)
                if far_square < near_square:
                    near_node, far_node = far_node, near_node
                    near_square, far_square = far_square, near_square
                if far_square < best:
                    waiting_node[waiting] = far_node
                    waiting_square[waiting] = far_square
                    waiting += 1
                if near_square >= best:
                    break
                node = near_node
            else:
                first = nodes[node, 1]
                for s in range(first, first + nodes[node, 0]):
                    square, v, w = _measure_primitive(px, py, pz, frames, s, shape[s])
                    if square < best:
                        best, best_slot, best_v, best_w = square, s, v, w
        slot[i] = best_slot
        _write_nearest(x, i, best_slot, best_v, best_w, frames, local, point, distance)


@compiled
def fill_projections(x, start, stop, frames, shape, slot, local, point, distance):
    """Write to rows ``start`` to ``stop`` the nearest point of each query on the primitive in its given ``slot`` (n,).

    Arguments are as in :func:`fill_nearest`; ``local``, ``point`` and ``distance`` are written.
    """
    for i in range(start, stop):
        s = np.uint64(slot[i])
        _, v, w = _measure_primitive(x[i, 0], x[i, 1], x[i, 2], frames, s, shape[s])
        _write_nearest(x, i, s, v, w, frames, local, point, distance)


@compiled
def find_local_minima(x, start, stop, radius, boxes, nodes, frames, shape, patches, cones):
    """Return queries and slots of the local minima, up to ``radius``, of the distance from ``x[start:stop]`` (n, 3).

    ``boxes``, ``nodes``, ``frames`` and ``shape`` are those of a ``BoxTree``, ``patches`` the vertices (m, 3) of each
    slot, for each vertex the position of its first slot (k + 1,), and the slots around the vertices. ``cones`` (nodes,
    5) bound the normals in each box: a box none of whose normals leads to the query is skipped. Returned are the row in
    ``x`` (j,), ascending, and the slot (j,) of each minimum, and the number of distances that were computed.
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
            if _box_square(px, py, pz, boxes, node) > limit or _cone_misses_query(px, py, pz, boxes, cones, node):
                continue
            begin = nodes[node, 1]
            if nodes[node, 0] == 0:
                waiting_node[waiting], waiting_node[waiting + 1] = begin, begin + np.uint64(1)
                waiting += 2
                continue
            for s in range(begin, begin + nodes[node, 0]):
                square, v, w = _measure_primitive(px, py, pz, frames, s, shape[s])
                measured += 1
                if square > limit:
                    continue
                has_lower, count_tested = _has_lower_neighbour(px, py, pz, frames, shape, patches, s, square, v, w)
                measured += count_tested
                if has_lower:
                    continue
                if count == len(rows):
                    rows, slots = np.concatenate((rows, rows)), np.concatenate((slots, slots))
                rows[count], slots[count] = i, s
                count += 1
    return rows[:count], slots[:count], measured


@inlined
def _cone_misses_query(px, py, pz, boxes, cones, node):
    """Return whether surely no normal in the node's cone leads, on either side, from its box to the query p.

    ``boxes`` (nodes, 6) and ``cones`` (nodes, 5) are those of a ``BoxTree`` and ``VertexTriangles``. At a local minimum
    the direction to the query is a normal, or a mean of those of the triangles around it (Johnson and Cohen 2001). From
    all points of the ball around the box, directions to the query lie in a cone about that from the centre, whose sine
    is radius over distance. False if the query lies in the ball, or both cones together reach a right angle.
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
def _has_lower_neighbour(px, py, pz, frames, shape, patches, s, square, v, w):
    """Return whether a neighbour of slot ``s`` at its closest point is nearer to p, and how many were measured.

    The point, at v, w of slot s, has the squared distance ``square``; neighbours share the edge or corner on which it
    lies. Triangles are convex, and so is the distance over each: the point is a local minimum if no neighbour is
    nearer. Of equal distances that in the lowest slot counts as nearer. ``patches`` is as in :func:`find_local_minima`.
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
    tested = 0
    for place in range(first[corner], first[corner + 1]):
        t = around[place]
        shares = vertices[t, 0] == other or vertices[t, 1] == other or vertices[t, 2] == other
        if t == np.int64(s) or (parts == 2 and not shares):
            continue
        tested += 1
        there, _, _ = _measure_primitive(px, py, pz, frames, np.uint64(t), shape[t])
        if there < square or (there == square and t < np.int64(s)):
            return True, tested
    return False, tested


@compiled
def mark_distinct_minima(rows, points, distance, relative, absolute, is_first):
    """Mark in ``is_first`` (k,) whether each of the ``points`` (k, 3) is the first of its query at its place.

    ``rows`` (k,), ascending, are the queries of the points, ``distance`` (k,) the distances from them. Points of a
    query that are nearer to each other than ``relative`` times the distance plus ``absolute`` are at one place.
    """
    begin = 0
    for i in range(len(rows)):
        if rows[i] != rows[begin]:
            begin = i
        allowed = (relative * distance[i] + absolute) ** 2
        is_first[i] = True
        for j in range(begin, i):
            square = 0.0
            for k in range(3):
                square += (points[i, k] - points[j, k]) ** 2
            if is_first[j] and square <= allowed:
                is_first[i] = False
                break


@inlined
def _write_nearest(x, i, s, v, w, frames, local, point, distance):
    """Write to row ``i`` of ``local``, ``point`` and ``distance`` the point at v, w of the primitive in slot ``s``.

    The distance is that from ``x[i]``; ``frames`` are those of a ``BoxTree``.
    """
    local[i, 0] = v
    local[i, 1] = w
    square = 0.0
    for k in range(3):
        point[i, k] = frames[s, 0, k] + (v * frames[s, 1, k] + w * frames[s, 2, k])
        square += (x[i, k] - point[i, k]) ** 2
    distance[i] = np.sqrt(square)


@inlined
def _box_square(px, py, pz, boxes, node):
    """Return the squared distance of p from the box of ``node`` in ``boxes`` (nodes, 6), zero inside."""
    dx = max(max(boxes[node, 0] - px, px - boxes[node, 3]), 0.0)
    dy = max(max(boxes[node, 1] - py, py - boxes[node, 4]), 0.0)
    dz = max(max(boxes[node, 2] - pz, pz - boxes[node, 5]), 0.0)
    return dx * dx + dy * dy + dz * dz


@inlined
def _measure_primitive(px, py, pz, frames, s, shape):
    """Return the squared distance from p to the primitive in slot ``s``, and v, w of its nearest point along its edges.

    ``frames`` (m, 3, 3) are those of a ``BoxTree``; ``shape`` is the formula: triangle, sliver or segment.
    """
    qx, qy, qz = px - frames[s, 0, 0], py - frames[s, 0, 1], pz - frames[s, 0, 2]
    bx, by, bz = frames[s, 1, 0], frames[s, 1, 1], frames[s, 1, 2]
    cx, cy, cz = frames[s, 2, 0], frames[s, 2, 1], frames[s, 2, 2]
    if shape == TRIANGLE_KIND:
        v, w = _closest_in_triangle(qx, qy, qz, bx, by, bz, cx, cy, cz)
    elif shape == SEGMENT_KIND:
        v, w = _closest_on_edge(qx, qy, qz, bx, by, bz), 0.0
    else:
        v, w = _closest_in_sliver(qx, qy, qz, bx, by, bz, cx, cy, cz)
    rx, ry, rz = qx - v * bx - w * cx, qy - v * by - w * cy, qz - v * bz - w * cz
    return rx * rx + ry * ry + rz * rz, v, w


@inlined
def _closest_in_triangle(qx, qy, qz, bx, by, bz, cx, cy, cz):
    """Return v, w of the point v b + w c of the triangle with corners 0, b and c that is nearest to q.

    Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
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
def _closest_on_edge(qx, qy, qz, ex, ey, ez):
    """Return the share in [0, 1] of the edge from 0 to e at which the edge is nearest to q; 0 if e is zero."""
    square = ex * ex + ey * ey + ez * ez
    t = (qx * ex + qy * ey + qz * ez) / square if square > 0.0 else 0.0
    return min(max(t, 0.0), 1.0)


@compiled
def _closest_in_sliver(qx, qy, qz, bx, by, bz, cx, cy, cz):
    """Return v, w of the point v b + w c of a thin triangle with corners 0, b, c that is nearest to q.

    It is sought on each edge and inside, in an orthonormal frame with an axis along the longer side: the usual formulas
    divide by the squared area, which cancellation destroys.
    """
    v, w = _closest_on_edge(qx, qy, qz, bx, by, bz), 0.0
    best = (qx - v * bx) ** 2 + (qy - v * by) ** 2 + (qz - v * bz) ** 2
    t = _closest_on_edge(qx, qy, qz, cx, cy, cz)
    square = (qx - t * cx) ** 2 + (qy - t * cy) ** 2 + (qz - t * cz) ** 2
    if square < best:
        best, v, w = square, 0.0, t
    ex, ey, ez = cx - bx, cy - by, cz - bz
    t = _closest_on_edge(qx - bx, qy - by, qz - bz, ex, ey, ez)
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
