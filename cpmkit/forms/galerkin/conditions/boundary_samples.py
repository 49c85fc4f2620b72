"""Samples on boundaries and rims: points on the facets of cells, with the conormals out of these cells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from cpmkit.forms.galerkin.conditions.facets import at_end, on_edge
from cpmkit.forms.galerkin.quadrature.samples import Samples
from cpmkit.mesh.mesh import HalfFacets, SampleMesh
from cpmkit.protocols import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class BoundarySamples:
    """Points at which conditions hold: two to a half facet of triangles, one to a half facet of segments.

    Samples of all cells beside one facet lie at the same points, and are numbered alike along it.

    Attributes
    ----------
    points : (b, d) float64
        Relative to the lattice's origin.
    weights : (b,) float64
        Share of the boundary's length, 1 where the boundary is a point.
    conormals : (b, d) float64
        Unit vectors tangent to the manifold, normal to the boundary, out of the cell; zero at points of a surface.
    normals : (b, c, d) float64
        Orthonormal vectors that span the manifold's normal space.
    cell : (b,) int64
        The cell that each belongs to.
    centres : (b, d) float64
        The mean of that cell's corners.
    half : (b,) int64
        The half facet; -1 at points of a surface.
    facet : (b,) int64
        The number of the facet in ``mesh.cut``; -1 on rims where no boundary lies, and at points of a surface.
    place : (b,) int64
        Number along the facet, from 0.
    owner : (b,) int64
        Number of the boundary; -1 on rims where no boundary lies.
    extends : (b,) bool
        Whether the facet goes on past a tip of its boundary.
    """

    points: Floats
    weights: Floats
    conormals: Floats
    normals: Floats
    cell: Ints
    centres: Floats
    half: Ints
    facet: Ints
    place: Ints
    owner: Ints
    extends: Bools

    def __len__(self) -> int:
        return len(self.points)

    def take(self, index: Ints | Bools) -> BoundarySamples:
        """Return those at ``index``."""
        return BoundarySamples(*[getattr(self, field.name)[index] for field in fields(self)])

    @property
    def as_samples(self) -> Samples:
        """The same as samples of the manifold of weight zero: they only read u."""
        return Samples(self.points, np.zeros(len(self)), self.normals, self.cell)


def boundary_samples(
    mesh: SampleMesh, half: HalfFacets, corners: Ints, rims: bool, points: Mapping[int, Ints] | None = None
) -> BoundarySamples:
    """Return the samples on the facets of boundaries, and on other rims where ``rims`` says so.

    Parameters
    ----------
    mesh : SampleMesh
        Flat or quadratic cells.
    half : HalfFacets
        Its facets on boundaries and rims, from each cell.
    corners : (m, k) int64
        The vertices of the cells after cutting.
    rims : bool
        Whether anything is to be read on rims where no boundary lies.
    points : mapping of int to (k,) int64, optional
        Vertices that are points of a surface with a condition, by the number of the boundary.
    """
    chosen = np.flatnonzero((half.cut >= 0) | rims)
    where = on_edge if mesh.manifold_dim == 2 else at_end
    cell, facet, cut = half.cell[chosen], half.facet[chosen], half.cut[chosen]
    x, weights, conormals, normals = where(mesh, corners, cell, facet, half.along[chosen] < 0)
    each = x.shape[1]
    rows, on = np.repeat(np.arange(len(chosen)), each), cut >= 0
    owner, extends = np.full(len(chosen), -1), np.zeros(len(chosen), dtype=bool)
    owner[on], extends[on] = mesh.owner[cut[on]], mesh.extends[cut[on]]
    found = BoundarySamples(
        x.reshape(-1, mesh.dim),
        weights.ravel(),
        conormals.reshape(-1, mesh.dim),
        normals.reshape(-1, *normals.shape[2:]),
        cell[rows],
        mesh.vertices[mesh.cells[cell]].mean(axis=1)[rows],
        chosen[rows],
        cut[rows],
        np.tile(np.arange(each), len(chosen)),
        owner[rows],
        extends[rows],
    )
    return joined(found, _at_vertices(mesh, corners, points)) if points else found


def joined(first: BoundarySamples, second: BoundarySamples) -> BoundarySamples:
    """Return the samples of both, one after the other."""
    names = [field.name for field in fields(BoundarySamples)]
    return BoundarySamples(*[np.concatenate([getattr(first, name), getattr(second, name)]) for name in names])


def _at_vertices(mesh: SampleMesh, corners: Ints, points: Mapping[int, Ints]) -> BoundarySamples:
    """Return the points of a surface, each in one of the triangles that meet there."""
    owner = np.repeat(list(points), [len(one) for one in points.values()])
    vertex = np.concatenate(list(points.values()))
    order = np.argsort(mesh.cells, axis=None, kind="stable")
    cell = order[np.searchsorted(mesh.cells.ravel()[order], vertex)] // mesh.cells.shape[1]
    normals = on_edge(mesh, corners, cell, np.zeros_like(cell), np.zeros(len(cell), dtype=bool))[3][:, 0]
    none, x = np.full(len(cell), -1), mesh.vertices[vertex]
    nowhere = np.zeros(len(cell), dtype=bool)
    return BoundarySamples(
        x, np.ones(len(cell)), np.zeros_like(x), normals, cell, x, none, none, np.zeros_like(cell), owner, nowhere
    )
