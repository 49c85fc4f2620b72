"""Points on facets of cells: lengths, and the manifold's tangent space there.

Triangles are quadratic: with barycentric coordinates l and the edge midpoints m opposite to corners x,
``y = sum_i l_i (2 l_i - 1) x_i + 4 l_(i+1) l_(i+2) m_i``; segments likewise, with one midpoint.
"""

from __future__ import annotations

import numpy as np

from cpmkit.forms.galerkin.conditions.slivers import steadied
from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.protocols import Bools, Floats, Ints

#: How many Gauss points of an edge are read: splines have a kink wherever it leaves a lattice cell, and two of them let
#: a flux through a rim feed its splines in shares that are off by .4 % at any spacing.
POINTS_OF_EDGE = 6
#: Their places from tail to head, and weights.
EDGE_POINTS, EDGE_WEIGHTS = (0.5 * one for one in np.polynomial.legendre.leggauss(POINTS_OF_EDGE))
EDGE_POINTS += 0.5

#: Points, weights, conormals out of the cell, normals of the manifold.
Facets = tuple[Floats, Floats, Floats, Floats]


def on_edge(mesh: SampleMesh, corners: Ints, cell: Ints, facet: Ints, reversed_: Bools) -> Facets:
    """Return g points on edges of triangles: points (n, g, d), weights, conormals, normals (n, g, d - 2, d).

    The edges are those opposite to corner ``facet`` (n,) of ``cell`` (n,), counted against the cell's sense where
    ``reversed_``, so that cells on both sides of an edge give the same points. ``corners`` (m, 3) are the vertices of
    the mesh after cutting.
    """
    tail, head = (facet + 1) % 3, (facet + 2) % 3
    tail, head = np.where(reversed_, head, tail), np.where(reversed_, tail, head)
    vertices = mesh.vertices[mesh.cells[cell]]
    mid = _midpoints(mesh, vertices, cell)
    p, q, opposite = (_picked(vertices, which) for which in (tail, head, facet))
    m, beside_tail, beside_head = (_picked(mid, which) for which in (facet, head, tail))
    s = EDGE_POINTS[:, None]
    y = (1 - s) * (1 - 2 * s) * p + 4 * s * (1 - s) * m + s * (2 * s - 1) * q
    along = (4 * s - 3) * p + (4 - 8 * s) * m + (4 * s - 1) * q
    inward = -opposite + 4 * (1 - s) * beside_tail + 4 * s * beside_head  # derivative by the opposite corner's l
    inward = inward - ((3 - 4 * s) * p + 4 * s * m)  # less that by the tail's, which is given up for it
    speed = norms(along)
    tangent = along / speed[..., None]
    conormals = _unit(dots(inward, tangent)[..., None] * tangent - inward)
    conormals = steadied(mesh, corners, cell, facet, tangent, conormals)
    normals = np.cross(tangent, conormals)[:, :, None] if mesh.dim == 3 else np.zeros((len(cell), POINTS_OF_EDGE, 0, 2))
    return y, EDGE_WEIGHTS * speed, conormals, normals


def at_end(mesh: SampleMesh, _corners: Ints, cell: Ints, facet: Ints, _reversed: Bools) -> Facets:
    """Return the ends of segments: points (n, 1, d), weights 1, tangents out of the cell, normals (n, 1, d - 1, d)."""
    vertices = mesh.vertices[mesh.cells[cell]]
    end, other = _picked(vertices, 1 - facet), _picked(vertices, facet)
    mid = 0.5 * (end + other) if mesh.midpoints is None else mesh.midpoints[cell]
    tangent = _unit(3 * end - 4 * mid + other)
    return end, np.ones(end.shape[:2]), tangent, _across(tangent)


def _across(tangent: Floats) -> Floats:
    """Return orthonormal vectors (n, 1, d - 1, d) across unit tangents (n, 1, d)."""
    if tangent.shape[-1] == 2:
        return np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)[:, :, None]
    axis = np.eye(3)[np.abs(tangent).argmin(axis=-1)]
    first = _unit(np.cross(tangent, axis))
    return np.stack([first, np.cross(tangent, first)], axis=-2)


def _midpoints(mesh: SampleMesh, vertices: Floats, cell: Ints) -> Floats:
    """Return the edge midpoints (n, 3, d) of triangles, each opposite to a corner."""
    if mesh.midpoints is not None:
        return mesh.midpoints[cell]
    return np.asarray(0.5 * (np.roll(vertices, -1, axis=1) + np.roll(vertices, -2, axis=1)))


def _picked(values: Floats, which: Ints) -> Floats:
    """Return one (n, 1, d) of the points (n, k, d) of each cell."""
    return np.take_along_axis(values, which[:, None, None], axis=1)


def _unit(vectors: Floats) -> Floats:
    """Return vectors (..., d) at length one, those of no length as zero."""
    return np.asarray(vectors / np.maximum(norms(vectors), np.finfo(float).tiny)[..., None])
