"""Lines, dots and discs as triangles, in the camera's axes: to the right, up, and towards the viewer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints

#: A disc around a point of a cloud, and a dot, have so many corners.
DISC_CORNERS, DOT_CORNERS = 8, 24

#: On a curve in the plane a disc's radius is half the distance to the second neighbour, on a surface this share of that
#: to the sixth: uneven clouds, too, are covered.
DISC_NEIGHBOURS, DISC_OVERLAP = {2: 2, 3: 6}, {2: 0.5, 3: 0.85}

#: Points whose neighbours are farther away than so many spacings belong to no cloud.
LONELY_SPACINGS = 10.0


@dataclass(frozen=True, eq=False)
class Shapes:
    """Triangles in one colour a vertex.

    Attributes
    ----------
    points, colours : (v, 3) float64
    triangles : (t, 3) int64
    """

    points: Floats
    colours: Floats
    triangles: Ints

    @classmethod
    def join(cls, parts: list[Shapes]) -> Shapes:
        """Return all of them as one."""
        parts = [cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)), *parts]
        starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
        return cls(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.colours for part in parts]),
            np.concatenate([part.triangles + start for part, start in zip(parts, starts, strict=True)]),
        )


def lines(starts: Floats, ends: Floats, half_width: float, lift: float, colour: Any) -> Shapes:
    """Return lines from ``starts`` to ``ends`` (s, 3), lifted towards the viewer; ``colour`` is one or (s, 3)."""
    points, triangles = ribbons(starts, ends, half_width)
    colours = np.broadcast_to(np.asarray(colour, dtype=np.float64), (len(starts), 3))
    return Shapes(points + [0, 0, lift], np.repeat(colours, 4, axis=0), triangles)


def dots(centres: Floats, radius: float, lift: float, colour: Any) -> Shapes:
    """Return dots (p, 3), lifted towards the viewer."""
    flat = np.zeros_like(centres)
    points, triangles = discs(centres, flat, np.full(len(centres), radius), np.array([0, 0, 1.0]), DOT_CORNERS)
    return Shapes(points + [0, 0, lift], np.tile(np.asarray(colour, dtype=np.float64), (len(points), 1)), triangles)


def ribbons(starts: Floats, ends: Floats, half_width: float) -> tuple[Floats, Ints]:
    """Return rectangles that face the viewer, a little longer than the segments: vertices (4 s, 3), triangles (2 s, 3).

    The first two vertices of each are at its start, the others at its end.
    """
    along = (ends - starts)[:, :2]
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along = half_width * np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    flat = np.zeros(len(along))
    across, beyond = np.column_stack([-along[:, 1], along[:, 0], flat]), 0.5 * np.column_stack([along, flat])
    corners = (starts - beyond - across, starts - beyond + across, ends + beyond + across, ends + beyond - across)
    points = np.stack(corners, axis=1)
    fan = 4 * np.arange(len(starts))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return points.reshape(-1, 3), fan.reshape(-1, 3)


def discs(
    centres: Floats, normals: Floats, radii: Floats, viewer: Floats, corners: int = DISC_CORNERS
) -> tuple[Floats, Ints]:
    """Return discs as triangles.

    Parameters
    ----------
    centres : (p, 3) float64
    normals : (p, 3) float64
        Of unit length and any sign; a disc with a normal of zero faces the viewer.
    radii : (p,) float64
    viewer : (3,) float64
        Unit vector towards the viewer.
    corners : int

    Returns
    -------
    vertices, triangles : (p * corners, 3) float64, (p * (corners - 2), 3) int64
    """
    normals = np.where(normals.any(axis=1, keepdims=True), normals, viewer)
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    angle = 2 * np.pi * np.arange(corners) / corners
    around = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
    corner = np.arange(1, corners - 1)
    fan = np.stack([np.zeros_like(corner), corner, corner + 1], axis=1)
    triangles = corners * np.arange(len(centres))[:, None, None] + fan
    return (centres[:, None] + radii[:, None, None] * around).reshape(-1, 3), triangles.reshape(-1, 3)


def disc_radii(points: Floats, spacing: float, least: float, alone: float) -> Floats:
    """Return (p,) radii with which discs around points (p, d) of a surface, or curve in the plane, leave no hole.

    No disc is smaller than ``least``; those that stand for points on no surface have the radius ``alone``.
    """
    from scipy.spatial import cKDTree

    neighbours, share = DISC_NEIGHBOURS[points.shape[1]], DISC_OVERLAP[points.shape[1]]
    if len(points) <= neighbours:
        return np.full(len(points), alone)
    reach = np.asarray(cKDTree(points).query(points, k=neighbours + 1)[0])[:, -1]
    lonely = reach > LONELY_SPACINGS * spacing
    usual = np.median(reach[~lonely]) if not lonely.all() else 0.0
    return np.where(lonely, alone, np.maximum(share * np.minimum(reach, 2 * usual), least))
