"""Refusing, before anything is built, what the memory of this process cannot hold."""

from __future__ import annotations

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.fitting import rounded_up, unknowns_at_one
from cpmkit.manifold.local_source import LocalSource
from cpmkit.runtime.memory import memory_limit

#: At the peak of a solve, for each unknown: samples, their mesh, the matrix and coarser ones.
BYTES_PER_UNKNOWN = 4000.0
#: Unknowns of this form for each of a closest point band of the lowest degree, about; a band is counted by blocks.
UNKNOWNS_OF_BAND_SHARE, BAND_DEGREE = 0.6, 2
#: Entries of the factors of a surface's matrix: an unknown's, over the square root of their number (measured).
FILL_FACTOR = 40.0
#: Bytes of such an entry.
ENTRY_BYTES = 12
#: A manifold of so many times its box's surface is thought possible before it is looked at.
FOLDED_FACTOR = 10.0


def check_samples_fit(surface: LocalSource, spacing: float) -> None:
    """Refuse a spacing whose samples and matrices need more memory than there is.

    The manifold is looked at only where a much folded one in its box would not fit.

    Raises
    ------
    ResolutionError
        With the spacing that would fit.
    """
    limit, m = memory_limit(), surface.largest_dim
    sides = np.sort(np.ptp(surface.bounds, axis=0)) / spacing
    if FOLDED_FACTOR * 4.5 * float(np.prod(sides[-m:])) * BYTES_PER_UNKNOWN <= limit.bytes:
        return
    at_one = UNKNOWNS_OF_BAND_SHARE * unknowns_at_one(surface, BAND_DEGREE)
    unknowns = at_one / spacing**m
    if unknowns * BYTES_PER_UNKNOWN > limit.bytes:
        fits = rounded_up((at_one * BYTES_PER_UNKNOWN / limit.bytes) ** (1 / m))
        raise ResolutionError(
            f"spacing={spacing:g} needs about {unknowns:.2g} unknowns and {unknowns * BYTES_PER_UNKNOWN / 2**30:.3g} "
            f"GiB, and {limit}; spacing={fits:g} or more would fit."
        )


def check_factors_fit(unknowns: int, manifold_dim: int) -> None:
    """Refuse a factorisation that needs more memory than there is.

    Raises
    ------
    ResolutionError
        With the solver that needs less.
    """
    limit = memory_limit()
    needed = ENTRY_BYTES * FILL_FACTOR * unknowns ** (1.5 if manifold_dim > 1 else 1.0)
    if needed > limit.bytes:
        raise ResolutionError(
            f"factors of {unknowns} unknowns need about {needed / 2**30:.3g} GiB, and {limit}; use solver='multigrid'."
        )
