"""Compiled: a binary tree of boxes over triangles and segments, split by a cost over 16 bins along each axis.

Arguments have no type annotations: numba infers the types.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import compiled

SPLIT_BINS = 16
LEAF_PRIMITIVES = 4
#: Below this depth nodes are split into halves of equal number, which bounds the depth and with it the stacks.
HALVING_DEPTH = 40
STACK_NODES = 96


@compiled
def build_boxes(lower, upper):
    """Return the bounding box tree over m > 0 primitives with boxes from ``lower`` (m, 3) to ``upper``.

    Returned are ``boxes`` (nodes, 6); ``nodes`` (nodes, 2): 0 and the first of two adjacent children, or for a leaf the
    number of primitives and the first of them in ``order``; and ``order`` (m,). Nodes are unsigned so that no index is
    tested for its sign.
    """
    m = len(lower)
    order = np.arange(m)
    boxes = np.empty((2 * m, 6))
    nodes = np.zeros((2 * m, 2), dtype=np.int64)
    pending = np.empty((2 * STACK_NODES, 4), dtype=np.int64)
    pending[0, 0], pending[0, 1], pending[0, 2], pending[0, 3] = 0, 0, m, 0
    used, waiting = 1, 1
    while waiting:
        waiting -= 1
        node, start, stop = pending[waiting, 0], pending[waiting, 1], pending[waiting, 2]
        depth = pending[waiting, 3]
        _write_bounding_box(lower, upper, order, start, stop, boxes[node])
        if stop - start <= LEAF_PRIMITIVES:
            nodes[node, 0], nodes[node, 1] = stop - start, start
            continue
        middle = _split_primitives(lower, upper, order, start, stop, depth)
        nodes[node, 0], nodes[node, 1] = 0, used
        for half in range(2):
            pending[waiting + half, 0], pending[waiting + half, 3] = used + half, depth + 1
            pending[waiting + half, 1] = middle if half else start
            pending[waiting + half, 2] = stop if half else middle
        waiting += 2
        used += 2
    return boxes[:used].copy(), nodes[:used].astype(np.uint64), order


@compiled
def _write_bounding_box(lower, upper, order, start, stop, box):
    """Write to ``box`` (6,) the lowest and highest corner of the box around the primitives ``order[start:stop]``.

    ``lower`` and ``upper`` (m, 3) are the primitives' boxes.
    """
    box[:3] = np.inf
    box[3:] = -np.inf
    for i in range(start, stop):
        for axis in range(3):
            box[axis] = min(box[axis], lower[order[i], axis])
            box[3 + axis] = max(box[3 + axis], upper[order[i], axis])


@compiled
def _split_primitives(lower, upper, order, start, stop, depth):
    """Reorder ``order[start:stop]``, in place, into two groups, and return the position at which the second begins.

    ``lower`` and ``upper`` (m, 3) are the primitives' boxes. The groups lie on both sides of the cut that costs least
    by :func:`_best_bin`. They are halves of equal number where ``depth``, that of the node, is :data:`HALVING_DEPTH` or
    more, where all centres agree, and where a group would be empty.
    """
    axis, place, least, scale, cost = -1, 0, 0.0, 0.0, np.inf
    for k in range(3):
        low, high = np.inf, -np.inf
        for i in range(start, stop):
            twice_centre = lower[order[i], k] + upper[order[i], k]
            low, high = min(low, twice_centre), max(high, twice_centre)
        if high > low:
            per_width = SPLIT_BINS * (1 - 1e-12) / (high - low)
            bin_here, cost_here = _best_bin(lower, upper, order, start, stop, k, low, per_width)
            if cost_here < cost:
                axis, place, least, scale, cost = k, bin_here, low, per_width, cost_here
    half = (start + stop) // 2
    if axis < 0:
        return half
    if depth >= HALVING_DEPTH:
        gap = half - start
        while gap > 0:  # Shell's sort
            for i in range(start + gap, stop):
                moved, place = order[i], i
                twice_centre = lower[moved, axis] + upper[moved, axis]
                while place >= start + gap:
                    other = order[place - gap]
                    if lower[other, axis] + upper[other, axis] <= twice_centre:
                        break
                    order[place] = other
                    place -= gap
                order[place] = moved
            gap //= 2
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
    """Return the bin after which a cut of ``order[start:stop]`` along ``axis`` costs least, and the cost.

    ``lower`` and ``upper`` (m, 3) are the primitives' boxes. The bin of a primitive is (lower + upper - ``least``)
    times ``scale``, rounded down. The cost is the extent of a box times the number of primitives in it, summed over
    both sides. For rays the extent is the area; for nearest points the sum of the box's sides is slightly better.
    """
    counts = np.zeros(SPLIT_BINS, dtype=np.int64)
    box = np.empty((SPLIT_BINS, 6))
    box[:, :3] = np.inf
    box[:, 3:] = -np.inf
    for i in range(start, stop):
        primitive = order[i]
        b = int((lower[primitive, axis] + upper[primitive, axis] - least) * scale)
        counts[b] += 1
        for k in range(3):
            box[b, k] = min(box[b, k], lower[primitive, k])
            box[b, 3 + k] = max(box[b, 3 + k], upper[primitive, k])
    cost = np.zeros(SPLIT_BINS - 1)
    for direction in range(2):
        total = 0
        grown = np.array([np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf])
        for step in range(SPLIT_BINS - 1):
            b = step if direction == 0 else SPLIT_BINS - 1 - step
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
def bound_normals(nodes, vertices, axes, angles):
    """Return (nodes, 5) the axis, cosine and sine of a cone that contains the surface normals in each node of a tree.

    ``nodes`` (nodes, 2) are those of :func:`build_boxes`. The normals around each vertex lie within ``angles`` (k,)
    radians of the unit vectors ``axes`` (k, 3); ``vertices`` (m, 3) are the corners of the triangle in each slot.
    Children have higher numbers than their parents, so that nodes are visited backwards. Cosine and sine of cones of a
    right angle and more are 0.
    """
    count = len(nodes)
    angle, cones, axis = np.empty(count), np.empty((count, 5)), np.empty(3)
    for backwards in range(count):
        node = count - 1 - backwards
        size, begin = np.int64(nodes[node, 0]), np.int64(nodes[node, 1])
        part_axes, part_angles = (axes, angles) if size else (cones, angle)
        corners = vertices.shape[1] if size else 1
        parts = size * corners if size else 2
        axis[:] = 0.0
        for k in range(parts):
            part = vertices[begin + k // corners, k % corners] if size else begin + k
            for i in range(3):
                axis[i] += part_axes[part, i]
        length = np.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
        angle[node] = np.pi
        if length > 0.0:
            angle[node] = 0.0
            for i in range(3):
                axis[i] /= length
            for k in range(parts):
                part = vertices[begin + k // corners, k % corners] if size else begin + k
                cosine = axis[0] * part_axes[part, 0] + axis[1] * part_axes[part, 1] + axis[2] * part_axes[part, 2]
                angle[node] = max(angle[node], np.arccos(min(max(cosine, -1.0), 1.0)) + part_angles[part])
        for i in range(3):
            cones[node, i] = axis[i]
        cones[node, 3], cones[node, 4] = 0.0, 0.0
        if angle[node] < 0.5 * np.pi:
            cones[node, 3], cones[node, 4] = np.cos(angle[node]), np.sin(angle[node])
    return cones
