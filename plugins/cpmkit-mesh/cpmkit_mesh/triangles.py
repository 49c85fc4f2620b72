"""A triangle mesh as a closest point source, as it is or as a sample of a smooth surface."""

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
    norms,
    one_row_each,
    positive,
    source_repr,
)
from cpmkit_mesh.box_tree import BoxTree, Nearest, build_tree, translate_tree
from cpmkit_mesh.engines import Search, nearest_search
from cpmkit_mesh.error_floors import integral_floor, is_flat_sided, rms_turning_angle, solution_error_floor
from cpmkit_mesh.face_geometry import InnerEdges, inner_edges, nonmanifold_edges
from cpmkit_mesh.interpolated_normals import (
    InterpolatedNormals,
    follow_normals,
    interpolated_normals,
    translate_normals,
)
from cpmkit_mesh.local_minima import VertexTriangles, distinct_minima, local_minima, merge_nearest, vertex_triangles
from cpmkit_mesh.mesh_components import face_components
from cpmkit_mesh.mesh_warnings import closest_point_warnings, mesh_warnings
from cpmkit_mesh.plane_sections import PlaneSection, plane_section
from cpmkit_mesh.repair import RepairedMesh
from cpmkit_mesh.smooth_surface import edge_heights, raise_to_surface
from cpmkit_mesh.topology import FIRST_BOUNDARY, Topology

#: A closest point with a barycentric coordinate below this lies on the edge opposite that corner.
ON_EDGE_COORDINATE = 1e-12


