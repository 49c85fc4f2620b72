"""The two numberings of a layout: the rows of E, and the unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.protocols import Ints

if TYPE_CHECKING:
    from cpmkit.forms.collocation.ghosts.ghosts import Ghosts
    from cpmkit.grid.band import Band


@dataclass(frozen=True)
class Numbering:
    """Rows of E are the nodes of the band, then each boundary's ghosts; unknowns are those of them that are read.

    Attributes
    ----------
    nodes, inner : int
        How many nodes there are, and how many of them, the first, are unknowns.
    ghosts, unknown_ghosts : tuple of int
        The same of each boundary's ghosts.
    """

    nodes: int
    inner: int
    ghosts: tuple[int, ...]
    unknown_ghosts: tuple[int, ...]

    @classmethod
    def of(cls, band: Band, ghosts: Sequence[Ghosts]) -> Numbering:
        """Return the numbering of a band's nodes and the ghosts of each boundary."""
        counts = tuple(len(group.nodes) for group in ghosts)
        return cls(len(band.nodes), band.inner, counts, tuple(group.unknowns for group in ghosts))

    @property
    def rows(self) -> int:
        """Number of rows of E."""
        return self.nodes + sum(self.ghosts)

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.inner + sum(self.unknown_ghosts)

    @cached_property
    def first_rows(self) -> Ints:
        """(boundaries + 1,) the first row of each boundary's ghosts, and the number of rows."""
        return np.cumsum([self.nodes, *self.ghosts]).astype(np.int64)

    @cached_property
    def first_unknowns(self) -> Ints:
        """(boundaries + 1,) the first unknown of each boundary's ghosts, and the number of unknowns."""
        return np.cumsum([self.inner, *self.unknown_ghosts]).astype(np.int64)

    def rows_of(self, boundary: int) -> slice:
        """Return the rows of a boundary's ghosts."""
        return slice(int(self.first_rows[boundary]), int(self.first_rows[boundary + 1]))

    def unknowns_of(self, boundary: int) -> slice:
        """Return the unknowns of a boundary's ghosts."""
        return slice(int(self.first_unknowns[boundary]), int(self.first_unknowns[boundary + 1]))

    @cached_property
    def row_of_unknown(self) -> Ints:
        """(unknowns,) the row of E that belongs to each unknown, ascending."""
        ghosts = [first + np.arange(n) for first, n in zip(self.first_rows, self.unknown_ghosts, strict=False)]
        return np.concatenate([np.arange(self.inner), *ghosts])

    @cached_property
    def unknown_of_row(self) -> Ints:
        """(rows,) the unknown that belongs to each row of E, -1 where there is none."""
        unknown = np.full(self.rows, -1)
        unknown[self.row_of_unknown] = np.arange(self.unknowns)
        return unknown

    @cached_property
    def boundary_of_row(self) -> Ints:
        """(rows,) the boundary whose ghost each row belongs to, -1 for nodes."""
        return np.repeat(np.arange(-1, len(self.ghosts)), [self.nodes, *self.ghosts])
