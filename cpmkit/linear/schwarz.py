"""Overlapping Schwarz: blocks of unknowns that hang together, each solved for exactly, all from one residual.

It damps what a velocity carries through a block in one step, where smoothers that know neighbours alone need as many
steps as the block is wide, or grow. Blocks overlap by the neighbours of their unknowns, of which each block keeps
those that are its own (restricted additive Schwarz: Cai and Sarkis, SIAM J. Sci. Comput. 21, 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.linear.factorization import factors_of
from cpmkit.protocols import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Blocks hold so many unknowns at most, their overlap not counted: at half of it a cycle is a third dearer, as more
#: unknowns are solved for twice; at twice of it factors hold a third more.
MOST_IN_BLOCK = 1500


@dataclass(frozen=True, eq=False)
class Block:
    """Some unknowns with the factors of their part of a matrix.

    Attributes
    ----------
    unknowns : (k,) int64
        Own ones and their neighbours.
    own : (m,) int64
        Where the own ones stand among these.
    factors : SuperLU
        Of the rows and columns of these unknowns.
    """

    unknowns: Ints
    own: Ints
    factors: Any


@dataclass(frozen=True, eq=False)
class Schwarz:
    """Blocks that hold every unknown once."""

    blocks: Sequence[Block]

    def apply(self, residual: Floats) -> Floats:
        """Return the corrections (n, channels) for a residual."""
        found = np.empty_like(residual)
        for block in self.blocks:
            found[block.unknowns[block.own]] = block.factors.solve(residual[block.unknowns])[block.own]
        return found


def schwarz(matrix: csr_array) -> Schwarz:
    """Return overlapping blocks of a matrix whose pattern is symmetric."""
    blocks = []
    for own in bisected(matrix):
        unknowns = np.unique(matrix[own].indices).astype(np.int64)
        part = matrix[unknowns][:, unknowns]
        blocks.append(Block(unknowns, np.searchsorted(unknowns, own), factors_of(part, symmetric_pattern=True)))
    return Schwarz(blocks)


def bisected(matrix: csr_array, most: int = MOST_IN_BLOCK) -> list[Ints]:
    """Return the unknowns in compact parts of at most ``most``, each ascending.

    A part is halved where a search in breadth, from an unknown at its end, has seen half of it.
    """
    waiting, done = [np.arange(matrix.shape[0])], []
    while waiting:
        part = waiting.pop()
        if len(part) <= most:
            done.append(np.sort(part))
            continue
        order = part[_in_breadth(matrix if len(part) == matrix.shape[0] else matrix[part][:, part])]
        waiting += [order[: len(order) // 2], order[len(order) // 2 :]]
    return done


def _in_breadth(matrix: csr_array) -> Ints:
    """Return all unknowns, piece by piece, each searched in breadth from one that is far from another."""
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    count, piece = connected_components(matrix, directed=False)
    first = np.unique(piece, return_index=True)[1] if count > 1 else np.zeros(1, dtype=np.int64)
    found = []
    for start in first.tolist():
        far = breadth_first_order(matrix, start, directed=True, return_predecessors=False)[-1]
        found.append(breadth_first_order(matrix, far, directed=True, return_predecessors=False))
    return np.concatenate(found).astype(np.int64)
