"""Rims that lie on other rims: seams that no welding closed, across which nothing flows."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.mesh import HalfFacets, SampleMesh
from cpmkit.protocols import Floats

#: A rim's edge whose middle is nearer than this share of its length to an edge of another rim lies on it.
SEAM_EDGE_SHARE = 0.05
#: So many of the nearest edges of rims are looked at.
NEIGHBOURS = 5


def seams(mesh: SampleMesh, half: HalfFacets) -> Floats:
    """Return the middles (k, d) of edges of rims of triangles that lie on edges they share no vertex with.

    Parameters
    ----------
    mesh : SampleMesh
    half : HalfFacets
        Of this mesh.
    """
    from scipy.spatial import cKDTree

    rim = np.flatnonzero(half.cut < 0)
    if mesh.manifold_dim != 2 or len(rim) < 2:
        return np.zeros((0, mesh.dim))
    ends = mesh.cells[half.cell[rim, None], (half.facet[rim, None] + [1, 2]) % 3]
    a, b = mesh.vertices[ends].transpose(1, 0, 2)
    middle, length = 0.5 * (a + b), norms(b - a)
    near = cKDTree(middle).query(middle, min(NEIGHBOURS, len(rim)))[1]
    start, along, x = a[near], (b - a)[near], middle[:, None]
    t = np.clip(dots(x - start, along) / np.maximum(dots(along, along), np.finfo(float).tiny), 0.0, 1.0)
    gap = norms(x - start - t[..., None] * along)
    apart = (ends[:, None, :, None] != ends[near][:, :, None, :]).all(axis=(2, 3))
    return np.asarray(middle[(apart & (gap < SEAM_EDGE_SHARE * length[:, None])).any(axis=1)])
