"""Which way the cells of a mesh are wound: found by walking over the facets that two of them share."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.mesh.edges import Edges, edges_of
from cpmkit.mesh.mesh import SampleMesh


def winding_of(mesh: SampleMesh, edges: Edges | None = None) -> Any:
    """Return (m,) int8: 1 or -1 for each cell, by which neighbours are wound alike, and 0 beside where they are not.

    The ``edges`` of triangles are found if they are not given.
    """
    from cpmkit.mesh.winding_kernels import wound_alike

    if mesh.manifold_dim == 1:
        facets, count = mesh.cells[:, ::-1], len(mesh.vertices)
    else:
        edges = edges_of(mesh) if edges is None else edges
        facets, count = edges.of_cells, len(edges.ends)
    return wound_alike(np.ascontiguousarray(mesh.cells), np.ascontiguousarray(facets, dtype=np.int64), count)
