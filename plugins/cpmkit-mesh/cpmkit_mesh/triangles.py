"""A triangle mesh, as it stands or as a sample of a smooth surface."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.plugin import (
    Advice,
    Bools,
    ClosestPoints,
    Floats,
    InputError,
    Ints,
    as_points,
    as_vector,
    one_row_each,
    positive,
    source_repr,
)
from cpmkit_mesh.engines import Search, search_with
from cpmkit_mesh.feet import VertexPatches, distinct, local_minima, patches, with_nearest
from cpmkit_mesh.folds import Folds, folds
from cpmkit_mesh.pieces import pieces
from cpmkit_mesh.sections import PlaneSection, plane_section
from cpmkit_mesh.smooth import SmoothPart, follow_normals, moved_smooth_part, smooth_part
from cpmkit_mesh.soundness import closest_point_warnings, mesh_warnings
from cpmkit_mesh.topology import FIRST_BOUNDARY, Topology
from cpmkit_mesh.tree import Nearest, Tree, build_tree, moved_tree
from cpmkit_mesh.turning import integral_floor, is_meant_flat, mesh_floor, turning_angle

#: A foot with a barycentric coordinate below this lies on the edge opposite that corner.
ON_EDGE_COORDINATE = 1e-12


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
        The same triangles by the numbers that the user's vertices have, in the same order.
    given_index : (m,) int64
        The number that each triangle has among the user's, ascending; further parts of a divided one have ones beyond.
    turned : (m,) bool
        Which of the triangles are wound otherwise than the user's.
    value_count : int
        How many vertices the user gave: the rows that :meth:`interpolate` expects.
    engine : "own", "fcl" or "open3d"
        What finds the nearest triangle.
    crease_angle : float
        In degrees: edges at which the mesh turns by more are creases.
    notes : tuple of str
        Sentences on what of the user's mesh was changed.
    shift : (3,) float64
        How far the mesh was moved from where the user gave it.
    as_given : (n, 3) float64 and (f, 3) int64
        The user's vertices, where they were given, and faces; some may have been merged or left out since.
    """

    vertices: Floats
    faces: Ints
    smooth: bool
    adjacency: Topology
    normals_at_corners: Floats
    given_faces: Ints
    given_index: Ints
    turned: Bools
    value_count: int
    engine: str
    crease_angle: float
    notes: tuple[str, ...]
    shift: Floats
    as_given: tuple[Floats, Ints]

    dim = 3
    manifold_dim = 2

    __repr__ = source_repr

    @property
    def exact(self) -> bool:
        """True where feet are the nearest points of the triangles; Open3D, in float32, does not always find those."""
        return not self.smooth and self.engine != "open3d"

    @property
    def bounds(self) -> Floats:
        """(2, 3) corners of the box that holds all vertices."""
        return self._bounds.copy()

    @cached_property
    def _bounds(self) -> Floats:
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
        found = self._search(x)
        return self._records(found, self._made_smooth(x, found))

    def local_minima(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return all feet of ``x`` (n, 3) within ``radius``: the rows (k,) of ``x``, and the feet, nearest first.

        They are the local minima of the distance to the triangles, as many as there are sheets: on the hollow side of
        a bend, where facets differ from the surface that they sample, now and then more. Those of a smooth mesh follow
        its normals from there; where several arrive at the same place, one of them is kept, and one that arrives nearer
        than it started is on another's sheet.

        Raises
        ------
        InputError
            If ``x`` does not have shape (n, 3) or is not finite, or ``radius`` is not a number above zero.
        """
        x, radius = as_points(x, 3), positive(radius, "radius")
        minima = with_nearest(self._search(x), radius, local_minima(self._tree, self._patches, x, radius))
        rows, found = minima.rows, minima.found
        doubtful = self._made_smooth(x[rows], found)
        kept = distinct(x, rows, found, float(np.ptp(self.bounds, axis=0).max()))
        return rows[kept], self._records(found, doubtful).take(kept)

    def faceted(self) -> TriangleMesh:
        """Return the same mesh, closest points on it being those of its triangles."""
        return replace(self, smooth=False)

    def interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return ``values`` (value_count, ...), one row a given vertex, interpolated linearly in each triangle."""
        face, local = self._located(feet)
        values = one_row_each(values, self.value_count, "vertices")
        return np.einsum("nc,nc...->n...", local, values[self.given_faces[face]])

    def mesh(self, _spacing: float, /) -> tuple[Floats, Ints]:
        """Return the mesh's own vertices (k, 3) and triangles (m, 3), whatever the spacing."""
        return self.vertices, self.faces

    def plane_section(self, point: Floats, normal: Floats, /) -> PlaneSection:
        """Return the section by the plane through ``point`` (3,) across ``normal`` (3,), which points to its left."""
        return plane_section(self, point, normal)

    @property
    def given_mesh(self) -> tuple[Floats, Ints]:
        """The user's vertices (n, 3) and faces (f, 3), all of them and in their order."""
        vertices, faces = self.as_given
        return vertices + self.shift, faces

    def translated(self, offset: Floats, /) -> TriangleMesh:
        """Return the mesh moved by ``offset`` (3,); what is searched and told is made once for all places."""
        offset = as_vector(offset, 3, "offset")
        made = replace(self, vertices=self.vertices + offset, shift=self.shift + offset)
        made.__dict__["_first"] = self._first
        made.__dict__["_bounds"] = self._bounds + offset  # rounded as the vertices are
        return made

    @cached_property
    def _first(self) -> TriangleMesh:
        """The mesh that this one was moved from, or itself."""
        return self

    def advice(self, spacing: float, /) -> Advice:
        """Return what was changed in the mesh, or may spoil a solution on it, and the error that it leaves in any."""
        if self._first is not self:
            return self._first.advice(spacing)
        told = self.__dict__.get("_advised")  # it is asked for several times at one spacing
        if told is None or told[0] != spacing:
            floors = mesh_floor(self._turning, self.smooth), self.own_integral_floor(spacing)
            found = Advice(floors[0], self.own_warnings(spacing), floors[1], closest_point_warnings(self, spacing))
            self.__dict__["_advised"] = told = spacing, found
        return told[1]

    def own_warnings(self, spacing: float, /) -> tuple[str, ...]:
        """Return what was changed in the mesh, and how many pieces it has, at whatever spacing."""
        del spacing
        return mesh_warnings(self)

    def own_integral_floor(self, spacing: float, /) -> float:
        """Return the error that the mesh leaves in integrals, whatever the spacing."""
        del spacing
        return integral_floor(self._turning, self.smooth)

    @cached_property
    def folds(self) -> Folds:
        """The edges at which two triangles meet, with their angles."""
        return folds(self.vertices, self.faces, self.adjacency) if self._first is self else self._first.folds

    @cached_property
    def piece(self) -> Ints:
        """(m,) the number of the piece that each triangle is on: those that share an edge are on the same."""
        return pieces(self.faces, self.adjacency) if self._first is self else self._first.piece

    @cached_property
    def _turning(self) -> float:
        """The angle by which the mesh turns from vertex to vertex; zero where its sides are meant to be flat."""
        if self._first is not self:
            return self._first._turning
        if not self.smooth and is_meant_flat(self.folds, self.crease_angle):
            return 0.0
        return turning_angle(self.vertices, self.faces, self.normals_at_corners)

    @cached_property
    def given_vertices(self) -> Ints:
        """(k,) the number that each vertex has among the user's; of several at one place that of an early triangle.

        Each has one, for a vertex of the mesh is one that triangles use.
        """
        numbers = np.full(len(self.vertices), -1)
        numbers[self.faces.ravel()[::-1]] = self.given_faces.ravel()[::-1]
        return numbers

    def _made_smooth(self, x: Floats, found: Nearest) -> Bools | None:
        """Move the nearest points in ``found`` along a smooth mesh; return (n,) the doubtful ones, None if faceted."""
        return follow_normals(self._tree, self._smooth_part, x, found) if self.smooth else None

    def _records(self, found: Nearest, doubtful: Bools | None) -> ClosestPoints:
        face = self._tree.order[found.slot]
        local = np.empty((len(face), 3))
        local[:, 1:] = found.local
        local[:, 0] = 1.0 - local[:, 1] - local[:, 2]
        edge = self._edges(face, local)
        return ClosestPoints(
            found.foot, found.distance, edge, self.given_index[face], self._as_given(face, local), doubtful
        )

    def _located(self, feet: ClosestPoints) -> tuple[Ints, Floats]:
        if feet.element is None or feet.local is None:
            raise InputError("feet must be records that this mesh answered: they lack element or local.")
        face = np.searchsorted(self.given_index, feet.element)
        return face, self._as_given(face, feet.local)

    def _as_given(self, face: Ints, local: Floats) -> Floats:
        """Return coordinates in triangles as the user's winding has them from those of the mesh's own, and back."""
        return np.where(self.turned[face, None], local[:, [0, 2, 1]], local) if self.turned.any() else local

    def _edges(self, face: Ints, local: Floats) -> Ints:
        """Return (n,) the boundary loop on which each foot lies, -1 for none."""
        edge = np.full(len(face), -1)
        if not len(self.adjacency.loop):
            return edge
        near = np.flatnonzero((local <= ON_EDGE_COORDINATE).any(axis=1))
        zero = local[near] <= ON_EDGE_COORDINATE
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
        corners = self.vertices[self.faces]
        return build_tree(corners) if self._first is self else moved_tree(self._first._tree, corners)

    @cached_property
    def _patches(self) -> VertexPatches:
        return patches(self._tree, self.vertices, self.faces, self.adjacency)

    @cached_property
    def _search(self) -> Search:
        return search_with(self.engine, self._tree)

    @cached_property
    def _smooth_part(self) -> SmoothPart:
        if self._first is not self:  # a moved tree has the same slots
            return moved_smooth_part(self._first._smooth_part, self.vertices, self.adjacency)
        return smooth_part(self.vertices, self.adjacency, self._followed_normals, self._tree.order)

    @property
    def _followed_normals(self) -> Floats:
        """(m, 3, 3) the normals at the corners of each face that closest points follow."""
        return self.normals_at_corners
