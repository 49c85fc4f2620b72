"""How roughly the triangles of a surface may be sampled: flat ones as much as the surface turns at their edges.

Where flat triangles stand for a bent surface, the gradient of u has kinks at their edges, of the size of the angle
there, which no spline between knot planes has. A rule for a piece of a triangle need not err less than that.
"""

from __future__ import annotations

import numpy as np

from cpmkit.mesh.mesh import SampleMesh
from cpmkit.protocols import Floats

#: Pieces with the area times the square of the length, in spacings, below the angle times this have one sample.
SINGLE_MOMENT_OF_ANGLE = 0.5
#: And below this at most. Errors on Spot are then those of all samples to 1 percent, at three spacings, with five
#: eighths of them; on a ball of 1,280 facets, under smooth data, 1 to 4 percent more with three fifths; on Spot and a
#: koala of 100,000 triangles, left whole on coarse lattices, up to 5 percent more with one sample a triangle.
MOST_SINGLE_MOMENT = 5e-3
#: The same for whole curved triangles, which only lattices far coarser than a mesh come to. A sphere of 82,000
#: triangles and a torus of 58,000 then have the same errors to 1 percent, Nefertiti and a koala of 100,000 errors up to
#: 7 percent larger, with a third to three quarters of the samples; ten times the limit is a sixth more on the sphere.
CURVED_SINGLE_MOMENT = 1e-4


def single_moments(mesh: SampleMesh, spacing: float) -> Floats:
    """Return (m,) the area times the square of the length, in spacings, below which pieces of a triangle have a sample.

    None has where a triangle touches a boundary: what one side of that sees of a cell may be little. And where a flat
    one lies in a plane with a neighbour, or has none at an edge or several, or a curved one is not small as a whole.
    """
    found = _of_flat(mesh) if mesh.midpoints is None else _of_curved(mesh, spacing)
    if len(mesh.cut):
        beside = np.zeros(len(mesh.vertices), dtype=bool)
        beside[mesh.cut] = True
        found[beside[mesh.cells].any(axis=1)] = 0.0
    return found


def _of_flat(mesh: SampleMesh) -> Floats:
    from cpmkit.forms.galerkin.quadrature.facet_kernels import least_turn
    from cpmkit.mesh.edges import edges_of

    sine = least_turn(mesh.vertices, np.ascontiguousarray(mesh.cells), edges_of(mesh).of_cells)
    found: Floats = np.minimum(SINGLE_MOMENT_OF_ANGLE * sine, MOST_SINGLE_MOMENT)
    return found


def _of_curved(mesh: SampleMesh, spacing: float) -> Floats:
    from cpmkit.forms.galerkin.quadrature.facet_kernels import mark_small

    found = np.zeros(len(mesh.cells))  # zeros that nobody writes take no memory
    mark_small(mesh.vertices, np.ascontiguousarray(mesh.cells), spacing, CURVED_SINGLE_MOMENT, found)
    return found
