"""Reference elements: points with weights, and the functions that are 1 at one node and 0 at all others."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cpmkit.plugin import Floats, Ints

#: Corners of a cell and nodes of an element, by the dimension of the manifold and the degree.
NODES = {(0, 1): 1, (1, 1): 2, (2, 1): 3, (3, 1): 4, (0, 2): 1, (1, 2): 3, (2, 2): 6, (3, 2): 10}
#: The edges between the corners of a cell in the order of their midpoints, which follow the corners.
EDGES_OF = {
    1: np.array([[0, 1]]),
    2: np.array([[0, 1], [1, 2], [0, 2]]),
    3: np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]),
}
#: The parts of an element between its nodes, by the dimension of the manifold and the degree.
PARTS = {
    (1, 1): np.array([[0, 1]]),
    (2, 1): np.array([[0, 1, 2]]),
    (1, 2): np.array([[0, 2], [2, 1]]),
    (2, 2): np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]),
}


@dataclass(frozen=True, eq=False)
class Shape:
    """Values, derivatives and weights of the basis functions of a reference element at q points.

    Attributes
    ----------
    values : (n, q) float64
        The values of each of n functions.
    slopes : (n, k, q) float64
        Their derivatives along k axes.
    weights : (q,) float64
        Quadrature weights, which add up to the element's measure; 1 for points that are no quadrature rule.
    """

    values: Floats
    slopes: Floats
    weights: Floats


@lru_cache(maxsize=16)
def basis_at_quadrature(manifold_dim: int, degree: int, order: int) -> Shape:
    """Return the basis functions at quadrature points that are exact for polynomials up to ``order``.

    ``degree`` is that of the functions, 1 or 2. The record is cached: do not change its arrays.
    """
    from skfem.quadrature import get_quadrature

    if manifold_dim == 0:
        return Shape(np.ones((1, 1)), np.zeros((1, 0, 1)), np.ones(1))
    points, weights = get_quadrature(_element(manifold_dim, degree).refdom, order)
    return shape_at(manifold_dim, degree, points, weights)


def shape_at(manifold_dim: int, degree: int, points: Floats, weights: Floats | None = None) -> Shape:
    """Return the basis functions at ``points`` (k, q) of the reference element; ``weights`` (q,) are 1 by default.

    Coordinates go from 0 to 1 and are barycentric ones of corners 1 to k. The functions are ordered as nodes: corners,
    then midpoints in the order of :data:`EDGES_OF`.
    """
    found = [_element(manifold_dim, degree).lbasis(points, i) for i in range(NODES[manifold_dim, degree])]
    count = points.shape[1]
    values = np.stack([np.broadcast_to(phi, (count,)) for phi, _ in found])
    slopes = np.stack([np.broadcast_to(slope, (manifold_dim, count)) for _, slope in found])
    return Shape(values, slopes, np.ones(count) if weights is None else weights)


def _element(manifold_dim: int, degree: int):  # type: ignore[no-untyped-def]  # scikit-fem has no types
    """Return scikit-fem's Lagrange element of ``degree`` 1 or 2 on a reference segment, triangle or tetrahedron."""
    import skfem

    return getattr(skfem, f"Element{('Line', 'Tri', 'Tet')[manifold_dim - 1]}P{degree}")()


def split_into_linear_cells(cells: Ints, manifold_dim: int, degree: int) -> Ints:
    """Return linear cells (p, k) between nodes of ``cells`` (m, n), those of one cell after those of another.

    Of degree 2 a triangle has four, with its orientation, and a segment two. Cells are no tetrahedra.
    """
    return np.ascontiguousarray(cells[:, PARTS[manifold_dim, degree]].reshape(-1, manifold_dim + 1))
