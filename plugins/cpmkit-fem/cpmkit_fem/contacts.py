"""Contacts without resistance at points of a curve: the jump of u is a prescribed unknown there.

With ``w = u_left - u_right`` in place of ``u_right``, u is ``T w`` with a T that is its own inverse. Along a curve of a
surface a large conductance imposes the jump instead (``ties.py``), since curves may meet; at points of a curve, where b
is as small as an edge, the rounding errors of a large conductance would matter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.plugin import Ints
from cpmkit_fem.ties import Tie

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def change_of_unknowns(ties: Sequence[Tie], size: int) -> csr_array | None:
    """Return T (size, size), its own inverse, from unknowns to values at nodes; None if no unknown is a jump."""
    from scipy.sparse import csr_array

    left, right = sides_of_jumps(ties)
    if not len(left):
        return None
    sign = np.ones(size)
    sign[right] = -1.0
    entries = np.concatenate([sign, np.ones(len(right))])
    rows, columns = np.concatenate([np.arange(size), right]), np.concatenate([np.arange(size), left])
    return csr_array((entries, (rows, columns)), shape=(size, size))


def sides_of_jumps(ties: Sequence[Tie]) -> tuple[Ints, Ints]:
    """Return the nodes (k,) on the left and on the right of the contacts that prescribe their jumps as unknowns."""
    none, contacts = np.zeros(0, dtype=np.int64), [tie for tie in ties if tie.prescribes_jump]
    left = np.concatenate([none, *(contact.left for contact in contacts)])
    return left, np.concatenate([none, *(contact.right for contact in contacts)])
