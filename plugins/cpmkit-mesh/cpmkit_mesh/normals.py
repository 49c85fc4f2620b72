"""Normals at the corners of triangles, as close as the mesh tells to those of the surface that it samples."""

from __future__ import annotations

import numpy as np

from cpmkit.protocols import Floats, Ints
from cpmkit_mesh.topology import Topology

#: A mean of unit normals this much shorter than the sum of its weights has no direction.
VANISHED = 1e-9
#: Directions in which the neighbours of a rim vertex spread less than this are not corrected.
SPREAD = 0.05
#: A rim normal that would be tilted by more (radians) stands at a crease and is left alone.
CREASE = 0.2


def corner_normals(vertices: Floats, faces: Ints, adjacency: Topology) -> Floats:
    """Return (m, 3, 3) unit normals at the corners of each face, averaged around each vertex.

    Where the winding of neighbours disagrees, the normals around a vertex are aligned before they
    are averaged, and each face sees the mean with the sign of its own winding. A corner whose
    mean vanishes takes the normal of its face.

    Notes
    -----
    The weights are those of Max (1999), Weights for computing vertex normals from facet normals:
    the sine of the angle at the corner over the product of the lengths of its edges. They are exact
    on meshes inscribed in a sphere, where weights by angle or by area are of first order.
    """
    corner, own = faces.ravel(), np.repeat(face_normals(vertices, faces), 3, axis=0)
    weights = _weights(vertices, faces).ravel()
    if not adjacency.consistent:
        reference = np.zeros_like(vertices)
        reference[corner[::-1]] = own[::-1]
        weights = weights * _sign(np.einsum("ij,ij->i", own, reference[corner]))
    total = np.stack([np.bincount(corner, weights * own[:, k], len(vertices)) for k in range(3)], axis=1)
    vanished = np.linalg.norm(total, axis=1) <= VANISHED * np.bincount(corner, np.abs(weights), len(vertices))
    total[vanished] = 0.0
    normals = unit(total)
    if adjacency.consistent and len(adjacency.boundary):
        normals = _with_tilted_rim(vertices, faces, adjacency, normals)
    normals = normals[corner]
    if not adjacency.consistent:
        normals = normals * _sign(np.einsum("ij,ij->i", own, normals))[:, None]
    lost = ~normals.any(axis=1)
    normals[lost] = own[lost]
    normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)
    return normals.reshape(-1, 3, 3)


def face_normals(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) unit normals by the winding of the faces; zero where a face has no area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return unit(np.cross(b - a, c - a))


def doubled_areas(vertices: Floats, faces: Ints) -> Floats:
    """Return (m,) twice the area of each face."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1)


def unit(vectors: Floats) -> Floats:
    """Return ``vectors`` (n, 3) at length one; those of length zero stay zero."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)


def _weights(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) the weight of each face at each of its corners, relative to the mesh's largest edge."""
    towards = vertices[faces[:, [1, 2, 0]]] - vertices[faces]
    towards = towards / np.abs(towards).max()
    back = -towards[:, [2, 0, 1]]
    squares = np.einsum("fck,fck->fc", towards, towards)
    return np.linalg.norm(np.cross(towards, back), axis=2) / (squares * squares[:, [2, 0, 1]])


def _with_tilted_rim(vertices: Floats, faces: Ints, adjacency: Topology, normals: Floats) -> Floats:
    """Tilt the normals of rim vertices, whose triangles lie on one side and lean them to the inside.

    On a smooth surface the normals at both ends of a short edge e fulfil e . (n + n') = 0 up to the
    third order in its length. The rim's normals take the least tilt that fulfils this, in the sense of
    least squares, towards the inner neighbours, whose normals are sound.
    """
    on_rim = np.zeros(len(vertices), dtype=bool)
    on_rim[adjacency.boundary] = True
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    rim, inner = pairs[on_rim[pairs[:, 0]] & ~on_rim[pairs[:, 1]]].T
    edge = unit(vertices[inner] - vertices[rim])
    wanted = -np.einsum("ij,ij->i", edge, normals[rim] + normals[inner])
    at, place = np.unique(rim, return_inverse=True)
    matrix, right = np.zeros((len(at), 3, 3)), np.zeros((len(at), 3))
    np.add.at(matrix, place, edge[:, :, None] * edge[:, None, :])
    np.add.at(right, place, edge * wanted[:, None])
    tilt = np.einsum("nij,nj->ni", np.linalg.pinv(matrix, rcond=SPREAD, hermitian=True), right)
    tilt -= np.einsum("ni,ni->n", tilt, normals[at])[:, None] * normals[at]
    tilt[np.linalg.norm(tilt, axis=1) > CREASE] = 0.0
    tilted = normals.copy()
    tilted[at] = unit(normals[at] + tilt)
    return tilted


def _sign(values: Floats) -> Floats:
    return np.where(values < 0.0, -1.0, 1.0)
