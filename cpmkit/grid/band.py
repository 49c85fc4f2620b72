"""The band: the lattice nodes on which a surface's PDE is solved.

Inner nodes are those that an interpolation stencil of a surface point reads: the unknowns. Outer
nodes are their difference neighbours, at which only the extension E u is needed.
Differs from King et al. (2024), eq. 4: nodes that no stencil reads are left out, though they lie within that radius.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.fitting import check_fits
from cpmkit.grid.lattice import Codes, find
from cpmkit.grid.stencils import base_offset, stencil_range
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import ClosestPoints, Floats, Ints, Progress, no_progress
from cpmkit.runtime.arrays import check_size, length

if TYPE_CHECKING:
    from cpmkit.forms.collocation.sheets.sheets import Sheets

#: Share of a cell's half diagonal by which a cell is kept although the surface seems to miss it: rounding.
CELL_SLACK_SHARE = 1e-6
#: Cells along an axis that can be numbered.
MOST_CELLS_PER_AXIS = 2.0**40
#: From so many blocks on, they tell how large the band will be.
TELLING_BLOCKS = 20_000
#: Nodes whose closest points are asked for at a time.
BAND_PARCEL_NODES = 1 << 17


@dataclass(frozen=True, eq=False)
class Band:
    """Nodes around a surface, inner ones first.

    Attributes
    ----------
    spacing, degree : float, int
        Spacing of the lattice and degree of the interpolation that reads the band.
    nodes : (n, d) int64
        Lattice nodes, the ``inner`` unknowns first, each part in the order of its codes.
    inner : int
        How many of the nodes are inner.
    feet : ClosestPoints
        Of all nodes, relative to the lattice's origin.
    codes : Codes
        The numbering under which nodes are looked up.
    own_inner, own_outer : int
        How many of the inner and of the outer nodes come first in their part and are no twins; -1 for all.
    sheets : Sheets or None
        The twins, where several sheets share nodes of the band.
    """

    spacing: float
    degree: int
    nodes: Ints
    inner: int
    feet: ClosestPoints
    codes: Codes
    own_inner: int = -1
    own_outer: int = -1
    sheets: Sheets | None = None

    @property
    def dim(self) -> int:
        """Dimension d of the space."""
        return int(self.nodes.shape[1])

    @property
    def positions(self) -> Floats:
        """(n, d) nodes in units of length, relative to the lattice's origin."""
        return np.asarray(self.nodes * self.spacing, dtype=np.float64)

    @property
    def first_twin(self) -> int:
        """How many of the inner nodes are no twins; those from there up to ``inner`` are."""
        return self.inner if self.sheets is None else self.own_inner

    def neighbours(self) -> tuple[Ints, Ints]:
        """Return the pairs (n,), (n,) of inner nodes that are neighbours along an axis; no twins."""
        nodes = np.arange(self.first_twin)
        pairs = []
        for axis in np.eye(self.dim, dtype=np.int64):
            beside = self.find_inner(self.nodes[nodes] + axis)
            pairs.append(np.stack([nodes[beside >= 0], beside[beside >= 0]]))
        first, second = np.concatenate(pairs, axis=1)
        return first, second

    def find_inner(self, nodes: Ints) -> Ints:
        """Return the numbers of integer ``nodes`` (..., d) among the inner nodes, -1 where they are none."""
        return find(self._inner_codes, self.codes.encode(nodes))

    def find(self, nodes: Ints) -> Ints:
        """Return the numbers of integer ``nodes`` (..., d) in the band, -1 where they are outside."""
        codes = self.codes.encode(nodes)
        inner, outer = find(self._inner_codes, codes), find(self._outer_codes, codes)
        return np.where(inner >= 0, inner, np.where(outer >= 0, outer + self.inner, -1))

    @cached_property
    def _inner_codes(self) -> Ints:
        return self.codes.encode(self.nodes[: self.first_twin])

    @cached_property
    def _outer_codes(self) -> Ints:
        stop = len(self.nodes) if self.sheets is None else self.inner + self.own_outer
        return self.codes.encode(self.nodes[self.inner : stop])


