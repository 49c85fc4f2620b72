"""The blocks of lattice cells that a manifold meets, from coarse to fine."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.manifold.local_source import LocalSource
from cpmkit.runtime.arrays import check_size, length
from cpmkit.types import Floats, Ints

#: Share of a block's half diagonal within which the distance at its centre may exceed it, for rounding.
CELL_SLACK_SHARE = 1e-6
#: Largest number of cells along an axis that can be numbered.
MOST_CELLS_PER_AXIS = 2.0**40


def cell_levels(source: LocalSource, spacing: float, offset: float | Floats) -> Iterator[tuple[int, Ints]]:
    """Yield, from coarse to fine, the side in cells and the indices (k, d) of the blocks that may meet the manifold.

    A block is selected if the distance at its centre is at most half its diagonal. Since ``distance`` is 1-Lipschitz
    and at most the true distance, no block with a point of the manifold is missed, whatever the number of connected
    components. At the last level, side 1, the blocks are cells.
    Differs from King et al. (2024), section 5.1, Algorithm 1, which searches from one node and finds one component.

    Parameters
    ----------
    source : LocalSource
    spacing : float
        Side of a cell.
    offset : float or (d,) float64
        Shift of the cells against the nodes, in cells.
    """
    check_numbered(source.bounds, spacing)
    cells = np.floor(source.bounds / spacing + offset).astype(np.int64)  # the first and the last along each axis
    extent = int((cells[1] - cells[0]).max()) + 1
    side = 1 << max(extent - 1, 0).bit_length()
    dim = source.dim
    children = np.stack(np.meshgrid(*[np.arange(2)] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    lower, upper = cells[0] // side, cells[1] // side
    blocks = np.stack(np.meshgrid(*[np.arange(a, b + 1) for a, b in zip(lower, upper, strict=True)], indexing="ij"), -1)
    blocks = blocks.reshape(-1, dim)
    while side > 1 and len(blocks) <= len(children):  # nothing is far from blocks as large as the manifold
        blocks, side = (2 * blocks[:, None] + children).reshape(-1, dim), side // 2
    while True:
        centres = np.asarray(((blocks + 0.5) * side - offset) * spacing, dtype=np.float64)
        reach = 0.5 * np.sqrt(dim) * side * spacing * (1 + CELL_SLACK_SHARE)
        blocks = blocks[source.closest_point(centres).distance <= reach]
        yield side, blocks
        if side == 1:
            return
        blocks = (2 * blocks[:, None] + children).reshape(-1, dim)
        side //= 2


def check_numbered(bounds: Floats, spacing: float) -> None:
    """Raise if the cells of a box with corners ``bounds`` (2, d), relative to the lattice's origin, cannot be numbered.

    Raises
    ------
    ResolutionError
        If the bounds are no finite numbers, or there would be more cells than can be numbered.
    InputError
        If coordinates are too large or too close together to compute with.
    """
    if not np.isfinite(bounds).all() or (bounds[1] < bounds[0]).any():
        raise ResolutionError(
            "The bounds of the source must be finite, the lower corner first; the error is in its class."
        )
    farthest = float(np.abs(bounds).max())
    check_size(bounds, "coordinates relative to the lattice's origin")
    length(spacing, "spacing")
    if farthest > MOST_CELLS_PER_AXIS * spacing:
        raise ResolutionError(
            f"spacing={spacing:g} is too small to number the nodes: the source reaches {farthest:.3g} from the "
            f"lattice's origin, and a spacing of {farthest / MOST_CELLS_PER_AXIS:.2g} or more could be numbered; a far "
            "larger one is needed to fit into memory."
        )


def nodes_of_blocks(blocks: int, side: int, dim: int, manifold_dim: int, degree: int) -> float:
    """Estimate the number of inner nodes of the band of a manifold that meets this many blocks.

    A block of an m-dimensional manifold contains about side^m cells that meet it, each with about
    0.9 (p + 1)^(d - m) nodes (measured on circle and sphere).

    Parameters
    ----------
    blocks, side : int
        Number of blocks, and their side in cells.
    dim, manifold_dim : int
        d and m.
    degree : int
        p, of the interpolation.
    """
    return float(blocks * float(side) ** manifold_dim * 0.9 * (degree + 1) ** (dim - manifold_dim))
