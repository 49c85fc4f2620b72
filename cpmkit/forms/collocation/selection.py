"""Which unknown, or which row of E, a stencil reads in each of its nodes: the node's own, its twin's or its ghost's.

A stencil reads, in each node, the value that belongs to its own sheet of the surface and to its own side of every
boundary. One function chooses, for interpolation and difference stencils alike.
King et al. (2024), eq. 12, as eq. 13 for the stencils of nodes and eq. 14 for those of ghosts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from cpmkit.forms.collocation.ghosts.ghosts import Ghosts
    from cpmkit.forms.collocation.side_view import SideView
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


@dataclass(frozen=True, eq=False)
class Centres:
    """Where n stencils are centred on a surface.

    Attributes
    ----------
    side_views : sequence of SideView
        How each boundary sees the centres; their rows number the stencils.
    owner : (n,) int64
        The boundary whose ghost the stencil belongs to; -1 where it belongs to a node or a point.
    feet : ClosestPoints, optional
        The surface's records of the centres: where several of its sheets share the band.
    normals : (n, d) float64, optional
        Of the surface, NaN where they are not known yet.
    """

    side_views: Sequence[SideView]
    owner: Ints
    feet: ClosestPoints | None = None
    normals: Floats | None = None

    @classmethod
    def of_points(cls, feet: ClosestPoints, side_views: Sequence[SideView] = ()) -> Centres:
        """Return the centres of stencils at points of the surface that belong to no ghost."""
        return cls(side_views, np.full(len(feet), -1), feet)

    @classmethod
    def of_nodes(cls, band: Band, nodes: Ints) -> Centres:
        """Return the centres of stencils at the feet of nodes (n,), which see no boundary."""
        n = None if band.sheets is None else band.sheets.normals[nodes]
        return cls((), np.full(len(nodes), -1), band.feet.take(nodes), n)

    def take(self, rows: Ints) -> Centres:
        """Return the centres of the stencils ``rows`` (ascending), numbered from zero."""
        side_views = []
        for view in self.side_views:
            position = np.searchsorted(rows, view.rows)
            inside = (position < len(rows)) & (rows[np.minimum(position, len(rows) - 1)] == view.rows)
            side_views.append(replace(view.take(inside), rows=position[inside]))
        feet = None if self.feet is None else self.feet.take(rows)
        return Centres(side_views, self.owner[rows], feet, None if self.normals is None else self.normals[rows])


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns, which stencils read: the inner nodes of a band, and after them the ghosts of each boundary.

    Attributes
    ----------
    band : Band
        The nodes.
    ghosts : sequence of Ghosts
        Those of each boundary.
    """

    band: Band
    ghosts: Sequence[Ghosts] = ()

    @cached_property
    def numbering(self) -> Numbering:
        """The numbers of rows of E and of unknowns."""
        counts = tuple(len(group.nodes) for group in self.ghosts)
        return Numbering(len(self.band.nodes), self.band.inner, counts, tuple(group.unknowns for group in self.ghosts))

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return self.numbering.unknowns

    @property
    def ghost_nodes(self) -> Ints:
        """(g, 2) the number of its boundary, and of its node in the band, of each ghost that is an unknown."""
        parts = [
            np.stack([np.full(group.unknowns, index), group.nodes[: group.unknowns]], axis=1)
            for index, group in enumerate(self.ghosts)
        ]
        return np.concatenate([np.zeros((0, 2), dtype=np.int64), *parts])

    @property
    def ghost_sides(self) -> Bools:
        """(g,) whether each ghost that is an unknown continues the left of its boundary."""
        return np.concatenate([np.zeros(0, bool), *(group.carries_left[: group.unknowns] for group in self.ghosts)])

    def select(self, centres: Centres, columns: Ints) -> Ints:
        """Return the unknowns (n, s) that n stencils read in the inner nodes ``columns`` (n, s).

        That of the stencil's own sheet, and, where a boundary runs between, the ghost that continues its side.
        """
        numbers = [group.unknown_numbers for group in self.ghosts]
        return self._select(centres, columns, self.band.inner, numbers, self.numbering.first_unknowns)

    def select_rows(self, centres: Centres, columns: Ints) -> Ints:
        """Return the rows of E (n, s) that n stencils read in the nodes ``columns`` (n, s) of the band, likewise."""
        numbers = [group.numbers for group in self.ghosts]
        return self._select(centres, columns, len(self.band.nodes), numbers, self.numbering.first_rows)

    def _select(self, centres: Centres, columns: Ints, readable: int, numbers: Sequence[Ints], first: Ints) -> Ints:
        """Return the choice among the sites below ``readable`` and the ghosts of these ``numbers``."""
        nodes = self._on_own_sheet(centres, columns, readable)
        if not any(len(view.rows) for view in centres.side_views):
            return nodes
        touched = np.unique(np.concatenate([view.rows for view in centres.side_views]))
        directors = [group.director for group in self.ghosts]
        boundary, number = visible_ghosts(centres.take(touched), nodes[touched], numbers, directors)
        selected = nodes.copy()
        selected[touched] = np.where(boundary >= 0, first[boundary] + number, nodes[touched])
        return selected

    def _on_own_sheet(self, centres: Centres, columns: Ints, readable: int) -> Ints:
        """Return stencils (n, s) with nodes of other sheets replaced by their twins."""
        sheets = self.band.sheets
        if sheets is None:
            return columns
        touched = np.flatnonzero(sheets.counts(columns).any(axis=1))
        if not len(touched):
            return columns
        assert centres.feet is not None  # recorded wherever several sheets share the band
        feet, n = centres.feet.take(touched), np.full((len(touched), self.band.dim), np.nan)
        if centres.normals is not None:
            n = centres.normals[touched]
        unknown = np.isnan(n).any(axis=1)
        n[unknown] = unit_normals(sheets.source, feet.take(unknown), 0.5 * self.band.spacing)
        selected = columns.copy()
        may_be_read = np.arange(len(self.band.nodes)) < readable
        selected[touched] = sheets.select_twins(feet, n, columns[touched], may_be_read)[0]
        return selected


