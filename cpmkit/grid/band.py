"""The band: the lattice nodes on which a surface's PDE is solved, and stencils of interpolation and differences.

Inner nodes, the unknowns, are the nodes in the interpolation stencil of some surface point. Outer nodes are their
difference neighbours, at which only the extension E u is needed.
Differs from King et al. (2024), eq. 4: nodes within its radius that no stencil reads are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.errors import InputError, ResolutionError, shown
from cpmkit.grid.lattice import COUNTED_BLOCKS, Codes, cell_levels, check_band_memory, estimated_node_count, find_codes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints
from cpmkit.runtime.arrays import is_whole
from cpmkit.types import Floats, Ints, Progress, no_progress

#: Number of nodes in one batch of closest point queries: it bounds temporary memory.
BATCH_NODES = 1 << 17


def check_degree(degree: int, label: str = "degree") -> int:
    """Return ``degree``, of the interpolation, if it is an integer from 2 to 5; ``label`` names it in the message.

    Raises InputError if it is not. Degree 1 does not converge: its error stays of order one at every spacing.
    """
    if not is_whole(degree) or not 2 <= degree <= 5:
        reason = (
            " (degree 1 does not converge: the second differences of its error do not vanish)" if degree == 1 else ""
        )
        raise InputError(f"{label} must be one of 2, 3, 4, 5, got {shown(degree)}{reason}; 3 is the default.")
    return int(degree)


def base_offset(degree: int) -> float:
    """Return the shift, in cells, that is added to coordinates before ``floor`` to get the cell of the stencil.

    A stencil of odd degree is centred on a cell between nodes, a stencil of even degree on the nearest node.
    """
    return 0.0 if degree % 2 else 0.5


def stencil_range(degree: int) -> range:
    """Return the offsets of a stencil's nodes from its cell along one axis."""
    first = -((degree - 1) // 2) if degree % 2 else -(degree // 2)
    return range(first, first + degree + 1)


def stencil_cells(points: Floats, spacing: float, degree: int) -> tuple[Ints, Floats]:
    """Return the stencil's cell (n, d) of each point (n, d), and the fractions (n, d) of its position there.

    Points are relative to the lattice's origin; a fraction, 0 to 1, is the distance from the cell's low side, in cells.
    """
    coordinates = points / spacing + base_offset(degree)
    cells = np.floor(coordinates)
    return cells.astype(np.int64), coordinates - cells


def lagrange_weights(fractions: Floats, degree: int) -> Floats:
    """Return the weights (n, d, degree + 1) of one-dimensional Lagrange interpolation along each axis, nodes ascending.

    The first barycentric form (Berrut and Trefethen 2004, eq. 3.1), ``l(t) lambda_k / (t - t_k)``, with the product
    ``l(t) / (t - t_k)`` written out, so that a point on a node is no special case; ``fractions`` (n, d) are those of
    :func:`stencil_cells`.
    """
    nodes = np.array(stencil_range(degree), dtype=np.float64) + base_offset(degree)
    differences = fractions[..., None] - nodes
    weights = np.empty_like(differences)
    for k in range(degree + 1):
        others = [j for j in range(degree + 1) if j != k]
        weights[..., k] = np.prod(differences[..., others], axis=-1) / np.prod(nodes[k] - nodes[others])
    return weights


def tensor_weights(fractions: Floats, degree: int, along: int | None = None) -> Floats:
    """Return the weights (n, (degree + 1)^d) of tensor-product interpolation at ``fractions`` (n, d).

    The last axis varies fastest; fractions are those of :func:`stencil_cells`. With an axis ``along``, return the
    derivatives of the weights with respect to the fractions along it: per cell, not per unit of length.
    """
    # King et al. (2024), eq. 1: the weights of the closest point extension.
    lines = lagrange_weights(fractions, degree)
    if along is not None:
        lines[:, along] = _lagrange_slopes(fractions[:, along], degree)
    weights = lines[:, 0]
    for axis in range(1, lines.shape[1]):
        weights = (weights[:, :, None] * lines[:, axis, None, :]).reshape(len(weights), -1)
    return weights


def _lagrange_slopes(fractions: Floats, degree: int) -> Floats:
    """Return the derivatives (n, degree + 1) of Lagrange weights along one axis with respect to ``fractions`` (n,)."""
    nodes = np.array(stencil_range(degree), dtype=np.float64) + base_offset(degree)
    differences = fractions[:, None] - nodes
    slopes = np.zeros_like(differences)
    for k in range(degree + 1):
        others = [j for j in range(degree + 1) if j != k]
        for omitted in others:
            slopes[:, k] += np.prod(differences[:, [j for j in others if j != omitted]], axis=-1)
        slopes[:, k] /= np.prod(nodes[k] - nodes[others])
    return slopes


def tensor_offsets(degree: int, dim: int) -> Ints:
    """Return the offsets ((degree + 1)^d, d) of a stencil's nodes from its cell, last axis fastest."""
    lines = np.array(stencil_range(degree), dtype=np.int64)
    return np.stack(np.meshgrid(*[lines] * dim, indexing="ij"), axis=-1).reshape(-1, dim)


def cross_offsets(dim: int) -> Ints:
    """Return the offsets (2 d, d) of the neighbours in the cross-shaped Laplacian, positive before negative directions.

    In ``spacing^2`` times the Laplacian they have the weight 1, and the node itself -2 d: King et al. (2024), eq. 2.
    """
    unit = np.eye(dim, dtype=np.int64)
    return np.concatenate([unit, -unit])


def reading_radius(dim: int, degree: int) -> float:
    """Return the radius, in spacings, of a ball that contains the stencil of its centre: ``sqrt(d) (p + 1) / 2``."""
    # King et al. (2024), eq. 4 with q = 0.
    return float(np.sqrt(dim) * (degree + 1) / 2)


@dataclass(frozen=True, eq=False)
class Band:
    """Lattice nodes around a manifold, inner nodes first.

    Where several sheets of the manifold share nodes, the collocation form adds twins: copies of nodes, one for each
    further sheet.
    """

    #: spacing, degree, float, int: spacing of the lattice and degree of the interpolation.
    spacing: float
    degree: int
    nodes: Ints  #: (n, d): lattice nodes, the ``inner`` unknowns first, each part in the order of its codes.
    inner: int  #: Number of inner nodes.
    feet: ClosestPoints  #: Closest points of all nodes, relative to the lattice's origin.
    codes: Codes  #: Numbering by which nodes are found.
    #: own_inner, own_outer: Numbers of inner and of outer nodes that are no twins; they precede twins. -1 means all.
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

    def neighbour_pairs(self) -> tuple[Ints, Ints]:
        """Return the numbers of the lower (k,) and upper (k,) node of all pairs of adjacent inner nodes but twins."""
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
    """Return the indices (c, d) of interpolation cells: all that contain points of the manifold, and a few others.

    Cells are those of :func:`stencil_cells` with the same ``spacing`` and ``degree``. Raises as :func:`check_numbered`,
    and ResolutionError as soon as an estimate shows that their band does not fit into memory.
    """
    manifold_dim = source.largest_dim
    for side, blocks in cell_levels(source, spacing, base_offset(degree)):
        unknowns = estimated_node_count(len(blocks), side, source.dim, manifold_dim, degree)
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
    the band does not fit into memory or cannot be numbered, or the source has no point inside its bounds; InputError if
    coordinates are too large, or the source's answers break its contract.
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
    return Band(spacing, degree, nodes, len(inner), _feet_of_nodes(source, nodes, spacing, progress), codes)


def _feet_of_nodes(source: LocalSource, nodes: Ints, spacing: float, progress: Progress) -> ClosestPoints:
    """Return the closest points of integer ``nodes`` (n, d), computed in batches; ``progress`` gets the share done."""
    parts = []
    for start in range(0, len(nodes), BATCH_NODES):
        progress("band", start / len(nodes))
        parts.append(source.closest_point(np.asarray(nodes[start : start + BATCH_NODES] * spacing, dtype=np.float64)))
    progress("band", 1.0)
    return ClosestPoints.join(parts)


def stencil_nodes(band: Band, cells: Ints) -> Ints:
    """Return the band numbers (n, (p + 1)^d), int32, of the nodes of the interpolation stencils of ``cells`` (n, d).

    The last axis varies fastest; p is the band's degree. Cells may repeat; no node is a twin. Raises ResolutionError if
    a node is not an inner node of the band: the source contradicts itself.
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
