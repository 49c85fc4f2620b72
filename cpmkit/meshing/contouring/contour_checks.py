"""Checks of a triangulation against the closest points it was made from, and repair of creases that it cuts off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vector_algebra import nearest_barycentric, norms
from cpmkit.meshing.contour_edges import components_with_areas, edge_table, halve_edges, open_edges
from cpmkit.meshing.contouring.contour_nodes import LatticeNodes
from cpmkit.meshing.contouring.contour_repair import crowded_edges
from cpmkit.meshing.contouring.contour_rims import RimTest
from cpmkit.types import Bools, Floats, Ints

#: The weight in ``severity`` of a component gained or lost, of a wrong area and of a missed part of the surface; an
#: open edge has the weight 4, a fold or an uncovered point 1.
COMPONENT_WEIGHT = 40


@dataclass(frozen=True, eq=False)
class MeshDefects:
    """Places at which a triangulation does not represent the surface."""

    cracks: Floats  #: (k, 3): midpoints of open edges off rims.
    nonmanifold_edges: Floats  #: (k, 3): midpoints of edges of four triangles or more at which no two sheets cross.
    #: (k, 3): ends of branch lines (edges of three triangles or more in a row) that lie neither on another such line
    #: nor at the border.
    branch_ends: Floats
    folds: Floats  #: (k, 3): centres of triangles that fold over beside a rim.
    #: (k, 3): points of creases, rims and close sheets with no triangle within .3 spacings of the lattice.
    uncovered: Floats
    component_change: int  #: Number of components gained, negative if lost, when vertices were moved onto rims.
    #: Number of components with an area below two squares of the form's spacing: another lattice may have none.
    small_components: int
    area_error: float  #: The relative excess of the area over that computed from the nodes.

    @property
    def wrong_area(self) -> bool:
        """Whether the area differs from that computed from the nodes by more than the uncertainty of both."""
        return abs(self.area_error) > 0.15

    @property
    def severity(self) -> int:
        """A weighted count of the defects: zero where there is none."""
        topological = len(self.cracks) + len(self.nonmanifold_edges) + len(self.branch_ends) + self.small_components
        global_ones = abs(self.component_change) + self.wrong_area
        return len(self.folds) + len(self.uncovered) + 4 * topological + COMPONENT_WEIGHT * global_ones


def find_defects(
    rims: RimTest,
    nodes: LatticeNodes,
    vertices: Floats,
    cells: Ints,
    on_rim: Bools,
    folds: Floats,
    components_before: int,
    spacing: float,
) -> MeshDefects:
    """Return the defects of a triangulation made from lattice nodes.

    ``rims``: the test for rims. ``nodes``: the nodes that the triangulation was made from.
    ``vertices``, ``cells`` (v, 3) float64, (m, 3) int64. ``on_rim`` (v,): which vertices lie on rims.
    ``folds`` (k, 3): centres of triangles that fold over.
    ``components_before``: the number of components before vertices were moved onto rims.
    ``spacing``: spacing of the form's lattice.
    """
    edges = edge_table(cells)
    border = open_edges(vertices, cells, edges)
    off_rim = np.flatnonzero(~on_rim[border.ends].all(axis=1))
    off_rim = off_rim[~rims.of_edges(vertices, border.take(off_rim))]
    crowded = crowded_edges(rims.source, vertices, cells, edges)
    degree = np.bincount(edges.ends[edges.count > 2].ravel(), minlength=len(vertices))
    lone = (edges.count > 2) & (degree[edges.ends] == 1).all(axis=1)
    degree[edges.ends[edges.count == 1]] = 0  # a branch line may end at the border
    degree[edges.ends[lone]] = 1  # a single edge is no branch line: both ends are defects
    areas = components_with_areas(vertices, cells, cells)[1]
    creases = nodes.closest[nodes.near_creases]
    # The area from the nodes is a sum of a raised cosine of their distance, a smoothed delta function that is zero from
    # one spacing on. Kublik and Tsai, Integration over curves and surfaces defined by the closest point mapping (2016).
    distances = nodes.distance[(nodes.distance < nodes.spacing) & ~nodes.on_rim] / nodes.spacing
    area_from_nodes = (1 + np.cos(np.pi * distances)).sum() * 0.5 * nodes.spacing**2
    return MeshDefects(
        border.midpoints[off_rim],
        vertices[edges.ends[crowded]].mean(axis=1),
        vertices[degree == 1],
        folds,
        creases[_nearest_edges(creases, vertices, cells)[0] > 0.3 * nodes.spacing],
        len(areas) - components_before,
        int((areas < 2.0 * spacing**2).sum()),
        float(areas.sum() / area_from_nodes - 1),
    )


def restore_creases(nodes: LatticeNodes, vertices: Floats, cells: Ints, on_rim: Bools) -> tuple[Floats, Ints, Bools]:
    """Return vertices (v, 3), triangles (m, 3) and a mask (v,) of rim vertices; edges that cut off creases are halved.

    An edge is halved at the crease point farthest from it, if that is farther than .1 lattice spacings and projects to
    the inner 70 % of the edge. Open edges are halved at points on rims alone. New vertices follow those given.
    """
    creases, creases_on_rim = nodes.closest[nodes.near_creases], nodes.on_rim[nodes.near_creases]
    for _ in range(3):  # each round treats the result of the round before
        distance, slot, share = _nearest_edges(creases, vertices, cells)
        edges = edge_table(cells)
        rows = np.flatnonzero((distance > 0.1 * nodes.spacing) & (share > 0.15) & (share < 0.85))
        edge = edges.of_cells.ravel()[slot[rows]]
        wanted = (edges.count[edge] > 1) | creases_on_rim[rows]
        order = np.argsort(-distance[rows[wanted]])
        rows, edge = _at_most_one_per_triangle(rows[wanted][order], edge[wanted][order], edges.of_cells)
        if not len(rows):
            break
        midpoint = np.full(int(edges.of_cells.max()) + 1, -1)
        midpoint[edge] = len(vertices) + np.arange(len(edge))
        cell, corner = np.nonzero(midpoint[edges.of_cells] >= 0)
        vertices = np.concatenate([vertices, creases[rows]])
        cells = halve_edges(cells, 3 * cell + corner, midpoint[edges.of_cells[cell, corner]])
        on_rim = np.append(on_rim, creases_on_rim[rows] & (edges.count[edge] == 1))
    return vertices, cells, on_rim


def _at_most_one_per_triangle(rows: Ints, edge: Ints, of_cells: Ints) -> tuple[Ints, Ints]:
    """Return the entries of ``rows`` (k,) and ``edge`` (k,) that are left if each triangle keeps its first edge only.

    ``edge`` are numbers of edges, preferred edges first; of equal numbers the first counts. ``of_cells`` (m, 3) are the
    edges of all triangles.
    """
    rank = np.full(int(of_cells.max(initial=-1)) + 1, len(edge))
    np.minimum.at(rank, edge, np.arange(len(edge)))
    first = rank[of_cells].min(axis=1)
    excluded = np.zeros(len(rank), dtype=bool)
    excluded[of_cells[rank[of_cells] > first[:, None]]] = True
    chosen = np.flatnonzero((rank[edge] == np.arange(len(edge))) & ~excluded[edge])
    return rows[chosen], edge[chosen]


def _nearest_edges(points: Floats, vertices: Floats, cells: Ints) -> tuple[Floats, Ints, Floats]:
    """Return the distance (n,) of each of ``points`` (n, 3) from the triangles, a slot (n,) and a share (n,).

    The slot is that of the nearest edge of the nearest triangle (:meth:`EdgeTable.slots_of`); the share is where on the
    edge, from its first end (:func:`edge_ends`), the nearest point lies. Only the twelve triangles with the nearest
    centres are tested.
    """
    from scipy.spatial import KDTree

    count = min(12, len(cells))
    cell = KDTree(vertices[cells].mean(axis=1)).query(points, k=count)[1].reshape(-1)
    x = np.repeat(points, count, axis=0)
    shares = nearest_barycentric(x, vertices[cells[cell]])
    distance = norms(x - np.einsum("nk,nkd->nd", shares, vertices[cells[cell]])).reshape(len(points), count)
    rows = np.arange(len(points))
    nearest = count * rows + distance.argmin(axis=1)
    corner = shares[nearest].argmin(axis=1)
    tail, head = (shares[nearest, (corner + k) % 3] for k in (1, 2))
    return distance.min(axis=1), 3 * cell[nearest] + corner, head / np.maximum(tail + head, np.finfo(float).tiny)