def visible_ghosts(
    centres: Centres, nodes: Ints, numbers: Sequence[Ints], directors: Sequence[Floats]
) -> tuple[Ints, Ints]:
    """Return the ghosts that stencils read in place of nodes that lie across a boundary.

    A node is replaced where the directors of stencil and node have a negative product and the node
    has a ghost there (past an open end it has none). Where several boundaries are crossed, the
    stencil's own comes first, else the one nearest to it. (Differs from adding the weight once a
    boundary, which counts it twice where two are crossed.)

    Parameters
    ----------
    centres : Centres
        Of n stencils.
    nodes : (n, s) int64
        Node numbers of the stencils.
    numbers : sequence of (nodes,) int64
        For each boundary, the number of each node's ghost, -1 where it has none that can be read here.
    directors : sequence of (ghosts, d) float64
        For each boundary, the directors of its ghosts' nodes.

    Returns
    -------
    boundary, number : (n, s) int64
        The boundary whose ghost is read and the ghost's number; -1 where the node itself is.
    """
    boundary = np.full(nodes.shape, -1)
    number = np.full(nodes.shape, -1)
    nearest = np.full(nodes.shape, np.inf)
    for index, view in enumerate(centres.side_views):
        rows = view.rows
        ghost_of_node = numbers[index][nodes[rows]]
        row, column = np.nonzero(ghost_of_node >= 0)
        ghost = ghost_of_node[row, column]
        across = np.einsum("kd,kd->k", view.director[row], directors[index][ghost]) < 0
        rank = np.where(centres.owner[rows] == index, -1.0, view.distance)[row]
        row = rows[row]
        better = across & (rank < nearest[row, column])
        row, column = row[better], column[better]
        boundary[row, column], number[row, column], nearest[row, column] = index, ghost[better], rank[better]
    return boundary, number
