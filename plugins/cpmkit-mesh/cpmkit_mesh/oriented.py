"""A triangle mesh of consistent winding: its normals have one sign."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import ClosestPoints, Floats, unit
from cpmkit_mesh.face_geometry import face_normals
from cpmkit_mesh.triangles import ON_EDGE_COORDINATE, TriangleMesh
from cpmkit_mesh.unsupported_edges import support_warnings, tilt_normals_at_unsupported_edges

#: A closest point with a barycentric coordinate below this lies at the edge opposite that corner: those of points of
#: the smooth surface above the edge do not lie on it to rounding.
NEAR_EDGE_COORDINATE = 1e-3


class OrientedTriangleMesh(TriangleMesh):
    """A triangle mesh whose faces have consistent winding, so that its normals have one sign."""

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, 3) unit normals at closest points ``feet``, interpolated between the corners' normals.

        Their sign follows the winding of the faces. Where the interpolated vector vanishes, the normal at the
        triangle's first corner is returned. Raise InputError if ``feet`` lack ``element`` or ``local``.
        """
        face, local = self._locate(feet)
        normals = np.einsum("nc,nck->nk", local, self.normals_at_corners[face])
        vanished = np.linalg.norm(normals, axis=1) <= ON_EDGE_COORDINATE
        normals[vanished] = self.normals_at_corners[face[vanished], 0]
        return unit(normals)

    def all_warnings(self) -> tuple[str, ...]:
        """Return warnings about repairs, several pieces and, if smooth, triangles off which their normals lean."""
        return (*super().all_warnings(), *support_warnings(self)) if self.smooth else super().all_warnings()

    def facet_normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, 3) unit normals of the triangles that contain ``feet``; NaN if these have no corner at a crease.

        Such triangles of a smooth mesh are flat (:attr:`at_crease`). Rows are also NaN where no corner at a crease has
        a barycentric coordinate above :data:`NEAR_EDGE_COORDINATE`: the surface beyond that corner or edge is smooth.
        On a faceted mesh all rows are NaN. Raise InputError if ``feet`` lack ``element`` or ``local``.
        """
        face, local = self._locate(feet)
        is_flat = (self.at_crease[self.faces[face]] & (local > NEAR_EDGE_COORDINATE)).any(axis=1)
        normals = np.full((len(face), 3), np.nan)
        normals[is_flat] = face_normals(self.vertices, self.faces[face[is_flat]])
        return normals

    @property
    def _normals_to_follow(self) -> Floats:
        """(m, 3, 3) the normals at the corners of each face, tilted so that they are normal to unsupported edges."""
        return tilt_normals_at_unsupported_edges(self)
