"""The choice of a spacing: a first suggestion, and the finest that fits into memory."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cpmkit.errors import InputError, ResolutionError
from cpmkit.grid.lattice import cell_levels, nodes_of_blocks
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.runtime import memory
from cpmkit.runtime.arrays import positive

#: Number of cells on the manifold at a suggested spacing, by the manifold's dimension.
SUGGESTED_CELLS = {0: 1, 1: 200, 2: 10_000, 3: 60_000}
#: Least number of blocks from which the number of unknowns is estimated.
COUNTED_BLOCKS = 12_000
#: Side of the finest blocks of that estimate, over the manifold's largest side: 4096 blocks with half a block to spare.
FINEST_CELL_SHARE = 1 / 4095.5
#: Share of the memory that a suggested spacing leaves unused.
SPARE_MEMORY_SHARE = 0.2


def needed_spacing(surface: ClosestPointSource, spacing: float | None) -> float:
    """Return ``spacing`` as a float if it is a finite number above zero.

    Raises InputError if it is not; if it is None, the message suggests a spacing for ``surface``.
    """
    if spacing is None:
        raise InputError(
            "spacing is needed, in the scene's unit of length; "
            f"for this surface try spacing={suggest_spacing(surface):g}."
        )
    return positive(spacing, "spacing")


def suggest_spacing(surface: ClosestPointSource) -> float:
    """Return a spacing, rounded to two digits, at which about :data:`SUGGESTED_CELLS` cells meet the surface."""
    source = localize(surface, np.zeros(surface.dim))
    bounds, manifold_dim = source.bounds, source.largest_dim
    size = float((bounds[1] - bounds[0]).max()) or 1.0
    trial = size / 16
    count = next(len(blocks) for side, blocks in cell_levels(source, trial, 0.0) if side == 1)
    spacing = trial * (count / SUGGESTED_CELLS[manifold_dim]) ** (1 / max(manifold_dim, 1))
    return float(f"{spacing:.2g}")


def check_band_memory(source: LocalSource, unknowns: float, spacing: float, degree: int, excess: float = 1.0) -> None:
    """Raise ResolutionError if a band with so many ``unknowns`` does not fit into the memory of this process.

    The message states a spacing of ``source`` that fits. ``degree`` is that of the interpolation, ``excess`` the factor
    by which the memory may be exceeded: above 1 while ``unknowns`` is a rough estimate.
    """
    needed = unknowns * bytes_per_unknown(source.dim, degree)
    if needed > excess * memory.memory_limit().bytes:
        check_spacing_fits(needed, unknowns, spacing, lambda available: fitting_spacing(source, degree, available))


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
    of right-hand sides, ``rows`` the rows of the extension E for each unknown, by default the usual number. With
    ``solver`` "direct" the matrix and its factors count in place of the vectors; other solvers count alike.
    """
    stencil: int = (degree + 1) ** dim
    rows = rows or (1.3 if dim == 3 else 1.5)
    tables = rows * (stencil * memory.ENTRY_BYTES + 80 * dim) + 2 * dim * (memory.ENTRY_BYTES + 8)
    if solver == "direct":
        # A has about 2.1 entries for each stencil entry in the plane and 2.3 in space; SuperLU's fill was measured.
        return tables + stencil * (2.2 * memory.ENTRY_BYTES + (14 if dim == 2 else 60))
    return tables + 96 * channels


def fitting_spacing(source: LocalSource, degree: int, available: int, solver: str = "reference") -> float:
    """Return a spacing, rounded up to two digits, at which a solve on a band fits into ``available`` bytes.

    A fifth of them is left unused. The result depends neither on the user's spacing nor on the lattice's origin.
    ``degree`` and ``solver`` are as in :func:`bytes_per_unknown`.
    """
    unknowns = (1 - SPARE_MEMORY_SHARE) * max(available, 1) / bytes_per_unknown(source.dim, degree, solver)
    return rounded_up((unknowns_at_unit_spacing(source, degree) / unknowns) ** (1 / max(source.largest_dim, 1)))


def unknowns_at_unit_spacing(source: LocalSource, degree: int, counted: int = COUNTED_BLOCKS) -> float:
    """Return an estimate of the number of unknowns of a band, times the spacing to the power of the manifold dimension.

    The number of nodes follows from the first level of blocks (:func:`cell_levels`) of which more than ``counted`` meet
    the manifold, else from the finest; parts thinner than a block count as thick as it. ``degree``: of the
    interpolation.
    """
    extent = float((source.bounds[1] - source.bounds[0]).max()) or 1.0
    cell = extent * FINEST_CELL_SHARE
    levels = cell_levels(source, cell, -source.bounds[0] / cell)
    side, count = next((side, len(blocks)) for side, blocks in levels if side == 1 or len(blocks) > counted)
    m = source.largest_dim
    return nodes_of_blocks(count, side, source.dim, m, degree) * cell**m


def rounded_up(value: float) -> float:
    """Return ``value``, above zero, rounded up to two significant digits; an excess of 1e-9 over these is ignored."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit * (1 - 1e-9)) * unit:.2g}")


def other_solver_hint(solver: str, other: str = "reference") -> str:
    """Return the end of a message that recommends the solver ``other`` if ``solver`` is "direct", else ""."""
    return f", or solver={other!r}" if solver == "direct" else ""
