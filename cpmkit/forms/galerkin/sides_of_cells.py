"""On which side of a boundary the cells beside it lie, as far as some spacings from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.mesh.mesh import HalfFacets
from cpmkit.protocols import Bools, Floats, Ints

#: Sides are known so many spacings from a boundary: a point is compared with its nearest samples alone.
REACH_SPACINGS = 2.0


@dataclass(frozen=True, eq=False)
class SidesOfCells:
    """Sides spread from the half facets of a boundary over the corners that cells share, never across it.

    Around an open end both sides meet: there a cell has the side that comes to it first, or none.

    Attributes
    ----------
    corners : (m, k) int64
        The vertices of the cells after cutting.
    places : (m, d) float64
        A point of each cell.
    spacing : float
        h, of the lattice.
    half : HalfFacets
        Facets on boundaries, seen from the cells beside them.
    owner : (n,) int64
        The number of the boundary that each lies on, -1 on rims and past tips.
    left : (n,) bool
        Whether each is on its boundary's left.
    """

    corners: Ints
    places: Floats
    spacing: float
    half: HalfFacets
    owner: Ints
    left: Bools

    def of_boundary(self, number: int) -> Ints:
        """Return the sides (m,) of all cells: 1 on the left of a boundary, -1 on its right, 0 where it is not told."""
        if number not in self._found:
            self._found[number] = self._spread(number)
        return self._found[number]

    @cached_property
    def _found(self) -> dict[int, Ints]:
        return {}

    def _spread(self, number: int) -> Ints:
        from scipy.spatial import cKDTree

        cells, rows = np.zeros(len(self.corners), dtype=np.int64), np.flatnonzero(self.owner == number)
        if not len(rows):
            return cells
        reach, k = REACH_SPACINGS * self.spacing, self.corners.shape[1]
        beside = cKDTree(self.places[self.half.cell[rows]])
        near = np.flatnonzero(np.isfinite(beside.query(self.places, distance_upper_bound=reach)[0]))
        sign = np.where(self.left[rows], 1, -1)
        corner = np.zeros(int(self.corners.max()) + 1, dtype=np.int64)
        ends = (self.half.facet[rows, None] + np.arange(1, k)) % k
        np.add.at(corner, self.corners[self.half.cell[rows, None], ends], sign[:, None])
        corner = np.sign(corner)
        cells[self.half.cell[rows]] = sign
        corners, known = self.corners[near], -1
        while known < (count := int(np.count_nonzero(cells))):
            known = count
            cells[near] = np.where(cells[near] == 0, np.sign(corner[corners].sum(axis=1)), cells[near])
            reached = np.zeros(len(corner), dtype=np.int64)
            np.add.at(reached, corners, cells[near, None])
            corner = np.where(corner == 0, np.sign(reached), corner)
        return cells
