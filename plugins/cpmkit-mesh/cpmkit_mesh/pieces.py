"""The pieces of a mesh, which share no edge, and where they meet nevertheless."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints
from cpmkit_mesh.chains import components
from cpmkit_mesh.topology import BLOCKED, Topology
from cpmkit_mesh.tree import build_tree, nearest

#: Parts of an edge that may pass through another piece, and how often the nearest of them are parted further.
EDGE_PARTS, PART_ROUNDS = 16, 3


@dataclass(frozen=True, eq=False)
class Meeting:
    """Where pieces come nearest to each other: the distance, and (3,) the place."""

    distance: float
    place: Floats


def pieces(faces: Ints, adjacency: Topology) -> Ints:
    """Return (m,) the number of the piece of each face: faces that share an edge are of the same."""
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
    if count == len(faces):  # all numbers are of faces
        return part
    number: Ints = np.unique(part[: len(faces)], return_inverse=True)[1]
    return number


def closest_meeting(vertices: Floats, faces: Ints, piece: Ints, distance: float) -> Meeting | None:
    """Return where two pieces come nearest to each other, of all places where they come within ``distance``.

    Looked at are the vertices of one that are as near to another as half their edges are long, and points along their
    edges: an edge that passes through a triangle has an end as near as that. Two pieces differ in a digit of their
    numbers, so that a few halves of the mesh are compared, however many pieces there are.
    """
    best: Meeting | None = None
    for digit in range(int(piece.max()).bit_length()):
        half = (piece >> digit) & 1 == 0
        for first, second in ((half, ~half), (~half, half)):
            found = _meeting(vertices, faces[first], faces[second], distance)
            best = found if found and (best is None or found.distance < best.distance) else best
    return best


def _meeting(vertices: Floats, faces: Ints, others: Ints, distance: float) -> Meeting | None:
    """Return where edges of ``faces`` come nearest to the triangles ``others``, if within ``distance``."""
    corners = vertices[others]
    ends = _near_edges(vertices, faces, corners, distance)
    if not len(ends):
        return None
    tree, start, end = build_tree(corners), vertices[ends[:, 0]], vertices[ends[:, 1]]
    for _ in range(PART_ROUNDS):
        parts = np.linspace(0.0, 1.0, EDGE_PARTS + 1)[:, None, None]
        knots = (1.0 - parts) * start + parts * end
        start, end = knots[:-1].reshape(-1, 3), knots[1:].reshape(-1, 3)
        middle = 0.5 * (start + end)
        found = nearest(tree, middle).distance
        least = int(np.argmin(found))
        if found[least] <= distance:
            return Meeting(float(found[least]), middle[least])
        near = found - 0.5 * np.linalg.norm(end - start, axis=1) <= distance
        if not near.any():
            return None
        start, end = start[near], end[near]
    return Meeting(float(found[least]), middle[least])


def _near_edges(vertices: Floats, faces: Ints, corners: Floats, distance: float) -> Ints:
    """Return (k, 2) the edges of ``faces`` of which an end is as near to triangles as half its edges, or nearer."""
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
    near: Bools = np.zeros(len(vertices), dtype=bool)
    near[target] = nearest(build_tree(corners), vertices[target]).distance <= reach[target]
    edges = np.sort(np.stack([start, end], axis=1)[near[start] | near[end]], axis=1)
    return np.unique(edges, axis=0)
