"""On which side of a boundary the cells near it lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.mesh.adjacency import HalfFacets
from cpmkit.types import Bools, Floats, Ints

#: Sides of cells are known up to so many spacings from a boundary: points are compared with nearby samples only.
SIDE_REACH_SPACINGS = 2.0


@dataclass(frozen=True, eq=False)
class CellSides:
    """The side of each boundary on which cells lie, propagated from half facets over shared corners of the cut mesh.

    Both sides meet around a tip: a cell there has the side that is propagated to it first, or none.
    """

    corners: Ints  #: (m, k): the vertices of the cells after cutting.
    places: Floats  #: (m, d): a point of each cell.
    spacing: float  #: Spacing h of the lattice.
    half: HalfFacets  #: Facets on boundaries, seen from the cells beside them.
    owner: Ints  #: (n,): the number of the boundary on which each half facet lies, -1 on rims and past tips.
    left: Bools  #: (n,): whether each half facet is on its boundary's left.

    def of_boundary(self, number: int) -> Ints:
        """Return the side (m,) of each cell: 1 on the left of boundary ``number``, -1 on its right, else 0.

        It is 0 for cells farther than `SIDE_REACH_SPACINGS` from those beside the boundary, for cells that no chain of
        cells within that distance joins to these, and for cells with as many corners on the left as on the right.
        """
        from scipy.spatial import cKDTree

        sides, rows = np.zeros(len(self.corners), dtype=np.int64), np.flatnonzero(self.owner == number)
        if not len(rows):
            return sides
        reach, k = SIDE_REACH_SPACINGS * self.spacing, self.corners.shape[1]
        tree = cKDTree(self.places[self.half.cell[rows]])
        within = np.flatnonzero(np.isfinite(tree.query(self.places, distance_upper_bound=reach)[0]))
        sign = np.where(self.left[rows], 1, -1)
        of_corner = np.zeros(int(self.corners.max()) + 1, dtype=np.int64)
        ends = (self.half.facet[rows, None] + np.arange(1, k)) % k
        np.add.at(of_corner, self.corners[self.half.cell[rows, None], ends], sign[:, None])
        of_corner = np.sign(of_corner)
        sides[self.half.cell[rows]] = sign
        corners, known = self.corners[within], -1
        while known < (count := int(np.count_nonzero(sides))):
            known = count
            sides[within] = np.where(sides[within] == 0, np.sign(of_corner[corners].sum(axis=1)), sides[within])
            sums = np.zeros(len(of_corner), dtype=np.int64)
            np.add.at(sums, corners, sides[within, None])
            of_corner = np.where(of_corner == 0, np.sign(sums), of_corner)
        return sides
