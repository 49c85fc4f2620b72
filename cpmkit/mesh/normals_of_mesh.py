"""How far a mesh itself supports the smooth surface that the normals at its vertices claim.

Beside a fillet the normals at the corners of a flat face lean off it, and by them the face is as round as its edges are
long. The surface is not: beyond the ends of these edges it bends much more, over a much shorter way. Both must hold for
an edge to lose its support: at the ends of an ellipsoid the surface bends more, but over as long a way; beside the
small triangles of a random triangulation the way is shorter, but bends as much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vector_algebra import unit
from cpmkit.types import Bools, Floats, Ints

#: Support below which an edge is creased, and above which the surface stands over it as far as its normals claim.
#: Edges of flat faces beside fillets have less than .02, those of smooth shapes, but for stray ones, more than .15.
UNSUPPORTED, SUPPORTED = 0.03, 0.15
#: Over edges that are lower than this share of their length the surface stands as high as normals claim: where that of
#: a torus is creased, it bends more on all sides.
LOW = 0.002


@dataclass(frozen=True, eq=False)
class Support:
    """The support of edges by the surface beyond their ends.

    Attributes
    ----------
    ratio : (e,) float64
        Curvature along the edge over that beyond its ends, times the length beyond over its own; the lesser of both
        ends.
    height : (e,) float64
        Of the surface that the normals at the ends claim, above the middle of the edge, over its length.
    """

    ratio: Floats
    height: Floats

    @property
    def share(self) -> Floats:
        """(e,) of its height above the edge that the surface keeps, from 0 to 1."""
        t = np.clip((self.ratio - UNSUPPORTED) / (SUPPORTED - UNSUPPORTED), 0.0, 1.0)
        return np.where(self.height > LOW, t * t * (3.0 - 2.0 * t), 1.0)

    def unsupported(self, limit: float = UNSUPPORTED) -> Bools:
        """(e,) whether the normals claim a height that the surface beyond supports by less than ``limit``."""
        return np.asarray((self.ratio < limit) & (self.height > LOW))


def edge_support(vertices: Floats, ends: Ints, normals: Floats, creased: Bools) -> Support:
    """Return the support of the edges of triangles.

    Parameters
    ----------
    vertices : (v, d) float64
    ends : (e, 2) int64
        The vertices of each edge, each edge once.
    normals : (e, 2, d) float64
        Unit normals at these.
    creased : (v,) bool
        Vertices at creases: their normals are not those of the surface along all edges there.
    """
    from cpmkit.mesh import mesh_kernels

    corner = ends.ravel()
    first = np.r_[0, np.cumsum(np.bincount(corner, minlength=len(vertices)))]
    around = np.argsort(corner, kind="stable") // 2
    at, across = np.ascontiguousarray(vertices), np.ascontiguousarray(normals)
    return Support(*mesh_kernels.edge_supports(at, np.ascontiguousarray(ends), across, creased, first, around))


def vertex_normals(points: Floats, triangles: Ints) -> Floats:
    """Return (v, 3) unit normals at the vertices: the mean of the triangles around, weighted by area.

    At an edge whose two triangles are wound against each other their normals would cancel: there those of all
    triangles around a vertex are turned to the side of the first.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    twice_area = np.cross(b - a, c - a)
    at_corners = np.repeat(twice_area, 3, axis=0)  # (3 t, 3)
    vertices = triangles.ravel()
    turned = np.flatnonzero(vertices_of_misaligned_edges(triangles, len(points))[vertices])
    if len(turned):
        found, first = np.unique(vertices[turned], return_index=True)
        reference = np.zeros(len(points), dtype=np.int64)
        reference[found] = turned[first]
        along = np.einsum("ij,ij->i", at_corners[turned], at_corners[reference[vertices[turned]]])
        at_corners[turned[along < 0]] *= -1
    total = np.empty_like(points)
    for axis in range(3):
        total[:, axis] = np.bincount(vertices, at_corners[:, axis], minlength=len(points))
    return unit(total)


def vertices_of_misaligned_edges(triangles: Ints, count: int) -> Bools:
    """Tell which of ``count`` vertices (v,) lie on an edge that two triangles pass the same way."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    passed, times = np.unique(starts * np.int64(count) + ends, return_counts=True)
    found = np.zeros(count, dtype=bool)
    for side in np.divmod(passed[times > 1], count):
        found[side] = True
    return found
