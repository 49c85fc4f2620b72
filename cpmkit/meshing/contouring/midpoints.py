"""Midpoints of edges, on the surface or straight between the ends where a crease runs through."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import norms
from cpmkit.meshing.contouring.contour_edges import border_of, edges_of
from cpmkit.meshing.contouring.rim_test import RimTest
from cpmkit.meshing.contouring.rims import rim_edges
from cpmkit.protocols import Bools, Floats, Ints

#: A midpoint farther from the surface than this share of its edge lies beside a crease: the edge stays straight.
CREASE = 0.15
#: The midpoint of an edge on a rim is looked for so far beyond it, as a share of the edge.
BEYOND_RIM = 0.25


def midpoints(rims: RimTest, vertices: Floats, cells: Ints, on_rim: Bools) -> Floats:
    """Return the points (m, 3, 3) halfway along the edges of each triangle, those of rims on the rim."""
    edges = edges_of(cells)
    a, b = vertices[edges.ends[:, 0]], vertices[edges.ends[:, 1]]
    middles, length = 0.5 * (a + b), norms(b - a)
    border = border_of(vertices, cells, edges)
    rows = rim_edges(border, on_rim)
    rim = border.edge[rows]
    inside = np.setdiff1d(np.arange(len(length)), rim)
    feet = middles.copy()
    feet[inside] = rims.source.closest_point(middles[inside]).points
    found, missed = rims.beyond(
        middles[rim], border.conormals[rows], border.across(vertices)[rows], BEYOND_RIM * length[rim]
    )
    feet[rim[missed]] = found[missed]
    crease = norms(feet - middles) > CREASE * length
    feet[crease] = middles[crease]
    return np.asarray(feet[edges.of])
