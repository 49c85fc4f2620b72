"""On which side of a closed triangle mesh a point lies: the pseudonormals of Baerentzen and Aanaes (2005).

Let p be the point of the mesh nearest to x. The pseudonormal at p is the normal of the face inside which p lies, the
sum of the normals of two faces on their edge, and at a vertex the sum of its faces' normals, each times the face's
angle there. Its product with x - p is positive outside and negative inside of every closed mesh that does not cross
itself, however sharp; normals averaged or interpolated otherwise fail at sharp corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Floats, Ints, dots
from cpmkit_mesh.box_tree import BoxTree, Nearest, build_tree, find_nearest
from cpmkit_mesh.face_geometry import face_normals
from cpmkit_mesh.triangles import ON_EDGE_COORDINATE


@dataclass(frozen=True, eq=False)
class Pseudonormals:
    """The pseudonormals of a closed mesh; those of edges are the sums of two faces' normals.

    Attributes
    ----------
    faces, neighbours : (m, 3) int64
        The vertices of each face, and the face across the edge opposite each corner.
    of_faces : (m, 3) float64
        Unit normals.
    of_vertices : (k, 3) float64
        Sums of faces' normals, each times the angle of the face at the vertex in radians.
    """

    faces: Ints
    neighbours: Ints
    of_faces: Floats
    of_vertices: Floats

    @classmethod
    def of(cls, vertices: Floats, faces: Ints, neighbours: Ints, signs: Floats) -> Pseudonormals:
        """Return the pseudonormals of ``faces`` (m, 3) between ``vertices`` (k, 3), those of each face times its sign.

        ``signs`` (m,) are 1 or -1, the same for faces with a common edge.
        """
        normals = signs[:, None] * face_normals(vertices, faces)
        weighted = (_corner_angles(vertices, faces)[:, :, None] * normals[:, None]).reshape(-1, 3)
        sums = [np.bincount(faces.ravel(), column, len(vertices)) for column in weighted.T]
        return cls(faces, neighbours, normals, np.stack(sums, axis=1))

    def at(self, face: Ints, local: Floats) -> Floats:
        """Return (n, 3) pseudonormals at points with barycentric coordinates ``local`` (n, 3) on ``face`` (n,)."""
        normals = self.of_faces[face]
        is_zero = local <= ON_EDGE_COORDINATE
        count = is_zero.sum(axis=1)
        on_edge, at_vertex = np.flatnonzero(count == 1), np.flatnonzero(count == 2)
        normals[on_edge] += self.of_faces[self.neighbours[face[on_edge], is_zero[on_edge].argmax(axis=1)]]
        normals[at_vertex] = self.of_vertices[self.faces[face[at_vertex], local[at_vertex].argmax(axis=1)]]
        return normals

    def heights(self, tree: BoxTree, nearest: Nearest, x: Floats) -> Floats:
        """Return (n,) the products of the pseudonormals at the ``nearest`` points with ``x`` (n, 3) minus these points.

        They are negative inside and positive outside. ``tree`` is that of the faces.
        """
        local = np.concatenate([1.0 - nearest.local.sum(axis=1, keepdims=True), nearest.local], axis=1)
        return dots(x - nearest.point, self.at(tree.order[nearest.slot], local))


def _corner_angles(vertices: Floats, faces: Ints) -> Floats:
    """Return (m, 3) the angle in radians at each corner of each of ``faces`` (m, 3) between ``vertices`` (k, 3)."""
    corners = vertices[faces]
    after, before = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    return np.arctan2(np.linalg.norm(np.cross(after, before), axis=2), np.einsum("mck,mck->mc", after, before))


def outward_signs(vertices: Floats, faces: Ints, neighbours: Ints, component: Ints) -> Floats:
    """Return (m,) for each face 1.0 if its normal points out of the solid that the mesh bounds, else -1.0.

    ``faces`` (m, 3) between ``vertices`` (k, 3) form closed components, numbered by ``component`` (m,); ``neighbours``
    (m, 3) are the faces across their edges. A point is in the solid if an odd number of components encloses it, in
    whatever sense each is wound.
    """
    corners, count = vertices[faces], int(component.max()) + 1
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(lower, component, corners.min(axis=1))
    np.maximum.at(upper, component, corners.max(axis=1))
    a, b, c = np.moveaxis(corners - 0.5 * (lower + upper)[component][:, None], 1, 0)
    outward = np.where(np.bincount(component, dots(a, np.cross(b, c))) < 0, -1.0, 1.0)
    depth, place = np.zeros(count, dtype=np.int64), np.empty_like(component)
    middles = corners[np.unique(component, return_index=True)[1]].mean(axis=1)  # of a face: vertices may touch others
    for outer in range(count):
        inner = np.flatnonzero(((lower[outer] <= lower) & (upper <= upper[outer])).all(axis=1))
        inner = inner[inner != outer]
        if len(inner):
            rows = np.flatnonzero(component == outer)
            place[rows] = np.arange(len(rows))
            part = Pseudonormals.of(vertices, faces[rows], place[neighbours[rows]], np.full(len(rows), outward[outer]))
            tree, at = build_tree(corners[rows]), middles[inner]
            depth[inner] += part.heights(tree, find_nearest(tree, at), at) < 0
    return np.asarray((outward * (-1.0) ** depth)[component])
