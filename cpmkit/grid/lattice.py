"""The lattice: integer nodes, their positions, codes of nodes in sorted tables, blocks of cells, and its spacing.

Geometry inside the core is relative to the lattice's origin: node i is at ``spacing * i`` to rounding, wherever the
model lies in space. A first spacing is suggested by the size of the manifold, the finest by what fits into memory.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cpmkit.errors import InputError, ResolutionError
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.runtime import memory
from cpmkit.runtime.arrays import as_vector, check_size, length, positive
from cpmkit.types import Floats, Ints

#: The largest spacing, as a share of the manifold's largest side, of splines, and of a band, which needs a finer
#: lattice to separate the manifold's parts.
COARSEST_SPACING_SHARE, COARSEST_BAND_SHARE = 0.4, 0.25
#: Rounding of coordinates above this share of a surface's size causes a warning.
LOST_SIZE_SHARE = 1e-7
#: Error of closest points far from zero, in roundings of a coordinate: up to one for spheres of user classes at 1e8 to
#: 1e12, a hundred for a capsule of radius 1e-3 at 1e5. Translated sources have an error of 0.02.
FAR_OUT_ROUNDINGS = 100.0
#: Number of cells on the manifold at a suggested spacing, by the manifold's dimension.
SUGGESTED_CELLS = {1: 200, 2: 10_000, 3: 60_000}
#: Least number of blocks from which the number of unknowns is estimated.
COUNTED_BLOCKS = 12_000
#: Side of the finest blocks of that estimate, over the manifold's largest side: at most 4096 blocks along a side.
FINEST_CELL_SHARE = 1 / 4095.5
#: Share of the memory that a suggested spacing leaves unused.
SPARE_MEMORY_SHARE = 0.2


@dataclass(frozen=True, eq=False)
class Lattice:
    """Nodes at ``origin + spacing * i`` for integer i."""

    origin: Floats  #: (d,): position of node zero in the scene's coordinates.
    spacing: float  #: Distance of neighbouring nodes, in the scene's unit of length.

    @property
    def dim(self) -> int:
        """Dimension d of the space."""
        return len(self.origin)

    def to_scene(self, points: Floats) -> Floats:
        """Return the scene's coordinates (n, d) of ``points`` (n, d) that are relative to the origin."""
        return points + self.origin

    def rounding_warnings(self, bounds: Floats, translated: bool) -> tuple[str, ...]:
        """Return a tuple with a warning if the scene's coordinates are rounded too coarsely for the manifold, else ().

        ``bounds`` (2, d): bounds of the manifold, relative to the origin; a single point causes no warning.
        ``translated``: whether the source computes relative to it; if not, its error is :data:`FAR_OUT_ROUNDINGS`.
        """
        far, size = float(np.abs(bounds + self.origin).max()), float(np.ptp(bounds, axis=0).max())
        loss = float(np.spacing(far)) * (1.0 if translated else FAR_OUT_ROUNDINGS)
        if size == 0 or loss <= LOST_SIZE_SHARE * size:
            return ()
        return (
            f"The surface lies {far:.2g} from zero, where coordinates are rounded to {np.spacing(far):.1g}: a solution "
            f"may be off by its slope times {loss / size:.1g} of the surface's size; move the scene nearer to zero.",
        )

    def to_local(self, points: Floats) -> Floats:
        """Return the coordinates (n, d) relative to the origin of ``points`` (n, d) in the scene's coordinates."""
        return points - self.origin


def lattice_of(
    surface: ClosestPointSource,
    spacing: float,
    origin: Any = None,
    coarsest: float = COARSEST_SPACING_SHARE,
    name: str = "a manifold",
) -> Lattice:
    """Return the lattice with this spacing and a node at ``origin``, by default the centre of the surface's bounds.

    ``origin`` is in the scene's coordinates; InputError is raised if it is not d finite numbers. Raises ResolutionError
    if the spacing is more than the share ``coarsest`` of the largest side of the manifold, in the message ``name``.
    """
    bounds = np.asarray(surface.bounds, dtype=np.float64)
    largest = float((bounds[1] - bounds[0]).max())
    if spacing > coarsest * largest > 0:
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for {name} whose largest side is {largest:.3g}; "
            f"use {coarsest * largest:.3g} or less."
        )
    centre: Floats = 0.5 * (bounds[0] + bounds[1])
    return Lattice(centre if origin is None else as_vector(origin, surface.dim, "origin"), float(spacing))


