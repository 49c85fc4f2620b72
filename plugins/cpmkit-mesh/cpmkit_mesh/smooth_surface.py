"""The smooth surface that a mesh samples: its triangles, curved by the normals at their corners.

A point q of a triangle is raised along the interpolated normal by a quadratic function, zero at the corners, whose
values at the middles of the edges are those of the form ``galerkin``: (t_a - t_b) / 8 for an edge from a to b with
tangents t at its ends, as long as the edge. Neighbouring triangles have the same points above their common edge.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, dots, norms, unit
from cpmkit_mesh.unsupported_edges import edge_support

if TYPE_CHECKING:
    from cpmkit_mesh.triangles import TriangleMesh

#: Edges above which the surface would be higher than this share of their length are straight, as in the core.
CREASED_EDGE_SHARE = 0.15


def edge_heights(mesh: TriangleMesh) -> Floats:
    """Return the heights (m, 3) of the smooth surface above the middles of edges, along the mean of their end normals.

    Edge j of a face is opposite its corner j. Edges with an end at a crease are straight; others keep the share of
    their height that the surface beyond their ends supports.
    """
    edges, support, of_faces = edge_support(mesh)
    straight = mesh.at_crease[edges].any(axis=1)
    share = np.where(straight, 0.0, support.share)[of_faces]
    heights = np.empty(mesh.faces.shape)
    for j in range(3):
        a, b = (j + 1) % 3, (j + 2) % 3
        chord = mesh.vertices[mesh.faces[:, b]] - mesh.vertices[mesh.faces[:, a]]
        start, end = (_tangents(chord, mesh.normals_at_corners[:, corner]) for corner in (a, b))
        rise = (start - end) / 8
        across = unit(mesh.normals_at_corners[:, a] + mesh.normals_at_corners[:, b])
        heights[:, j] = np.where(norms(rise) > CREASED_EDGE_SHARE, 0.0, norms(chord) * dots(rise, across))
    return share * heights


def raise_to_surface(points: Floats, local: Floats, heights: Floats, normals: Floats) -> Floats:
    """Return the points (n, 3) of the smooth surface above ``points`` (n, 3) of triangles.

    ``local`` (n, 3) are their barycentric coordinates, ``heights`` (n, 3) those above the edges of their triangles;
    ``normals`` (n, 3, 3) the normal at the first corner and the differences of the other two from it.
    """
    u, v, w = local.T
    height = 4.0 * (v * w * heights[:, 0] + w * u * heights[:, 1] + u * v * heights[:, 2])
    across = unit(normals[:, 0] + v[:, None] * normals[:, 1] + w[:, None] * normals[:, 2])
    return np.asarray(points + height[:, None] * across)


def _tangents(chords: Floats, normals: Floats) -> Floats:
    """Return unit vectors (n, 3) along ``chords`` (n, 3), perpendicular to unit ``normals`` (n, 3)."""
    return unit(chords - dots(chords, normals)[:, None] * normals)
