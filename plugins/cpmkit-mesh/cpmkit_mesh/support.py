"""How much of a mesh that is read as smooth does not support the surface that its normals claim."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import place, support_of
from cpmkit_mesh.directions import doubled_areas

if TYPE_CHECKING:
    from cpmkit_mesh.oriented import OrientedTriangleMesh

#: More than this share of the area in triangles with an unsupported edge is worth a warning. Boxes with fillets,
#: capsules and terrain have .6 to 1, smooth shapes and scans 0 to .025.
UNSUPPORTED_AREA_SHARE = 0.05


def support_warnings(mesh: OrientedTriangleMesh) -> list[str]:
    """Return a sentence where much of the mesh's area has an edge that the surface beyond does not support."""
    faces, count = mesh.faces, len(mesh.vertices)
    starts, ends = faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]  # edge j is opposite to corner j
    codes = np.minimum(starts, ends) * np.int64(count) + np.maximum(starts, ends)
    _, first, of_faces = np.unique(codes.ravel(), return_index=True, return_inverse=True)
    face, corner = np.divmod(first, 3)
    normals = mesh.normals_at_corners[face[:, None], np.stack([corner + 1, corner + 2], axis=1) % 3]
    edges = np.stack([starts.ravel()[first], ends.ravel()[first]], axis=1)
    unsupported = support_of(mesh.vertices, edges, normals, mesh.at_crease).unsupported()
    unsupported &= ~mesh.at_crease[edges].any(axis=1)  # straight in any case
    areas, beside = doubled_areas(mesh.vertices, faces), unsupported[of_faces.reshape(-1, 3)].any(axis=1)
    share = areas[beside].sum() / areas.sum()
    if share <= UNSUPPORTED_AREA_SHARE:
        return []
    largest = mesh.vertices[faces[np.argmax(np.where(beside, areas, 0.0))]].mean(axis=0)
    return [
        f"{share:.0%} of the mesh's area is in triangles beside much shorter ones that turn more, as beside fillets, "
        f"the largest near {place(largest - mesh.shift)}: normals lean off these triangles, and the mesh does not say "
        "what stands above them; use closest = 'faceted' if the triangles are meant, or a finer mesh."
    ]
