"""Reading functions of elements at places inside cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.elements import shape_at
from cpmkit_fem.surface_mapping import measure_and_pseudoinverse

#: Steps of Gauss and Newton from the place on a flat cell to that on the curved one, and how far they may lead.
STEPS, FARTHEST = 3, 0.3

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def locate_on_curved_cells(mesh: CellMesh, cell: Ints, local: Floats, points: Floats) -> Floats:
    """Return the barycentric coordinates (k, c) of the places on curved cells nearest to ``points`` (k, d) near them.

    ``cell`` (k,) are the cells; :data:`STEPS` steps of Gauss and Newton start from ``local`` (k, c) on the flat cells,
    which is returned where they change a coordinate by more than :data:`FARTHEST`. They may end a little outside of the
    cell, at a negative coordinate.
    """
    start = local[:, 1:].T
    found, nodes = start, mesh.nodes[mesh.cells[cell]]
    for _ in range(STEPS):
        shape = shape_at(mesh.manifold_dim, mesh.degree, found)
        missed = points - np.einsum("nk,knd->kd", shape.values, nodes)
        jacobian = np.einsum("njk,knd->jdk", shape.slopes, nodes)
        found = found + np.einsum("jdk,kd->jk", measure_and_pseudoinverse(jacobian[..., None])[1][..., 0], missed)
    astray = ~(np.abs(found - start).max(axis=0, initial=0.0) <= FARTHEST)
    found = np.where(astray, start, found)
    return np.concatenate([1 - found.sum(axis=0, keepdims=True), found]).T


def reading_matrix(mesh: CellMesh, cell: Ints, local: Floats) -> csr_array:
    """Return the matrix (k, n) that evaluates u in ``cell`` (k,) at barycentric coordinates ``local`` (k, c)."""
    from scipy.sparse import csr_array

    values = local if mesh.degree == 1 else shape_at(mesh.manifold_dim, mesh.degree, local[:, 1:].T).values.T
    starts = values.shape[1] * np.arange(len(cell) + 1)
    return csr_array((values.ravel(), mesh.cells[cell].ravel(), starts), shape=(len(cell), len(mesh.nodes)))
