"""A triangle mesh whose triangles are wound alike: its normals have one sign, and its creases are known by them."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from cpmkit.plugin import Bools, ClosestPoints, Floats, unit
from cpmkit_mesh.directions import face_normals
from cpmkit_mesh.folds import crowded_edges
from cpmkit_mesh.support import support_warnings, supported_normals
from cpmkit_mesh.triangles import ON_EDGE_COORDINATE, TriangleMesh

#: A foot with a barycentric coordinate below this lies beside the edge opposite that corner: those of points of the
#: smooth surface above it do not lie on it to rounding.
BESIDE_EDGE_COORDINATE = 1e-3


class OrientedTriangleMesh(TriangleMesh):
    """A mesh whose triangles are wound alike, so that its normals have one sign."""

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, 3) unit normals at ``feet``, interpolated from the vertices; their sign is the faces' winding."""
        face, local = self._located(feet)
        mixed = np.einsum("nc,nck->nk", local, self.normals_at_corners[face])
        vanished = np.linalg.norm(mixed, axis=1) <= ON_EDGE_COORDINATE
        mixed[vanished] = self.normals_at_corners[face[vanished], 0]
        return unit(mixed)

    def own_warnings(self, spacing: float, /) -> tuple[str, ...]:
        """Return what was changed in the mesh, and how much of it is not as smooth as it is read."""
        if self._first is not self:
            return self._first.own_warnings(spacing)
        found = super().own_warnings(spacing)
        return (*found, *support_warnings(self)) if self.smooth else found

    def facet_normals(self, feet: ClosestPoints, /) -> Floats:
        """Return (n, 3) unit normals of triangles with a corner at a crease, NaN elsewhere.

        NaN as well at corners off creases, and on edges between such: from the other side the surface is smooth there.
        """
        face, local = self._located(feet)
        held = (self.at_crease[self.faces[face]] & (local > BESIDE_EDGE_COORDINATE)).any(axis=1)
        found = np.full((len(face), 3), np.nan)
        found[held] = face_normals(self.vertices, self.faces[face[held]])
        return found

    @cached_property
    def at_crease(self) -> Bools:
        """(k,) whether an edge that ends at each vertex is a crease of a mesh that is read as smooth.

        Edges at which three or more triangles meet are creases, whatever the angles there.
        """
        at = np.zeros(len(self.vertices), dtype=bool)
        if self.smooth:
            at[self.folds.ends[self.folds.angle > np.deg2rad(self.crease_angle)]] = True
            at[crowded_edges(self.faces, self.adjacency)] = True
        return at

    @property
    def _followed_normals(self) -> Floats:
        return supported_normals(self)
