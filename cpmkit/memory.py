"""How much memory a band needs, and how much the machine has."""

from __future__ import annotations

import os
import sys

from cpmkit.errors import ResolutionError

#: Bytes of one entry of a sparse matrix: a float64 and an int32 index.
ENTRY = 12


def machine_bytes() -> int:
    """Return the physical memory of the machine in bytes; a number that refuses nothing where the system tells none."""
    if "SC_PHYS_PAGES" not in getattr(os, "sysconf_names", {}):
        return sys.maxsize
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def available_bytes() -> int:
    """Return the memory that this process may have in bytes."""
    return machine_bytes()


def peak_bytes(rows: float, unknowns: float, dim: int, degree: int, channels: int, solver: str) -> float:
    """Return the bytes of tables and vectors at the peak of a solve.

    Parameters
    ----------
    rows : float
        Rows of E: outer nodes, and ghosts where E u is needed.
    unknowns : float
        Rows of N.
    dim, degree, channels : int
        Of the space, the interpolation, and the right-hand sides.
    solver : str
        ``direct`` assembles the matrix and factorises it.
    """
    stencil: int = (degree + 1) ** dim
    tables = rows * (stencil * ENTRY + 10 * dim * 8) + unknowns * 2 * dim * (ENTRY + 4)
    if solver == "direct":
        # About 2.1 entries of A a stencil entry in the plane and 2.3 in space; SuperLU's fill was measured.
        fill = 14 if dim == 2 else 60
        return tables + unknowns * stencil * ENTRY * 2.2 + unknowns * fill * stencil
    return tables + unknowns * channels * 8 * 12


def bytes_per_unknown(dim: int, degree: int) -> float:
    """Return the bytes that an unknown needs at the peak of an iterative solve.

    A band has about 1.3 rows of E an unknown in space, 1.5 in the plane.
    """
    return peak_bytes(1.3 if dim == 3 else 1.5, 1.0, dim, degree, 1, "reference")


def check_fits(unknowns: float, dim: int, manifold_dim: int, degree: int, spacing: float) -> None:
    """Refuse a band that the machine's memory cannot hold.

    Raises
    ------
    ResolutionError
        With the spacing that would fit.
    """
    needed, available = unknowns * bytes_per_unknown(dim, degree), machine_bytes()
    if needed > available:
        fits = spacing * (needed / (0.8 * available)) ** (1 / max(manifold_dim, 1))
        raise ResolutionError(
            f"spacing={spacing:g} needs about {unknowns:.2g} unknowns and {needed / 2**30:.3g} GiB, this machine has "
            f"{available / 2**30:.3g} GiB; spacing={fits:.2g} or more would fit."
        )
