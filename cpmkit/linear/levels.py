"""What a form tells a multigrid: how the unknowns of a coarser lattice stand for those of a finer one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cpmkit.protocols import Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class Level:
    """One step from a finer level to the next coarser one; a form hands them out from the finest on.

    Attributes
    ----------
    prolongation : csr_array (n, m)
        P, from m coarser unknowns to the n finer ones; coarser operators are P' A P, and what is ``added``.
    strip : (k,) int64
        Those of the finer level's unknowns that conditions tie, which a smoother solves for exactly.
    added : csr_array (m, m), optional
        What the coarser operator has besides, as a velocity needs more upwinding there.
    lines : (r, k) int64, optional
        Coarser unknowns in a row, whose differences of order k - 1 are held a little: what hardly touches the manifold
        has entries so small elsewhere that rounding makes their sign.
    """

    prolongation: csr_array
    strip: Ints
    added: csr_array | None = None
    lines: Ints | None = None
