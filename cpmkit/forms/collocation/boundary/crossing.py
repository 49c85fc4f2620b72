"""Which unknown a stencil reads in each of its nodes: the node's own, or a ghost's.

A stencil sees, in each node, the value that belongs to its own side of every boundary. One function
chooses, for interpolation and difference stencils alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.boundary.frame import Frame
from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class View:
    """How a batch of n stencils sees the boundaries.

    Attributes
    ----------
    frames : sequence of Frame
        One a boundary; their rows number the stencils.
    own : (n,) int64
        The boundary whose ghost the stencil belongs to; -1 where it belongs to a node or a point.
    """

    frames: Sequence[Frame]
    own: Ints

    @classmethod
    def of_points(cls, frames: Sequence[Frame], count: int) -> View:
        """Return the view of ``count`` points that belong to no ghost."""
        return cls(frames, np.full(count, -1))

    def select(self, rows: Ints) -> View:
        """Return the view of the stencils ``rows`` (ascending), numbered from zero."""
        frames = []
        for frame in self.frames:
            place = np.searchsorted(rows, frame.rows)
            inside = (place < len(rows)) & (rows[np.minimum(place, len(rows) - 1)] == frame.rows)
            frames.append(frame.take(inside).renumbered(place[inside]))
        return View(frames, self.own[rows])


def visible_ghosts(view: View, nodes: Ints, numbers: Sequence[Ints], directors: Sequence[Floats]) -> tuple[Ints, Ints]:
    """Choose a ghost for the stencil nodes that lie across a boundary.

    A node is replaced where the directors of stencil and node have a negative product and the node
    has a ghost there (past an open end it has none). Where several boundaries are crossed, the
    stencil's own comes first, else the one nearest to it. (Differs from adding the weight once a
    boundary, which counts it twice where two are crossed.)

    Parameters
    ----------
    view : View
        Of n stencils.
    nodes : (n, s) int64
        Node numbers of the stencils.
    numbers : sequence of (nodes,) int64
        For each boundary, the number of each node's ghost, -1 where it has none that can be read here.
    directors : sequence of (ghosts, d) float64
        For each boundary, the directors of its ghosts' nodes.

    Returns
    -------
    label, number : (n, s) int64
        The boundary whose ghost is read and the ghost's number; -1 where the node itself is.
    """
    label = np.full(nodes.shape, -1)
    number = np.full(nodes.shape, -1)
    nearest = np.full(nodes.shape, np.inf)
    for index, seen in enumerate(view.frames):
        rows = seen.rows
        ghost = numbers[index][nodes[rows]]
        row, column = np.nonzero(ghost >= 0)
        found = ghost[row, column]
        across = np.einsum("kd,kd->k", seen.director[row], directors[index][found]) < 0
        rank = np.where(view.own[rows] == index, -1.0, seen.distance)[row]
        row = rows[row]
        taken = across & (rank < nearest[row, column])
        row, column = row[taken], column[taken]
        label[row, column], number[row, column], nearest[row, column] = index, found[taken], rank[taken]
    return label, number
