"""The matrices of finite elements: sums over points of each cell, as SciPy's sparse arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_fem.elements import NODES, Shape, basis_at_quadrature
from cpmkit_fem.surface_mapping import jacobians, measure_and_pseudoinverse

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Points are exact for products of so many functions of the element; one more where there is a coefficient.
PRODUCTS = 2


def stiffness_and_mass(
    vertices: Floats,
    faces: Ints,
    diffusivity: Floats | None = None,
    density: Floats | None = None,
    degree: int = 1,
) -> tuple[csr_array, csr_array]:
    """Return the integrals of a grad u . grad v and of c u v over a solid, a surface or a curve.

    On flat triangles, without a and c, the first is the cotangent Laplacian (Pinkall and Polthier 1993; Dziuk 1988),
    positive semi-definite, and the second the consistent mass matrix.

    Parameters
    ----------
    vertices : (v, d) float64
        d = 2 or 3.
    faces : (m, n) int64
        Tetrahedra, triangles with an area above zero, or segments; of degree 2 with their midpoints, which may lie off
        the chords.
    diffusivity, density : (v,) float64, optional
        a and c at the vertices, polynomials of the degree in between; 1 unless given.
    degree : int
        1 or 2.

    Returns
    -------
    stiffness, mass : csr_array (v, v)
    """
    dim = next(k for k in (1, 2, 3) if NODES[k, degree] == faces.shape[1])
    stiffness, mass = (
        _assemble(vertices, faces, _basis_for_products(dim, degree, a), a if a is None else a[faces], slopes)
        for a, slopes in ((diffusivity, True), (density, False))
    )
    return stiffness, mass


def weighted_mass(vertices: Floats, cells: Ints, weight: Floats, manifold_dim: int, degree: int) -> csr_array:
    """Return the integrals (v, m c) of w u v over ``cells`` (m, c), with v a function of one cell alone, cell by cell.

    ``weight`` (m, c) is w at the nodes of each cell, in the order of its element, a polynomial of ``degree`` there.
    """
    shape = _basis_for_products(manifold_dim, degree, weight)
    return _assemble(vertices, cells, shape, weight, False, np.arange(cells.size).reshape(cells.shape))


def gathered(matrix: csr_array, cells: Ints, size: int) -> csr_array:
    """Return a ``matrix`` (v, m c), with a column for each node of each of ``cells`` (m, c), as one (v, ``size``)."""
    from scipy.sparse import csr_array

    corners = np.arange(cells.size)
    made: csr_array = (matrix @ csr_array((np.ones(cells.size), (corners, cells.ravel())), (cells.size, size))).tocsr()
    return made


def lump_mass(mass: csr_array) -> csr_array:
    """Return the diagonal matrix of the row sums of a ``mass`` matrix."""
    from scipy.sparse import diags_array

    return diags_array(np.asarray(mass.sum(axis=1)).ravel()).tocsr()


def _basis_for_products(manifold_dim: int, degree: int, weight: Floats | None) -> Shape:
    """Return the basis functions at points that integrate products of two exactly, with a ``weight`` of three."""
    return basis_at_quadrature(manifold_dim, degree, degree * (PRODUCTS + (weight is not None)))


def _assemble(
    vertices: Floats, cells: Ints, shape: Shape, weight: Floats | None, slopes: bool, columns: Ints | None = None
) -> csr_array:
    """Return the integrals (v, v) over ``cells`` (m, c) of w u v, or, if ``slopes``, of w grad u . grad v.

    ``weight`` (m, c) is w at the nodes of each cell, None for 1; ``shape`` are the basis functions at the points.
    ``columns`` (m, c) are the numbers of the functions v, by default the nodes.
    """
    from scipy.sparse import csr_array

    measure, inverse = measure_and_pseudoinverse(jacobians(vertices, cells, shape))
    measure = measure * shape.weights
    if weight is not None:
        measure = measure * (weight @ shape.values)
    gradients = [np.einsum("kq,kdmq->dmq", slope, inverse) for slope in shape.slopes] if slopes else []
    blocks = []
    for i, j in _pairs(cells.shape[1]):
        product = np.sum(gradients[i] * gradients[j], axis=0) if slopes else shape.values[i] * shape.values[j]
        blocks.append((cells[:, i], (cells if columns is None else columns)[:, j], np.sum(product * measure, axis=1)))
    row, column, entries = (np.concatenate([one[k] for one in blocks]) for k in range(3))
    size = len(vertices)
    return csr_array((entries, (row, column)), shape=(size, size if columns is None else columns.size))


def _pairs(count: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(count) for j in range(count)]
