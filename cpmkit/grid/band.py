"""The band: the lattice nodes on which a surface's PDE is solved.

Inner nodes, the unknowns, are those that the interpolation stencil of some surface point reads. Outer nodes are their
difference neighbours, at which only the extension E u is needed.
Differs from King et al. (2024), eq. 4: nodes within its radius that no stencil reads are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.lattice import Codes, cell_levels, find_codes, nodes_of_blocks
from cpmkit.grid.spacings import COUNTED_BLOCKS, check_band_memory
from cpmkit.grid.stencils import base_offset, stencil_range, tensor_offsets
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints
from cpmkit.types import Floats, Ints, Progress, no_progress

#: Number of nodes in one batch of closest point queries: it bounds temporary memory.
BATCH_NODES = 1 << 17


@dataclass(frozen=True, eq=False)
class Band:
    """Lattice nodes around a manifold, inner nodes first.

    Where several sheets of the manifold share nodes, the collocation form adds copies of nodes, one for each further
    sheet, called twins.
    """

    #: spacing, degree, float, int: spacing of the lattice and degree of the interpolation.
    spacing: float
    degree: int
    nodes: Ints  #: (n, d): lattice nodes, the ``inner`` unknowns first, each part in the order of its codes.
    inner: int  #: Number of inner nodes.
    feet: ClosestPoints  #: Closest points of all nodes, relative to the lattice's origin.
    codes: Codes  #: Numbering by which nodes are found.
    #: own_inner, own_outer: Number of inner and of outer nodes that are no twins, and come first in their part; -1 for
    #: all.
    own_inner: int = -1
    own_outer: int = -1
    sheets: Any = None  #: object: the collocation form's record of the twins.

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
        """Number of inner nodes that are no twins: inner twins have the numbers from this up to ``inner``."""
        return self.inner if self.sheets is None else self.own_inner

    def neighbours(self) -> tuple[Ints, Ints]:
        """Return the numbers of the lower (k,) and upper (k,) node of all pairs of adjacent inner nodes, no twins."""
        nodes = np.arange(self.first_twin)
        pairs = []
        for axis in np.eye(self.dim, dtype=np.int64):
            neighbour = self.find_inner(self.nodes[nodes] + axis)
            pairs.append(np.stack([nodes[neighbour >= 0], neighbour[neighbour >= 0]]))
        first, second = np.concatenate(pairs, axis=1)
        return first, second

    def find_inner(self, nodes: Ints) -> Ints:
        """Return the numbers (...) of integer ``nodes`` (..., d) among the inner nodes but twins, -1 for others."""
        return find_codes(self._inner_codes, self.codes.encode(nodes))

    def find(self, nodes: Ints) -> Ints:
        """Return the numbers (...) of integer ``nodes`` (..., d) in the band, not of twins; -1 for nodes outside it."""
        codes = self.codes.encode(nodes)
        inner, outer = find_codes(self._inner_codes, codes), find_codes(self._outer_codes, codes)
        return np.where(inner >= 0, inner, np.where(outer >= 0, outer + self.inner, -1))

    @cached_property
    def _inner_codes(self) -> Ints:
        """(k,) sorted codes of the inner nodes that are no twins."""
        return self.codes.encode(self.nodes[: self.first_twin])

    @cached_property
    def _outer_codes(self) -> Ints:
        """(k,) sorted codes of the outer nodes that are no twins."""
        stop = len(self.nodes) if self.sheets is None else self.inner + self.own_outer
        return self.codes.encode(self.nodes[self.inner : stop])


def surface_cells(source: LocalSource, spacing: float, degree: int) -> Ints:
    """Return the indices (c, d) of the interpolation cells that contain points of the manifold, and a few beside them.

    ``spacing`` is that of the lattice, ``degree`` that of the interpolation. Raises ResolutionError if the cells cannot
    be numbered, or as soon as an estimate shows that their band does not fit into memory.
    """
    manifold_dim = source.largest_dim
    for side, blocks in cell_levels(source, spacing, base_offset(degree)):
        unknowns = nodes_of_blocks(len(blocks), side, source.dim, manifold_dim, degree)
        if side == 1 or len(blocks) > COUNTED_BLOCKS:
            # Coarse blocks overestimate thin parts: only a clear excess is refused early.
            check_band_memory(source, unknowns, spacing, degree, excess=1.0 if side == 1 else 4.0)
    return blocks


def stencil_codes(cells: Ints, codes: Codes, degree: int) -> Ints:
    """Return the sorted codes (n,), in the numbering ``codes``, of the nodes of the stencils of ``cells`` (c, d)."""
    nodes = np.sort(codes.encode(cells))
    for axis in range(cells.shape[1]):
        nodes = codes.dilate(nodes, axis, stencil_range(degree))
    return nodes


def build_band(source: LocalSource, spacing: float, degree: int, progress: Progress = no_progress) -> Band:
    """Return the band of ``source``: its nodes and their closest points.

    The stencil of every surface point is in the band, not only those of the nodes' closest points, so that a solution
    can be evaluated anywhere. Outer nodes reach one node farther along each axis. ``degree`` is that of the
    interpolation; ``progress`` gets "band" and the share of closest points that is computed. Raises ResolutionError if
    the band does not fit into memory or cannot be numbered, or the source has no point inside its bounds.
    """
    progress("band", 0.0)
    cells = surface_cells(source, spacing, degree)
    if not len(cells):
        raise ResolutionError(
            "The source has no point inside its bounds: its closest points and bounds contradict each other."
        )
    codes = Codes.from_points(cells, degree + 2)
    inner = stencil_codes(cells, codes, degree)
    reach = range(-1, 2)
    around = [codes.dilate(inner, axis, reach) for axis in range(source.dim)]
    outer = np.setdiff1d(np.unique(np.concatenate(around)), inner, assume_unique=True)
    nodes = codes.decode(np.concatenate([inner, outer]))
    return Band(spacing, degree, nodes, len(inner), _feet(source, nodes, spacing, progress), codes)


def _feet(source: LocalSource, nodes: Ints, spacing: float, progress: Progress) -> ClosestPoints:
    """Return the closest points of integer ``nodes`` (n, d), computed in batches; ``progress`` gets the share done."""
    parts = []
    for start in range(0, len(nodes), BATCH_NODES):
        progress("band", start / len(nodes))
        parts.append(source.closest_point(np.asarray(nodes[start : start + BATCH_NODES] * spacing, dtype=np.float64)))
    progress("band", 1.0)
    return ClosestPoints.join(parts)


def stencil_nodes(band: Band, cells: Ints) -> Ints:
    """Return the band numbers (n, (p + 1)^d), int32, of the nodes of the interpolation stencils of ``cells`` (n, d).

    The last axis varies fastest; p is the band's degree. Cells may repeat. Raises ResolutionError if a node is not an
    inner node of the band: the source contradicts itself.
    """
    codes = band.codes.encode(cells)
    _, first, member = np.unique(codes, return_index=True, return_inverse=True)
    nodes = band.find_inner(cells[first][:, None] + tensor_offsets(band.degree, band.dim))
    incomplete = np.asarray((nodes < 0).any(axis=1))
    if incomplete.any():
        lost = int(np.count_nonzero(incomplete[member.ravel()]))
        raise ResolutionError(
            f"{lost} interpolation stencils leave the band: the source's distances or bounds contradict its closest "
            "points; run `cpmkit.testing.run_laws` on it."
        )
    return np.asarray(nodes.astype(np.int32)[member.ravel()])
