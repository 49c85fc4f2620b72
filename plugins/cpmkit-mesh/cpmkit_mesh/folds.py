"""How sharply a mesh turns at its edges, and which of them are creases."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.plugin import Bools, Floats, InputError, Ints, dots, norms, positive, shown, unit
from cpmkit_mesh.directions import across
from cpmkit_mesh.topology import BLOCKED, Topology

#: Triangles lower than this share of the mesh's size have no say: files of six digits do not hold their normal.
LEAST_HEIGHT_SIZE_SHARE = 1e-5


@dataclass(frozen=True, eq=False)
class Folds:
    """The edges at which two triangles meet.

    Attributes
    ----------
    ends : (m, 2) int64
        Their vertices.
    angle : (m,) float64
        By how much the surface turns there, in radians from 0 to pi; 0 where a triangle is too flat to tell.
    width : (m,) float64
        The mean height of the two triangles above the edge.
    length : (m,) float64
    """

    ends: Ints
    angle: Floats
    width: Floats
    length: Floats

    def take(self, index: Ints | Bools) -> Folds:
        """Return the edges at ``index``."""
        return Folds(self.ends[index], self.angle[index], self.width[index], self.length[index])


def folds(vertices: Floats, faces: Ints, adjacency: Topology) -> Folds:
    """Return the edges at which two triangles meet, whichever way these are wound."""
    face, corner = np.nonzero(adjacency.neighbours > np.arange(len(faces))[:, None])
    other = adjacency.neighbours[face, corner]
    start, end = faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]
    a, b, c = faces[other].T
    alike = ~(((a == start) & (b == end)) | ((b == start) & (c == end)) | ((c == start) & (a == end)))
    over_faces = across(vertices, faces)
    normal = unit(over_faces)
    one, two = normal[face], np.where(alike[:, None], 1.0, -1.0) * normal[other]
    angle = np.arctan2(norms(np.cross(one, two)), dots(one, two))
    length = norms(vertices[end] - vertices[start])
    twice_area = norms(over_faces)
    heights = np.stack([twice_area[face], twice_area[other]]) / length
    angle[heights.min(axis=0) < LEAST_HEIGHT_SIZE_SHARE * np.ptp(vertices, axis=0).max()] = 0.0
    return Folds(np.stack([start, end], axis=1), angle, heights.mean(axis=0), length)


def in_degrees(value: Any, what: str) -> float:
    """Return ``value`` as an angle in degrees between 0 and 180.

    Raises
    ------
    InputError
        If it is none.
    """
    angle = positive(value, what)
    if angle >= 180.0:
        raise InputError(f"{what} must be an angle between 0 and 180 degrees, got {shown(value)}.")
    return angle


def crowded_edges(faces: Ints, adjacency: Topology) -> Ints:
    """Return (m, 2) the vertices of each edge that three or more triangles share, once."""
    face, corner = np.nonzero(adjacency.neighbours == BLOCKED)
    ends = np.stack([faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3]], axis=1)
    return np.unique(np.sort(ends, axis=1), axis=0)
