"""The edges of cells: which cells have them, and which of them lie on boundaries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.lattice import find
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a mesh, each once; those of segments are the segments.

    Attributes
    ----------
    ends : (e, 2) int64
        Their vertices.
    of_cells : (m, 3) or (m, 1) int64
        The edges of each cell; of a triangle edge j is opposite to corner j.
    """

    ends: Ints
    of_cells: Ints

    def lengths(self, vertices: Floats) -> Floats:
        """Return (e,) the distances of their ends."""
        from cpmkit.mesh import edges_kernels

        found: Floats = edges_kernels.lengths(np.ascontiguousarray(self.ends), np.ascontiguousarray(vertices))
        return found


def edges_of(mesh: SampleMesh) -> Edges:
    """Return the edges of a mesh's cells."""
    if mesh.manifold_dim == 1:
        return Edges(mesh.cells, np.arange(len(mesh.cells))[:, None])
    from cpmkit.mesh import edges_kernels

    return Edges(*edges_kernels.number_edges(np.ascontiguousarray(mesh.cells), len(mesh.vertices)))


def edges_on_cut(mesh: SampleMesh, edges: Edges) -> Ints:
    """Return (c,) the numbers that the edges of triangles in ``mesh.cut`` have among ``edges``, -1 if none."""
    if not len(mesh.cut):
        return np.zeros(0, dtype=np.int64)
    count = len(mesh.vertices)
    ends = np.sort(mesh.cut, axis=1)
    wanted, place = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
    on_cut = np.zeros(count, dtype=bool)
    on_cut[ends] = True
    near = np.flatnonzero(on_cut[edges.ends].all(axis=1))
    low, high = np.sort(edges.ends[near], axis=1).T
    at = find(wanted, low * count + high)
    number = np.full(len(wanted), -1)
    number[at[at >= 0]] = near[at >= 0]
    return np.asarray(number[place.ravel()], dtype=np.int64)
