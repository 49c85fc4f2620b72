"""Surfaces of quadratic triangles: their points and normals, and the splitting of their edges and triangles.

A triangle is split in its own parameters, so that its parts are the same surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.insertion.surface_matching import ProjectionSearch
from cpmkit.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class QuadraticSurface:
    """Points, normals and heights of a surface of quadratic triangles, by a search among the flat triangles."""

    mesh: Mesh  #: Quadratic triangles.

    @cached_property
    def _search(self) -> ProjectionSearch:
        """The search among the flat triangles."""
        return ProjectionSearch(Mesh.of(self.mesh.vertices, self.mesh.cells), self.mesh.lengths_of_cells.max(axis=1))

    def frames(self, cell: Ints, shares: Floats) -> tuple[Floats, Floats, Floats]:
        """Return points (n, 3) at barycentric coordinates ``shares`` (n, 3) of cells (n,), and two tangents (n, 3)."""
        assert self.mesh.midpoints is not None
        nodes = np.concatenate([self.mesh.vertices[self.mesh.cells[cell]], self.mesh.midpoints[cell]], axis=1)
        a, b, c = shares.T
        zero = np.zeros(len(shares))
        values = [a * (2 * a - 1), b * (2 * b - 1), c * (2 * c - 1), 4 * b * c, 4 * c * a, 4 * a * b]
        # along b and c at a = 1 - b - c
        along_b = [1 - 4 * a, 4 * b - 1, zero, 4 * c, -4 * c, 4 * (a - b)]
        along_c = [1 - 4 * a, zero, 4 * c - 1, 4 * b, 4 * (a - c), -4 * b]
        point, first, second = (
            np.einsum("kn,nkd->nd", np.stack(functions), nodes) for functions in (values, along_b, along_c)
        )
        return point, first, second

    def feet(self, points: Floats) -> tuple[Ints, Floats]:
        """Return a cell (n,) near each of ``points`` (n, 3), and barycentric coordinates (n, 3) of a foot in it."""
        found = self._search.nearest(points)
        cell, shares = found.cell, found.shares
        for _ in range(3):
            at, first, second = self.frames(cell, shares)
            off = points - at
            g11, g12, g22 = dots(first, first), dots(first, second), dots(second, second)
            r1, r2 = dots(off, first), dots(off, second)
            determinant = np.maximum(g11 * g22 - g12**2, np.finfo(float).tiny)
            b = shares[:, 1] + (g22 * r1 - g12 * r2) / determinant
            c = shares[:, 2] + (g11 * r2 - g12 * r1) / determinant
            shares = np.maximum(np.stack([1 - b - c, b, c], axis=1), 0.0)
            shares /= shares.sum(axis=1, keepdims=True)
        return cell, shares

    def nearest(self, points: Floats) -> Floats:
        """Return the feet (n, 3) of ``points`` (n, 3) on the surface; approximately the closest points."""
        return self.frames(*self.feet(points))[0]

    def normals(self, cell: Ints, shares: Floats) -> Floats:
        """Return unit normals (n, 3), oriented alike all over the surface."""
        _, first, second = self.frames(cell, shares)
        return np.asarray(unit(np.cross(first, second)) * self.mesh.winding[cell, None])

    def side(self, points: Floats, reach: float) -> tuple[Floats, Floats]:
        """Return the signed heights (n,) of ``points`` (n, 3) above the surface, and distances (n,) from its normals.

        Both are infinite for points farther than ``reach`` from the surface, though some such points may have values.
        """
        height, beyond = np.full((2, len(points)), np.inf)
        rows = np.flatnonzero(self.is_near(points, reach))
        if len(rows):
            cell, shares = self.feet(points[rows])
            off, normals = points[rows] - self.frames(cell, shares)[0], self.normals(cell, shares)
            height[rows] = dots(off, normals)
            beyond[rows] = norms(off - height[rows, None] * normals)
        return height, beyond

    def is_near(self, points: Floats, reach: float) -> Bools:
        """Return which of ``points`` (n, 3) may be within ``reach`` of the surface."""
        limit = reach + float(self.mesh.edge_lengths.max())
        return np.asarray(np.isfinite(self._tree.query(points, distance_upper_bound=limit)[0]))

    @cached_property
    def _tree(self) -> Any:
        """The k-d tree of the vertices."""
        from scipy.spatial import KDTree

        return KDTree(self.mesh.vertices)


def arc_points(mesh: Mesh, edges: Ints, shares: Floats) -> Floats:
    """Return the points (n, 3) at ``shares`` (n,) of quadratic ``edges`` (n,)."""
    return points_of_arcs(arc_nodes(mesh, edges), shares)


def arc_nodes(mesh: Mesh, edges: Ints) -> Floats:
    """Return the first end, the midpoint and the last end of quadratic ``edges`` (n,), as (n, 3, 3)."""
    return np.insert(mesh.vertices[mesh.edges.ends[edges]], 1, edge_midpoints(mesh)[edges], axis=1)


def points_of_arcs(nodes: Floats, shares: Floats) -> Floats:
    """Return the points (n, 3) at ``shares`` (n,) of arcs with these ``nodes`` (n, 3, 3)."""
    t = shares
    values = np.stack([(1 - t) * (1 - 2 * t), 4 * t * (1 - t), t * (2 * t - 1)], axis=1)
    return np.asarray(np.einsum("nk,nkd->nd", values, nodes))


def edge_midpoints(mesh: Mesh) -> Floats:
    """Return the midpoint (e, 3) of each edge of quadratic triangles."""
    midpoints = np.empty((len(mesh.edges.ends), mesh.dim))
    midpoints[mesh.edges.of_cells] = mesh.midpoints
    return midpoints


def with_edge_midpoints(mesh: Mesh, midpoints: Floats) -> Mesh:
    """Return the triangles with these ``midpoints`` (e, 3) of their edges."""
    return mesh.with_same_cells(midpoints=midpoints[mesh.edges.of_cells])


def quartered(mesh: Mesh) -> Mesh:
    """Return the flat triangles (4 m) between the corners and midpoints of m quadratic triangles.

    Rows i, m + i and 2 m + i are the parts of triangle i at its corners, and row 3 m + i is its central part.
    """
    count, edges = len(mesh.vertices), mesh.edges
    a, b, c = mesh.cells.T
    p, q, r = (count + edges.of_cells).T
    quarters = [(a, r, q), (b, p, r), (c, q, p), (p, q, r)]
    cells = np.concatenate([np.stack(corners, axis=1) for corners in quarters])
    return Mesh.of(np.concatenate([mesh.vertices, edge_midpoints(mesh)]), cells)


def extremes_at_edges(mesh: Mesh, values: Ints) -> tuple[Ints, Ints]:
    """Return the least and the largest (e,) of the ``values`` (m,) of the triangles at each edge."""
    numbers = mesh.edges.of_cells.ravel()
    order, starts = np.argsort(numbers, kind="stable"), np.cumsum(np.bincount(numbers, minlength=len(mesh.edges.ends)))
    of_edges, first = np.repeat(values, 3)[order], np.concatenate([[0], starts[:-1]])
    return np.minimum.reduceat(of_edges, first), np.maximum.reduceat(of_edges, first)


def split_edges(mesh: Mesh, ends: Ints, shares: Floats) -> tuple[Mesh, Ints]:
    """Return quadratic triangles with edges split, and the original triangle (m,) that contains each triangle.

    ``ends`` (k, 2) are distinct edges, which are split at ``shares`` (k,) from their first ends. The new vertices
    follow the old vertices, in the order of the edges.
    """
    parent, first = np.arange(len(mesh.cells)), len(mesh.vertices)
    # of two edges of a triangle, that split nearer to an end comes first: then parts are less thin
    waiting = np.argsort(np.minimum(shares, 1 - shares), kind="stable")
    vertices = np.concatenate([mesh.vertices, np.zeros((len(ends), mesh.dim))])
    while len(waiting):
        edge = edge_numbers(mesh, ends[waiting])
        rank = np.full(len(mesh.edges.ends), len(ends))
        rank[edge] = np.arange(len(waiting))
        least = rank[mesh.edges.of_cells].min(axis=1)
        blocked = np.zeros(len(mesh.edges.ends), dtype=bool)
        cell, corner = np.nonzero(rank[mesh.edges.of_cells] < len(ends))
        late = rank[mesh.edges.of_cells[cell, corner]] > least[cell]
        blocked[mesh.edges.of_cells[cell[late], corner[late]]] = True
        now = ~blocked[edge]
        rows, edge = waiting[now], edge[now]
        is_turned = mesh.edges.ends[edge, 0] != ends[rows, 0]
        share = np.where(is_turned, 1 - shares[rows], shares[rows])
        vertices[first + rows] = arc_points(mesh, edge, share)
        mesh, parts = _split(mesh, vertices, edge, share, first + rows)
        parent, waiting = parent[parts], waiting[~now]
    return mesh, parent


def split_cells(mesh: Mesh, cells: Ints, shares: Floats) -> tuple[Mesh, Ints]:
    """Return quadratic triangles with distinct ``cells`` (k,) split in three, and the parent (m,) of each triangle.

    The new vertices follow the old ones; they lie at barycentric ``shares`` (k, 3) of the cells.
    """
    surface, corners = QuadraticSurface(mesh), mesh.cells[cells]
    new = len(mesh.vertices) + np.arange(len(cells))
    kept = np.ones(len(mesh.cells), dtype=bool)
    kept[cells] = False
    assert mesh.midpoints is not None
    made, midpoints = [mesh.cells[kept]], [mesh.midpoints[kept]]
    spokes = [surface.frames(cells, 0.5 * (shares + corner))[0] for corner in np.eye(3)]  # from the new vertex
    for k in range(3):
        b, c = (k + 1) % 3, (k + 2) % 3
        made.append(np.stack([new, corners[:, b], corners[:, c]], axis=1))
        midpoints.append(np.stack([mesh.midpoints[cells, k], spokes[c], spokes[b]], axis=1))
    vertices = np.concatenate([mesh.vertices, surface.frames(cells, shares)[0]])
    split = Mesh.of(vertices, np.concatenate(made), np.concatenate(midpoints))
    parent = np.concatenate([np.flatnonzero(kept), np.tile(cells, 3)])
    return replace(split, cut=mesh.cut, owner=mesh.owner, beyond_tip=mesh.beyond_tip), parent


def _split(mesh: Mesh, vertices: Floats, edges: Ints, shares: Floats, new: Ints) -> tuple[Mesh, Ints]:
    """Return the mesh with ``edges`` (k,), no two of one triangle, split at vertices ``new`` (k,), and parents (m,)."""
    row = np.full(len(mesh.edges.ends), -1)
    row[edges] = np.arange(len(edges))
    cell, corner = np.nonzero(row[mesh.edges.of_cells] >= 0)
    at = row[mesh.edges.of_cells[cell, corner]]
    c, a, b = (mesh.cells[cell, (corner + k) % 3] for k in range(3))
    t = np.where(mesh.edges.ends[edges[at], 0] == a, shares[at], 1 - shares[at])
    halves = [
        arc_points(mesh, edges[at], np.where(mesh.edges.ends[edges[at], 0] == a, s, 1 - s))
        for s in (t / 2, (1 + t) / 2)
    ]
    across = np.zeros((len(cell), 3))
    rows = np.arange(len(cell))
    across[rows, corner], across[rows, (corner + 1) % 3], across[rows, (corner + 2) % 3] = 0.5, 0.5 * (1 - t), 0.5 * t
    middle = QuadraticSurface(mesh).frames(cell, across)[0]
    assert mesh.midpoints is not None
    of_a, of_b = (mesh.midpoints[cell, (corner + k) % 3] for k in (1, 2))  # of the edges opposite to a and b
    kept = np.ones(len(mesh.cells), dtype=bool)
    kept[cell] = False
    m = new[at]
    cells = np.concatenate([mesh.cells[kept], np.stack([c, a, m], axis=1), np.stack([c, m, b], axis=1)])
    midpoints = np.concatenate(
        [mesh.midpoints[kept], np.stack([halves[0], middle, of_b], axis=1), np.stack([halves[1], of_a, middle], axis=1)]
    )
    parent = np.concatenate([np.flatnonzero(kept), cell, cell])
    cut, owner = mesh.cut, mesh.owner
    on = row[mesh.cut_edges] >= 0 if len(cut) else np.zeros(0, dtype=bool)
    if on.any():
        at = new[row[mesh.cut_edges[on]]]
        halves_of_cut = [np.stack([cut[on, 0], at], axis=1), np.stack([at, cut[on, 1]], axis=1)]
        cut = np.concatenate([cut[~on], *halves_of_cut])
        owner = np.concatenate([owner[~on], owner[on], owner[on]])
    return Mesh(vertices, cells, midpoints, cut, owner, np.zeros(len(owner), dtype=bool)), parent


def edge_numbers(mesh: Mesh, ends: Ints) -> Ints:
    """Return the numbers (k,) of the edges with these ``ends`` (k, 2), -1 for edges that no triangle has."""
    none = np.zeros(len(ends), dtype=np.int64)
    return replace(mesh, cut=ends, owner=none, beyond_tip=none.astype(bool)).cut_edges
