"""A mesh cut along a scene's boundaries, for forms that discretise on its triangles or segments."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_samples import boundary_samples
from cpmkit.forms.galerkin.conditions.boundary_sides import left_of_boundaries
from cpmkit.forms.galerkin.scene_sampling import check_insertion
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import localize
from cpmkit.mesh.adjacency import cut_corners, half_facets
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.insertion.boundary_insertion import insert_boundaries
from cpmkit.meshing.mesh_warnings import insertion_warnings
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.scene.scene import Scene
from cpmkit.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class CutMesh:
    """A mesh with boundaries along facets of its cells; vertices on boundaries are doubled, one for each side."""

    mesh: Mesh  #: Triangles of a surface or segments of a curve, in the scene's coordinates.
    #: (e, k - 1): facets on boundaries, edges of triangles or ends of segments, once for each cell beside them.
    edges: Ints
    owner: Ints  #: (e,): the number of the boundary on which each of these facets lies.
    left: Bools  #: (e,): whether the cell beside the facet is on the left of the boundary.
    #: (k,) each: the vertices at boundaries that are points of a surface, by the number of the boundary.
    points: Mapping[int, Ints]
    warnings: tuple[str, ...]  #: Warnings of the insertion of boundaries.

    #: The name of :attr:`warnings` before.
    told = DeprecatedMember("warnings")

    @property
    def vertices(self) -> Floats:
        """(v, d) the vertices of the mesh."""
        return self.mesh.vertices

    @property
    def faces(self) -> Ints:
        """(m, k) the cells of the mesh."""
        return self.mesh.cells


def cut_along_boundaries(scene: Scene, vertices: Floats, faces: Ints, length: float) -> CutMesh:
    """Return a mesh of the scene's manifold cut along the scene's boundaries, like the mesh of the Galerkin form.

    Parameters
    ----------
    scene : Scene
        The scene, whose boundaries are inserted.
    vertices, faces : (v, d) float64, (m, k) int64
        A mesh of the scene's surface, k = 3, or curve, k = 2, in its coordinates: welded, without degenerate cells.
    length : float
        Typical edge length. Curves are followed in steps of half of it; a boundary farther than three of these lengths
        from the surface is refused.

    Raises
    ------
    SceneError
        If a boundary lies off the surface, is not in the mesh, or lies on a boundary with a different condition.
    """
    bounds = np.asarray(scene.surface.bounds, dtype=np.float64)
    lattice = Lattice(0.5 * (bounds[0] + bounds[1]), length)
    sources = [localize(boundary.source, lattice.origin) for boundary in scene.boundaries]
    insertion = insert_boundaries(Mesh.of(vertices - lattice.origin, faces), sources, length)
    check_insertion(insertion, scene.boundaries, length)
    whole = insertion.mesh
    ends = ~whole.beyond_tip  # past its tips u is continuous
    mesh = replace(whole, cut=whole.cut[ends], owner=whole.owner[ends], beyond_tip=whole.beyond_tip[ends])
    numbers, corners = np.unique(cut_corners(mesh), return_inverse=True)
    corners, half = corners.reshape(mesh.cells.shape), half_facets(mesh)
    samples = boundary_samples(mesh, half, corners, False)
    oriented = [scene.oriented(boundary) for boundary in scene.boundaries]
    left = left_of_boundaries(mesh, half, corners, samples, oriented, lattice)
    first = np.flatnonzero((samples.owner >= 0) & (samples.place == 0))
    cell, facet = half.cell[samples.half[first]], half.facet[samples.half[first]]
    k = mesh.cells.shape[1]
    places = np.zeros((len(numbers), mesh.dim))
    places[corners] = mesh.vertices[mesh.cells]
    at = np.zeros(len(mesh.vertices), dtype=np.int64)
    at[mesh.cells] = corners
    return CutMesh(
        Mesh.of(lattice.to_scene(places), np.asarray(corners, dtype=np.int64)),
        corners[cell[:, None], (facet[:, None] + np.arange(1, k)) % k],
        samples.owner[first],
        left[first],
        {number: at[vertices] for number, vertices in insertion.point_vertices.items()},
        tuple(insertion_warnings(insertion, [boundary.name for boundary in scene.boundaries], length)),
    )
