"""Whether a source's drawing of itself is one that samples can be taken from: conforming, and without slivers."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.edges import edges_of
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.mesh.rim import rim_of_edges

#: Triangles with an angle whose cosine is below this have a bad shape; of a drawing that is fit, fewer than this share.
BLUNT_COSINE, MOST_BLUNT_SHARE = -0.9, 0.01
#: A drawing with more triangles than this on a square of its edge length costs more samples than it is worth: equal
#: sides make 2.3, parameters of a sphere 3, of a figure eight bent to a Klein bottle 5, marching tetrahedra 8 and more.
MOST_TRIANGLES_A_SQUARE = 7.0
#: Beyond the middle of an edge of one triangle, by this share of its length, the rim of the manifold is found.
BEYOND_RIM_EDGE_SHARE = 0.5


def is_fit(source: LocalSource, mesh: SampleMesh, length: float) -> bool:
    """Whether the drawing ends on the rim alone, with few blunt triangles, and not too many for edges of ``length``.

    Triangles that do not share edges end inside the manifold; those with an angle near 180 degrees turn their backs to
    it once they are curved. Narrow ones with a short edge, as towards a pole, do no harm. Drawings of curves are fit.
    """
    if mesh.manifold_dim == 1:
        return True
    corners = mesh.vertices[mesh.cells]
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cosine = dots(after, before) / (norms(after) * norms(before))
    if (cosine.min(axis=1) < BLUNT_COSINE).mean() > MOST_BLUNT_SHARE:
        return False
    area = 0.5 * float(norms(np.cross(after[:, 0], before[:, 0])).sum())
    if len(mesh.cells) * length**2 > MOST_TRIANGLES_A_SQUARE * area:
        return False
    edges = edges_of(mesh)
    rim = rim_of_edges(mesh, edges)
    if not len(rim.rows):
        return True
    middle = mesh.vertices[edges.ends[rim.rows]].mean(axis=1)
    beyond = source.closest_point(np.ascontiguousarray(middle + BEYOND_RIM_EDGE_SHARE * rim.outward))
    return bool((beyond.edge >= 0).all())