@dataclass(frozen=True, eq=False)
class Codes:
    """A numbering of the integer points of a box in C order: sorted codes are points in lexicographic order."""

    lower: Ints  #: (d,): lowest point of the box.
    shape: Ints  #: (d,): points per axis.

    @classmethod
    def from_points(cls, points: Ints, margin: int) -> Codes:
        """Return the numbering of the bounding box of integer ``points`` (n, d), widened by ``margin`` on each side.

        Raises ResolutionError if the box has more than 2^62 points.
        """
        lower = points.min(axis=0) - margin
        shape = points.max(axis=0) + margin + 1 - lower
        if np.prod(shape.astype(float)) > 2.0**62:
            raise ResolutionError(
                f"The lattice of {shape.tolist()} nodes is too fine to be numbered; use a larger spacing."
            )
        return cls(lower, shape)

    @property
    def strides(self) -> Ints:
        """(d,) difference of the codes of two neighbours along each axis."""
        return np.append(np.cumprod(self.shape[:0:-1])[::-1], 1).astype(np.int64)

    def encode(self, points: Ints) -> Ints:
        """Return the codes (...,) of integer points (..., d), -1 outside the box."""
        code, inside = np.zeros(points.shape[:-1], dtype=np.int64), np.ones(points.shape[:-1], dtype=bool)
        for axis, stride in enumerate(self.strides):  # not all at once: NumPy is slow along short axes
            place = points[..., axis] - self.lower[axis]
            inside &= (place >= 0) & (place < self.shape[axis])
            code += stride * place
        return np.where(inside, code, -1)

    def decode(self, codes: Ints) -> Ints:
        """Return the integer points (n, d) of codes (n,)."""
        return np.stack(np.unravel_index(codes, tuple(self.shape)), axis=1).astype(np.int64) + self.lower

    def dilate(self, codes: Ints, axis: int, offsets: range) -> Ints:
        """Return the sorted distinct codes (m,) of points ``offsets`` along ``axis`` from ``codes``, all in the box."""
        shifted = codes[:, None] + self.strides[axis] * np.array(offsets, dtype=np.int64)
        return np.unique(shifted)


def find_codes(sorted_codes: Ints, codes: Any) -> Ints:
    """Return the positions (...) of ``codes`` (...) in ascending ``sorted_codes`` (n,), -1 for codes not in it."""
    position = np.searchsorted(sorted_codes, codes)
    position[position == len(sorted_codes)] = 0
    return (
        np.where(sorted_codes[position] == codes, position, -1) if len(sorted_codes) else np.full(np.shape(codes), -1)
    )


#: Share of a block's half diagonal within which the distance at its centre may exceed it, for rounding.
CELL_SLACK_SHARE = 1e-6
#: Largest number of cells along an axis that can be numbered.
MOST_CELLS_PER_AXIS = 2.0**40


