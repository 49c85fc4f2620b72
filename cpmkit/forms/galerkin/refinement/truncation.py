"""The active splines of all levels in terms of each level's own: truncated hierarchical splines.

An active spline of a coarse level is, on a finer one, the sum of finer splines that the two-scale relation gives; of
those that are themselves candidates of the finer level it keeps nothing. With c the coefficients of the active splines,

    R_0 = I on the active ones,    R_l = D_l P_l R_(l-1) + I on the active ones of level l,

D_l zero for the candidates of level l and one for others, u is on a patch of level l the sum of that level's splines
with the coefficients R_l c. The splines sum to one, and a polynomial has the coefficients that it has on each level.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.refinement.levels import LevelSplines
from cpmkit.protocols import Bools, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def representations(levels: Sequence[LevelSplines], cap: int) -> list[csr_array]:
    """Return R_l (n_l, n), l from 0 to ``cap``, of the space in which level ``cap`` is the finest."""
    actives = [level.candidates if number == cap else level.active for number, level in enumerate(levels[: cap + 1])]
    starts = np.cumsum([0, *(int(one.sum()) for one in actives)])
    found: list[csr_array] = []
    for number, (level, active) in enumerate(zip(levels, actives, strict=False)):
        own = _selection(active, int(starts[number]), int(starts[-1]))
        if level.prolongation is not None:
            own = own + scaled_rows(~level.candidates, level.prolongation @ found[-1])
        found.append(own.tocsr())
    return found


def prolongation_to(levels: Sequence[LevelSplines], cap: int, coarser: csr_array) -> csr_array:
    """Return the matrix from the space in which level ``cap - 1`` is the finest to that with level ``cap``.

    ``coarser``: the last of the :func:`representations` of the former. Coefficients of truncated splines stay what they
    are on finer levels; the splines of level ``cap`` have what the two-scale relation says.
    """
    from scipy.sparse import csr_array, vstack

    before = [level.candidates if number == cap - 1 else level.active for number, level in enumerate(levels[:cap])]
    kept = np.concatenate([level.active[candidates] for level, candidates in zip(levels[:cap], before, strict=True)])
    stay = np.flatnonzero(kept)
    same = csr_array((np.ones(len(stay)), (np.arange(len(stay)), stay)), shape=(len(stay), len(kept)))
    level = levels[cap]
    assert level.prolongation is not None
    return vstack([same, (level.prolongation @ coarser)[level.candidates]], format="csr")


def _selection(active: Bools, start: int, size: int) -> csr_array:
    from scipy.sparse import csr_array

    rows: Ints = np.flatnonzero(active)
    return csr_array((np.ones(len(rows)), (rows, start + np.arange(len(rows)))), shape=(len(active), size))


def scaled_rows(keep: Bools, matrix: csr_array) -> csr_array:
    """Return a matrix with the rows emptied that are not to be kept (n,)."""
    from scipy.sparse import csr_array

    matrix = matrix.tocsr()
    counts = np.where(keep, np.diff(matrix.indptr), 0)
    entries = np.repeat(keep, np.diff(matrix.indptr))
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(matrix.indptr.dtype)
    return csr_array((matrix.data[entries], matrix.indices[entries], starts), shape=matrix.shape)
