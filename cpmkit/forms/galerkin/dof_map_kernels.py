"""Kernels of the dof map: samples are joined into patches, and nodes of touching patches into unknowns."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.disjoint_sets import find_root, unite
from cpmkit.types import Bools, Floats, Ints


@compiled
def with_double_room(values: Any) -> Any:
    """Return a copy of ``values`` (k,) of length 2 k; the second half is not filled."""
    more = np.empty(2 * len(values), dtype=values.dtype)
    more[: len(values)] = values
    return more


@compiled
def cell_codes(points: Floats, spacing: float) -> Ints:
    """Return an integer (q,) for each of the ``points`` (q, d), equal for points in the same lattice cell only.

    Cells are centred at multiples of the ``spacing``.
    """
    q, d = points.shape
    code = np.zeros(q, dtype=np.int64)
    for axis in range(d):
        low, high = np.inf, -np.inf
        for i in range(q):
            cell = np.floor(points[i, axis] / spacing + 0.5)
            low, high = min(low, cell), max(high, cell)
        first, size = np.int64(low), np.int64(high - low) + 1
        for i in range(q):
            code[i] = code[i] * size + np.int64(np.floor(points[i, axis] / spacing + 0.5)) - first
    return code


@compiled
def join_samples(code: Ints, contacts: Ints, cell: Any, vertices: int) -> tuple[Any, Any, Any, Any]:
    """Join the samples of a lattice cell that share a vertex of the mesh; return the joined sets and a list of slots.

    The arguments are the ``code`` (q,) of the lattice cell and the mesh ``cell`` (q,) of each sample, and the vertices
    ``contacts`` (m, k) of mesh cells, numbered below ``vertices``. Returned are the root (q,) of each sample, the same
    for joined samples, and linked slots: a vertex has a slot for each lattice cell with samples at it. ``first``
    (vertices,) is the first slot of a vertex, ``after`` the next slot of the same vertex (-1 for none), ``holder`` a
    sample of the slot.
    """
    q, k = len(code), contacts.shape[1]
    parent, first = np.empty(q, dtype=np.int32), np.empty(vertices, dtype=np.int32)
    parent[:], first[:] = np.arange(q), -1
    after, holder = np.empty(vertices + 1, dtype=np.int32), np.empty(vertices + 1, dtype=np.int32)
    used = 0
    for i in range(q):
        if i > 0 and code[i] == code[i - 1] and cell[i] == cell[i - 1]:
            parent[i] = parent[i - 1]
            continue
        for c in range(k):
            v = contacts[cell[i], c]
            slot = first[v]
            while slot >= 0 and code[holder[slot]] != code[i]:
                slot = after[slot]
            if slot >= 0:
                unite(parent, holder[slot], i)
                continue
            if used == len(after):
                after, holder = with_double_room(after), with_double_room(holder)
            after[used], holder[used] = first[v], i
            first[v] = used
            used += 1
    for i in range(q):
        parent[i] = find_root(parent, i)
    return parent, first, after, holder


@compiled
def touching_patches(patch: Any, patches: int, first: Any, after: Any, holder: Any) -> Any:
    """Return the pairs (t, 2) of patches that share a vertex, once each and ascending, the smaller number first.

    ``first``, ``after`` and ``holder`` are the linked slots from :func:`join_samples`; ``patch`` (q,) is the patch of
    each sample, ``patches`` their number.
    """
    head = np.full(patches, -1)
    other, link = np.empty(patches + 1, dtype=np.int64), np.empty(patches + 1, dtype=np.int64)
    used = 0
    for v in range(len(first)):
        one = first[v]
        while one >= 0:
            two = after[one]
            while two >= 0:
                a, b = patch[holder[one]], patch[holder[two]]
                a, b = min(a, b), max(a, b)
                pair = head[a]
                while pair >= 0 and other[pair] != b:
                    pair = link[pair]
                if pair < 0:
                    if used == len(other):
                        other, link = with_double_room(other), with_double_room(link)
                    other[used], link[used] = b, head[a]
                    head[a] = used
                    used += 1
                two = after[two]
            one = after[one]
    pairs = np.empty((used, 2), dtype=np.int32)
    at = 0
    for a in range(patches):
        pair = head[a]
        begin = at
        while pair >= 0:
            b, place = other[pair], at
            while place > begin and pairs[place - 1, 1] > b:  # insertion sort: there are about a dozen
                pairs[place, 1] = pairs[place - 1, 1]
                place -= 1
            pairs[at, 0], pairs[place, 1] = a, b
            at += 1
            pair = link[pair]
    return pairs


@compiled
def piece_extents(points: Floats, patch: Any, label: Ints, pieces: int) -> Floats:
    """Return (pieces, d) the extent along the axes of the points on each piece of the manifold.

    ``patch`` (q,) is the patch of each of the ``points`` (q, d), ``label`` (p,) the piece of each patch.
    """
    d = points.shape[1]
    lower, upper = np.full((pieces, d), np.inf), np.full((pieces, d), -np.inf)
    for i in range(len(points)):
        piece = label[patch[i]]
        for axis in range(d):
            lower[piece, axis] = min(lower[piece, axis], points[i, axis])
            upper[piece, axis] = max(upper[piece, axis], points[i, axis])
    extent: Floats = upper - lower
    return extent


@compiled
def number_unknowns(cells: Ints, touching: Any, single: Bools, along: int) -> tuple[Any, Ints]:
    """Return the unknowns (p, along^d) at the nodes that each patch reads, and the node (n, d) of each unknown.

    A node has an unknown for each connected component of the patches that read it, where the pairs ``touching`` (t, 2)
    are connected. ``cells`` (p, d) are the lattice cells of the patches, which read ``along`` nodes per axis. A patch
    that is ``single`` (p,) has the same unknown at all nodes, shared with the patches that it touches. Unknowns are
    numbered in the order in which the patches read them first.
    """
    p, d = cells.shape
    width = along**d
    parent = np.arange(p * width)
    depth = along if d == 3 else 1
    for t in range(len(touching)):
        a, b = touching[t, 0], touching[t, 1]
        if single[a]:
            unite(parent, a * width, b * width)
            continue
        di, dj = cells[b, 0] - cells[a, 0], cells[b, 1] - cells[a, 1]
        dk = cells[b, 2] - cells[a, 2] if d == 3 else 0
        shift = (di * along + dj) * depth + dk
        for i in range(max(0, di), min(along, along + di)):
            for j in range(max(0, dj), min(along, along + dj)):
                for k in range(max(0, dk), min(depth, depth + dk)):
                    place = (i * along + j) * depth + k
                    unite(parent, a * width + place, b * width + place - shift)
    unknowns = np.empty((p, width), dtype=np.int32)
    nodes = np.empty((p * width, d), dtype=np.int64)
    numbers = np.empty(p * width, dtype=np.int64)
    n = 0
    for a in range(p):
        for place in range(width):
            at = a * width + place
            root = find_root(parent, a * width) if single[a] else find_root(parent, at)
            if root == at:
                numbers[at] = n
                rest = width // 2 if single[a] else place
                for axis in range(d - 1, -1, -1):
                    nodes[n, axis] = cells[a, axis] + rest % along - (along - 1) // 2
                    rest //= along
                n += 1
            unknowns[a, place] = numbers[root]
    return unknowns, nodes[:n].copy()
