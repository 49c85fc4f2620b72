"""Conormals out of thin triangles: a curved edge bends by more than their height, and they tell no direction."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.protocols import Floats, Ints

#: A triangle less high over its edge than this share of the edge is thin.
THIN_SHARE = 0.1
#: How far the polynomial of a triangle is followed past its edges, in its own coordinates.
REACH = (-2.0, 3.0)


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
    slopes = (a, b) if mesh.midpoints is None else _slopes(corner, mesh.midpoints[cell], middles[row])
    across = np.cross(*slopes)
    across *= (np.sqrt(area) / np.maximum(norms(across), np.finfo(float).tiny))[:, None]
    squares = np.array([[np.bincount(row, x * y, len(at)) for x in across.T] for y in across.T])
    normal: Floats = np.linalg.eigh(squares.transpose(2, 0, 1))[1][:, :, -1]
    return place, normal


def _slopes(x: Floats, m: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Return two tangents (n, d) of quadratic triangles, corners ``x`` and midpoints ``m`` (n, 3, d), near ``points``.

    Their polynomials go on past their edges: flat tangent planes would be off by as much as the manifold bends on the
    way.
    """
    a, b, p = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], points - x[:, 0]
    aa, ab, bb = dots(a, a), dots(a, b), dots(b, b)
    size = np.maximum(aa * bb - ab**2, np.finfo(float).tiny)
    r = np.clip((bb * dots(a, p) - ab * dots(b, p)) / size, *REACH)[:, None]
    s = np.clip((aa * dots(b, p) - ab * dots(a, p)) / size, *REACH)[:, None]
    t = 1 - r - s
    last = (4 * t - 1) * x[:, 0]
    first = (4 * r - 1) * x[:, 1] - last + 4 * ((t - r) * m[:, 2] + s * (m[:, 0] - m[:, 1]))
    return first, (4 * s - 1) * x[:, 2] - last + 4 * ((t - s) * m[:, 1] + r * (m[:, 0] - m[:, 2]))
