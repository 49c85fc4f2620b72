"""Normals at the vertices of triangles, and the support of edges: whether the mesh resolves the surface above them.

Beside a fillet the normals at the corners of a flat face lean off it, and define a surface over the face that is as
round as its edges are long. The true surface is flat there: beyond the ends of these edges it bends much more, over a
much shorter length. An edge loses its support only if both hold. At the ends of an ellipsoid the surface bends more,
but over as long a length; beside the small triangles of a random triangulation the length is shorter, but the bend is
the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vector_algebra import unit
from cpmkit.types import Bools, Floats, Ints

#: Support ratio below which an edge is creased, and above which the surface keeps its whole height over the edge. Edges
#: of flat faces beside fillets have less than .02, edges of smooth shapes, with few exceptions, more than .15.
UNSUPPORTED, SUPPORTED = 0.03, 0.15
#: Heights below this share of the edge length are kept in any case: where a torus would count as creased, it bends more
#: on all sides.
LOW_HEIGHT = 0.002


@dataclass(frozen=True, eq=False)
class EdgeSupport:
    """The support of edges: how well the surface beyond their ends agrees with the curvature along them."""

    #: (e,): curvature along the edge over the curvature beyond its ends, times the length beyond over its own length;
    #: the lesser value of both ends.
    ratio: Floats
    #: (e,): height of the surface defined by the normals at the ends above the middle of the edge, over its length.
    height: Floats

    @property
    def share(self) -> Floats:
        """(e,) the factor, from 0 to 1, by which the height of the surface above each edge is scaled."""
        t = np.clip((self.ratio - UNSUPPORTED) / (SUPPORTED - UNSUPPORTED), 0.0, 1.0)
        return np.where(self.height > LOW_HEIGHT, t * t * (3.0 - 2.0 * t), 1.0)

    def unsupported(self, limit: float = UNSUPPORTED) -> Bools:
        """Return which edges (e,) have a relevant height and a support ratio below ``limit``."""
        return np.asarray((self.ratio < limit) & (self.height > LOW_HEIGHT))


def edge_support(vertices: Floats, ends: Ints, normals: Floats, creased: Bools) -> EdgeSupport:
    """Return the support of the edges of triangles, from their chords and the normals at the vertices.

    Parameters
    ----------
    vertices : (v, d) float64
    ends : (e, 2) int64
        The vertices of each edge, each edge once.
    normals : (e, 2, d) float64
        Unit normals at the ends of each edge.
    creased : (v,) bool
        Whether a vertex lies on a crease: its normal is then not perpendicular to the surface along all its edges.
    """
    from cpmkit.mesh import mesh_kernels

    corner = ends.ravel()
    first = np.r_[0, np.cumsum(np.bincount(corner, minlength=len(vertices)))]
    around = np.argsort(corner, kind="stable") // 2
    at, across = np.ascontiguousarray(vertices), np.ascontiguousarray(normals)
    return EdgeSupport(*mesh_kernels.edge_supports(at, np.ascontiguousarray(ends), across, creased, first, around))


def vertex_normals(points: Floats, triangles: Ints) -> Floats:
    """Return unit normals (v, 3) at ``points`` (v, 3): the area-weighted mean of the normals of ``triangles`` (t, 3).

    Normals of triangles that are oriented differently, as on one-sided surfaces, would cancel: at the vertices of an
    edge between such triangles, the normals of all triangles are first flipped to the side of one of these. They are
    zero at vertices without triangles.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    twice_area = np.cross(b - a, c - a)
    at_corners = np.repeat(twice_area, 3, axis=0)  # (3 t, 3)
    vertices = triangles.ravel()
    directed, times = np.unique(vertices * len(points) + np.roll(triangles, -1, axis=1).ravel(), return_counts=True)
    on_edge = np.zeros(len(points), dtype=bool)  # of two triangles that traverse it in the same direction
    on_edge[np.concatenate(np.divmod(directed[times > 1], max(len(points), 1)))] = True
    misaligned = np.flatnonzero(on_edge[vertices])
    if len(misaligned):
        rows, first = np.unique(vertices[misaligned], return_index=True)
        reference = np.zeros(len(points), dtype=np.int64)
        reference[rows] = misaligned[first]
        cosine = np.einsum("ij,ij->i", at_corners[misaligned], at_corners[reference[vertices[misaligned]]])
        at_corners[misaligned[cosine < 0]] *= -1
    total = np.empty_like(points)
    for axis in range(3):
        total[:, axis] = np.bincount(vertices, at_corners[:, axis], minlength=len(points))
    return unit(total)
