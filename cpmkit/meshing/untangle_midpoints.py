"""Midpoints of thin triangles beside a boundary that bends: they go along with the boundary's, or that stays straight.

A vertex may lie nearer to the chord of a boundary than the boundary does. Its edges then have to bend as the boundary
does, or the triangle between turns over; were the boundary left on its chord, samples would lie on its wrong side, and
be given data of the other one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.mesh import Edges, Mesh
from cpmkit.meshing.untangle_vertices import is_folded
from cpmkit.protocols import Bools, Floats, Ints

#: Step of differences that tell a normal, where the manifold has none of its own, over the longest edge.
NORMAL_EDGE_SHARE = 0.1
#: Edges that are put back turn other triangles over; so often it is looked again.
ROUNDS = 4


def untangle_midpoints(
    mesh: Mesh,
    edges: Edges,
    number: Ints,
    found: Floats,
    free: Floats,
    source: LocalSource,
    put: Callable[[Floats], Floats],
) -> Floats:
    """Return the midpoints ``found`` (e, d) of edges, changed where triangles beside boundaries would turn over.

    Parameters
    ----------
    mesh : SampleMesh
        Triangles.
    edges : Edges
        Of it.
    number : (c,) int64
        Among them, those on boundaries.
    found, free : (e, d) float64
        Midpoints on the manifold, the rim and boundaries, and where they would be but for these.
    source : LocalSource
        The manifold.
    put : callable
        Puts points (k, d) beside the free midpoints on it.
    """
    folded = _folded(mesh, edges, found, source)
    if not len(folded):
        return found
    on_boundary = np.zeros(len(found), dtype=bool)
    on_boundary[number] = True
    carried = _carried(mesh, edges, on_boundary, folded, found, free, put)
    for _ in range(ROUNDS):
        left = edges.of_cells[_folded(mesh, edges, carried, source)].ravel()
        if not len(left):
            break
        rows = np.unique(left[on_boundary[left]])
        others = np.unique(left[~on_boundary[left]])
        carried[others] = found[others]
        carried[rows] = put(free[rows])
    return carried


def _folded(mesh: Mesh, edges: Edges, midpoints: Floats, source: LocalSource) -> Ints:
    """Return the triangles (k,) that turn over, seen along the manifold's normal.

    The plane of one that is thinner than its edges bend with the manifold says nothing, and is only looked at first.
    """
    corners = mesh.vertices[mesh.cells]
    rows = np.flatnonzero(is_folded(corners, midpoints[edges.of_cells]))
    if not len(rows):
        return rows
    x, middles = corners[rows], midpoints[edges.of_cells[rows]]
    step = NORMAL_EDGE_SHARE * float(norms(x - np.roll(x, 1, axis=1)).max())
    normal = unit_normals(source, source.closest_point(x.mean(axis=1)), step)[:, None]
    x, middles = (one - dots(one, normal)[..., None] * normal for one in (x, middles))
    return rows[is_folded(x, middles)]


def _carried(
    mesh: Mesh,
    edges: Edges,
    on_boundary: Bools,
    folded: Ints,
    found: Floats,
    free: Floats,
    put: Callable[[Floats], Floats],
) -> Floats:
    """Return the midpoints with those of ``folded`` triangles (k,) moved as the boundary is next to them."""
    own = edges.of_cells[folded]
    own = own[on_boundary[own].sum(axis=1) == 1]
    moved = found.copy()
    if not len(own):
        return moved
    line = own[on_boundary[own]]
    start, end = (mesh.vertices[edges.ends[line, k]] for k in range(2))
    chord, way = end - start, found[line] - free[line]
    for rows in own[~on_boundary[own]].reshape(-1, 2).T:
        along = dots(free[rows] - start, chord) / dots(chord, chord)
        gap = norms(free[rows] - start - along[:, None] * chord) / norms(chord)
        share = np.maximum(4 * along * (1 - along), 0.0) * np.maximum(1 - gap, 0.0)
        moved[rows] = put(free[rows] + share[:, None] * way)
    return moved
