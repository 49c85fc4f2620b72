"""Normals at vertices, tilted until they agree with the chords between them.

On a smooth surface the normals n and n' at both ends of a short chord e fulfil e . (n + n') = 0 up to the third order
in its length. Averages over triangles know nothing of this: they are normals of a surface that passes beside the
vertices, and closest points that follow them lose flux at every edge. ``benchmarks/normals.py`` measures what the tilts
are worth.
"""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints, unit
from cpmkit_mesh.topology import FIRST_BOUNDARY, Topology

#: Directions in which the neighbours of a rim vertex spread less than this are not corrected.
LEAST_NEIGHBOUR_SPREAD = 0.05
#: A rim normal that would be tilted by more (radians) stands at a crease and is left alone.
MOST_TILT_RADIANS = 0.2
#: A chord that disagrees with its normals by this much (radians) counts half: the mesh is rough or creased there.
ROUGH_CHORD_RADIANS = 0.05
#: Relative accuracy of the tilts.
TILT_TOLERANCE = 1e-12


def tilted_to_chords(vertices: Floats, faces: Ints, adjacency: Topology, normals: Floats) -> Floats:
    """Return the unit ``normals`` (k, 3) of the vertices with the tilts that best fit the chords along all edges.

    The triangles are wound alike, so that each inner edge is met once in either direction.

    The tilts t, in the tangent planes, minimise sum w (e . (n + t + n' + t'))^2 + sum |t|^2 over the edges and
    vertices, e of length one; w falls where n and n' disagree with e, which also bounds the tilts: 3.5 degrees at the
    most on the meshes of Spot, the koala, the fish and Nefertiti.
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


def with_tilted_rim(vertices: Floats, faces: Ints, adjacency: Topology, normals: Floats) -> Floats:
    """Tilt the normals of rim vertices, whose triangles lie on one side and lean them to the inside.

    The triangles are wound alike, so that each edge off the rim is met once in either direction. The normals take the
    least tilt that fits the chords to inner neighbours, whose normals are sound, in the sense of least squares.
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
    tilt[np.linalg.norm(tilt, axis=1) > MOST_TILT_RADIANS] = 0.0
    tilted = normals.copy()
    tilted[at] = unit(normals[at] + tilt)
    return tilted
