"""A sign for normals and tangents that come from closest points alone, carried along the boundary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class Orientation:
    """Signs of directions along a boundary, known at samples of it.

    Attributes
    ----------
    points : (s, d) float64 or None
        Samples of the boundary; None where the source's own signs are used as they are.
    directions : (s, d) float64 or None
        Directions at the samples, neighbours agreeing.
    """

    points: Floats | None = None
    directions: Floats | None = None

    def apply(self, points: Floats, directions: Floats) -> Floats:
        """Return ``directions`` (n, d) at ``points`` (n, d) with the sign of the nearest sample."""
        if self.points is None or self.directions is None:
            return directions
        from scipy.spatial import cKDTree

        nearest = cKDTree(self.points).query(points)[1]
        agree = np.sum(directions * self.directions[nearest], axis=1) >= 0
        return np.where(agree[:, None], directions, -directions)

    def reversed(self) -> Orientation:
        """Return the opposite signs."""
        return Orientation(self.points, None if self.directions is None else -self.directions)


#: The signs that the source gives.
AS_GIVEN = Orientation()


def carry(points: Floats, directions: Floats, spacing: float, name: str) -> Orientation:
    """Return signs for ``directions`` (s, d) at samples ``points`` such that neighbouring samples agree.

    The sign of each connected piece is chosen so that the largest component of its first sample is
    positive.

    Raises
    ------
    SceneError
        If the direction comes back reversed along the boundary: it then has no left.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(2.5 * spacing, output_type="ndarray").astype(np.int64)
    signs = np.sign(np.sum(directions[pairs[:, 0]] * directions[pairs[:, 1]], axis=1))
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points))).tocsr()
    count, label = connected_components(graph, directed=False)
    sign = np.ones(len(points))
    for piece in range(count):
        members = np.flatnonzero(label == piece)
        _, parent = breadth_first_order(graph, members[0], directed=False)
        sign[members] = _signs_from_root(directions, members, np.asarray(parent, dtype=np.int64))
        first = directions[members[0]]
        if sign[members[0]] * first[np.argmax(np.abs(first))] < 0:
            sign[members] *= -1
    if np.any(sign[pairs[:, 0]] * sign[pairs[:, 1]] * signs < 0):
        raise SceneError(
            f"boundary {name!r} has no left side: the surface's normal comes back reversed along it; "
            "give one condition for both sides."
        )
    return Orientation(points, directions * sign[:, None])


def _signs_from_root(directions: Floats, members: Ints, parent: Ints) -> Floats:
    """Return each member's sign relative to the root of a spanning tree, by doubling steps towards the root."""
    place = np.full(len(directions), -1)
    place[members] = np.arange(len(members))
    up = np.where(parent[members] < 0, np.arange(len(members)), place[np.maximum(parent[members], 0)])
    agrees = np.sum(directions[members] * directions[members][up], axis=1) >= 0
    sign = np.where(agrees, 1.0, -1.0)
    while True:
        further = up[up]
        if np.array_equal(further, up):
            return sign
        sign, up = sign * sign[up], further
