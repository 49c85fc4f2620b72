"""Cells that grow smaller towards tips, so that sums over their samples see the root of the distance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.forms.galerkin.conditions.crossings import ends_inside
from cpmkit.mesh.edges import edges_of
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.mesh.subdivision import halved
from cpmkit.protocols import Bools, Floats, Ints

#: Edges are no longer than this share of their distance from a tip,
LONGEST_EDGE_SHARE = 0.5
#: but may be as long as this many spacings: what lies in one such edge is 1/1000 of the energy within a spacing.
LEAST_EDGE_SPACINGS = 1e-3


def graded_towards_ends(mesh: SampleMesh, spacing: float) -> SampleMesh:
    """Return flat triangles with their edges halved that are longer than half their distance from a boundary's end.

    Parameters
    ----------
    mesh : SampleMesh
        Of flat triangles.
    spacing : float
        h of the lattice.
    """
    tips = np.concatenate([np.zeros(0, dtype=np.int64), *(ends_inside(mesh, k) for k in np.unique(mesh.owner))])
    if not len(tips):
        return mesh
    centres, done = mesh.vertices[tips], []
    while True:
        edges = edges_of(mesh)
        long = _long(mesh.vertices, edges.ends, edges.lengths(mesh.vertices), centres, spacing)
        open_cells = long[edges.of_cells].any(axis=1)
        done.append(mesh.cells[~open_cells])
        if not open_cells.any():
            return replace(mesh, cells=np.concatenate(done))
        mesh = replace(mesh, cells=mesh.cells[open_cells])
        edges = edges_of(mesh)
        long = _long(mesh.vertices, edges.ends, edges.lengths(mesh.vertices), centres, spacing)
        middle = np.full(len(edges.ends), -1)
        middle[long] = len(mesh.vertices) + np.arange(long.sum())
        mesh = halved(mesh, edges, middle, mesh.vertices[edges.ends[long]].mean(axis=1))


def _long(vertices: Floats, ends: Ints, lengths: Floats, centres: Floats, spacing: float) -> Bools:
    from scipy.spatial import cKDTree

    distance = cKDTree(centres).query(vertices[ends.ravel()])[0].reshape(-1, 2).min(axis=1)
    return np.asarray(lengths > np.maximum(LONGEST_EDGE_SHARE * distance, LEAST_EDGE_SPACINGS * spacing))
