"""Compiled: a binary tree of boxes over triangles and segments, and the nearest of them to each query.

The tree is split at the cheapest of 16 bins along each axis; a query walks it with a stack of its
own, the nearer child first. Triangles stand in the order of the leaves, each as a corner and the
two edges that leave it. Arguments carry no types: numba infers them.
"""

from __future__ import annotations

import numpy as np

from cpmkit.compilation import compiled, inlined

BINS = 16
LEAF = 4
#: Below this depth nodes are halved by number, which bounds the depth and with it the stacks.
DEEP = 40
STACK = 96

#: How a primitive is measured: a triangle, a triangle too thin for plain formulas, a segment.
TRIANGLE, SLIVER, SEGMENT = 0, 1, 2


@compiled
def build(lower, upper):
    """Return the tree over primitives with the boxes ``lower``, ``upper`` (m, 3).

    Returns ``boxes`` (nodes, 6); ``nodes`` (nodes, 2), unsigned so that no index is tested for its
    sign: (0, first of two adjacent children), or for a leaf (how many primitives, first of them in
    ``order``); and ``order`` (m,).
    """
    m = len(lower)
    order = np.arange(m)
    boxes = np.empty((2 * m, 6))
    nodes = np.zeros((2 * m, 2), dtype=np.int64)
    pending = np.empty((2 * STACK, 4), dtype=np.int64)
    pending[0] = (0, 0, m, 0)
    used, waiting = 1, 1
    while waiting:
        waiting -= 1
        node, start, stop, depth = pending[waiting]
        _bound(lower, upper, order, start, stop, boxes[node])
        if stop - start <= LEAF:
            nodes[node] = (stop - start, start)
            continue
        middle = _split(lower, upper, order, start, stop, depth)
        nodes[node] = (0, used)
        pending[waiting] = (used, start, middle, depth + 1)
        pending[waiting + 1] = (used + 1, middle, stop, depth + 1)
        waiting += 2
        used += 2
    return boxes[:used].copy(), nodes[:used].astype(np.uint64), order


@compiled
def _bound(lower, upper, order, start, stop, box):
    box[:3] = np.inf
    box[3:] = -np.inf
    for i in range(start, stop):
        for axis in range(3):
            box[axis] = min(box[axis], lower[order[i], axis])
            box[3 + axis] = max(box[3 + axis], upper[order[i], axis])


@compiled
def _split(lower, upper, order, start, stop, depth):
    """Reorder ``order[start:stop]`` so that it splits well at the returned place."""
    axis, place, least, scale, cost = -1, 0, 0.0, 0.0, np.inf
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(start, stop):
            twice_centre = lower[order[i], k] + upper[order[i], k]
            low, high = min(low, twice_centre), max(high, twice_centre)
        if high > low:
            per_width = BINS * (1 - 1e-12) / (high - low)
            bin_here, cost_here = _best_bin(lower, upper, order, start, stop, k, low, per_width)
            if cost_here < cost:
                axis, place, least, scale, cost = k, bin_here, low, per_width, cost_here
    half = (start + stop) // 2
    if axis < 0:
        return half
    if depth >= DEEP:
        part = order[start:stop].copy()
        order[start:stop] = part[np.argsort(lower[part, axis] + upper[part, axis])]
        return half
    middle = start
    for i in range(start, stop):
        primitive = order[i]
        if int((lower[primitive, axis] + upper[primitive, axis] - least) * scale) <= place:
            order[i] = order[middle]
            order[middle] = primitive
            middle += 1
    return middle if start < middle < stop else half


@compiled
def _best_bin(lower, upper, order, start, stop, axis, least, scale):
    """Return the bin after which a cut along ``axis`` costs least, and the cost.

    That is the box's extent times the number in it, summed over both sides. For rays the extent would be
    the area; for queries nearby the sum of the sides does slightly better.
    """
    counts = np.zeros(BINS, dtype=np.int64)
    box = np.empty((BINS, 6))
    box[:, :3] = np.inf
    box[:, 3:] = -np.inf
    for i in range(start, stop):
        primitive = order[i]
        b = int((lower[primitive, axis] + upper[primitive, axis] - least) * scale)
        counts[b] += 1
        for k in range(3):
            box[b, k] = min(box[b, k], lower[primitive, k])
            box[b, 3 + k] = max(box[b, 3 + k], upper[primitive, k])
    cost = np.zeros(BINS - 1)
    for direction in range(2):
        total = 0
        grown = np.array([np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf])
        for step in range(BINS - 1):
            b = step if direction == 0 else BINS - 1 - step
            total += counts[b]
            for k in range(3):
                grown[k] = min(grown[k], box[b, k])
                grown[3 + k] = max(grown[3 + k], box[b, 3 + k])
            if total:
                x, y, z = grown[3] - grown[0], grown[4] - grown[1], grown[5] - grown[2]
                cost[b if direction == 0 else b - 1] += total * (x + y + z)
    best = np.argmin(cost)
    return best, cost[best]


@compiled
def nearest(x, start, stop, boxes, nodes, frames, shape, slot, local, foot, distance):
    """Answer the queries ``x[start:stop]`` (n, 3) from ``frames`` (m, 3, 3): a corner and the two edges that leave it.

    Writes the place ``slot`` (n,) of the nearest primitive in the order of the leaves, the
    coordinates ``local`` (n, 2) of the foot along its first two edges, ``foot`` (n, 3) and
    ``distance`` (n,). Ties go to the primitive met first, the same in every run.
    """
    waiting_node = np.empty(STACK, dtype=np.uint64)
    waiting_square = np.empty(STACK)
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
    if shape == TRIANGLE:
        v, w = _foot_in_triangle(qx, qy, qz, bx, by, bz, cx, cy, cz)
    elif shape == SEGMENT:
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
