"""The mesh of a manifold: segments or triangles, flat or quadratic, boundaries among their facets, and normals.

Edges, winding and other derived quantities are computed on first use and stay with the mesh. Those that depend on the
connectivity of the cells alone are shared by all meshes that :meth:`Mesh.with_same_cells` makes from one another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np

from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.vector_algebra import every, norms, unit
from cpmkit.types import Bools, Floats, Ints

#: How the manifold runs between the vertices of a mesh. "flat": along the cells. "closest_point": through the closest
#: points of positions on the cells. "normals": closest points lie on the flat cells, and the normals at the vertices
#: define a smooth surface above them.
CellGeometry: TypeAlias = Literal["flat", "closest_point", "normals"]
#: Support ratio (:class:`CurvatureSupport`) below which an edge is flat, and above which the surface keeps its whole
#: height over the edge. Edges of flat faces beside fillets have less than .02, edges of smooth shapes more than .15.
UNSUPPORTED, SUPPORTED = 0.03, 0.15
#: Heights below this share of the edge length are kept in any case: on a torus, edges along which the surface is curved
#: less than beyond their ends would lose their support otherwise.
LOW_HEIGHT = 0.002


@dataclass(frozen=True, eq=False)
class Edges:
    """The edges of a mesh, each listed once; a segment is its own edge."""

    ends: Ints  #: (e, 2): the vertices of each edge.
    of_cells: Ints  #: (m, 3) or (m, 1): the edges of each cell; edge j of a triangle is opposite to corner j.

    def lengths(self, vertices: Floats) -> Floats:
        """Return the distances (e,) between the ends of the edges, at the positions ``vertices`` (v, d)."""
        return norms(vertices[self.ends[:, 1]] - vertices[self.ends[:, 0]])


@dataclass(frozen=True, eq=False)
class Connectivity:
    """Quantities of a mesh that depend on its cells alone, computed on first use.

    The facet opposite to corner j of a triangle is the edge from corner j + 1 to j + 2; of a segment its ends.
    """

    cells: Ints  #: (m, k): the corners of each cell: k = 2 for segments, 3 for triangles.
    vertex_count: int

    @cached_property
    def edges(self) -> Edges:
        """The edges of the cells; points have none."""
        if self.cells.shape[1] == 1:
            return Edges(np.zeros((0, 2), dtype=np.int64), np.zeros((len(self.cells), 0), dtype=np.int64))
        if self.cells.shape[1] == 2:
            return Edges(self.cells, np.arange(len(self.cells))[:, None])
        from cpmkit.mesh import mesh_kernels

        return Edges(*mesh_kernels.number_triangle_edges(np.ascontiguousarray(self.cells), self.vertex_count))

    @property
    def facet_numbers(self) -> Ints:
        """(m, k) the number of the facet opposite to each corner: a vertex for segments, an edge for triangles."""
        return self.cells[:, ::-1] if self.cells.shape[1] == 2 else self.edges.of_cells

    @property
    def facet_count(self) -> int:
        """Number of facets."""
        return self.vertex_count if self.cells.shape[1] == 2 else len(self.edges.ends)

    @property
    def on_rim(self) -> Bools:
        """(f,) whether a facet lies on the rim: exactly one cell has it."""
        return np.asarray(np.bincount(self.facet_numbers.ravel(), minlength=self.facet_count) == 1)

    @cached_property
    def winding(self) -> Any:
        """(m,) int8: factors 1 or -1 that orient neighbouring cells alike, 0 beside facets where this is impossible.

        The orientation is propagated over shared facets; 0 occurs only beside facets of exactly two cells.
        """
        from cpmkit.mesh.mesh_kernels import propagate_orientation

        facets = np.ascontiguousarray(self.facet_numbers, dtype=np.int64)
        return propagate_orientation(np.ascontiguousarray(self.cells), facets, self.facet_count)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Segments (k = 2) or triangles (k = 3) on the manifold; a facet of a cell is opposite to one of its corners."""

    vertices: Floats  #: (v, d): relative to the lattice's origin, in the scene's unit of length.
    cells: Ints  #: (m, k): the corners of each cell.
    #: (m, e, d): points of the manifold halfway along the edges of each cell: e = 3 and edge j opposite to corner j for
    #: triangles, e = 1 for segments. None where cells are flat.
    midpoints: Floats | None
    #: (c, k - 1): the facets on boundaries: edges from tail to head along the boundary, or vertices of a curve.
    cut: Ints
    owner: Ints  #: (c,): the number of the boundary on which each of these facets lies.
    beyond_tip: Bools  #: (c,): whether the facet continues a boundary past its tip, where u is continuous.

    @classmethod
    def of(cls, vertices: Floats, cells: Ints, midpoints: Floats | None = None) -> Mesh:
        """Return a mesh of ``vertices`` (v, d) and ``cells`` (m, k) without boundaries among its facets."""
        none = np.zeros(0, dtype=np.int64)
        return cls(vertices, cells, midpoints, none.reshape(0, cells.shape[1] - 1), none, none.astype(bool))

    def with_same_cells(self, **changes: Any) -> Mesh:
        """Return the mesh with other ``vertices`` (as many), ``midpoints`` or facets; connectivity is shared."""
        mesh = replace(self, **changes)
        mesh.__dict__["connectivity"] = self.connectivity  # in the place where cached_property stores it
        return mesh

    @cached_property
    def connectivity(self) -> Connectivity:
        """Quantities that depend on the cells alone."""
        return Connectivity(self.cells, len(self.vertices))

    @property
    def edges(self) -> Edges:
        """The edges of the cells."""
        return self.connectivity.edges

    @property
    def winding(self) -> Any:
        """(m,) int8: the orientation of each cell, see :attr:`Connectivity.winding`."""
        return self.connectivity.winding

    @cached_property
    def edge_lengths(self) -> Floats:
        """(e,) the length of the chord of each edge."""
        return self.edges.lengths(self.vertices)

    @property
    def lengths_of_cells(self) -> Floats:
        """(m, 3) or (m, 1) the lengths of the edges of each cell."""
        return self.edge_lengths[self.edges.of_cells]

    @property
    def centres(self) -> Floats:
        """(m, d) the centre of each cell, of a curved cell the point at equal barycentric coordinates."""
        mean: Floats = self.vertices[self.cells].mean(axis=1)
        if self.midpoints is None:
            return mean
        if self.manifold_dim == 1:
            return np.asarray(self.midpoints[:, 0])
        return np.asarray((4 * self.midpoints.mean(axis=1) - mean) / 3)

    @property
    def dim(self) -> int:
        """Dimension d of the space."""
        return int(self.vertices.shape[1])

    @property
    def manifold_dim(self) -> int:
        """Dimension of the manifold: 1 for segments, 2 for triangles."""
        return int(self.cells.shape[1]) - 1

    @property
    def facets(self) -> Ints:
        """(m, k, k - 1) the vertices of each cell's facets, in the orientation of the cell."""
        k = self.cells.shape[1]
        places = (np.arange(k)[:, None] + np.arange(1, k)) % k
        return self.cells[:, places]

    @property
    def cut_edges(self) -> Ints:
        """(c,) the numbers among ``edges`` of the edges of triangles in ``cut``, -1 for edges that no cell has."""
        if not len(self.cut):
            return np.zeros(0, dtype=np.int64)
        count, edges = len(self.vertices), self.edges
        ends = np.sort(self.cut, axis=1)
        codes, place = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True)
        on_cut = np.zeros(count, dtype=bool)
        on_cut[ends] = True
        candidates = np.flatnonzero(every(on_cut[edges.ends]))
        low, high = np.sort(edges.ends[candidates], axis=1).T
        at = find_codes(codes, low * count + high)
        number = np.full(len(codes), -1)
        number[at[at >= 0]] = candidates[at >= 0]
        return np.asarray(number[place.ravel()], dtype=np.int64)

    @property
    def edge_is_cut(self) -> Bools:
        """(e,) whether each edge of triangles is in ``cut``."""
        is_cut = np.zeros(len(self.edges.ends) + 1, dtype=bool)  # edge number -1, no edge, has the last entry
        is_cut[self.cut_edges] = True
        return is_cut[:-1]


