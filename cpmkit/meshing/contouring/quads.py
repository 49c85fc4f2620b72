"""Triangles from one quadrilateral round each crossing."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms
from cpmkit.meshing.contouring.contour_edges import edges_of
from cpmkit.meshing.contouring.dual_vertices import DualVertices
from cpmkit.protocols import Floats, Ints

#: A quadrilateral is plane if no edge leaves the planes of its ends by more than this share of its length.
PLANE_SINE = 0.1


def triangles(source: LocalSource, found: DualVertices) -> Ints:
    """Return the triangles (m, 3): of two diagonals the one whose midpoint is nearer to S, in the plane the shorter."""
    quads = _once(found.around)
    corners, normals = found.points[quads], found.normals[quads]
    first, second = _middles(corners)
    worse = norms(corners[:, 0] - corners[:, 2]) - norms(corners[:, 1] - corners[:, 3])
    edges = np.roll(corners, -1, axis=1) - corners
    leaves = np.maximum(np.abs(dots(edges, normals)), np.abs(dots(edges, np.roll(normals, -1, axis=1))))
    bent = np.flatnonzero((leaves > PLANE_SINE * norms(edges)).any(axis=1))
    if len(bent):
        misses = [norms(x - source.closest_point(x).points) for x in (first[bent], second[bent])]
        worse[bent] = misses[0] - misses[1]
    turned = np.where((worse > 0)[:, None], np.roll(quads, -1, axis=1), quads)
    return np.ascontiguousarray(turned[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3))


def _once(quads: Ints) -> Ints:
    """Return the quadrilaterals, of two on the same vertices one or none.

    They are what is thinner than a cell, closed on itself, and nothing is lost without them; but where two sheets meet
    that closely another one may end at them, and would be cut off.
    """
    ordered = np.sort(quads, axis=1)
    _, first, same, count = np.unique(ordered, axis=0, return_index=True, return_inverse=True, return_counts=True)
    single = count[same.ravel()] == 1
    several, alone = quads[first[count > 1]], edges_of(quads[single])
    ends = np.sort(np.stack([several, np.roll(several, -1, axis=1)], axis=-1), axis=-1)
    odd = alone.ends[alone.count % 2 == 1]
    bound = np.isin(_code(ends, quads), _code(odd, quads)).any(axis=1) | (count[count > 1] % 2 == 1)
    return np.concatenate([quads[single], several[bound]])


def _code(ends: Ints, quads: Ints) -> Ints:
    return np.asarray(ends[..., 0] * (int(quads.max(initial=0)) + 1) + ends[..., 1])


def _middles(corners: Floats) -> tuple[Floats, Floats]:
    return 0.5 * (corners[:, 0] + corners[:, 2]), 0.5 * (corners[:, 1] + corners[:, 3])
