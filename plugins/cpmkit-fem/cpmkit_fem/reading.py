"""Reading functions of elements at places inside cells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Floats, Ints
from cpmkit_fem.cell_mesh import CellMesh
from cpmkit_fem.elements import shape_at

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def reading_matrix(mesh: CellMesh, cell: Ints, local: Floats) -> csr_array:
    """Return the matrix (k, n) that reads u in a cell (k,) each, at barycentric coordinates (k, c) of its corners."""
    from scipy.sparse import csr_array

    values = local if mesh.degree == 1 else shape_at(mesh.manifold_dim, mesh.degree, local[:, 1:].T).values.T
    starts = values.shape[1] * np.arange(len(cell) + 1)
    return csr_array((values.ravel(), mesh.cells[cell].ravel(), starts), shape=(len(cell), len(mesh.nodes)))
