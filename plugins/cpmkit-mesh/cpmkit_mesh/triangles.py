"""The kind ``mesh.triangles``: a triangle mesh, as it stands or as a sample of a smooth surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.arrays import as_points, as_vector, one_row_each
from cpmkit.errors import InputError
from cpmkit.protocols import ClosestPoints, Floats, Ints
from cpmkit_mesh.normals import corner_normals, unit
from cpmkit_mesh.reading import as_mesh, read_mesh, weld
from cpmkit_mesh.smooth import SmoothPart, follow_normals, smooth_part
from cpmkit_mesh.topology import FIRST_BOUNDARY, Topology, topology
from cpmkit_mesh.tree import Tree, build_tree, nearest

#: A foot with a barycentric coordinate below this lies on the edge opposite that corner.
ON_EDGE = 1e-12


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles in space, welded, of which none repeats a vertex.

    Attributes
    ----------
    vertices : (k, 3) float64
        Those that triangles use, each place once.
    faces : (m, 3) int64
    smooth : bool
        True: feet follow the interpolated normals. False: feet are the nearest points of the triangles.
    adjacency : Topology
    normals_at_corners : (m, 3, 3) float64
    given_faces : (m, 3) int64
        The same triangles by the numbers that the user's vertices have.
    given_index : (m,) int64
        The number that each triangle has among the user's.
    value_count : int
        How many vertices the user gave: the rows that :meth:`interpolate` expects.
    """

    vertices: Floats
    faces: Ints
    smooth: bool
    adjacency: Topology
    normals_at_corners: Floats
    given_faces: Ints
    given_index: Ints
    value_count: int

    dim = 3
    manifold_dim = 2

    @property
    def exact(self) -> bool:
        """True where feet are the nearest points of the triangles."""
        return not self.smooth

    @property
    def bounds(self) -> Floats:
        """(2, 3) corners of the box that holds all vertices."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, 3).

        ``element`` is the triangle of the foot, by the user's numbers, ``local`` (n, 3) its
        barycentric coordinates, ``edge`` the number of the boundary loop that it lies on (loops by
        decreasing length), and ``distance`` the distance to the triangles. Feet of a smooth mesh
        are ``doubtful`` where no normal nearby leads to the query, and the nearest point of the triangles
        was taken.

        Raises
        ------
        InputError
            If ``x`` does not have shape (n, 3) or is not finite.
        """
        x = as_points(x, 3)
        found = nearest(self._tree, x)
        doubtful = follow_normals(self._tree, self._smooth_part, x, found) if self.smooth else None
        face = self._tree.order[found.slot]
        local = np.empty((len(x), 3))
        local[:, 1:] = found.local
        local[:, 0] = 1.0 - local[:, 1] - local[:, 2]
        edge = self._edges(face, local)
        return ClosestPoints(found.foot, found.distance, edge, self.given_index[face], local, doubtful)

    def interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return ``values`` (value_count, ...), one row a given vertex, interpolated linearly in each triangle."""
        face, local = self._located(feet)
        values = one_row_each(values, self.value_count, "vertices")
        return np.einsum("nc,nc...->n...", local, values[self.given_faces[face]])

    def mesh(self, _spacing: float, /) -> tuple[Floats, Ints]:
        """Return the mesh's own vertices (k, 3) and triangles (m, 3), whatever the spacing."""
        return self.vertices, self.faces

    def translated(self, offset: Floats, /) -> TriangleMesh:
        """Return the mesh moved by ``offset`` (3,)."""
        return replace(self, vertices=self.vertices + as_vector(offset, 3, "offset"))

    def _located(self, feet: ClosestPoints) -> tuple[Ints, Floats]:
        if feet.element is None or feet.local is None:
            raise InputError("feet must be records that this mesh answered: they lack element or local.")
        return np.searchsorted(self.given_index, feet.element), feet.local

    def _edges(self, face: Ints, local: Floats) -> Ints:
        """Return (n,) the boundary loop on which each foot lies, -1 for none."""
        edge = np.full(len(face), -1)
        if not len(self.adjacency.loop):
            return edge
        near = np.flatnonzero((local <= ON_EDGE).any(axis=1))
        zero = local[near] <= ON_EDGE
        loops = np.where(zero, self._loop_of_edge[face[near]], -1)
        at_corner = zero.sum(axis=1) == 2
        corner = self.faces[face[near], np.argmax(local[near], axis=1)]
        edge[near] = np.where(at_corner, self._loop_of_vertex[corner], loops.max(axis=1))
        return edge

    @cached_property
    def _loop_of_edge(self) -> Ints:
        """(m, 3) the boundary loop of each edge of each triangle, -1 for inner ones."""
        loops = np.full(self.faces.shape, -1)
        side = self.adjacency.neighbours
        boundary = side <= FIRST_BOUNDARY
        loops[boundary] = self.adjacency.loop[FIRST_BOUNDARY - side[boundary]]
        return loops

    @cached_property
    def _loop_of_vertex(self) -> Ints:
        loops = np.full(len(self.vertices), -1)
        loops[self.adjacency.boundary] = self.adjacency.loop[:, None]
        return loops

    @cached_property
    def _tree(self) -> Tree:
        return build_tree(self.vertices[self.faces])

    @cached_property
    def _smooth_part(self) -> SmoothPart:
        return smooth_part(self.vertices, self.adjacency, self.normals_at_corners, self._tree.order)


