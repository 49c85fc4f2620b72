"""A triangle mesh of consistent winding without rims: it encloses a solid."""

from __future__ import annotations

from functools import cached_property

from cpmkit.plugin import Bools, ClosestPoints, Floats, as_points
from cpmkit_mesh.oriented import OrientedTriangleMesh
from cpmkit_mesh.pseudonormals import Pseudonormals, outward_signs


class ClosedTriangleMesh(OrientedTriangleMesh):
    """A triangle mesh of consistent winding in which every edge has two triangles."""

    def closest_point_and_inside(self, x: Floats, /) -> tuple[ClosestPoints, Bools]:
        """Return the closest points of ``x`` (n, 3), and (n,) whether each is on or inside an odd number of shells.

        The second is exact for shells that do not cross themselves or each other, however sharp and in whatever sense
        each is wound. Raise InputError if ``x`` does not have shape (n, 3) or is not finite.
        """
        x = as_points(x, 3)
        nearest = self._search(x)
        inside = self._pseudonormals.heights(self._tree, nearest, x) <= 0  # before the nearest points are moved
        return self._records(x, nearest, self._move_along_normals(x, nearest)), inside

    @cached_property
    def _pseudonormals(self) -> Pseudonormals:
        """The pseudonormals that point out of the enclosed solid."""
        if isinstance(self._original, ClosedTriangleMesh) and self._original is not self:
            return self._original._pseudonormals
        mesh = self.vertices, self.faces, self.adjacency.neighbours
        return Pseudonormals.of(*mesh, outward_signs(*mesh, self.component))