def rectangle(lower: Floats, upper: Floats, spacing: float) -> tuple[Floats, Ints]:
    """Return vertices (v, 2) and triangles (m, 3) of a regular triangulation between corners ``lower``, ``upper`` (2,).

    Triangles are counterclockwise; the legs are at most ``spacing`` long.
    """
    counts = np.maximum(np.ceil((upper - lower) / spacing).astype(np.int64), 1) + 1
    axes = [np.linspace(low, high, count) for low, high, count in zip(lower, upper, counts, strict=True)]
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    number = np.arange(len(vertices)).reshape(counts)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    return vertices, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


@dataclass(frozen=True, eq=False)
class CurvatureSupport:
    """The support of the curvature along edges: how well the surface beyond their ends agrees with it.

    Beside a fillet the normals at the corners of a flat face are tilted, and define a surface above the face that is
    curved over the length of its edges. The true surface is flat there, and beyond the ends of these edges the
    curvature is much larger over a much shorter length. An edge loses its support only if both hold: at the ends of an
    ellipsoid the curvature is larger, but over as long a length; beside the small triangles of a random triangulation
    the length is shorter, but the curvature is the same.
    """

    #: (e,): curvature along the edge over the curvature beyond its ends, times the length beyond over its own length;
    #: the lesser value of both ends.
    ratio: Floats
    #: (e,): height of the surface defined by the normals at the ends above the midpoint of the edge, over its length.
    height: Floats

    @property
    def share(self) -> Floats:
        """(e,) the factor, from 0 to 1, by which the height of the surface above each edge is scaled."""
        t = np.clip((self.ratio - UNSUPPORTED) / (SUPPORTED - UNSUPPORTED), 0.0, 1.0)
        return np.where(self.height > LOW_HEIGHT, t * t * (3.0 - 2.0 * t), 1.0)

    def unsupported(self, limit: float = UNSUPPORTED) -> Bools:
        """Return which edges (e,) have a relevant height and a support ratio below ``limit``."""
        return np.asarray((self.ratio < limit) & (self.height > LOW_HEIGHT))


