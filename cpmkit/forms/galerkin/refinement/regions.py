"""Where the splines are finer: lattice cells that are parted in two along every axis, level by level.

Level l has the spacing h_l = h / 2^l, and its cells are those of level l - 1 parted along every axis. What lies in a
cell follows from positions alone, so that the mesh of the manifold may be made anew for each set of regions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.types import Bools, Floats, Ints

#: A cell's place along an axis has so many bits of its code, and counts from half their range.
BITS = 21
HALF = 1 << (BITS - 1)


@dataclass(frozen=True, eq=False)
class Regions:
    """The cells that are parted, by level.

    Attributes
    ----------
    spacing : float
        h, of level 0.
    dim : int
        Dimension of the space.
    parted : tuple of (k_l,) int64
        Codes of the cells of level l that are parted into cells of level l + 1, ascending; each lies in a parted cell
        of the level before.
    """

    spacing: float
    dim: int
    parted: tuple[Ints, ...] = ()

    @property
    def finest(self) -> int:
        """The deepest level that there is; 0 where nothing is parted."""
        return len(self.parted)

    def cells(self, points: Floats, level: int) -> Ints:
        """Return (q, d) the cells of a level that ``points`` (q, d) lie in, relative to the lattice's origin."""
        return np.floor(2.0**level * (points / self.spacing + 0.5)).astype(np.int64)

    def levels(self, points: Floats) -> Ints:
        """Return (q,) the level of the splines at ``points`` (q, d)."""
        found = np.zeros(len(points), dtype=np.int64)
        rows = np.arange(len(points))
        for level, parted in enumerate(self.parted):
            rows = rows[is_among(codes_of_cells(self.cells(points[rows], level)), parted)]
            found[rows] = level + 1
        return found

    def levels_around(self, points: Floats) -> Ints:
        """Return (q,) the finest level within a quarter of a cell of the level before, along the axes' diagonals."""
        found = np.zeros(len(points), dtype=np.int64)
        corners = np.indices((2,) * self.dim).reshape(self.dim, -1).T - 0.5
        for level, parted in enumerate(self.parted):
            rows = np.flatnonzero(found == level)
            reach = 0.5 * self.spacing / 2**level
            near = [codes_of_cells(self.cells(points[rows] + reach * corner, level)) for corner in corners]
            found[rows[np.any([is_among(one, parted) for one in near], axis=0)]] = level + 1
        return found

    def with_parted(self, levels: Ints, cells: Ints, most: int) -> Regions:
        """Return regions in which these ``cells`` (k, d) of ``levels`` (k,) below ``most`` are parted as well.

        With those around each, and so many of the levels before that neighbouring cells differ by one level at most.
        """
        wanted = [np.zeros(0, dtype=np.int64) if one >= self.finest else self.parted[one] for one in range(most)]
        for level in range(most):
            own = with_neighbours(cells[levels == level])
            wanted[level] = np.union1d(wanted[level], codes_of_cells(own))
        for level in range(most - 1, 0, -1):
            beside = with_neighbours(cells_of_codes(wanted[level], self.dim))
            wanted[level - 1] = np.union1d(wanted[level - 1], codes_of_cells(beside >> 1))
        return Regions(self.spacing, self.dim, tuple(one for one in wanted if len(one)))

    def codes_near(self) -> Ints:
        """Return the codes, ascending, of the cells of level 0 that are parted or meet such a cell."""
        first = self.parted[0] if self.finest else np.zeros(0, dtype=np.int64)
        return codes_of_cells(with_neighbours(cells_of_codes(first, self.dim)))

    def table(self) -> Ints:
        """Return (k, 1 + d) the parted cells as plain numbers: the level, and the cell."""
        rows = [
            np.column_stack([np.full(len(one), level), cells_of_codes(one, self.dim)])
            for level, one in enumerate(self.parted)
        ]
        return np.concatenate([np.zeros((0, 1 + self.dim), dtype=np.int64), *rows])


def codes_of_cells(cells: Ints) -> Ints:
    """Return (k,) a number for each of the ``cells`` (k, d)."""
    code = np.zeros(len(cells), dtype=np.int64)
    for column in cells.T:
        code = (code << BITS) + column + HALF
    return code


def cells_of_codes(codes: Ints, dim: int) -> Ints:
    """Return (k, d) the cells that have these ``codes`` (k,)."""
    shifts = BITS * np.arange(dim - 1, -1, -1)
    return np.asarray((codes[:, None] >> shifts & (2 * HALF - 1)) - HALF)


def is_among(codes: Ints, ascending: Ints) -> Bools:
    """Tell which of the ``codes`` (k,) are among others."""
    if not len(ascending):
        return np.zeros(len(codes), dtype=bool)
    place = np.minimum(np.searchsorted(ascending, codes), len(ascending) - 1)
    return np.asarray(ascending[place] == codes)


def with_neighbours(cells: Ints) -> Ints:
    """Return (m, d) the distinct ``cells`` (k, d) with all that meet them, at corners too."""
    dim = cells.shape[1]
    steps = np.indices((3,) * dim).reshape(dim, -1).T - 1
    every = codes_of_cells((cells[:, None] + steps).reshape(-1, dim))
    return cells_of_codes(np.unique(every), dim)