class OrientedTriangleMesh(TriangleMesh):
    """A mesh whose triangles are wound alike, so that its normals have one sign."""

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, 3) unit normals at ``feet``, interpolated from the vertices; their sign is the faces' winding."""
        face, local = self._located(feet)
        mixed = np.einsum("nc,nck->nk", local, self.normals_at_corners[face])
        vanished = np.linalg.norm(mixed, axis=1) <= ON_EDGE
        mixed[vanished] = self.normals_at_corners[face[vanished], 0]
        return unit(mixed)


def triangles(
    *, file: str | Path | None = None, vertices: Any = None, faces: Any = None, closest: str = "smooth"
) -> TriangleMesh:
    """Return a triangle mesh from a file or from arrays.

    Parameters
    ----------
    file : str or Path
        An OBJ, PLY, STL or OFF file.
    vertices : (n, 3) array
        Vertices that lie at exactly the same place count as one.
    faces : (m, 3) array
        Indices of vertices. Triangles that repeat a vertex are left out.
    closest : "smooth" or "faceted"
        Whether feet follow interpolated vertex normals, as if the mesh sampled a smooth surface,
        or are the nearest points of the triangles as they stand.

    Raises
    ------
    InputError
        If both or neither of file and arrays are given, the file cannot be read, the arrays are
        empty, of another shape or not finite, a face names a vertex that is not there, no triangle
        has three different corners, or ``closest`` is another word.
    """
    if closest not in ("smooth", "faceted"):
        raise InputError(f"closest must be 'smooth' or 'faceted', got {closest!r}.")
    if file is not None and (vertices is not None or faces is not None):
        raise InputError("mesh.triangles takes either a file or vertices and faces, got both.")
    if file is None and (vertices is None or faces is None):
        raise InputError("mesh.triangles needs a file, or both vertices and faces.")
    given_vertices, given_faces = as_mesh(vertices, faces) if file is None else read_mesh(file)
    used, compact = np.unique(given_faces, return_inverse=True)
    first, place = weld(given_vertices[used])
    welded = place[compact.reshape(-1, 3)]
    apart = np.flatnonzero((welded != np.roll(welded, 1, axis=1)).all(axis=1))
    if not len(apart):
        raise InputError(f"No triangle has three different corners, of {len(welded)}; use mesh.polyline for curves.")
    points, cells = given_vertices[used][first], welded[apart]
    adjacency = topology(points, cells)
    oriented = OrientedTriangleMesh if adjacency.consistent else TriangleMesh
    return oriented(
        vertices=points,
        faces=cells,
        smooth=closest == "smooth",
        adjacency=adjacency,
        normals_at_corners=corner_normals(points, cells, adjacency),
        given_faces=given_faces[apart],
        given_index=apart,
        value_count=len(given_vertices),
    )
