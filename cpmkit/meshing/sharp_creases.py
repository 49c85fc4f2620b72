"""Nodes of a contoured mesh at creases, moved onto the creases of the manifold that closest points define.

Closest points of nodes beside a crease lie on one of its faces, up to a hundredth of a spacing from the crease: an
error of first order. Here each node moves to the common point of planes that touch the faces nearby.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.adjacency import rim_of_vertices
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.creases import CREASE_DEGREES, inward_directions, turning_facets
from cpmkit.meshing.untangling import flip_third_edges
from cpmkit.types import Bools, Floats, Ints

#: Planes touch the faces at these shares of an edge's length from the node, one after the other: the error of a plane
#: on a curved face is proportional to the square.
PLANE_SHARES = (0.25, 0.03, 0.004)
#: Normals are taken at this share of that distance above a face, and from no closer than so many times the noise.
HEIGHT_SHARE, NOISE_FACTOR = 0.1, 30.0
#: Planes whose normals, of length one, have a smaller share of the largest singular value define no further direction:
#: two planes at 11 degrees.
LEAST_SINGULAR_SHARE = 0.1
#: A node moves by at most this share of an edge, and to where the manifold is nearer than the second share.
FARTHEST_SHARE, ON_MANIFOLD_SHARE = 0.3, 1e-4
#: A triangle whose height over its longest edge is a smaller share of it is a sliver.
SLIVER_SHARE = 0.1
#: Rounds of flips, since a triangle takes part in one flip a round.
FLIP_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Faces:
    """The faces of a manifold that meet near nodes, each by a triangle that touches it."""

    node: Ints  #: (f,): the number of the node.
    inward: Floats  #: (f, d): unit vectors from the node into the face.
    normals: Floats  #: (f, d): unit normals of the triangles.
    lengths: Floats  #: (f,): lengths of the edges there.


def creased_edges(mesh: Mesh) -> Bools:
    """Return whether (e,) edges off boundaries turn by over ``CREASE_DEGREES``, or have three triangles or more."""
    creased = turning_facets(mesh, CREASE_DEGREES)
    creased[mesh.cut_edges] = False
    return creased


def sharpen_vertices(mesh: Mesh, source: LocalSource) -> Mesh:
    """Return the mesh with the vertices of creased edges on creases, unless they are on a rim or boundary, or far off.

    Of slivers with all corners on creases the longest edges are flipped, so that each triangle lies on one face.
    """
    fixed = np.zeros(len(mesh.vertices), dtype=bool)
    fixed[mesh.cut], fixed[rim_of_vertices(mesh).rows] = True, True
    for _ in range(FLIP_ROUNDS):
        creased = creased_edges(mesh)
        if not creased.any():
            break
        faces = _faces_at(mesh, creased)
        ends = mesh.edges.ends[faces.node]
        both = (np.concatenate([of, of]) for of in (faces.inward, faces.normals, faces.lengths))
        vertices, on_crease = points_on_creases(source, mesh.vertices, Faces(ends.T.ravel(), *both))
        mesh = mesh.with_same_cells(vertices=np.where(fixed[:, None], mesh.vertices, vertices))
        if not on_crease.any():
            break
        slivers = np.flatnonzero(on_crease[mesh.cells].all(axis=1))
        mesh = flip_third_edges(mesh, slivers, mesh.lengths_of_cells[slivers].argmax(axis=1))
    return mesh


def sharpen_midpoints(mesh: Mesh, source: LocalSource) -> Mesh:
    """Return the mesh with the midpoints of creased edges on creases."""
    assert mesh.midpoints is not None
    flat = mesh.with_same_cells(midpoints=None)
    creased = creased_edges(flat)
    if not creased.any():
        return mesh
    of_cells = mesh.edges.of_cells
    points = np.empty((len(creased), mesh.dim))
    points[of_cells] = mesh.midpoints
    points, _ = points_on_creases(source, points, _faces_at(flat, creased))
    return mesh.with_same_cells(midpoints=points[of_cells])


def _faces_at(mesh: Mesh, creased: Bools) -> Faces:
    """Return the faces at ``creased`` edges (e,) of flat triangles, which are the nodes.

    The plane of a sliver touches no face: for it stands that of the triangle across the edge, continued over the edge.
    """
    cell, facet = np.nonzero(creased[mesh.edges.of_cells])
    edge = mesh.edges.of_cells[cell, facet]
    order = np.argsort(edge, kind="stable")
    cell, facet, edge = cell[order], facet[order], edge[order]
    a, b, c = mesh.vertices[mesh.cells[cell]].transpose(1, 0, 2)
    normals, inward = np.cross(b - a, c - a), unit(inward_directions(mesh, 3 * cell + facet))
    sliver = norms(normals) < SLIVER_SHARE * mesh.lengths_of_cells[cell].max(axis=1) ** 2
    first, count = np.unique(edge, return_index=True, return_counts=True)[1:]
    pair = first[count == 2, None] + np.arange(2)
    for one, other in (pair.T, pair.T[::-1]):
        alone = sliver[one] & ~sliver[other]
        inward[one[alone]], normals[one[alone]] = -inward[other[alone]], normals[other[alone]]
        sliver[one[alone]] = False
    kept = ~sliver
    return Faces(edge[kept], inward[kept], unit(normals[kept]), mesh.edge_lengths[edge[kept]])


def points_on_creases(source: LocalSource, points: Floats, faces: Faces) -> tuple[Floats, Bools]:
    """Return ``points`` (n, d) with the nodes of ``faces`` moved onto creases, and whether (n,) each is on one.

    Other nodes, those at smooth places and those that would move far (``FARTHEST_SHARE``) stay. A node x moves by
    the shortest vector that takes it onto the planes through feet p on the faces with normals n, ``n . (x - p) = 0``,
    in the sense of least squares, for planes ever nearer to it.
    """
    nodes, node, times = np.unique(faces.node, return_inverse=True, return_counts=True)
    start, dim = points[nodes], points.shape[1]
    x, length, rank = start.copy(), np.zeros(len(nodes)), np.zeros(len(nodes), dtype=np.int64)
    np.maximum.at(length, node, faces.lengths)
    for share in PLANE_SHARES:
        step = share * faces.lengths[:, None]
        if HEIGHT_SHARE * float(step.min(initial=np.inf)) < NOISE_FACTOR * source.noise:
            break
        feet = source.closest_point(x[node] + step * faces.inward).points
        above = feet + HEIGHT_SHARE * step * faces.normals
        n = unit(above - source.closest_point(above).points)
        distance = dots(n, feet - x[node])
        products = [n[:, i] * value for i in range(dim) for value in (*n.T, distance)]
        sums = np.stack([np.bincount(node, each, len(nodes)) for each in products], axis=1)
        sums = sums.reshape(len(nodes), dim, dim + 1)
        values, vectors = np.linalg.eigh(sums[:, :, :dim])
        large = values > LEAST_SINGULAR_SHARE**2 * values[:, -1:]
        inverse = np.where(large, 1 / np.where(large, values, 1.0), 0.0)
        x += np.einsum("nij,nj,nkj,nk->ni", vectors, inverse, vectors, sums[:, :, dim])
        rank = large.sum(axis=1)
        if not (rank > 1).any():
            break
    found = np.flatnonzero((times > 1) & (rank > 1) & (norms(x - start) < FARTHEST_SHARE * length))
    found = found[source.closest_point(x[found]).distance < ON_MANIFOLD_SHARE * length[found]]
    moved, on_crease = points.copy(), np.zeros(len(points), dtype=bool)
    moved[nodes[found]], on_crease[nodes[found]] = x[found], True
    return moved, on_crease
