"""Selection of the unknown, or the row of the extension matrix E, that a stencil reads at each of its nodes.

A stencil reads the value on its own sheet of the surface and on its own side of every boundary: the node's own unknown,
that of its twin on another sheet, or that of its ghost, which continues one side of a boundary.
The same function selects for interpolation stencils and for difference stencils.
King et al. (2024), eq. 12, as eq. 13 for the stencils of nodes and eq. 14 for those of ghosts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.forms.collocation.ghosts.ghosts import Ghosts
from cpmkit.forms.collocation.side_view import SideView
from cpmkit.grid.band import Band
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class Centres:
    """The points of a surface at which n stencils are centred."""

    #: For each boundary, the distances and sides of the centres near it; their rows are numbers of stencils.
    side_views: Sequence[SideView]
    owner: Ints  #: (n,): the boundary whose ghost the stencil belongs to; -1 for that of a node or of any other point.
    #: The surface's closest point records of the centres; needed where several of its sheets share the band.
    feet: ClosestPoints | None = None
    normals: Floats | None = None  #: (n, d): unit normals of the surface at the centres, NaN where not computed yet.

    @classmethod
    def of_points(cls, feet: ClosestPoints, side_views: Sequence[SideView] = ()) -> Centres:
        """Return the centres of stencils at the points of these records; no stencil belongs to a ghost."""
        return cls(side_views, np.full(len(feet), -1), feet)

    def take(self, rows: Ints) -> Centres:
        """Return the centres of the stencils ``rows`` (k,), ascending, renumbered from zero, with their side views."""
        side_views = []
        for view in self.side_views:
            position = np.searchsorted(rows, view.rows)
            inside = (position < len(rows)) & (rows[np.minimum(position, len(rows) - 1)] == view.rows)
            side_views.append(replace(view.take(inside), rows=position[inside]))
        feet = None if self.feet is None else self.feet.take(rows)
        return Centres(side_views, self.owner[rows], feet, None if self.normals is None else self.normals[rows])


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns that stencils read, and the rows of the extension matrix E.

    Rows are the nodes of the band, then the ghosts of each boundary in turn. Unknowns are numbered in the same order,
    but are only the rows whose values E reads: the inner nodes, and the first ghosts of each boundary.
    """

    band: Band  #: The nodes and their closest points.
    ghosts: Sequence[Ghosts] = ()  #: The ghosts of each boundary.

    @property
    def rows(self) -> int:
        """The number of rows of E."""
        return int(self.first_rows[-1])

    @property
    def count(self) -> int:
        """The number of unknowns."""
        return int(self.first_unknowns[-1])

    @cached_property
    def first_rows(self) -> Ints:
        """(boundaries + 1,) the first row of each boundary's ghosts, then the number of rows."""
        return np.cumsum([len(self.band.nodes), *(len(group.nodes) for group in self.ghosts)])

    @cached_property
    def first_unknowns(self) -> Ints:
        """(boundaries + 1,) the first unknown of each boundary's ghosts, then the number of unknowns."""
        return np.cumsum([self.band.inner, *(group.unknowns for group in self.ghosts)])

    def rows_of(self, boundary: int) -> slice:
        """Return the slice of the rows of E that are ghosts of this boundary."""
        return slice(int(self.first_rows[boundary]), int(self.first_rows[boundary + 1]))

    def unknowns_of(self, boundary: int) -> slice:
        """Return the slice of the unknowns that are ghosts of this boundary."""
        return slice(int(self.first_unknowns[boundary]), int(self.first_unknowns[boundary + 1]))

    @cached_property
    def row_of_unknown(self) -> Ints:
        """(unknowns,) the row of E of each unknown, ascending."""
        ghosts = [first + np.arange(group.unknowns) for first, group in zip(self.first_rows, self.ghosts, strict=False)]
        return np.concatenate([np.arange(self.band.inner), *ghosts])

    @cached_property
    def unknown_of_row(self) -> Ints:
        """(rows,) the unknown of each row of E, -1 where the row's value is not an unknown."""
        unknown = np.full(self.rows, -1)
        unknown[self.row_of_unknown] = np.arange(self.count)
        return unknown

    @property
    def ghost_nodes(self) -> Ints:
        """(g, 2) for each ghost that is an unknown, the number of its boundary and of its node in the band."""
        parts = [
            np.stack([np.full(group.unknowns, index), group.nodes[: group.unknowns]], axis=1)
            for index, group in enumerate(self.ghosts)
        ]
        return np.concatenate([np.zeros((0, 2), dtype=np.int64), *parts])

    @property
    def ghost_sides(self) -> Bools:
        """(g,) for each ghost that is an unknown, whether it continues the solution from the left of its boundary."""
        return np.concatenate([np.zeros(0, bool), *(group.continues_left[: group.unknowns] for group in self.ghosts)])

    def select(self, centres: Centres, columns: Ints) -> Ints:
        """Return the unknowns (n, s) that n stencils read at the inner nodes ``columns`` (n, s).

        At each node this is the unknown on the stencil's own sheet or, where a boundary separates node and centre, the
        ghost that continues the solution from the stencil's side.
        """
        numbers = [group.unknown_numbers for group in self.ghosts]
        return self._select(centres, columns, self.band.inner, numbers, self.first_unknowns)

    def select_rows(self, centres: Centres, columns: Ints) -> Ints:
        """Return the rows of E (n, s) that n stencils read at the nodes ``columns`` (n, s) of the band.

        They are chosen as in :meth:`select`, with outer nodes and all ghosts allowed.
        """
        numbers = [group.numbers for group in self.ghosts]
        return self._select(centres, columns, len(self.band.nodes), numbers, self.first_rows)

    def _select(self, centres: Centres, columns: Ints, readable: int, numbers: Sequence[Ints], first: Ints) -> Ints:
        """Return the numbers (n, s) that n stencils read at the nodes ``columns`` (n, s).

        Nodes below ``readable`` may be read. For each boundary, ``numbers`` (nodes,) is the number of each node's ghost
        (-1: none), and ``first`` (boundaries + 1,) what is added to it.
        """
        nodes = self._replace_by_twins(centres, columns, readable)
        if not any(len(view.rows) for view in centres.side_views):
            return nodes
        touched = np.unique(np.concatenate([view.rows for view in centres.side_views]))
        directors = [group.geometry.seen.director for group in self.ghosts]
        boundary, number = visible_ghosts(centres.take(touched), nodes[touched], numbers, directors)
        selected = nodes.copy()
        selected[touched] = np.where(boundary >= 0, first[boundary] + number, nodes[touched])
        return selected

    def _replace_by_twins(self, centres: Centres, columns: Ints, readable: int) -> Ints:
        """Return ``columns`` (n, s) with nodes of other sheets replaced by their twins with numbers < ``readable``."""
        sheets = self.band.sheets
        if sheets is None:
            return columns
        touched = np.flatnonzero(sheets.twin_counts(columns).any(axis=1))
        if not len(touched):
            return columns
        assert centres.feet is not None  # always given where several sheets share the band
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
    """Return the ghosts that n stencils read in place of nodes on the other side of a boundary.

    A node is replaced if the directors of stencil and node (see `SideView`) have a negative product and the node has a
    ghost (past an open end it has none). If several boundaries are between, the ghost is that of the boundary to which
    the stencil itself belongs, else that of the boundary nearest to the stencil. (Differs from adding the weight once
    for each boundary, which counts it twice where two boundaries are crossed.)

    ``centres``: centres of the n stencils.
    ``nodes`` (n, s): node numbers of the stencils.
    ``numbers`` sequence of (nodes,) int64: for each boundary, the number of each node's ghost, -1 where it has none
        that can be read here.
    ``directors`` sequence of (ghosts, d) float64: for each boundary, the directors of its ghosts' nodes.
    Returned ``boundary``, ``number`` (n, s): the boundary whose ghost is read and the ghost's number; both -1 where the
        node itself is read.
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
