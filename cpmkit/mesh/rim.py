"""The rim of a mesh: facets of one cell alone, and which way the mesh ends there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.mesh.edges import Edges
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class Rim:
    """Which rows of points lie on the rim of a mesh, and which way it ends there.

    Attributes
    ----------
    rows : (r,) int64
        Ascending.
    outward : (r, d) float64
        Along the cell, out of it, as long as the edge there.
    """

    rows: Ints
    outward: Floats

    def among(self, chosen: Ints) -> Rim:
        """Return the same of the points ``chosen`` (n,), each once."""
        at = np.searchsorted(self.rows, chosen)
        known = np.flatnonzero(np.append(self.rows, -1)[at] == chosen)
        return Rim(known, self.outward[at[known]])


def rim_of_edges(mesh: SampleMesh, edges: Edges) -> Rim:
    """Return which edges of triangles lie on the rim; no segment does."""
    if mesh.manifold_dim == 1:
        return Rim(np.zeros(0, dtype=np.int64), np.zeros((0, mesh.dim)))
    single = np.bincount(edges.of_cells.ravel(), minlength=len(edges.ends)) == 1
    cell, facet = np.nonzero(single[edges.of_cells])
    a, b, c = (mesh.vertices[mesh.cells[cell, (facet + k) % 3]] for k in range(3))
    way = c - b
    across = b - a
    across = across - (dots(across, way) / np.maximum(dots(way, way), np.finfo(float).tiny))[:, None] * way
    rows = edges.of_cells[cell, facet]
    order = np.argsort(rows)
    return Rim(rows[order], (norms(way)[:, None] * unit(across))[order])


def rim_of_vertices(mesh: SampleMesh, edges: Edges) -> Rim:
    """Return which vertices lie on the rim, with the mean of their edges' outward vectors."""
    if mesh.manifold_dim == 1:
        single = np.bincount(mesh.cells.ravel(), minlength=len(mesh.vertices)) == 1
        cell, end = np.nonzero(single[mesh.cells])
        ends, other = mesh.cells[cell, end], mesh.cells[cell, 1 - end]
        outward = mesh.vertices[ends] - mesh.vertices[other]
    else:
        of_edges = rim_of_edges(mesh, edges)
        ends = edges.ends[of_edges.rows].ravel()
        outward = np.repeat(of_edges.outward, 2, axis=0)
    rows, place = np.unique(ends, return_inverse=True)
    times = np.bincount(place, minlength=len(rows))
    sums = [np.bincount(place, outward[:, k], minlength=len(rows)) for k in range(mesh.dim)]
    return Rim(rows, np.stack(sums, axis=1) / np.maximum(times, 1)[:, None])
