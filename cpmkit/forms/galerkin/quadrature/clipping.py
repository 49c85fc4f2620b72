"""Which triangles are clipped at the lattice's knot planes before samples are taken from them.

Between two knot planes splines are polynomials: what is clipped is integrated to its rule's degree, whole triangles
only as well as they are small beside a cell.
"""

from __future__ import annotations

import numpy as np

from cpmkit.mesh.mesh import Bend, SampleMesh
from cpmkit.protocols import Bools

#: How samples may be asked for.
SAMPLINGS = ("auto", "plain", "clipped")
#: Edges of whole triangles are at most this many spacings long: three samples a triangle then see every spline.
PLAIN_EDGE_SPACINGS = 0.5
#: The same where triangles are clipped: 19 samples an unknown, and on a sphere the error of edges half as long to 3 %.
CLIPPED_EDGE_SPACINGS = 0.7
#: The same where they are flat: the error of whole ones half as long, with a tenth to a quarter fewer samples (measured
#: on a square, a cube and Spot).
CLIPPED_FLAT_EDGE_SPACINGS = 1.0


def is_clipped(sampling: str, manifold_dim: int) -> bool:
    """Tell whether triangles are to be clipped where it pays.

    Segments are split where they cross knot planes in any case.
    """
    return manifold_dim == 2 and sampling != "plain"


def is_fine(degree: int, bend: Bend) -> bool:
    """Tell whether pieces of triangles have a rule of degree 4: for cubic splines on what follows the manifold itself.

    On meshes, flat or bent by their normals, the mesh is the error, and it is the same without (measured).
    """
    return degree == 3 and bend == "feet"


def longest_edge_spacings(sampling: str, bend: Bend, manifold_dim: int) -> float:
    """Return how long edges of cells may be when samples are taken, in spacings."""
    if not is_clipped(sampling, manifold_dim):
        return PLAIN_EDGE_SPACINGS
    return CLIPPED_FLAT_EDGE_SPACINGS if bend == "flat" else CLIPPED_EDGE_SPACINGS


def clipped_triangles(mesh: SampleMesh, sampling: str, bend: Bend, spacing: float) -> Bools:
    """Return which triangles (m,) are to be clipped: "auto" leaves flat ones whole that are small beside a cell."""
    if not is_clipped(sampling, mesh.manifold_dim):
        return np.zeros(len(mesh.cells), dtype=bool)
    if sampling == "clipped" or bend != "flat":
        return np.ones(len(mesh.cells), dtype=bool)
    from cpmkit.mesh.subdivision_kernels import with_long_edges

    return with_long_edges(mesh.vertices, np.ascontiguousarray(mesh.cells), PLAIN_EDGE_SPACINGS * float(spacing))
