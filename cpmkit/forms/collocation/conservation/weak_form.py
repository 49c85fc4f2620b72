"""The weak form of an equation on quadratic cells: what u and a test function give, integrated over the manifold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.mesh.mixed_cells import cells_of_dimension, member_dimensions, mesh_of, refine_mixed_cells
from cpmkit.mesh.quadratic_cells import RULES_BY_NODES, QuadraticCells, edge_midpoints_on, outward_edges
from cpmkit.protocols import ClosestPointSource, Floats

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: A cell whose tangents span less than the root of this share of the area that they would at right angles has none.
DEGENERATE_AREA_SHARE = 1e-20
#: Cells whose matrices are made at a time.
WEAK_FORM_CHUNK_CELLS = 1 << 14


def curved_cells_of(surface: ClosestPointSource, longest: float) -> QuadraticCells:
    """Return quadratic cells on a surface of one dimension, with edges of at most about ``longest``.

    Raises
    ------
    InputError
        If the surface has no mesh, or one that does not fill it.
    """
    points, cells = refine_mixed_cells(*mesh_of(surface)(longest), surface.dim, longest)
    corners = cells_of_dimension(cells, surface, member_dimensions(surface)[0])
    points = surface.closest_point(np.ascontiguousarray(points)).points
    edges = outward_edges(points, corners)
    nodes = np.concatenate([points, edge_midpoints_on(surface, points, edges)])
    return QuadraticCells(nodes, np.hstack([corners, len(points) + edges.of_cells]))


@dataclass(frozen=True, eq=False)
class WeakForm:
    """The matrices of ``int a grad u . grad v + c u v`` and of ``int f v``, over quadratic functions on cells.

    Attributes
    ----------
    nodes : (n, d) float64
        Corners of the cells and middles of their edges.
    form : (n, n) csr_array
        Of the left side.
    mass : (n, n) csr_array
        Of the right side.
    """

    nodes: Floats
    form: csr_array
    mass: csr_array


def weak_form(curved: QuadraticCells, diffusivity: Floats, c: Floats) -> WeakForm:
    """Return the weak form of ``-div(a grad u) + c u = f`` with a and c (n,) at the nodes.

    With tangents T of a cell at a point of the rule and G = T T', grad u . grad v = (du)' inv(G) dv, where d are
    derivatives along the cell's coordinates.
    """
    shares, slopes, weights = RULES_BY_NODES[curved.cells.shape[1]]()
    forms, masses = [], []
    for start in range(0, len(curved.cells), WEAK_FORM_CHUNK_CELLS):
        cells = curved.cells[start : start + WEAK_FORM_CHUNK_CELLS]
        tangents = np.einsum("qka,mkd->mqad", slopes, curved.nodes[cells])
        determinant, inverse = _inverse(np.einsum("mqad,mqbd->mqab", tangents, tangents))
        measure = weights * np.sqrt(determinant)
        rises = np.einsum("mqab,qkb->mqka", inverse, slopes)
        a, c_here = diffusivity[cells] @ shares.T, c[cells] @ shares.T
        stiff = np.einsum("mq,mqia,qja->mij", measure * a, rises, slopes, optimize=True)
        forms.append(stiff + np.einsum("mq,qi,qj->mij", measure * c_here, shares, shares, optimize=True))
        masses.append(np.einsum("mq,qi,qj->mij", measure, shares, shares, optimize=True))
    return WeakForm(curved.nodes, _assembled(curved, forms), _assembled(curved, masses))


def _inverse(gram: Floats) -> tuple[Floats, Floats]:
    """Return the determinants (m, q) of symmetric matrices (m, q, a, a), a of 1 or 2, and their inverses.

    Both are zero where the determinant is rounding: the cell has no area.
    """
    cofactors = np.ones_like(gram)
    if gram.shape[-1] == 2:
        cofactors[..., 0, 0], cofactors[..., 1, 1] = gram[..., 1, 1], gram[..., 0, 0]
        cofactors[..., 0, 1] = cofactors[..., 1, 0] = -gram[..., 0, 1]
    determinant = np.einsum("mqb,mqb->mq", gram[..., 0, :], cofactors[..., 0, :])
    largest = np.prod(np.diagonal(gram, axis1=2, axis2=3), axis=2)
    determinant = np.where(determinant > DEGENERATE_AREA_SHARE * largest, determinant, 0.0)
    return determinant, cofactors / np.where(determinant > 0, determinant, np.inf)[..., None, None]


def _assembled(curved: QuadraticCells, blocks: list[Floats]) -> csr_array:
    """Return the sum of the cells' matrices (m, k, k)."""
    from scipy.sparse import coo_array

    corners, size = curved.cells.shape[1], len(curved.nodes)
    rows, columns = np.repeat(curved.cells, corners, axis=1).ravel(), np.tile(curved.cells, (1, corners)).ravel()
    made: csr_array = coo_array((np.concatenate(blocks).ravel(), (rows, columns)), shape=(size, size)).tocsr()
    return made
