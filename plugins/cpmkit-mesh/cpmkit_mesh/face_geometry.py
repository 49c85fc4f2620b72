"""Normals and areas of triangles, and the angles at their edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.plugin import Bools, Floats, InputError, Ints, dots, norms, positive, shown, unit
from cpmkit_mesh.topology import BLOCKED, Topology

#: Triangles lower than this share of the mesh's size have no normal: files of six digits do not determine it.
LEAST_HEIGHT_SIZE_SHARE = 1e-5


@dataclass(frozen=True, eq=False)
class InnerEdges:
    """The edges that exactly two triangles share.

    Attributes
    ----------
    ends : (m, 2) int64
        Their vertices.
    angle : (m,) float64
        The angle between the two triangles' normals, in radians from 0 to pi; 0 where one is too low to have a normal.
    width : (m,) float64
        The mean height of the two triangles above the edge.
    length : (m,) float64
        The length of each edge.
    """

    ends: Ints
    angle: Floats
    width: Floats
    length: Floats

    def take(self, index: Ints | Bools) -> InnerEdges:
        """Return the edges at ``index``, numbers or a mask (m,)."""
        return InnerEdges(self.ends[index], self.angle[index], self.width[index], self.length[index])


def inner_edges(vertices: Floats, faces: Ints, adjacency: Topology) -> InnerEdges:
    """Return the edges that two of the triangles ``faces`` (m, 3) share, with their angles, for any winding.

    ``adjacency`` is that of the faces between ``vertices`` (k, 3). The ends of an edge are in the order of the first of
    its two faces.
    """
    face, corner = np.nonzero(adjacency.neighbours > np.arange(len(faces))[:, None])
    other = adjacency.neighbours[face, corner]
    start, end = faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]
    a, b, c = faces[other].T
    consistent = ~(((a == start) & (b == end)) | ((b == start) & (c == end)) | ((c == start) & (a == end)))
    areas = area_vectors(vertices, faces)
    normal = unit(areas)
    first, second = normal[face], np.where(consistent[:, None], 1.0, -1.0) * normal[other]
    angle = np.arctan2(norms(np.cross(first, second)), dots(first, second))
    length = norms(vertices[end] - vertices[start])
    twice_area = norms(areas)
    heights = np.stack([twice_area[face], twice_area[other]]) / length
    angle[heights.min(axis=0) < LEAST_HEIGHT_SIZE_SHARE * np.ptp(vertices, axis=0).max()] = 0.0
    return InnerEdges(np.stack([start, end], axis=1), angle, heights.mean(axis=0), length)


def checked_angle(value: Any, name: str) -> float:
    """Return ``value`` as a float in degrees, in (0, 180); raise InputError, which names the key ``name``, if not."""
    angle = positive(value, name)
    if angle >= 180.0:
        raise InputError(f"{name} must be an angle between 0 and 180 degrees, got {shown(value)}.")
    return angle


def nonmanifold_edges(faces: Ints, adjacency: Topology) -> Ints:
    """Return (k, 2) the two vertices, ascending, of each edge that three or more of the triangles ``faces`` share."""
    face, corner = np.nonzero(adjacency.neighbours == BLOCKED)
    ends = np.stack([faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]], axis=1)
    return np.unique(np.sort(ends, axis=1), axis=0)


def face_normals(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) unit normals of ``faces`` (m, 3), signed by their winding; zero where a face has no area."""
    return unit(area_vectors(vertices, faces))


def double_areas(vertices: Floats, faces: Ints) -> Floats:
    """Return (m,) twice the area of each of ``faces`` (m, 3)."""
    return norms(area_vectors(vertices, faces))


def area_vectors(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) normals of ``faces`` (m, 3), signed by winding, whose length is twice the face's area."""
    a, b, c = (vertices[faces[:, k]].T for k in range(3))
    (u, v, w), (x, y, z) = b - a, c - a
    return np.stack([v * z - w * y, w * x - u * z, u * y - v * x], axis=1)
