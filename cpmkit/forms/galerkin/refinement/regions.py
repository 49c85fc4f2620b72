"""Where splines are finer: lattice cells that are subdivided into two along every axis, level by level.

Level l has the spacing h_l = h / 2^l; its cells are those of level l - 1, each subdivided along every axis. The cell of
a point depends on its position alone, so that the mesh of the manifold may be made anew for each set of regions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.types import Bools, Floats, Ints

#: Bits of a cell's code for its place along an axis, and the place that counts as zero: half their range.
BITS = 21
HALF = 1 << (BITS - 1)


@dataclass(frozen=True, eq=False)
class Regions:
    """The subdivided cells, by level.

    Attributes
    ----------
    spacing : float
        Spacing h of level 0.
    dim : int
        Dimension of the space.
    subdivided : tuple of (k_l,) int64
        Codes of the cells of level l that are subdivided into cells of level l + 1, ascending; each lies in a
        subdivided cell of the level before.
    """

    spacing: float
    dim: int
    subdivided: tuple[Ints, ...] = ()

    @property
    def finest(self) -> int:
        """The finest level; 0 where no cell is subdivided."""
        return len(self.subdivided)

    def cells(self, points: Floats, level: int) -> Ints:
        """Return (q, d) the cells of a level that contain ``points`` (q, d), given relative to the lattice's origin."""
        return np.floor(2.0**level * (points / self.spacing + 0.5)).astype(np.int64)

    def levels(self, points: Floats) -> Ints:
        """Return (q,) the level of the splines at ``points`` (q, d), given relative to the lattice's origin."""
        level_of_point = np.zeros(len(points), dtype=np.int64)
        rows = np.arange(len(points))
        for level, codes in enumerate(self.subdivided):
            rows = rows[is_among(codes_of_cells(self.cells(points[rows], level)), codes)]
            level_of_point[rows] = level + 1
        return level_of_point

    def levels_around(self, points: Floats) -> Ints:
        """Return (q,) the finest level of the splines around each of the ``points`` (q, d).

        Around means displaced along all axes by a quarter of the spacing of the level before, with any signs.
        """
        level_of_point = np.zeros(len(points), dtype=np.int64)
        corners = np.indices((2,) * self.dim).reshape(self.dim, -1).T - 0.5
        for level, codes in enumerate(self.subdivided):
            rows = np.flatnonzero(level_of_point == level)
            reach = 0.5 * self.spacing / 2**level
            around = [codes_of_cells(self.cells(points[rows] + reach * corner, level)) for corner in corners]
            level_of_point[rows[np.any([is_among(near, codes) for near in around], axis=0)]] = level + 1
        return level_of_point

    def with_subdivided(self, levels: Ints, cells: Ints, most: int) -> Regions:
        """Return regions in which also the ``cells`` (k, d) of ``levels`` (k,), below ``most``, are subdivided.

        Their neighbours are subdivided too, and cells of coarser levels until neighbouring cells differ by at most one
        level.
        """
        codes = [
            self.subdivided[level] if level < self.finest else np.zeros(0, dtype=np.int64) for level in range(most)
        ]
        for level in range(most):
            codes[level] = np.union1d(codes[level], codes_of_cells(with_neighbours(cells[levels == level])))
        for level in range(most - 1, 0, -1):
            around = with_neighbours(cells_of_codes(codes[level], self.dim))
            codes[level - 1] = np.union1d(codes[level - 1], codes_of_cells(around >> 1))
        return Regions(self.spacing, self.dim, tuple(level for level in codes if len(level)))

    def codes_near(self) -> Ints:
        """Return the ascending codes of the cells of level 0 that are subdivided or neighbours of such cells."""
        first = self.subdivided[0] if self.finest else np.zeros(0, dtype=np.int64)
        return codes_of_cells(with_neighbours(cells_of_codes(first, self.dim)))

    def table(self) -> Ints:
        """Return (k, 1 + d) the subdivided cells as integers: the level, then the cell."""
        rows = [
            np.column_stack([np.full(len(codes), level), cells_of_codes(codes, self.dim)])
            for level, codes in enumerate(self.subdivided)
        ]
        return np.concatenate([np.zeros((0, 1 + self.dim), dtype=np.int64), *rows])


def codes_of_cells(cells: Ints) -> Ints:
    """Return (k,) an integer code for each of the ``cells`` (k, d), different for different cells."""
    code = np.zeros(len(cells), dtype=np.int64)
    for column in cells.T:
        code = (code << BITS) + column + HALF
    return code


def cells_of_codes(codes: Ints, dim: int) -> Ints:
    """Return (k, d) the cells, in a space of dimension ``dim``, with the ``codes`` (k,)."""
    shifts = BITS * np.arange(dim - 1, -1, -1)
    return np.asarray((codes[:, None] >> shifts & (2 * HALF - 1)) - HALF)


def is_among(codes: Ints, ascending: Ints) -> Bools:
    """Return (k,) whether each of the ``codes`` (k,) is one of the ``ascending`` codes (m,)."""
    if not len(ascending):
        return np.zeros(len(codes), dtype=bool)
    place = np.minimum(np.searchsorted(ascending, codes), len(ascending) - 1)
    return np.asarray(ascending[place] == codes)


def with_neighbours(cells: Ints) -> Ints:
    """Return (m, d) the distinct ``cells`` (k, d) and all cells that share a corner with one of them."""
    dim = cells.shape[1]
    steps = np.indices((3,) * dim).reshape(dim, -1).T - 1
    codes = codes_of_cells((cells[:, None] + steps).reshape(-1, dim))
    return cells_of_codes(np.unique(codes), dim)
