"""Quadratic triangles and segments: cells with a node in the middle of each edge, and quadrature on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.source import ClosestPointSource
from cpmkit.manifold.vector_algebra import unit
from cpmkit.mesh.mixed_cells import number_edges
from cpmkit.types import Floats, Ints

#: The rule of degree 4 with 6 points (Dunavant 1985): a of its barycentric points (a, a, 1 - 2 a), and their weights.
TRIANGLE_RULE = ((0.445948490915964886, 0.223381589678011466), (0.091576213509770743, 0.109951743655321867))
#: The rim is searched for beyond the middle of an edge on the rim, by this share of the edge's length outwards.
OUTWARD_EDGE_SHARE = 0.5
#: A midpoint whose closest point is farther away than this share of its edge's length stays on the chord.
MOVED_MIDDLE_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class QuadraticCells:
    """Cells of one dimension, each with its corners first and the middles of its edges after them.

    Attributes
    ----------
    nodes : (n, d) float64
        Positions of corners and middles.
    cells : (m, 6), (m, 3) or (m, 1) int64
        Nodes of each triangle, segment or point.
    """

    nodes: Floats
    cells: Ints

    def rule(self) -> tuple[Floats, Floats, Floats]:
        """Return quadrature points (m, q, d), weights (m, q) times the area element, and shape functions (q, k)."""
        shares, slopes, weights = SHAPE_FUNCTIONS_BY_NODES[self.cells.shape[1]]()
        corners = self.nodes[self.cells]
        points = np.einsum("qk,mkd->mqd", shares, corners)
        tangents = np.einsum("qka,mkd->mqad", slopes, corners)
        gram = np.einsum("mqad,mqbd->mqab", tangents, tangents)
        determinant = np.linalg.det(gram) if gram.shape[-1] else np.ones(gram.shape[:2])
        return points, weights * np.sqrt(np.maximum(determinant, 0.0)), shares


def _triangle_shape_functions() -> tuple[Floats, Floats, Floats]:
    """Return the shape functions (6, 6), their derivatives (6, 6, 2) and the weights (6,) of the triangle rule.

    Rows are quadrature points; derivatives are with respect to the first two barycentric coordinates.
    """
    points, weights = [], []
    for a, weight in TRIANGLE_RULE:
        points += [(a, a, 1 - 2 * a), (a, 1 - 2 * a, a), (1 - 2 * a, a, a)]
        weights += [0.5 * weight] * 3
    bary = np.array(points)
    following = np.roll(bary, -1, axis=1)
    shares = np.hstack([bary * (2 * bary - 1), 4 * bary * following])
    # Derivatives along (l0, l1), with l2 = 1 - l0 - l1.
    along = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]])
    corner = (4 * bary - 1)[:, :, None] * along
    middle = 4 * (following[:, :, None] * along + bary[:, :, None] * np.roll(along, -1, axis=0))
    return shares, np.concatenate([corner, middle], axis=1), np.array(weights)


def _segment_shape_functions() -> tuple[Floats, Floats, Floats]:
    """Return the shape functions (3, 3), derivatives (3, 3, 1) and weights (3,) at the three Gauss points of [0, 1]."""
    gauss, weights = np.polynomial.legendre.leggauss(3)
    t = 0.5 * (gauss + 1)
    shares = np.stack([(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)], axis=1)
    slopes = np.stack([4 * t - 3, 4 * t - 1, 4 - 8 * t], axis=1)[:, :, None]
    return shares, slopes, 0.5 * weights


SHAPE_FUNCTIONS_BY_NODES: dict[int, Callable[[], tuple[Floats, Floats, Floats]]] = {
    6: _triangle_shape_functions,
    3: _segment_shape_functions,
    1: lambda: (np.ones((1, 1)), np.zeros((1, 1, 0)), np.ones(1)),
}


@dataclass(frozen=True, eq=False)
class OutwardEdges:
    """The edges of cells of one dimension, with outward vectors on the rim.

    Attributes
    ----------
    ends : (e, 2) int64
        Vertices of each edge.
    of_cells : (m, c) int64
        The edges of each cell.
    outward : (e, d) float64
        At an edge of a single cell, the unit vector in the plane of the cell, perpendicular to the edge and out of the
        cell; else zero.
    """

    ends: Ints
    of_cells: Ints
    outward: Floats


def outward_edges(points: Floats, cells: Ints) -> OutwardEdges:
    """Return the edges of triangles (m, 3) or segments (m, 2) between ``points`` (v, d); cells (m, 1) have none."""
    ends, of_cells = number_edges(cells, len(points))
    outward = np.zeros((len(ends), points.shape[1]))
    if cells.shape[1] == 3:
        uses = np.bincount(of_cells.ravel(), minlength=len(ends))
        cell, corner = np.nonzero(uses[of_cells] == 1)
        a, b, c = (points[cells[cell, (corner + k) % 3]] for k in range(3))
        outward[of_cells[cell, corner]] = _outward_normals(a, b, c)
    return OutwardEdges(ends, of_cells, outward)


def _outward_normals(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return unit vectors (n, d) in the planes of a, b, c (n, d), perpendicular to the edges a b, away from c."""
    along = b - a
    length2 = np.sum(along * along, axis=1, keepdims=True)
    across = a - c
    across = across - np.sum(across * along, axis=1, keepdims=True) / np.where(length2 > 0, length2, 1.0) * along
    return unit(across)


def edge_midpoints_on(surface: ClosestPointSource, points: Floats, edges: OutwardEdges) -> Floats:
    """Return the closest points (e, d) on ``surface`` of the middles of ``edges``, on its rim for edges of one cell.

    A middle stays on the chord where the closest point is too far away for the length of the edge.
    """
    a, b = points[edges.ends[:, 0]], points[edges.ends[:, 1]]
    straight, length = 0.5 * (a + b), np.linalg.norm(b - a, axis=1)
    moved = surface.closest_point(np.ascontiguousarray(straight)).points
    single = np.flatnonzero(edges.outward.any(axis=1))
    beyond = straight[single] + OUTWARD_EDGE_SHARE * length[single, None] * edges.outward[single]
    rim = surface.closest_point(np.ascontiguousarray(beyond))
    moved = moved.copy()
    moved[single[rim.edge >= 0]] = rim.points[rim.edge >= 0]
    return limit_midpoint_shift(straight, moved, length)


def limit_midpoint_shift(straight: Floats, moved: Floats, length: Floats) -> Floats:
    """Return ``moved`` (e, d), except ``straight`` (e, d) where the shift is too large for the edge's ``length`` (e,).

    A larger shift leads to another part of the surface.
    """
    far = np.linalg.norm(moved - straight, axis=1) > MOVED_MIDDLE_SHARE * length
    return np.where(far[:, None], straight, moved)
