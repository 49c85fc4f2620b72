"""Sparse matrices made of blocks, one row and column of blocks for each part of a union."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def block_diagonal(matrices: Sequence[Any]) -> Any:
    """Return the sparse matrix with the ``matrices`` on its diagonal."""
    from scipy.sparse import block_diag

    return block_diag(matrices, format="csr")


def add_blocks(blocks: list[list[Any]], high: int, low: int, added: Sequence[Any]) -> None:
    """Add the blocks (n, n), (n, m) and (m, m) of a junction of the parts ``high`` and ``low`` to ``blocks``."""
    upper, across, lower = added
    for row, column, block in ((high, high, upper), (high, low, across), (low, high, across.T), (low, low, lower)):
        before = blocks[row][column]
        blocks[row][column] = block if before is None else before + block


def stack_blocks(blocks: list[list[Any]]) -> Any:
    """Return the sparse matrix of ``blocks`` by row and column, None for zero, with ascending columns."""
    from scipy.sparse import block_array

    matrix = block_array(blocks, format="csr")
    matrix.sort_indices()
    return matrix