def curvature_support(vertices: Floats, ends: Ints, normals: Floats, creased: Bools) -> CurvatureSupport:
    """Return how well the surface beyond edges supports the curvature along them, which follows from vertex normals.

    ``vertices`` (v, d), ``ends`` (e, 2): positions, and the vertices of each edge, each edge once.
    ``normals`` (e, 2, d): unit normals at the ends of each edge.
    ``creased`` (v,): whether a vertex lies on a crease, where no normal is perpendicular to all edges.
    """
    from cpmkit.mesh import mesh_kernels

    corner = ends.ravel()
    first = np.r_[0, np.cumsum(np.bincount(corner, minlength=len(vertices)))]
    around = np.argsort(corner, kind="stable") // 2
    at, across = np.ascontiguousarray(vertices), np.ascontiguousarray(normals)
    ends = np.ascontiguousarray(ends)
    return CurvatureSupport(*mesh_kernels.curvature_supports(at, ends, across, creased, first, around))


def vertex_normals(points: Floats, triangles: Ints) -> Floats:
    """Return unit normals (v, 3) at ``points`` (v, 3): the area-weighted mean of the normals of ``triangles`` (t, 3).

    Normals of triangles that are oriented differently, as on one-sided surfaces, would cancel: at the vertices of an
    edge between such triangles, all normals are first flipped to the side of one triangle. The result is zero at
    vertices without triangles of positive area.
    """
    a, b, c = (points[triangles[:, k]] for k in range(3))
    twice_area = np.cross(b - a, c - a)
    at_corners = np.repeat(twice_area, 3, axis=0)  # (3 t, 3)
    vertices = triangles.ravel()
    directed, times = np.unique(vertices * len(points) + np.roll(triangles, -1, axis=1).ravel(), return_counts=True)
    on_edge = np.zeros(len(points), dtype=bool)  # ends of edges that two triangles traverse in the same direction
    on_edge[np.concatenate(np.divmod(directed[times > 1], max(len(points), 1)))] = True
    misaligned = np.flatnonzero(on_edge[vertices])
    if len(misaligned):
        rows, first = np.unique(vertices[misaligned], return_index=True)
        reference = np.zeros(len(points), dtype=np.int64)
        reference[rows] = misaligned[first]
        cosine = np.einsum("ij,ij->i", at_corners[misaligned], at_corners[reference[vertices[misaligned]]])
        at_corners[misaligned[cosine < 0]] *= -1
    total = np.empty_like(points)
    for axis in range(3):
        total[:, axis] = np.bincount(vertices, at_corners[:, axis], minlength=len(points))
    return unit(total)
