"""Kernels of the dof map: samples are joined into patches, and nodes of touching patches into unknowns."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.runtime.disjoint_sets import find_root, unite
from cpmkit.types import Bools, Floats, Ints


@compiled
def grown(values: Any) -> Any:
    """Return the array with room for twice as many."""
    more = np.empty(2 * len(values), dtype=values.dtype)
    more[: len(values)] = values
    return more


@compiled
def codes_of(points: Floats, spacing: float) -> Ints:
    """Return (q,) a code of the lattice cell that each point is in."""
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
    """Join the samples of one lattice cell ``code`` (q,) that share a vertex: of ``contacts`` (m, k), by ``cell`` (q,).

    Returns the root of each sample, and a linked list of slots: one for each vertex and each cell that has samples at
    it. ``first`` (vertices,) is the first slot of a vertex, ``after`` the next one of the same vertex (-1 for none),
    ``holder`` a sample in it.
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
                after, holder = grown(after), grown(holder)
            after[used], holder[used] = first[v], i
            first[v] = used
            used += 1
    for i in range(q):
        parent[i] = find_root(parent, i)
    return parent, first, after, holder


@compiled
def touching_pairs(patch: Any, patches: int, first: Any, after: Any, holder: Any) -> Any:
    """Return (t, 2) the pairs of patches, the smaller number first, that have slots at one vertex, each pair once."""
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
                        other, link = grown(other), grown(link)
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
            while place > begin and pairs[place - 1, 1] > b:  # in order: there are a dozen
                pairs[place, 1] = pairs[place - 1, 1]
                place -= 1
            pairs[at, 0], pairs[place, 1] = a, b
            at += 1
            pair = link[pair]
    return pairs


@compiled
def bounds(points: Floats, patch: Any, label: Ints, pieces: int) -> Floats:
    """Return (pieces, d) the extent along the axes of the points whose ``patch`` (q,) has each ``label`` (p,)."""
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
def number(cells: Ints, touching: Any, single: Bools, along: int) -> tuple[Any, Ints]:
    """Return ``unknowns`` (p, along^d) and ``nodes`` (n, d): nodes that patches read are one where such patches touch.

    ``cells`` (p, d) are those of the patches, ``touching`` (t, 2) pairs of them; where ``single`` (p,) holds, all that
    a patch reads is one unknown, and one with those of the patches that it touches. ``along``: how many nodes an axis
    a patch reads. Unknowns are numbered as the patches come to them.
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
