"""Edges of a smooth mesh beyond which the mesh does not turn as its vertex normals say, as beside fillets."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Bools, CurvatureSupport, Floats, Ints, curvature_support, place, unit
from cpmkit_mesh.corner_normals import LEAST_NEIGHBOUR_SPREAD
from cpmkit_mesh.face_geometry import double_areas

if TYPE_CHECKING:
    from cpmkit_mesh.oriented import OrientedTriangleMesh
    from cpmkit_mesh.triangles import TriangleMesh

#: The share of the area in triangles with an unsupported edge above which a warning is given. Boxes with fillets,
#: capsules and terrain have .6 to 1, smooth shapes and scans 0 to .025.
UNSUPPORTED_AREA_SHARE = 0.05


def tilt_normals_at_unsupported_edges(mesh: OrientedTriangleMesh) -> Floats:
    """Return (m, 3, 3) unit normals at corners, tilted least so that they are orthogonal to unsupported edges.

    They are orthogonal in the least squares sense. An edge is unsupported (:class:`CurvatureSupport`) if the surface
    beyond its ends bends much more, over a much shorter length. The corners of a flat face beside a fillet then have
    the face's normal. Where the unsupported edges at a vertex have about one direction, the normal is tilted in that
    direction alone.
    """
    ends, unsupported, _ = _unsupported_edges(mesh)
    ends = ends[unsupported]
    if not len(ends):
        return mesh.normals_at_corners
    normals = np.zeros_like(mesh.vertices)
    normals[mesh.faces] = mesh.normals_at_corners
    at, row = np.unique(ends, return_inverse=True)
    chord = np.repeat(unit(mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]]), 2, axis=0)
    across = normals[ends.ravel()]
    off = np.einsum("ij,ij->i", chord, across)
    tangential = chord - off[:, None] * across
    matrix, right = np.zeros((len(at), 3, 3)), np.zeros((len(at), 3))
    np.add.at(matrix, row.ravel(), tangential[:, :, None] * tangential[:, None, :])
    np.add.at(right, row.ravel(), -off[:, None] * tangential)
    inverse = np.linalg.pinv(matrix, rcond=LEAST_NEIGHBOUR_SPREAD, hermitian=True)
    normals[at] = unit(normals[at] + np.einsum("nij,nj->ni", inverse, right))
    return normals[mesh.faces]


def support_warnings(mesh: OrientedTriangleMesh) -> list[str]:
    """Return a warning if triangles with unsupported edges pass :data:`UNSUPPORTED_AREA_SHARE` of the area; else []."""
    faces = mesh.faces
    _, unsupported, of_faces = _unsupported_edges(mesh)
    areas, affected = double_areas(mesh.vertices, faces), unsupported[of_faces].any(axis=1)
    share = areas[affected].sum() / areas.sum()
    if share <= UNSUPPORTED_AREA_SHARE:
        return []
    largest = mesh.vertices[faces[np.argmax(np.where(affected, areas, 0.0))]].mean(axis=0)
    return [
        f"{share:.0%} of the mesh's area is in triangles beside much shorter ones that turn more, as beside fillets, "
        f"the largest near {place(largest - mesh.shift)}: normals lean off these triangles, and the mesh does not "
        "determine the surface above them; use closest = 'faceted' if the triangles are meant, or a finer mesh."
    ]


def _unsupported_edges(mesh: OrientedTriangleMesh) -> tuple[Ints, Bools, Ints]:
    """Return the edges (e, 2), which of them (e,) are unsupported, and the numbers (m, 3) of each face's edges.

    Edges with an end at a crease are straight, and count as supported.
    """
    edges, support, of_faces = edge_support(mesh)
    return edges, support.unsupported() & ~mesh.at_crease[edges].any(axis=1), of_faces


def edge_support(mesh: TriangleMesh) -> tuple[Ints, CurvatureSupport, Ints]:
    """Return the edges (e, 2), the support of the curvature along them, and the numbers (m, 3) of each face's edges.

    Edge j of a face is opposite its corner j.
    """
    faces, count = mesh.faces, len(mesh.vertices)
    starts, ends = faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]  # edge j is opposite to corner j
    codes = np.minimum(starts, ends) * np.int64(count) + np.maximum(starts, ends)
    _, first, of_faces = np.unique(codes.ravel(), return_index=True, return_inverse=True)
    face, corner = np.divmod(first, 3)
    normals = mesh.normals_at_corners[face[:, None], np.stack([corner + 1, corner + 2], axis=1) % 3]
    edges = np.stack([starts.ravel()[first], ends.ravel()[first]], axis=1)
    support = curvature_support(mesh.vertices, edges, normals, mesh.at_crease)
    return edges, support, of_faces.reshape(faces.shape)
