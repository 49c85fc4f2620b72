"""Whether a solve fits into memory; where it does not, the spacing that would."""

from __future__ import annotations

import math
import traceback
from typing import TYPE_CHECKING

import numpy as np

from cpmkit import memory
from cpmkit.errors import ResolutionError
from cpmkit.localized import Localized, localize

if TYPE_CHECKING:
    from cpmkit.scene import Scene

#: Blocks of the manifold from which the number of unknowns is foretold.
COUNTED = 12_000
#: Such blocks are cells of at least this share of the largest side of the surface; half a cell is beyond it.
FINEST = 1 / 4095.5
#: Share of the memory that a spacing which is named leaves unused.
SPARE = 0.2
#: Where memory ran out although a spacing seemed to fit, one this many times as large is named.
COARSER = 1.5


def check_fits(
    source: Localized,
    unknowns: float,
    spacing: float,
    degree: int,
    solver: str = "reference",
    excess: float = 1.0,
) -> None:
    """Refuse a band that the memory of this process cannot hold.

    Parameters
    ----------
    source : Localized
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
            f"spacing={fits:g} or more would fit{_other(solver)}."
        )


def fitting_spacing(source: Localized, degree: int, available: int, solver: str = "reference") -> float:
    """Return a spacing, rounded up to two digits, at which a solve fits into so many bytes.

    It does not depend on the spacing that was asked for, nor on where the lattice is.
    """
    unknowns = (1 - SPARE) * max(available, 1) / memory.bytes_per_unknown(source.dim, degree, solver)
    return _rounded_up((_unknowns_at_one(source, degree) / unknowns) ** (1 / max(source.largest_dim, 1)))


def _unknowns_at_one(source: Localized, degree: int) -> float:
    """Return how many unknowns a band has, times the spacing to the power of the manifold's dimension.

    Counted from the blocks that the manifold meets, coarse ones: thin parts look as thick as a block.
    """
    from cpmkit.grid.band import cell_levels, nodes_of_blocks

    extent = float((source.bounds[1] - source.bounds[0]).max()) or 1.0
    cell = extent * FINEST
    levels = cell_levels(source, cell, -source.bounds[0] / cell)
    side, count = next((side, len(blocks)) for side, blocks in levels if side == 1 or len(blocks) > COUNTED)
    m = source.largest_dim
    return nodes_of_blocks(count, side, source.dim, m, degree) * cell**m


def _rounded_up(value: float) -> float:
    """Return ``value`` rounded up to two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / unit * (1 - 1e-9)) * unit:.2g}")


def memory_ran_out(
    scene: Scene, spacing: float | None, degree: int, solver: str, error: BaseException, limit: memory.Limit
) -> ResolutionError:
    """Return what to raise in place of an error: what is needed, what there was, and a spacing that would fit.

    The tables that the error's traceback holds are let go first. ``limit`` is that of before the work.
    """
    traceback.clear_frames(error.__traceback__)
    if spacing is None:
        return ResolutionError(f"Memory ran out, and {limit}; a coarser mesh, or a larger spacing, needs less.")
    try:
        needed, fits, chosen = _needed(scene, spacing, degree, solver, limit)
    except (MemoryError, ValueError, ArithmeticError):
        needed, fits, chosen = "", 0.0, solver
    fits = max(fits, _rounded_up(COARSER * spacing))
    return ResolutionError(
        f"Memory ran out at spacing={spacing:g}: {needed}{limit}, libraries included; "
        f"try spacing={fits:g} or more{_other(chosen)}."
    )


def _other(solver: str) -> str:
    return ", or solver='reference'" if solver == "direct" else ""


def _needed(scene: Scene, spacing: float, degree: int, solver: str, limit: memory.Limit) -> tuple[str, float, str]:
    """Return what a solve needs, in words, the spacing that would fit, and the solver."""
    from cpmkit.solvers import choose_solver

    source = localize(scene.surface, np.zeros(scene.surface.dim))
    unknowns = _unknowns_at_one(source, degree) / spacing**source.largest_dim
    chosen = choose_solver(solver, round(unknowns), source.largest_dim, scene.problem.factorise_up_to)
    needed = unknowns * memory.bytes_per_unknown(source.dim, degree, chosen)
    told = f"about {unknowns:.2g} unknowns need {needed / 2**30:.2g} GiB or more with the solver {chosen!r}, and "
    return told, fitting_spacing(source, degree, limit.bytes, chosen), chosen