def cell_levels(source: LocalSource, spacing: float, offset: float | Floats) -> Iterator[tuple[int, Ints]]:
    """Yield, from coarse to fine, the side in cells and the indices (k, d) of the blocks that may meet the manifold.

    A block is selected if the distance at its centre is at most half its diagonal. Since ``distance`` is 1-Lipschitz
    and at most the true distance, no block with a point of the manifold is missed, whatever the number of connected
    components. At the last level, side 1, the blocks are cells. Raises ResolutionError or InputError if the cells of
    the source's bounds cannot be numbered (:func:`check_numbered`).
    Differs from King et al. (2024), section 5.1, Algorithm 1, which searches from one node and finds one component.

    ``spacing``: side of a cell.
    ``offset``, float or (d,): cell k extends from (k - offset) to (k + 1 - offset) spacings along each axis.
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
    while side > 1 and len(blocks) <= len(children):  # blocks as large as the manifold exclude nothing
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

    Raises ResolutionError if the bounds are not finite or not in order, or there are more cells than can be numbered.
    Raises InputError if coordinates or the spacing are too large or too small to compute with.
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


def estimated_node_count(blocks: int, side: int, dim: int, manifold_dim: int, degree: int) -> float:
    """Return an estimate of the number of inner nodes of the band of a manifold that meets so many ``blocks``.

    A block of an m-dimensional manifold contains about side^m cells that meet it, each with about 0.9 (p + 1)^(d - m)
    nodes (measured on circle and sphere). ``side`` is that of a block in cells, ``dim`` is d, ``manifold_dim`` m, and
    ``degree`` the degree p of the interpolation.
    """
    return float(blocks * float(side) ** manifold_dim * 0.9 * (degree + 1) ** (dim - manifold_dim))


def needed_spacing(surface: ClosestPointSource, spacing: float | None) -> float:
    """Return ``spacing`` as a float if it is a finite number above zero.

    Raises InputError if it is not; for None the message suggests a spacing, or :func:`suggest_spacing` raises.
    """
    if spacing is None:
        raise InputError(
            "spacing is needed, in the scene's unit of length; "
            f"for this surface try spacing={suggest_spacing(surface):g}."
        )
    return positive(spacing, "spacing")


def suggest_spacing(surface: ClosestPointSource) -> float:
    """Return a spacing, rounded to two digits, at which about :data:`SUGGESTED_CELLS` cells meet the surface.

    For points it is a sixteenth of their extent. Raises as :func:`check_numbered` for bounds that this refuses.
    """
    source = localize(surface, np.zeros(surface.dim))
    bounds, manifold_dim = source.bounds, source.largest_dim
    size = float((bounds[1] - bounds[0]).max()) or 1.0
    trial = size / 16
    count = next(len(blocks) for side, blocks in cell_levels(source, trial, 0.0) if side == 1)
    factor = (count / SUGGESTED_CELLS[manifold_dim]) ** (1 / manifold_dim) if manifold_dim else 1.0
    return float(f"{trial * factor:.2g}")


def check_band_memory(
    source: LocalSource, unknowns: float, spacing: float, degree: int, excess: float = 1.0, channels: int = 1
) -> None:
    """Raise ResolutionError if a band with so many ``unknowns`` does not fit into the memory of this process.

    The message states a spacing of ``source`` that fits; finding it may raise as :func:`check_numbered`. ``degree`` is
    that of the interpolation, ``channels`` the number of right-hand sides, ``excess`` the factor by which the memory
    may be exceeded: above 1 while ``unknowns`` is a rough estimate.
    """
    needed = unknowns * bytes_per_unknown(source.dim, degree, channels=channels)
    if needed > excess * memory.memory_limit().bytes:
        check_spacing_fits(needed, unknowns, spacing, partial(fitting_spacing, source, degree, channels=channels))


def check_spacing_fits(
    needed: float,
    unknowns: float,
    spacing: float,
    fitting: Callable[[int], float],
    solver: str = "reference",
    smaller_solver: str = "reference",
) -> None:
    """Raise ResolutionError if a solve needs more memory than this process has; the message states a spacing that fits.

    ``needed``, ``unknowns``, ``spacing``: bytes and unknowns of the solve, and the spacing.
    ``fitting``: returns the spacing that fits into a number of bytes.
    ``solver``, ``smaller_solver``: name of the solver, and of the solver to recommend in place of "direct".
    """
    limit = memory.memory_limit()
    if needed > limit.bytes:
        named = f" with the solver {solver!r}" if solver == "direct" else ""
        raise ResolutionError(
            f"spacing={spacing:g} needs about {unknowns:.2g} unknowns and {needed / 2**30:.3g} GiB{named}, and "
            f"{limit}; spacing={fitting(limit.bytes):g} or more would fit{other_solver_hint(solver, smaller_solver)}."
        )


def bytes_per_unknown(
    dim: int, degree: int, solver: str = "reference", channels: int = 1, rows: float | None = None
) -> float:
    """Return the bytes of tables and vectors for each unknown of a band, at the peak of a solve.

    ``dim``, ``degree`` and ``channels`` are the dimension of the space, the degree of the interpolation and the number
    of right-hand sides, ``rows`` the number of rows of the extension E for each unknown, by default the usual. With
    ``solver`` "direct" the matrix and its factors count in place of the vectors; other solvers count alike.
    """
    stencil: int = (degree + 1) ** dim
    rows = rows or (1.3 if dim == 3 else 1.5)
    tables = rows * (stencil * memory.ENTRY_BYTES + 80 * dim) + 2 * dim * (memory.ENTRY_BYTES + 8)
    if solver == "direct":
        # A has about 2.1 entries for each stencil entry in the plane and 2.3 in space; SuperLU's fill was measured.
        return tables + stencil * (2.2 * memory.ENTRY_BYTES + (14 if dim == 2 else 60))
    return tables + 96 * channels


def fitting_spacing(
    source: LocalSource, degree: int, available: int, solver: str = "reference", channels: int = 1
) -> float:
    """Return a spacing, rounded up to two digits, at which a solve on a band fits into ``available`` bytes.

    A fifth of the bytes is left unused. The result depends neither on the user's spacing nor on the lattice's origin.
    ``degree``, ``solver`` and ``channels`` are as in :func:`bytes_per_unknown`. Raises as :func:`check_numbered`.
    """
    unknowns = (1 - SPARE_MEMORY_SHARE) * max(available, 1) / bytes_per_unknown(source.dim, degree, solver, channels)
    return round_up((unknowns_at_unit_spacing(source, degree) / unknowns) ** (1 / max(source.largest_dim, 1)))


def unknowns_at_unit_spacing(source: LocalSource, degree: int, counted: int = COUNTED_BLOCKS) -> float:
    """Return an estimate of the number of unknowns of a band, times the spacing to the power of the manifold dimension.

    The number of nodes follows from the first level of blocks (:func:`cell_levels`) with more than ``counted`` blocks
    that meet the manifold, else from the finest; thin parts count as thick as a block. ``degree``: of interpolation.
    """
    extent = float((source.bounds[1] - source.bounds[0]).max()) or 1.0
    cell = extent * FINEST_CELL_SHARE
    levels = cell_levels(source, cell, -source.bounds[0] / cell)
    side, count = next((side, len(blocks)) for side, blocks in levels if side == 1 or len(blocks) > counted)
    m = source.largest_dim
    return estimated_node_count(count, side, source.dim, m, degree) * cell**m


def round_up(value: float) -> float:
    """Return ``value``, above zero, rounded up to two significant digits; an excess of 1e-9 over these is ignored."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit * (1 - 1e-9)) * unit:.2g}")


def other_solver_hint(solver: str, other: str = "reference") -> str:
    """Return the end of a message that recommends the solver ``other`` if ``solver`` is "direct", else ""."""
    return f", or solver={other!r}" if solver == "direct" else ""
