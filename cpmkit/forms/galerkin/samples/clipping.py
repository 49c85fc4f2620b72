"""Which triangles are clipped at knot planes before samples are taken from them, and how long their edges may be.

Where samples of one triangle lie in several lattice cells, sums over them miss the kinks of splines at knot planes: the
error levels off below 1e-4, and gradients with it. Pieces that each lie in one cell see polynomials alone. They are
worth their samples where the triangles follow the manifold; between flat facets kinks of the manifold itself are left.
"""

from __future__ import annotations

from cpmkit.forms.galerkin.sample_mesh import Bend

#: How samples may be asked for.
SAMPLINGS = ("auto", "plain", "clipped")
#: Edges of triangles are at most this many spacings long: three samples a triangle then see every spline.
PLAIN_EDGE_SPACINGS = 0.5
#: The same where triangles are clipped: 19 samples an unknown, and on a sphere the error of edges half as long to 3 %.
CLIPPED_EDGE_SPACINGS = 0.7


def is_clipped(sampling: str, bend: Bend, manifold_dim: int) -> bool:
    """Tell whether triangles are to be clipped; "auto" clips those that bend.

    Segments are split where they cross knot planes in any case.
    """
    return manifold_dim == 2 and (sampling == "clipped" or (sampling == "auto" and bend != "flat"))


def is_fine(degree: int, bend: Bend) -> bool:
    """Tell whether pieces of triangles have a rule of degree 4: for cubic splines on what follows the manifold itself.

    On meshes, flat or bent by their normals, the mesh is the error, and it is the same without (measured).
    """
    return degree == 3 and bend == "feet"


def longest_edge_spacings(sampling: str, bend: Bend, manifold_dim: int) -> float:
    """Return how long edges of cells may be when samples are taken, in spacings."""
    return CLIPPED_EDGE_SPACINGS if is_clipped(sampling, bend, manifold_dim) else PLAIN_EDGE_SPACINGS
