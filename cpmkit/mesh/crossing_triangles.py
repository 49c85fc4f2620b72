"""Edges of a triangle mesh that pass through triangles of the same mesh."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Bools, Floats, Ints

#: Sine of the angle below which an edge lies in the plane of a triangle, as those of flat surfaces do.
LEAST_SLOPE = 1e-6
#: Pairs of edges and triangles that are tested at a time, to bound memory.
PAIRS_AT_ONCE = 2**20


def edges_through_triangles(mesh: Mesh) -> tuple[Ints, Ints]:
    """Return edges (k,) and triangles (k,) of a flat ``mesh`` that cross in inner points, without a common vertex."""
    ends, corners = mesh.vertices[mesh.edges.ends], mesh.vertices[mesh.cells]
    edge, cell = _near_pairs(ends, corners)
    found = []
    for start in range(0, len(edge), PAIRS_AT_ONCE):
        rows = slice(start, start + PAIRS_AT_ONCE)
        crosses = _cross(ends[edge[rows]], corners[cell[rows]])
        apart = (mesh.edges.ends[edge[rows], :, None] != mesh.cells[cell[rows], None, :]).all(axis=(1, 2))
        found.append(start + np.flatnonzero(crosses & apart))
    chosen = np.concatenate([np.zeros(0, dtype=np.int64), *found])
    return edge[chosen], cell[chosen]


def _near_pairs(ends: Floats, corners: Floats) -> tuple[Ints, Ints]:
    """Return segments (k,) and triangles (k,) whose bounding boxes meet, by a search per size class of triangles."""
    from scipy.spatial import cKDTree

    midpoints, centres = ends.mean(axis=1), corners.mean(axis=1)
    reach, radius = 0.5 * norms(ends[:, 1] - ends[:, 0]), norms(corners - centres[:, None]).max(axis=1)
    size = np.floor(np.log2(np.maximum(radius, np.finfo(float).tiny)))
    edges, cells = [], []
    for each in np.unique(size):
        members = np.flatnonzero(size == each)
        near = cKDTree(centres[members]).query_ball_point(midpoints, reach + radius[members].max())
        edge = np.repeat(np.arange(len(midpoints)), [len(rows) for rows in near])
        cell = members[np.concatenate([np.zeros(0), *near]).astype(np.int64)]
        apart = (ends.max(axis=1)[edge] < corners.min(axis=1)[cell]).any(axis=1)
        apart |= (ends.min(axis=1)[edge] > corners.max(axis=1)[cell]).any(axis=1)
        edges.append(edge[~apart])
        cells.append(cell[~apart])
    return np.concatenate(edges), np.concatenate(cells)


def _cross(ends: Floats, corners: Floats) -> Bools:
    """Return whether segments ``ends`` (n, 2, 3) meet triangles ``corners`` (n, 3, 3), ends and sides included."""
    p, q = ends[:, 0], ends[:, 1]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    before, after = (dots(normal, x - corners[:, 0]) for x in (p, q))
    sides = np.stack([dots(np.cross(corners[:, k] - p, corners[:, k - 2] - p), q - p) for k in range(3)])
    slope = np.abs(before - after) > LEAST_SLOPE * norms(normal) * norms(q - p)
    within = (sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)
    return np.asarray((before * after <= 0) & slope & within)
