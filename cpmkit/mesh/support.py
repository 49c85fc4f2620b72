"""How far a mesh itself supports the smooth surface that the normals at its vertices claim.

Beside a fillet the normals at the corners of a flat face lean off it, and by them the face is as round as its edges are
long. The surface is not: beyond the ends of these edges it bends much more, over a much shorter way. Both must hold for
an edge to lose its support: at the ends of an ellipsoid the surface bends more, but over as long a way; beside the
small triangles of a random triangulation the way is shorter, but bends as much.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.protocols import Bools, Floats, Ints

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


def support_of(vertices: Floats, ends: Ints, normals: Floats, creased: Bools) -> Support:
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
    from cpmkit.mesh import support_kernels

    corner = ends.ravel()
    first = np.r_[0, np.cumsum(np.bincount(corner, minlength=len(vertices)))]
    around = np.argsort(corner, kind="stable") // 2
    at, across = np.ascontiguousarray(vertices), np.ascontiguousarray(normals)
    return Support(*support_kernels.supports(at, np.ascontiguousarray(ends), across, creased, first, around))
