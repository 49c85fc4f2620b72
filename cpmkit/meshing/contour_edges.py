"""Edges and connected components of a triangulation that is being repaired, and the collapse of its edges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Bools, Floats, Ints

#: Components with less area than this, in squares of the spacing, are left out: splines with such a component alone in
#: their support have arbitrary values there. An ellipsoid 10 : 10 : 1 at spacings of its thickness has some of up to
#: .02; a sphere with a radius of a tenth of a spacing, which the lattice meets by chance alone, has .13.
LEAST_COMPONENT_AREA = 0.1


@dataclass(frozen=True, eq=False)
class EdgeTable:
    """The edges of triangles; edge j of a triangle is opposite to its corner j."""

    ends: Ints  #: (e, 2): the vertices of each edge, the lower number first.
    of_cells: Ints  #: (m, 3): the edges of each triangle.
    count: Ints  #: (e,): the number of triangles of each edge.

    def slots_of(self, edges: Ints, count: int) -> Ints:
        """Return the slots (k, count) of ``edges`` (k,), all of which have ``count`` triangles.

        A slot is three times the number of a triangle plus that of the corner opposite to the edge.
        """
        order = np.argsort(self.of_cells.ravel(), kind="stable")
        start = np.cumsum(self.count) - self.count
        return np.asarray(order[start[edges][:, None] + np.arange(count)])


def edge_table(cells: Ints) -> EdgeTable:
    """Return the edges of triangles or quadrilaterals ``cells`` (m, k); edge j joins the corners j + 1 and j + 2."""
    k = cells.shape[1]
    places = (np.arange(k)[:, None] + [1, 2]) % k
    ends = np.sort(cells[:, places].reshape(-1, 2), axis=1)
    size = int(cells.max(initial=0)) + 1
    codes, of_cells, count = np.unique(ends[:, 0] * size + ends[:, 1], return_inverse=True, return_counts=True)
    return EdgeTable(np.stack(np.divmod(codes, size), axis=1), of_cells.reshape(-1, k), count.astype(np.int64))


def edge_ends(cells: Ints, slots: Ints) -> Ints:
    """Return the vertices (..., 2) of the edges at ``slots`` (...), in the orientation of their triangles."""
    cell, corner = np.divmod(slots, 3)
    return np.stack([cells[cell, (corner + 1) % 3], cells[cell, (corner + 2) % 3]], axis=-1)


def halve_edges(cells: Ints, slots: Ints, midpoints: Ints) -> Ints:
    """Return the triangles (m + s, 3) with the edges at ``slots`` (s,) halved at the vertices ``midpoints`` (s,).

    No triangle may have two of the slots. The halves come last, with the orientation of their triangles.
    """
    cell, corner = np.divmod(slots, 3)
    apex, a, b = (cells[cell, (corner + k) % 3] for k in range(3))
    halves = [np.stack([apex, a, midpoints], axis=-1), np.stack([apex, midpoints, b], axis=-1)]
    return np.concatenate([np.delete(cells, cell, axis=0), *halves])


@dataclass(frozen=True, eq=False)
class OpenEdges:
    """The edges that belong to one triangle only."""

    edge: Ints  #: (b,): numbers of these edges among all edges.
    ends: Ints  #: (b, 2): vertices of each edge.
    #: midpoints, conormals (b, 3): the midpoints of the edges, and unit conormals there, perpendicular to the edge and
    #: pointing out of its triangle.
    midpoints: Floats
    conormals: Floats

    def take(self, rows: Bools | Ints) -> OpenEdges:
        """Return the edges at ``rows``, numbers or a mask."""
        return OpenEdges(self.edge[rows], self.ends[rows], self.midpoints[rows], self.conormals[rows])

    def normals(self, vertices: Floats) -> Floats:
        """Return unit normals (b, 3), of either sign, of the triangles at these edges."""
        return np.cross(unit(vertices[self.ends[:, 1]] - vertices[self.ends[:, 0]]), self.conormals)


def open_edges(vertices: Floats, cells: Ints, edges: EdgeTable) -> OpenEdges:
    """Return the edges that belong to one triangle only; ``edges`` is the table of the triangles ``cells`` (m, 3)."""
    cell, corner = np.nonzero(edges.count[edges.of_cells] == 1)
    ends = edge_ends(cells, 3 * cell + corner)
    a, b, apex = vertices[ends[:, 0]], vertices[ends[:, 1]], vertices[cells[cell, corner]]
    middle, along = 0.5 * (a + b), unit(b - a)
    outward = middle - apex
    conormal = unit(outward - dots(outward, along)[:, None] * along)
    degenerate = norms(conormal) == 0
    conormal[degenerate] = unit(outward[degenerate])
    return OpenEdges(edges.of_cells[cell, corner], ends, middle, conormal)


def double_areas(vertices: Floats, cells: Ints) -> Floats:
    """Return twice the area (m,) of each of the triangles ``cells`` (m, 3) with ``vertices`` (v, 3)."""
    corners = vertices[cells]
    return norms(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))


def shortest_at_both_ends(ends: Ints, length: Floats, count: int) -> Ints:
    """Return the rows (r,) of those edges ``ends`` (k, 2) that are the shortest of the given edges at both vertices.

    ``length`` (k,) are the lengths of the edges, ``count`` the number of all vertices.
    """
    order = np.argsort(length, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    least = np.full(count, len(order))
    np.minimum.at(least, ends, rank[:, None])
    return np.flatnonzero((least[ends] == rank[:, None]).all(axis=1))


def collapse_edges(cells: Ints, ends: Ints, count: int) -> Ints:
    """Return the triangles (n, 3) with the second vertex of each of the edges ``ends`` (k, 2) replaced by the first.

    Triangles with a repeated vertex are left out; of equal triangles an odd number leaves one, an even number none.
    ``count`` is the number of vertices, which keep their numbers.
    """
    number = np.arange(count)
    number[ends[:, 1]] = ends[:, 0]
    while (number != number[number]).any():  # edges with a common vertex
        number = number[number]
    cells = number[cells]
    cells = cells[(cells != np.roll(cells, 1, axis=1)).all(axis=1)]
    _, first, times = np.unique(np.sort(cells, axis=1), axis=0, return_index=True, return_counts=True)
    return np.ascontiguousarray(cells[np.sort(first[times % 2 == 1])])


def remove_small_components(vertices: Floats, cells: Ints, links: Ints, spacing: float) -> tuple[Ints, int]:
    """Return the triangles (n, 3) without components below ``LEAST_COMPONENT_AREA``, and the number of these.

    ``links`` as in :func:`components_with_areas`; ``spacing`` of the form's lattice. If all are that small, all stay.
    """
    component, areas = components_with_areas(vertices, cells, links)
    is_small = areas < LEAST_COMPONENT_AREA * spacing**2
    if is_small.all():
        return cells, 0
    return np.ascontiguousarray(cells[~is_small[component]]), int(is_small.sum())


def components_with_areas(vertices: Floats, cells: Ints, links: Ints) -> tuple[Ints, Floats]:
    """Return the component (m,) of each triangle, and the area (c,) of each component.

    ``links`` (m, 3) are the vertices or the edges of each triangle; triangles with a common link are connected.
    """
    ends = np.concatenate([links[:, :2], links[:, 1:]])
    label = connected_components(int(links.max(initial=-1)) + 1, ends)[1][links[:, 0]]
    component = np.unique(label, return_inverse=True)[1]
    areas = np.bincount(component, 0.5 * double_areas(vertices, cells))
    return component.astype(np.int64), np.asarray(areas, dtype=np.float64)
