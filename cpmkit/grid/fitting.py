"""Which spacing is right: one that is given, one to start with, and the finest that fits into memory."""

from __future__ import annotations

import math

import numpy as np

from cpmkit.errors import InputError, ResolutionError
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.protocols import ClosestPointSource
from cpmkit.runtime import memory
from cpmkit.runtime.arrays import positive

#: A suggested spacing gives about this many cells on the manifold, by its dimension.
SUGGESTED_CELLS = {0: 1, 1: 200, 2: 10_000, 3: 60_000}
#: Blocks of the manifold from which the number of unknowns is foretold.
COUNTED_BLOCKS = 12_000
#: Such blocks are cells of at least this share of the largest side of the surface; half a cell is beyond it.
FINEST_CELL_SHARE = 1 / 4095.5
#: Share of the memory that a spacing which is named leaves unused.
SPARE_MEMORY_SHARE = 0.2


def needed_spacing(surface: ClosestPointSource, spacing: float | None) -> float:
    """Return ``spacing`` if it is one.

    Raises
    ------
    InputError
        If there is none, with a suggestion, or it is not above zero.
    """
    if spacing is None:
        raise InputError(
            "spacing is needed, in the scene's unit of length; "
            f"for this surface try spacing={suggest_spacing(surface):g}."
        )
    return positive(spacing, "spacing")


def suggest_spacing(surface: ClosestPointSource) -> float:
    """Return a spacing, rounded to two digits, at which a scene is quick to solve and its surface's shape is seen."""
    from cpmkit.grid.band import cell_levels

    source = localize(surface, np.zeros(surface.dim))
    bounds, manifold_dim = source.bounds, source.largest_dim
    size = float((bounds[1] - bounds[0]).max()) or 1.0
    trial = size / 16
    count = next(len(blocks) for side, blocks in cell_levels(source, trial, 0.0) if side == 1)
    spacing = trial * (count / SUGGESTED_CELLS[manifold_dim]) ** (1 / max(manifold_dim, 1))
    return float(f"{spacing:.2g}")


def check_fits(
    source: LocalSource,
    unknowns: float,
    spacing: float,
    degree: int,
    solver: str = "reference",
    excess: float = 1.0,
) -> None:
    """Refuse a band that the memory of this process cannot hold.

    Parameters
    ----------
    source : LocalSource
        What the band is around.
    unknowns : float
        That the band has, about.
    spacing, degree : float, int
        Of the lattice and the interpolation.
    solver : str
        That will be taken.
    excess : float
        How many times too large the band must be: more than 1 while ``unknowns`` is a rough number.

    Raises
    ------
    ResolutionError
        With the spacing that would fit.
    """
    needed, limit = unknowns * memory.bytes_per_unknown(source.dim, degree, solver), memory.memory_limit()
    if needed > excess * limit.bytes:
        fits = fitting_spacing(source, degree, limit.bytes, solver)
        raise ResolutionError(
            f"spacing={spacing:g} needs about {unknowns:.2g} unknowns and {needed / 2**30:.3g} GiB"
            f"{' with the solver ' + repr(solver) if solver != 'reference' else ''}, and {limit}; "
            f"spacing={fits:g} or more would fit{other_solver_hint(solver)}."
        )


def fitting_spacing(source: LocalSource, degree: int, available: int, solver: str = "reference") -> float:
    """Return a spacing, rounded up to two digits, at which a solve fits into so many bytes.

    It does not depend on the spacing that was asked for, nor on where the lattice is.
    """
    unknowns = (1 - SPARE_MEMORY_SHARE) * max(available, 1) / memory.bytes_per_unknown(source.dim, degree, solver)
    return rounded_up((unknowns_at_one(source, degree) / unknowns) ** (1 / max(source.largest_dim, 1)))


def unknowns_at_one(source: LocalSource, degree: int, blocks: int = COUNTED_BLOCKS) -> float:
    """Return how many unknowns a band has, times the spacing to the power of the manifold's dimension.

    Counted from the blocks that the manifold meets, some more than ``blocks``, coarse ones: thin parts look as thick
    as a block.
    """
    from cpmkit.grid.band import cell_levels, nodes_of_blocks

    extent = float((source.bounds[1] - source.bounds[0]).max()) or 1.0
    cell = extent * FINEST_CELL_SHARE
    levels = cell_levels(source, cell, -source.bounds[0] / cell)
    side, count = next((side, len(met)) for side, met in levels if side == 1 or len(met) > blocks)
    m = source.largest_dim
    return nodes_of_blocks(count, side, source.dim, m, degree) * cell**m


def rounded_up(value: float) -> float:
    """Return ``value`` rounded up to two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit * (1 - 1e-9)) * unit:.2g}")


def other_solver_hint(solver: str, other: str = "reference") -> str:
    """Return that another solver would fit where the direct one is too large, as the end of a sentence."""
    return f", or solver={other!r}" if solver == "direct" else ""
