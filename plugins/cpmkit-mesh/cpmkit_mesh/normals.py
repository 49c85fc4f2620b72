"""Normals at the corners of triangles, as close as the mesh tells to those of the surface that it samples."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints, unit
from cpmkit_mesh.directions import face_normals
from cpmkit_mesh.tilting import tilted_to_chords, with_tilted_rim
from cpmkit_mesh.topology import Topology

#: A mean of unit normals this much shorter than the sum of its weights has no direction.
VANISHED_NORMAL_SHARE = 1e-9


def corner_normals(vertices: Floats, faces: Ints, adjacency: Topology) -> Floats:
    """Return (m, 3, 3) unit normals at the corners of each face, averaged around each vertex and tilted to its chords.

    Where the winding of neighbours disagrees, the normals around a vertex are aligned before they
    are averaged, and each face sees the mean with the sign of its own winding. A corner whose
    mean vanishes takes the normal of its face.

    Notes
    -----
    The weights are those of Max (1999), Weights for computing vertex normals from facet normals:
    the sine of the angle at the corner over the product of the lengths of its edges. They are exact
    on meshes inscribed in a sphere, where weights by angle or by area are of first order. Elsewhere the
    tilts make them two to three times more accurate.
    """
    corner, normal_of_corner = faces.ravel(), np.repeat(face_normals(vertices, faces), 3, axis=0)
    weights = _weights(vertices, faces).ravel()
    if not adjacency.consistent:
        reference = np.zeros_like(vertices)
        reference[corner[::-1]] = normal_of_corner[::-1]
        weights = weights * _sign(np.einsum("ij,ij->i", normal_of_corner, reference[corner]))
    total = np.stack([np.bincount(corner, weights * normal_of_corner[:, k], len(vertices)) for k in range(3)], axis=1)
    vanished = np.linalg.norm(total, axis=1) <= VANISHED_NORMAL_SHARE * np.bincount(
        corner, np.abs(weights), len(vertices)
    )
    total[vanished] = 0.0
    normals = unit(total)
    if adjacency.consistent:
        if len(adjacency.boundary):
            normals = with_tilted_rim(vertices, faces, adjacency, normals)
        normals = tilted_to_chords(vertices, faces, adjacency, normals)
    normals = normals[corner]
    if not adjacency.consistent:
        normals = normals * _sign(np.einsum("ij,ij->i", normal_of_corner, normals))[:, None]
    lost = ~normals.any(axis=1)
    normals[lost] = normal_of_corner[lost]
    normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)
    return normals.reshape(-1, 3, 3)


def _weights(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) the weight of each face at each of its corners, relative to the mesh's largest edge."""
    towards = vertices[faces[:, [1, 2, 0]]] - vertices[faces]
    towards = towards / np.abs(towards).max()
    back = -towards[:, [2, 0, 1]]
    squares = np.einsum("fck,fck->fc", towards, towards)
    return np.linalg.norm(np.cross(towards, back), axis=2) / (squares * squares[:, [2, 0, 1]])


def _sign(values: Floats) -> Floats:
    return np.where(values < 0.0, -1.0, 1.0)
