"""Normals at the corners of triangles, fitted to those of the smooth surface that the mesh samples.

On a smooth surface the normals n and n' at both ends of a short chord e satisfy e . (n + n') = 0 up to the third order
in its length. Averages of triangle normals do not: they are normals of a surface that passes beside the vertices, and
closest points that follow them lose flux at every edge. So averages are tilted until they fit the chords;
``benchmarks/normals.py`` measures the gain.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints, unit
from cpmkit_mesh.face_geometry import face_normals
from cpmkit_mesh.topology import FIRST_BOUNDARY, Topology

#: A weighted sum of unit normals shorter than this share of the sum of the weights has no direction.
VANISHED_NORMAL_SHARE = 1e-9


def corner_normals(vertices: Floats, faces: Ints, adjacency: Topology) -> Floats:
    """Return (m, 3, 3) unit normals at the corners of each face, averaged around each vertex and tilted to its chords.

    ``faces`` (m, 3) are triangles between ``vertices`` (k, 3), with their ``adjacency``. Where the winding is
    inconsistent, the normals around a vertex are aligned before they are averaged, not tilted, and each face gets the
    mean with the sign of its own winding. A corner whose mean vanishes takes the normal of its face, or (0, 0, 1) if
    that has no area.

    Notes
    -----
    The weights are those of Max (1999), Weights for computing vertex normals from facet normals: the sine of the angle
    at the corner over the product of the lengths of its edges. They are exact on meshes inscribed in a sphere, where
    weights by angle or by area are of first order. Elsewhere the tilts make them two to three times more accurate.
    """
    corner, normal_of_corner = faces.ravel(), np.repeat(face_normals(vertices, faces), 3, axis=0)
    weights = _corner_weights(vertices, faces).ravel()
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
            normals = tilt_rim_normals(vertices, faces, adjacency, normals)
        normals = fit_normals_to_chords(vertices, faces, adjacency, normals)
    normals = normals[corner]
    if not adjacency.consistent:
        normals = normals * _sign(np.einsum("ij,ij->i", normal_of_corner, normals))[:, None]
    lost = ~normals.any(axis=1)
    normals[lost] = normal_of_corner[lost]
    normals[~normals.any(axis=1)] = (0.0, 0.0, 1.0)
    return normals.reshape(-1, 3, 3)


def _corner_weights(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) sin(angle) / (product of both edge lengths) at each corner of each face.

    Lengths are in units of the largest component of an edge.
    """
    towards = vertices[faces[:, [1, 2, 0]]] - vertices[faces]
    towards = towards / np.abs(towards).max()
    back = -towards[:, [2, 0, 1]]
    squares = np.einsum("fck,fck->fc", towards, towards)
    return np.linalg.norm(np.cross(towards, back), axis=2) / (squares * squares[:, [2, 0, 1]])


def _sign(values: Floats) -> Floats:
    return np.where(values < 0.0, -1.0, 1.0)


#: Eigenvalues below this share of the largest one: in such directions the neighbours of a vertex determine no tilt.
LEAST_NEIGHBOUR_SPREAD = 0.05
#: A rim normal that would be tilted by more than this, in radians, lies at a crease and is left as it is.
MAX_TILT_RADIANS = 0.2
#: A chord that disagrees with its normals by this much, in radians, has half the weight: the mesh is rough there.
ROUGH_CHORD_RADIANS = 0.05
#: The relative tolerance of the least squares solve.
TILT_TOLERANCE = 1e-12


def fit_normals_to_chords(vertices: Floats, faces: Ints, adjacency: Topology, normals: Floats) -> Floats:
    """Return the unit ``normals`` (k, 3) at ``vertices`` (k, 3), tilted to fit the chords along all edges of ``faces``.

    The tilts t, in the tangent planes, minimise sum w (e . (n + t + n' + t'))^2 + sum |t|^2 over the edges and
    vertices, with unit chords e; edges at a vertex whose normal is zero are left out. The weight w falls where n and n'
    disagree with e, which also bounds the tilts: at most 3.5 degrees on the meshes of Spot, the koala, the fish and
    Nefertiti. The winding must be consistent. An edge of three or more triangles counts once for each of them that
    passes it towards its vertex of higher number.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import lsmr

    start, end = faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]
    once = (start < end) | (adjacency.neighbours <= FIRST_BOUNDARY)
    ends = np.stack([start[once], end[once]], axis=1)
    ends = ends[normals[ends].any(axis=2).all(axis=1)]
    if not len(ends):
        return normals
    chord = unit(vertices[ends[:, 1]] - vertices[ends[:, 0]])
    along = np.einsum("kj,kej->ke", chord, normals[ends])
    tangential = chord[:, None, :] - along[:, :, None] * normals[ends]
    off = along.sum(axis=1)
    share = 1.0 / np.hypot(1.0, off / ROUGH_CHORD_RADIANS)
    columns = 3 * ends[:, :, None] + np.arange(3)
    entries = (share[:, None, None] * tangential).ravel()
    matrix = csr_array((entries, columns.ravel(), 6 * np.arange(len(ends) + 1)), shape=(len(ends), normals.size))
    tilt = lsmr(matrix, -share * off, damp=1.0, atol=TILT_TOLERANCE, btol=TILT_TOLERANCE)[0]
    return unit(normals + tilt.reshape(-1, 3))


def tilt_rim_normals(vertices: Floats, faces: Ints, adjacency: Topology, normals: Floats) -> Floats:
    """Return the unit ``normals`` (k, 3) with those of rim vertices tilted to fit the chords to inner neighbours.

    ``faces`` (m, 3) are triangles between ``vertices`` (k, 3). Those of a rim vertex all lie on one side, so that its
    averaged normal leans inwards. The tilt is the least one that fits in the sense of least squares; one above
    :data:`MAX_TILT_RADIANS` is left out, and vertices without inner neighbours have none. The winding must be
    consistent.
    """
    on_rim = np.zeros(len(vertices), dtype=bool)
    on_rim[adjacency.boundary] = True
    start, end = faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]
    outwards = on_rim[start] & ~on_rim[end]
    rim, inner = start[outwards], end[outwards]
    edge = unit(vertices[inner] - vertices[rim])
    wanted = -np.einsum("ij,ij->i", edge, normals[rim] + normals[inner])
    at, place = np.unique(rim, return_inverse=True)
    matrix, right = np.zeros((len(at), 3, 3)), np.zeros((len(at), 3))
    np.add.at(matrix, place, edge[:, :, None] * edge[:, None, :])
    np.add.at(right, place, edge * wanted[:, None])
    tilt = np.einsum("nij,nj->ni", np.linalg.pinv(matrix, rcond=LEAST_NEIGHBOUR_SPREAD, hermitian=True), right)
    tilt -= np.einsum("ni,ni->n", tilt, normals[at])[:, None] * normals[at]
    tilt[np.linalg.norm(tilt, axis=1) > MAX_TILT_RADIANS] = 0.0
    tilted = normals.copy()
    tilted[at] = unit(normals[at] + tilt)
    return tilted
