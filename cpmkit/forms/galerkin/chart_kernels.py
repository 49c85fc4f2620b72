"""Compiled: pairs of groups of cells that face each other, paths between them, and the flood that assigns charts."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints

#: Two groups face each other across a fold if their offset is off their tangent spaces by more than this sine, or if
#: the cosine of their directions is below the second number.
OFF_TANGENT_SINE, OPPOSITE_COSINE = 0.8, -0.5
#: Rims face each other across a void if the cosines of the offset with their outward normals exceed this (reentrant
#: right angles have .71).
FACING_COSINE = 0.6
#: A chart reaches normals up to 100 degrees from that of its first cell; rims whose normals are within 78 degrees of
#: that normal hide what is behind them.
CHART_COSINE, HIDING_COSINE = float(np.cos(np.radians(100.0))), 0.2


@compiled
def facing_groups(
    candidates: Bools,
    unknowns: Any,
    readers: tuple[Ints, Any],
    members: tuple[Ints, Any],
    places: Floats,
    vectors: Floats,
    reach: float,
    kind: int,
) -> Ints:
    """Return the pairs (k, 2) of groups of cells that face each other and whose patches have a common unknown.

    ``candidates`` (p,) are the patches among which pairs are sought, ``unknowns`` (p, w) those that patches read,
    ``readers`` the inverse index of these, ``members`` that of the patches of groups. ``places`` (g, d) are points of
    the groups, at most ``reach`` apart in a pair. ``vectors`` (g, d) are normals for folds of a surface (``kind`` 2),
    tangents for folds of a curve (1), or outward normals of rims for voids (0).
    """
    width = unknowns.shape[1]
    seen = np.full(len(unknowns), -1)
    found = [np.int64(0) for _ in range(0)]
    for one in range(len(unknowns)):
        if not candidates[one]:
            continue
        for slot in range(width):
            unknown = unknowns[one, slot]
            for at in range(readers[0][unknown], readers[0][unknown + 1]):
                two = readers[1][at] // width
                if two < one or seen[two] == one or not candidates[two]:
                    continue
                seen[two] = one
                for i in range(members[0][one], members[0][one + 1]):
                    for j in range(members[0][two], members[0][two + 1]):
                        p, q = members[1][i], members[1][j]
                        if (one < two or p < q) and _are_facing(places, vectors, p, q, reach, kind):
                            found.append(np.int64(p))
                            found.append(np.int64(q))
    pairs = np.empty((len(found) // 2, 2), dtype=np.int64)
    for k in range(len(found)):
        pairs[k // 2, k % 2] = found[k]
    return pairs


@compiled
def _are_facing(places: Floats, vectors: Floats, p: int, q: int, reach: float, kind: int) -> bool:
    """Return whether groups ``p`` and ``q`` face each other, with the arguments of :func:`facing_groups`."""
    square = at_p = at_q = cosine = 0.0
    for axis in range(places.shape[1]):
        offset = places[q, axis] - places[p, axis]
        square += offset * offset
        at_p += offset * vectors[p, axis]
        at_q += offset * vectors[q, axis]
        cosine += vectors[p, axis] * vectors[q, axis]
    if square > reach * reach:
        return False
    distance = np.sqrt(square)
    if kind == 0:
        facing = at_p > FACING_COSINE * distance and -at_q > FACING_COSINE * distance
    elif kind == 1:
        facing = max(abs(at_p), abs(at_q)) < np.sqrt(1 - OFF_TANGENT_SINE**2) * distance
    else:
        facing = min(abs(at_p), abs(at_q)) > OFF_TANGENT_SINE * distance
    return bool(facing or (kind > 0 and cosine < OPPOSITE_COSINE))


@compiled
def path_lengths(
    pairs: Ints, distances: Floats, limits: Floats, starts: Ints, others: Any, steps: Floats, places: Floats
) -> Floats:
    """Return the lengths (k,) of the shortest paths between the two of each of ``pairs`` (k, 2), over adjacent groups.

    A path longer than the limit (k,) of its pair may count as infinite. The ``others`` (t,) adjacent to each group, at
    the distances ``steps`` (t,), are in compressed rows, with ``starts``. ``pairs`` ascend by their first group;
    ``distances`` (k,) are those between the ``places`` (g, d) of their two groups.
    """
    lengths = np.full(len(pairs), np.inf)
    distance = np.full(len(starts) - 1, np.inf)
    waiting = np.zeros(len(distance), dtype=np.bool_)
    queue = np.empty(len(distance) + 1, dtype=np.int64)  # a ring: no group is in it twice
    reached = np.empty(len(distance), dtype=np.int64)
    first = 0
    while first < len(pairs):
        # a path to q over x is at least as long as that to x and |x - q| >= |x - p| - |p - q|
        last, longest = first, 0.0
        while last < len(pairs) and pairs[last, 0] == pairs[first, 0]:
            longest = max(longest, limits[last] + distances[last])
            last += 1
        queue[0] = reached[0] = pairs[first, 0]
        distance[queue[0]] = 0.0
        head, tail, count = 0, 1, 1
        while head != tail:
            at = queue[head]
            head = head + 1 if head + 1 < len(queue) else 0
            waiting[at] = False
            for place in range(starts[at], starts[at + 1]):
                to = others[place]
                length = distance[at] + steps[place]
                if length < distance[to] and length + _distance(places, pairs[first, 0], to) <= longest:
                    if distance[to] == np.inf:
                        reached[count] = to
                        count += 1
                    distance[to] = length
                    if not waiting[to]:
                        waiting[to] = True
                        queue[tail] = to
                        tail = tail + 1 if tail + 1 < len(queue) else 0
        for k in range(first, last):
            lengths[k] = distance[pairs[k, 1]]
        for k in range(count):
            distance[reached[k]] = np.inf
        first = last
    return lengths


@compiled
def _distance(places: Floats, p: int, q: int) -> float:
    """Return the distance between two of the ``places`` (g, d)."""
    square = 0.0
    for axis in range(places.shape[1]):
        square += (places[q, axis] - places[p, axis]) ** 2
    return float(np.sqrt(square))


@compiled
def flood_charts(
    seeds: Ints,
    centres: Floats,
    directions: Floats,
    starts: Ints,
    others: Any,
    rims: Floats,
    normals: Floats,
    reach: float,
) -> Ints:
    """Return the chart (m,) of each cell: -1 for cells that are not among the ``seeds`` (k,).

    Each seed that has no chart yet, in this order, begins one. It floods to the ``others`` adjacent to a cell, in
    compressed rows with ``starts``, among the seeds without a chart that are within ``reach`` of its beginning, whose
    direction is within 100 degrees of the first one, and that are seen from there: in the first tangent plane the chord
    crosses no rim. ``centres``, ``directions`` (m, d) are those of cells, ``rims`` (r, 2, d) the ends of edges on rims,
    ``normals`` (r, d) those of their triangles.
    """
    chart, offset = np.empty(len(centres), dtype=np.int64), np.empty(centres.shape[1])
    chart[:] = -2
    for seed in seeds:
        chart[seed] = -1
    count = 0
    for first in seeds:
        if chart[first] >= 0:
            continue
        near = _rims_around(rims, normals, centres[first], directions[first], reach)
        chart[first] = count
        queue = [first]
        done = 0
        while done < len(queue):
            at = queue[done]
            done += 1
            for place in range(starts[at], starts[at + 1]):
                to = np.int64(others[place])
                if chart[to] != -1:
                    continue
                square = cosine = 0.0
                for axis in range(len(offset)):
                    offset[axis] = centres[to, axis] - centres[first, axis]
                    square += offset[axis] * offset[axis]
                    cosine += directions[to, axis] * directions[first, axis]
                is_near = square <= reach * reach and cosine > CHART_COSINE
                if is_near and not _crosses_any(offset, near, directions[first]):
                    chart[to] = count
                    queue.append(to)
        count += 1
    for cell in range(len(chart)):
        chart[cell] = max(chart[cell], -1)
    return chart


@compiled
def _rims_around(rims: Floats, normals: Floats, centre: Floats, normal: Floats, reach: float) -> Floats:
    """Return the ends (k, 2, d), relative to ``centre`` (d,), of ``rims`` (r, 2, d) that may hide cells from a chart.

    The chart begins at ``centre``. The first ends are within ``reach``, their ``normals`` (r, d) within 78 degrees of
    ``normal`` (d,).
    """
    near = np.empty_like(rims)
    count = 0
    for r in range(len(rims)):
        square = cosine = 0.0
        for axis in range(rims.shape[2]):
            square += (rims[r, 0, axis] - centre[axis]) ** 2
            cosine += normals[r, axis] * normal[axis]
        if square <= reach * reach and cosine > HIDING_COSINE:
            for end in range(2):
                for axis in range(rims.shape[2]):
                    near[count, end, axis] = rims[r, end, axis] - centre[axis]
            count += 1
    return near[:count]


@compiled
def _crosses_any(chord: Floats, rims: Floats, normal: Floats) -> bool:
    """Return whether ``chord`` (3,) from the origin crosses one of ``rims`` (k, 2, 3), seen along ``normal`` (3,)."""
    along, rest = np.empty(3), np.empty(3)
    for r in range(len(rims)):
        one, two = rims[r, 0], rims[r, 1]
        side_one, side_two = _turn(chord, one, normal), _turn(chord, two, normal)
        if side_one * side_two < 0:
            for i in range(3):
                along[i], rest[i] = two[i] - one[i], chord[i] - one[i]
            if -_turn(along, one, normal) * _turn(along, rest, normal) < 0:
                return True
    return False


@compiled
def _turn(a: Floats, b: Floats, normal: Floats) -> float:
    """Return the inner product of ``normal`` with the vector product of ``a`` and ``b``, (3,) each."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return float(normal[0] * x + normal[1] * y + normal[2] * z)
