"""Conormals out of thin triangles: a curved edge bends by more than their height, and they tell no direction."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.galerkin.sample_mesh import SampleMesh
from cpmkit.manifold.vectors import dots, norms
from cpmkit.protocols import Floats, Ints

#: A triangle less high over its edge than this share of the edge is thin.
THIN_SHARE = 0.1


def steadied(mesh: SampleMesh, corners: Ints, cell: Ints, facet: Ints, tangents: Floats, conormals: Floats) -> Floats:
    """Return ``conormals`` (n, g, d), at points of edges with ``tangents`` (n, g, d), put right on thin triangles.

    There they are those of the triangles near the ends of the edge on the same side of the boundary: normal to
    the edge in their mean tangent plane, away from their mean place.
    """
    ends = (facet[:, None] + np.array([1, 2])) % 3
    tail, head, apex = (mesh.vertices[mesh.cells[cell, k]] for k in (*ends.T, facet))
    chord, side = head - tail, apex - tail
    length = norms(chord)
    height = norms(side - (dots(side, chord) / length**2)[:, None] * chord)
    thin = np.flatnonzero(height < THIN_SHARE * length)
    if not len(thin):
        return conormals
    inward, normal = _around(mesh, corners, corners[cell[thin, None], ends[thin]], 0.5 * (tail + head)[thin])
    along, out = tangents[thin], -inward[:, None]
    normal = normal[:, None] - dots(normal[:, None], along)[..., None] * along
    normal /= np.maximum(norms(normal), np.finfo(float).tiny)[..., None]
    for axis in (along, normal):
        out = out - dots(out, axis)[..., None] * axis
    steady = conormals.copy()
    steady[thin] = out / norms(out)[..., None]
    return steady


def _around(mesh: SampleMesh, corners: Ints, at: Ints, middles: Floats) -> tuple[Floats, Floats]:
    """Return the mean place (n, d), relative to ``middles``, and normal (n, d) of triangles near new vertices (n, 2).

    Those that meet there and those that these meet: thin triangles may meet thin ones alone. Weighted by areas; in the
    plane there is no normal, and it is zero.
    """
    order = np.argsort(corners, axis=None, kind="stable")
    starts = np.searchsorted(corners.ravel()[order], np.arange(corners.max() + 2))
    row, vertex = np.repeat(np.arange(len(at)), at.shape[1]), at.ravel()
    for _ in range(2):
        counts = np.diff(starts)[vertex]
        first = np.repeat(starts[vertex] - np.cumsum(counts) + counts, counts)
        cell = order[first + np.arange(len(first))] // 3
        near, cell = np.unique(np.stack([np.repeat(row, counts), cell]), axis=1)
        row, vertex = np.repeat(near, 3), corners[cell].ravel()
    row = near
    corner = mesh.vertices[mesh.cells[cell]]
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = np.sqrt(np.maximum(dots(a, a) * dots(b, b) - dots(a, b) ** 2, 0.0))
    moved = area[:, None] * (corner.mean(axis=1) - middles[row])
    place: Floats = np.stack([np.bincount(row, x, len(at)) for x in moved.T], axis=1).astype(np.float64)
    if mesh.dim == 2:
        return place, np.zeros_like(place)
    across = np.cross(a, b) / np.sqrt(np.maximum(area, np.finfo(float).tiny))[:, None]
    squares = np.array([[np.bincount(row, x * y, len(at)) for x in across.T] for y in across.T])
    normal: Floats = np.linalg.eigh(squares.transpose(2, 0, 1))[1][:, :, -1]
    return place, normal