def cell_levels(source: LocalSource, spacing: float, offset: float | Floats) -> Iterator[tuple[int, Ints]]:
    """Yield, from coarse to fine, the side in cells and the indices (k, d) of all blocks that the manifold may meet.

    A block is kept if the distance at its centre is at most half its diagonal. As distance is
    1-Lipschitz and never above the true one, no block that holds a point of the manifold is lost,
    whatever its number of pieces; at the last level, side 1, the blocks are cells.
    Differs from King et al. (2024), section 5.1, Algorithm 1, which searches from one node and finds one piece.
    """
    cells = _numbered(source.bounds, spacing, offset)
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
    """Refuse bounds (2, d), relative to the lattice's origin, whose cells cannot be numbered.

    Raises
    ------
    ResolutionError
        If the bounds are no finite numbers, or there would be more cells than can be numbered.
    InputError
        If coordinates are too large or too close together to compute with.
    """
    if not np.isfinite(bounds).all() or (bounds[1] < bounds[0]).any():
        raise ResolutionError("The bounds of the source must be finite, the lower corner first; its class is at fault.")
    farthest = float(np.abs(bounds).max())
    check_size(bounds, "coordinates relative to the lattice's origin")
    length(spacing, "spacing")
    if farthest > MOST_CELLS_PER_AXIS * spacing:
        raise ResolutionError(
            f"spacing={spacing:g} is too small to number the nodes: the source reaches {farthest:.3g} from the "
            f"lattice's origin, and a spacing of {farthest / MOST_CELLS_PER_AXIS:.2g} or more could be numbered; a far "
            "larger one is needed to fit into memory."
        )


def _numbered(bounds: Floats, spacing: float, offset: float | Floats) -> Ints:
    """Return (2, d) the first and the last cell of ``bounds`` along each axis."""
    check_numbered(bounds, spacing)
    return np.floor(bounds / spacing + offset).astype(np.int64)


def surface_cells(source: LocalSource, spacing: float, degree: int) -> Ints:
    """Return the interpolation cells (c, d) that hold the manifold, and a few at its side.

    Raises
    ------
    ResolutionError
        If the band of these cells would not fit into the machine's memory, as soon as that shows.
    """
    manifold_dim = source.largest_dim
    for side, blocks in cell_levels(source, spacing, base_offset(degree)):
        unknowns = nodes_of_blocks(len(blocks), side, source.dim, manifold_dim, degree)
        if side == 1 or len(blocks) > TELLING_BLOCKS:
            # While blocks are coarse, thin parts look as thick as a block: only a clear excess is refused early.
            check_fits(source, unknowns, spacing, degree, excess=1.0 if side == 1 else 4.0)
    return blocks


def nodes_of_blocks(blocks: int, side: int, dim: int, manifold_dim: int, degree: int) -> float:
    """Return about how many inner nodes a manifold has that meets so many blocks of a side in cells.

    A block of an m-dimensional piece has side^m cells at the end, each with about 0.9 (p + 1)^(d - m) nodes
    (measured on circle and sphere).
    """
    return float(blocks * float(side) ** manifold_dim * 0.9 * (degree + 1) ** (dim - manifold_dim))


def stencil_codes(cells: Ints, codes: Codes, degree: int) -> Ints:
    """Return the codes of all nodes of the stencils in interpolation cells (c, d), in order."""
    nodes = np.sort(codes.encode(cells))
    for axis in range(cells.shape[1]):
        nodes = codes.dilate(nodes, axis, stencil_range(degree))
    return nodes


def build_band(source: LocalSource, spacing: float, degree: int, progress: Progress = no_progress) -> Band:
    """Find the nodes of the band of ``source`` and their closest points.

    Every surface point's stencil is in the band, not only those of the nodes' own closest points,
    so that a solution can be read anywhere. Outer nodes reach one node farther along each axis.

    Raises
    ------
    ResolutionError
        If the band would not fit into memory.
    """
    progress("band", 0.0)
    cells = surface_cells(source, spacing, degree)
    if not len(cells):
        raise ResolutionError(
            "The source has no point inside its own bounds: its closest points and bounds contradict each other."
        )
    codes = Codes.around(cells, degree + 2)
    inner = stencil_codes(cells, codes, degree)
    reach = range(-1, 2)
    around = [codes.dilate(inner, axis, reach) for axis in range(source.dim)]
    outer = np.setdiff1d(np.unique(np.concatenate(around)), inner, assume_unique=True)
    nodes = codes.decode(np.concatenate([inner, outer]))
    return Band(spacing, degree, nodes, len(inner), _feet(source, nodes, spacing, progress), codes)


def _feet(source: LocalSource, nodes: Ints, spacing: float, progress: Progress) -> ClosestPoints:
    """Return the closest points of all nodes, asked in parcels."""
    parts = []
    for start in range(0, len(nodes), BAND_PARCEL_NODES):
        progress("band", start / len(nodes))
        parts.append(
            source.closest_point(np.asarray(nodes[start : start + BAND_PARCEL_NODES] * spacing, dtype=np.float64))
        )
    progress("band", 1.0)
    return ClosestPoints.join(parts)
