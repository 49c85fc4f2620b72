"""On which side of a boundary the cells beside it lie, as far as some layers of cells from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.forms.galerkin.sample_mesh import HalfFacets
from cpmkit.protocols import Bools, Ints

#: Sides are known of so many layers of cells: a point is compared with its nearest samples alone, fewer layers away.
LAYERS = 8


@dataclass(frozen=True, eq=False)
class SidesOfCells:
    """Sides spread from the half facets of a boundary over the corners that cells share, never across it.

    Around an open end both sides meet: there a cell has the side that comes to it first, or none.

    Attributes
    ----------
    corners : (m, k) int64
        The vertices of the cells after cutting.
    half : HalfFacets
        Facets on boundaries, seen from the cells beside them.
    owner : (n,) int64
        The number of the boundary that each lies on, -1 on rims and past tips.
    left : (n,) bool
        Whether each is on its boundary's left.
    """

    corners: Ints
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
        rows = np.flatnonzero(self.owner == number)
        k = self.corners.shape[1]
        places = (self.half.facet[rows, None] + np.arange(1, k)) % k
        sign = np.where(self.left[rows], 1, -1)
        corner = np.zeros(int(self.corners.max(initial=-1)) + 1, dtype=np.int64)
        np.add.at(corner, self.corners[self.half.cell[rows, None], places], sign[:, None])
        corner = np.sign(corner)
        cells = np.zeros(len(self.corners), dtype=np.int64)
        cells[self.half.cell[rows]] = sign
        for _ in range(LAYERS):
            cells = np.where(cells == 0, np.sign(corner[self.corners].sum(axis=1)), cells)
            reached = np.zeros(len(corner), dtype=np.int64)
            np.add.at(reached, self.corners, cells[:, None])
            corner = np.where(corner == 0, np.sign(reached), corner)
        return cells
