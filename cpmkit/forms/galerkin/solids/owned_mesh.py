"""Quadratic triangles of the skin of a solid and of surfaces inside, each with the number of its surface."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.grid.lattice import Lattice
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.quadratic_surface import edge_numbers, extremes_at_edges, split_edges
from cpmkit.types import Bools, Floats, Ints

#: A surface that ends nearer to the skin or another surface than this, in spacings, counts as ending on it.
ON_SPACINGS = 0.05


@dataclass(frozen=True, eq=False)
class OwnedMesh:
    """Quadratic triangles of the skin and of surfaces inside, with common vertices where they meet."""

    mesh: Mesh
    owner: Ints  #: (m,): the number of the surface of each triangle, -1 for the skin.
    beyond: Bools  #: (m,): whether a triangle continues a surface past a rim.

    def take(self, rows: Bools | Ints, mesh: Mesh | None = None) -> OwnedMesh:
        """Return the triangles ``rows``; or those of a ``mesh``, if given, whose parents are the triangles ``rows``."""
        if mesh is None:
            mesh = part_of(self.mesh, rows)
        return OwnedMesh(mesh, self.owner[rows], self.beyond[rows])

    def near_rims(self, lattice: Lattice) -> Floats:
        """Return the tolerance (v,) within which a vertex lies on another surface: positive at vertices of rims."""
        continued, given = np.zeros((2, len(self.mesh.vertices)), dtype=bool)
        continued[self.mesh.cells[self.beyond]], given[self.mesh.cells[~self.beyond]] = True, True
        return np.where(continued & given, ON_SPACINGS * lattice.spacing, 0.0)

    @property
    def seams(self) -> Bools:
        """(e,) which edges have triangles of several owners."""
        least, most = extremes_at_edges(self.mesh, self.owner)
        return np.asarray(least < most)


def part_of(mesh: Mesh, rows: Bools | Ints) -> Mesh:
    """Return the triangles ``rows`` of a mesh, with all its vertices, and the facets in ``cut`` that they have."""
    assert mesh.midpoints is not None
    part = Mesh.of(mesh.vertices, mesh.cells[rows], mesh.midpoints[rows])
    has = edge_numbers(part, mesh.cut) >= 0 if len(mesh.cut) else np.zeros(0, dtype=bool)
    return replace(part, cut=mesh.cut[has], owner=mesh.owner[has], beyond_tip=mesh.beyond_tip[has])


def halved(own: OwnedMesh, cells: Ints) -> OwnedMesh:
    """Return the triangles with all edges of ``cells`` (k,) halved, the longest first, so that no part is thin."""
    edges = np.unique(own.mesh.edges.of_cells[cells])
    edges = edges[np.argsort(-own.mesh.edge_lengths[edges], kind="stable")]
    halves, parent = split_edges(own.mesh, own.mesh.edges.ends[edges], np.full(len(edges), 0.5))
    return own.take(parent, halves)


def halved_near(own: OwnedMesh, places: Floats) -> OwnedMesh:
    """Return the triangles, halved if nearer to one of ``places`` (k, 3) than their longest edge."""
    from scipy.spatial import KDTree

    distance = KDTree(places).query(own.mesh.vertices[own.mesh.cells].mean(axis=1))[0]
    return halved(own, np.flatnonzero(distance < own.mesh.lengths_of_cells.max(axis=1)))
