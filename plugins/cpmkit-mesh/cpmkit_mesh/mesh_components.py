"""The connected components of a mesh, and where two of them touch or pass through each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints
from cpmkit_mesh.box_tree import build_tree, find_nearest
from cpmkit_mesh.chains import components
from cpmkit_mesh.topology import BLOCKED, Topology

#: Parts into which an edge near another component is divided, and how often the nearest parts are divided again.
EDGE_PARTS, DIVISIONS = 16, 3


@dataclass(frozen=True, eq=False)
class Approach:
    """The smallest distance found between two components, and the point (3,) where it occurs."""

    distance: float
    place: Floats


def face_components(faces: Ints, adjacency: Topology) -> Ints:
    """Return (m,) the number of the component of each of ``faces`` (m, 3); faces with a common edge are connected.

    ``adjacency`` is that of the faces; faces at an edge of three or more triangles are connected too.
    """
    count = len(faces)
    face, corner = np.nonzero(adjacency.neighbours > np.arange(count)[:, None])
    links = [np.stack([face, adjacency.neighbours[face, corner]], axis=1)]
    face, corner = np.nonzero(adjacency.neighbours == BLOCKED)
    if len(face):
        ends = np.sort(np.stack([faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]], axis=1), axis=1)
        edge = np.unique(ends, axis=0, return_inverse=True)[1].reshape(-1)
        links.append(np.stack([face, count + edge], axis=1))
        count += int(edge.max()) + 1
    part = components(np.concatenate(links), count)
    if count == len(faces):  # no edge of three triangles or more was added
        return part
    number: Ints = np.unique(part[: len(faces)], return_inverse=True)[1]
    return number


def closest_approach(vertices: Floats, faces: Ints, component: Ints, distance: float) -> Approach | None:
    """Return a place where two components come within ``distance`` of each other; None if there is none.

    ``component`` (m,) is the number of the component of each of ``faces`` (m, 3) between ``vertices`` (k, 3). Two
    components differ in a binary digit of their numbers, so that few halves of the mesh are compared however many
    components there are. For each pair of halves the search stops at the first place within ``distance``; the nearest
    of these is returned. Points along edges of a half are tested against the triangles of the other where a vertex is
    as near to it as half its edges are long: an edge that passes through a triangle has such an end.
    """
    best: Approach | None = None
    for digit in range(int(component.max()).bit_length()):
        half = (component >> digit) & 1 == 0
        for first, second in ((half, ~half), (~half, half)):
            approach = _find_approach(vertices, faces[first], faces[second], distance)
            best = approach if approach and (best is None or approach.distance < best.distance) else best
    return best


def _find_approach(vertices: Floats, faces: Ints, others: Ints, distance: float) -> Approach | None:
    """Return a point on edges of ``faces`` within ``distance`` of the triangles ``others``, with its distance, or None.

    Both are (m, 3) rows of ``vertices`` (k, 3). Where the divided edges may still come within ``distance`` after
    :data:`DIVISIONS` divisions, the nearest middle of a part is returned, though it is a little farther.
    """
    corners = vertices[others]
    ends = _candidate_edges(vertices, faces, corners, distance)
    if not len(ends):
        return None
    tree, start, end = build_tree(corners), vertices[ends[:, 0]], vertices[ends[:, 1]]
    for _ in range(DIVISIONS):
        parts = np.linspace(0.0, 1.0, EDGE_PARTS + 1)[:, None, None]
        knots = (1.0 - parts) * start + parts * end
        start, end = knots[:-1].reshape(-1, 3), knots[1:].reshape(-1, 3)
        middle = 0.5 * (start + end)
        gap = find_nearest(tree, middle).distance
        least = int(np.argmin(gap))
        if gap[least] <= distance:
            return Approach(float(gap[least]), middle[least])
        is_close = gap - 0.5 * np.linalg.norm(end - start, axis=1) <= distance
        if not is_close.any():
            return None
        start, end = start[is_close], end[is_close]
    return Approach(float(gap[least]), middle[least])


def _candidate_edges(vertices: Floats, faces: Ints, corners: Floats, distance: float) -> Ints:
    """Return (k, 2) the edges of ``faces`` of which an end is near to the triangles ``corners`` (c, 3, 3).

    Near means within half the longest edge at that vertex plus ``distance``.
    """
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    length = np.linalg.norm(vertices[end] - vertices[start], axis=1)
    reach = np.zeros(len(vertices))
    np.maximum.at(reach, start, 0.5 * length)
    np.maximum.at(reach, end, 0.5 * length)
    reach += distance
    lower, upper = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    used = np.unique(faces)
    inside = ((vertices[used] >= lower - reach[used, None]) & (vertices[used] <= upper + reach[used, None])).all(axis=1)
    target = used[inside]
    if not len(target):
        return np.zeros((0, 2), dtype=np.int64)
    is_close: Bools = np.zeros(len(vertices), dtype=bool)
    is_close[target] = find_nearest(build_tree(corners), vertices[target]).distance <= reach[target]
    edges = np.sort(np.stack([start, end], axis=1)[is_close[start] | is_close[end]], axis=1)
    return np.unique(edges, axis=0)