class MeshAdvice(Advice):
    """Error estimates and warnings about a mesh at a spacing, each computed and cached when it is first read."""

    def __init__(self, mesh: TriangleMesh, spacing: float) -> None:
        self.__dict__.update(mesh=mesh, spacing=spacing)

    @cached_property
    def floor(self) -> float:
        """The error of a solution in the form ``collocation`` that the mesh causes, as a share of its range."""
        return solution_error_floor(self.mesh.mean_turning, self.mesh.smooth)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that hold in any form: repairs, several pieces and, if smooth, triangles off which normals lean."""
        return self.mesh.all_warnings()

    @cached_property
    def integral_floor(self) -> float:
        """The error of a solution in the form ``galerkin`` that the mesh causes, as a share of the solution's range."""
        return integral_floor(self.mesh.mean_turning, self.mesh.smooth)

    @cached_property
    def closest_point_warnings(self) -> tuple[str, ...]:
        """Further warnings, for the form ``collocation`` alone: touching pieces, long creases, and junctions."""
        return closest_point_warnings(self.mesh, self.spacing)


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Triangles in space, welded, none of which repeats a vertex; taken as they are or as samples of a smooth surface.

    Attributes
    ----------
    repaired : RepairedMesh
        The triangles, and their relation to those that the user gave.
    smooth : bool
        True: closest points follow the interpolated normals. False: they are the nearest points of the triangles.
    normals_at_corners : (m, 3, 3) float64
        Unit normals at the corners of each triangle.
    value_count : int
        How many vertices the user gave: the rows that :meth:`interpolate` expects.
    engine : "own", "fcl" or "open3d"
        The library that finds the nearest triangle.
    crease_angle : float
        In degrees: edges at which the mesh turns by more are creases.
    shift : (3,) float64
        How far the mesh was moved from where the user gave it.
    given_arrays : (n, 3) float64 and (f, 3) int64
        The user's vertices, before any translation, and faces; some may have been merged or left out since.
    curved : bool
        True: closest points lie on the smooth surface above the triangles (:mod:`cpmkit_mesh.smooth_surface`).
    """

    repaired: RepairedMesh
    smooth: bool
    normals_at_corners: Floats
    value_count: int
    engine: str
    crease_angle: float
    shift: Floats
    given_arrays: tuple[Floats, Ints]
    curved: bool = False

    dim = 3
    manifold_dim = 2

    __repr__ = source_repr

    @property
    def vertices(self) -> Floats:
        """(k, 3) the positions of the vertices that triangles use, no two of them equal."""
        return self.repaired.mesh.vertices

    @property
    def faces(self) -> Ints:
        """(m, 3) the vertices of each triangle."""
        return self.repaired.mesh.cells

    @property
    def adjacency(self) -> Topology:
        """The adjacency of the triangles."""
        return self.repaired.adjacency

    @property
    def exact(self) -> bool:
        """Whether closest points are the nearest points of the triangles; Open3D, in float32, may miss these."""
        return not self.smooth and self.engine != "open3d"

    @property
    def bounds(self) -> Floats:
        """(2, 3) corners of the box that holds all vertices."""
        return self._bounds.copy()

    @cached_property
    def _bounds(self) -> Floats:
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, 3), on the triangles or, if smooth, along interpolated normals.

        ``element`` is the triangle of the closest point, by the user's numbers (beyond these, further parts of
        triangles that were split at T-junctions), ``local`` (n, 3) its barycentric coordinates, ``edge`` the number of
        the boundary loop on which it lies (loops by decreasing length; -1 off the boundary), and ``distance`` the
        distance from the triangles. Closest points of a smooth mesh are ``doubtful`` where no normal near by leads to
        the query: they are the nearest points of the triangles. Raise InputError if ``x`` does not have shape (n, 3) or
        is not finite.
        """
        x = as_points(x, 3)
        nearest = self._search(x)
        return self._records(x, nearest, self._move_along_normals(x, nearest))

    def local_minima(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return the local minima, up to ``radius``, of the distance from each of ``x`` (n, 3) to the surface.

        There is a minimum for each sheet; on the concave side of a bend, where facets differ from the surface that they
        sample, sometimes more. Those of a smooth mesh are moved along its normals. Of several that coincide then, the
        first is returned; a minimum that is nearer to its query after the move lies on another sheet, and is left out.
        Raise InputError if ``x`` does not have shape (n, 3) or is not finite, or ``radius`` is not a number above zero.

        Returns
        -------
        rows : (k,) int64
            The row of ``x`` of each minimum, ascending.
        minima : ClosestPoints
            The closest point records of the minima, of each query the nearest first.
        """
        x, radius = as_points(x, 3), positive(radius, "radius")
        minima = merge_nearest(self._search(x), radius, local_minima(self._tree, self._vertex_triangles, x, radius))
        rows, points = minima.rows, minima.points
        doubtful = self._move_along_normals(x[rows], points)
        distinct = distinct_minima(x, rows, points, float(np.ptp(self.bounds, axis=0).max()))
        return rows[distinct], self._records(x[rows], points, doubtful).take(distinct)

    def read_as_facets(self) -> TriangleMesh:
        """Return a mesh of the same triangles whose closest points are the nearest points of the triangles."""
        return replace(self, smooth=False, curved=False)

    def smooth_surface(self) -> TriangleMesh:
        """Return the same mesh with closest points on its curved triangles; a faceted or curved mesh itself."""
        if not self.smooth or self.curved:
            return self
        made = replace(self, curved=True)
        made.__dict__["_original"] = self._original
        heights = np.abs(self._edge_heights).max(initial=0.0)
        made.__dict__["_bounds"] = self._bounds + [[-heights], [heights]]
        return made

    def interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return (n, ...) ``values`` (value_count, ...) of the user's vertices, interpolated linearly at ``feet``.

        Raise InputError if ``values`` has another number of rows, or ``feet`` lack ``element`` or ``local``.
        """
        face, local = self._locate(feet)
        values = one_row_each(values, self.value_count, "vertices")
        return np.einsum("nc,nc...->n...", local, values[self.repaired.given_faces[face]])

    def mesh(self, _spacing: float, /) -> tuple[Floats, Ints]:
        """Return the mesh's own vertices (k, 3) and triangles (m, 3), whatever the spacing."""
        return self.vertices, self.faces

    def plane_section(self, point: Floats, normal: Floats, /) -> PlaneSection:
        """Return the curve in which the plane through ``point`` (3,) with normal vector ``normal`` (3,) cuts the mesh.

        The normal points to the left of the curve. Raise InputError if the plane misses the mesh or only touches it, or
        ``point`` or ``normal`` is not 3 finite numbers.
        """
        return plane_section(self, as_vector(point, 3, "point"), as_vector(normal, 3, "normal"))

    @property
    def given_mesh(self) -> tuple[Floats, Ints]:
        """The user's vertices (n, 3), translated with the mesh, and faces (f, 3), all of them and in their order."""
        vertices, faces = self.given_arrays
        return vertices + self.shift, faces

    def translate(self, offset: Floats, /) -> TriangleMesh:
        """Return the mesh translated by ``offset`` (3,); it shares advice, edges and components with this mesh.

        Raise InputError if ``offset`` is not 3 finite numbers.
        """
        offset = as_vector(offset, 3, "offset")
        mesh = self.repaired.mesh.with_same_cells(vertices=self.vertices + offset)
        made = replace(self, repaired=replace(self.repaired, mesh=mesh), shift=self.shift + offset)
        made.__dict__["_original"] = self._original
        made.__dict__["_bounds"] = self._bounds + offset  # rounded as the vertices are
        return made

    @cached_property
    def _original(self) -> TriangleMesh:
        """The mesh of which this mesh is a translation, or itself."""
        return self

    def advice(self, spacing: float, /) -> MeshAdvice:
        """Return error estimates and warnings for solutions on this mesh at grid ``spacing``; cached by spacing."""
        if self._original is not self:
            return self._original.advice(spacing)
        if spacing not in self._advice:  # callers read its parts one by one
            self._advice[spacing] = MeshAdvice(self, spacing)
        return self._advice[spacing]

    @cached_property
    def _advice(self) -> dict[float, MeshAdvice]:
        """The advice returned so far, by spacing."""
        return {}

    def all_warnings(self) -> tuple[str, ...]:
        """Return a sentence for each repair, and about several pieces."""
        return mesh_warnings(self)

    @cached_property
    def inner_edges(self) -> InnerEdges:
        """The edges that two triangles share, with the angles between their normals."""
        if self._original is not self:
            return self._original.inner_edges
        return inner_edges(self.vertices, self.faces, self.adjacency)

    @cached_property
    def component(self) -> Ints:
        """(m,) the number of the component of each triangle; triangles with a common edge are connected."""
        if self._original is not self:
            return self._original.component
        return face_components(self.faces, self.adjacency)

    @cached_property
    def mean_turning(self) -> float:
        """Root mean square angle, in radians, between normals at both ends of an edge; 0 if faceted and flat-sided."""
        if self._original is not self:
            return self._original.mean_turning
        if not self.smooth and is_flat_sided(self.inner_edges, self.crease_angle):
            return 0.0
        return rms_turning_angle(self.vertices, self.faces, self.normals_at_corners)

    @cached_property
    def given_vertices(self) -> Ints:
        """(k,) the number of each vertex among the user's; of several merged vertices that of the first triangle."""
        numbers = np.full(len(self.vertices), -1)
        numbers[self.faces.ravel()[::-1]] = self.repaired.given_faces.ravel()[::-1]
        return numbers

    def _move_along_normals(self, x: Floats, nearest: Nearest) -> Bools | None:
        """Move ``nearest``, in place, along interpolated normals to the closest points of ``x`` (n, 3).

        Return (n,) whether no such point was found, so that the nearest point stays; None, and move nothing, if
        faceted.
        """
        return follow_normals(self._tree, self._interpolated_normals, x, nearest) if self.smooth else None

    @cached_property
    def _edge_heights(self) -> Floats:
        """(m, 3) the heights of the smooth surface above the middles of the edges of each triangle."""
        return edge_heights(self) if self._original is self else self._original._edge_heights

    @cached_property
    def at_crease(self) -> Bools:
        """(k,) whether each vertex is at a crease or at an edge of three or more triangles; False on a faceted mesh."""
        at = np.zeros(len(self.vertices), dtype=bool)
        if self.smooth:
            at[self.inner_edges.ends[self.inner_edges.angle > np.deg2rad(self.crease_angle)]] = True
            at[nonmanifold_edges(self.faces, self.adjacency)] = True
        return at

    def _records(self, x: Floats, points: Nearest, doubtful: Bools | None) -> ClosestPoints:
        """Return nearest ``points`` of ``x`` (n, 3) as closest point records, by the user's faces and winding.

        Those of a curved mesh are raised to the smooth surface. ``doubtful`` (n,) marks points of which no normal leads
        to the query; None on a faceted mesh.
        """
        face = self._tree.order[points.slot]
        local = np.empty((len(face), 3))
        local[:, 1:] = points.local
        local[:, 0] = 1.0 - local[:, 1] - local[:, 2]
        edge, position, distance = self._loop_of_point(face, local), points.point, points.distance
        if self.curved:
            normals = self._interpolated_normals.normals[points.slot]
            position = raise_to_surface(position, local, self._edge_heights[face], normals)
            distance = norms(x - position)
        return ClosestPoints(
            position,
            distance,
            edge,
            self.repaired.given_index[face],
            self._to_given_winding(face, local),
            doubtful,
        )

    def _locate(self, feet: ClosestPoints) -> tuple[Ints, Floats]:
        """Return the mesh's own triangle (n,) of each closest point, and its barycentric coordinates (n, 3) there.

        Raise InputError if ``feet`` lack ``element`` or ``local``: another source returned them.
        """
        if feet.element is None or feet.local is None:
            raise InputError("feet must be records that this mesh answered: they lack element or local.")
        face = np.searchsorted(self.repaired.given_index, feet.element)
        return face, self._to_given_winding(face, feet.local)

    def _to_given_winding(self, face: Ints, local: Floats) -> Floats:
        """Return barycentric coordinates (n, 3) with corners 1 and 2 exchanged on faces (n,) that the repair flipped.

        This converts from the mesh's order of corners to the user's, and back.
        """
        return (
            np.where(self.repaired.flipped[face, None], local[:, [0, 2, 1]], local)
            if self.repaired.flipped.any()
            else local
        )

    def _loop_of_point(self, face: Ints, local: Floats) -> Ints:
        """Return (n,) the number of the boundary loop on which each point lies, -1 for none.

        ``local`` (n, 3) are its barycentric coordinates on the mesh's triangle ``face`` (n,).
        """
        edge = np.full(len(face), -1)
        if not len(self.adjacency.loop):
            return edge
        rows = np.flatnonzero((local <= ON_EDGE_COORDINATE).any(axis=1))
        zero = local[rows] <= ON_EDGE_COORDINATE
        loops = np.where(zero, self._loop_of_edge[face[rows]], -1)
        at_corner = zero.sum(axis=1) == 2
        corner = self.faces[face[rows], np.argmax(local[rows], axis=1)]
        edge[rows] = np.where(at_corner, self._loop_of_vertex[corner], loops.max(axis=1))
        return edge

    @cached_property
    def _loop_of_edge(self) -> Ints:
        """(m, 3) the boundary loop of each edge of each triangle, -1 for edges of two triangles or more."""
        loops = np.full(self.faces.shape, -1)
        side = self.adjacency.neighbours
        boundary = side <= FIRST_BOUNDARY
        loops[boundary] = self.adjacency.loop[FIRST_BOUNDARY - side[boundary]]
        return loops

    @cached_property
    def _loop_of_vertex(self) -> Ints:
        """(k,) the number of the boundary loop through each vertex, -1 for inner vertices."""
        loops = np.full(len(self.vertices), -1)
        loops[self.adjacency.boundary] = self.adjacency.loop[:, None]
        return loops

    @cached_property
    def _tree(self) -> BoxTree:
        corners = self.vertices[self.faces]
        return build_tree(corners) if self._original is self else translate_tree(self._original._tree, corners)

    @cached_property
    def _vertex_triangles(self) -> VertexTriangles:
        return vertex_triangles(self._tree, self.vertices, self.faces, self.adjacency)

    @cached_property
    def _search(self) -> Search:
        return nearest_search(self.engine, self._tree)

    @cached_property
    def _interpolated_normals(self) -> InterpolatedNormals:
        """The normals that closest points follow, by slots of the tree."""
        if self._original is not self:  # a translated tree has the same slots
            return translate_normals(self._original._interpolated_normals, self.vertices, self.adjacency)
        return interpolated_normals(self.vertices, self.adjacency, self._normals_to_follow, self._tree.order)

    @property
    def _normals_to_follow(self) -> Floats:
        """(m, 3, 3) the normals at the corners of each face along which closest points are moved."""
        return self.normals_at_corners
