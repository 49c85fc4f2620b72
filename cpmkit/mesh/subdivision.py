"""Splitting cells until no edge is long."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.mesh.edges import Edges, edges_of, edges_on_cut
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.mesh.needles import split_needles
from cpmkit.mesh.segments import in_equal_parts
from cpmkit.protocols import Floats, Ints

#: An edge is long if it is longer than wanted by more than this share: more than what needles leave unparted, so that
#: the triangles on both sides of an edge agree whether a half of it is long.
SAME_LENGTH_SHARE = 1e-8


def subdivided(mesh: SampleMesh, length: float) -> SampleMesh:
    """Return the mesh with its edges halved until none is longer than ``length``; segments are cut in equal parts.

    Neighbours share the middles of their edges. Both halves of an edge on a boundary lie on it, in its direction. The
    edges that are halved are the longest of their triangles, so that angles stay what they were.

    Parameters
    ----------
    mesh : SampleMesh
        Of flat cells.
    length : float
        In the unit of the vertices.
    """
    assert mesh.midpoints is None
    if mesh.manifold_dim == 1:
        return in_equal_parts(mesh, length)
    from cpmkit.mesh import subdivision_kernels

    mesh, halves = split_needles(mesh, length)
    longest = float(length) * (1 + SAME_LENGTH_SHARE)
    short: list[Ints] = []
    while True:  # what has a long edge is split with all that share the edge; the rest is done
        long = subdivision_kernels.with_long_edges(mesh.vertices, mesh.cells, longest)
        if not short and not long.any():
            return mesh  # these very cells: what is kept of them serves again
        short.append(mesh.cells[~long])
        if not long.any():
            return replace(mesh, cells=np.concatenate(short))
        mesh = replace(mesh, cells=mesh.cells[long])
        edges = edges_of(mesh)
        middle = np.full(len(edges.ends), -1)
        long = subdivision_kernels.long_edges(mesh.vertices, edges.ends, longest)
        middle[long] = halves.of(edges.ends[long])
        new = long & (middle < 0)
        middle[new] = len(mesh.vertices) + np.arange(new.sum())
        mesh = halved(mesh, edges, middle, mesh.vertices[edges.ends[new]].mean(axis=1))


def halved(mesh: SampleMesh, edges: Edges, middle: Ints, points: Floats) -> SampleMesh:
    """Return triangles with their edges halved at the vertices ``middle`` (e,), -1 where one stays whole.

    ``points`` (k, d) are those vertices that the mesh does not have yet.
    """
    from cpmkit.mesh import subdivision_kernels

    vertices = np.concatenate([mesh.vertices, points])
    cells = subdivision_kernels.split(np.ascontiguousarray(mesh.cells), edges.of_cells, middle, vertices)
    on_cut = edges_on_cut(mesh, edges)
    return _with_halved_cut(replace(mesh, vertices=vertices, cells=cells), np.append(middle, -1)[on_cut])


def _with_halved_cut(mesh: SampleMesh, middle: Ints) -> SampleMesh:
    """Return the mesh with those edges on boundaries halved that have a vertex ``middle`` (c,), not -1."""
    times = np.where(middle >= 0, 2, 1)
    halved = np.flatnonzero(middle >= 0)
    cut = np.repeat(mesh.cut, times, axis=0)
    second = np.cumsum(times)[halved] - 1
    cut[second - 1, 1] = cut[second, 0] = middle[halved]
    return replace(mesh, cut=cut, owner=np.repeat(mesh.owner, times), extends=np.repeat(mesh.extends, times))
