"""Truncated hierarchical splines: the splines of each level, the active ones among them, and their representation.

The splines of level l are built over the samples of the region of level l and of a halo: the patches of level l - 1
that share an unknown with a patch of that region. So it has all patches that read an unknown of the region, and
nodes have the same unknowns as if the whole manifold were subdivided.

An active spline of a coarse level is on a finer level a sum of finer splines, by the two-scale relation; truncation
removes from the sum those that are candidates of the finer level. With c the coefficients of the active splines,

    R_0 = I on the active splines,    R_l = D_l P_l R_(l-1) + I on the active splines of level l,

D_l being zero for the candidates of level l and one for the other splines. On a patch of level l, u is the sum of the
splines of that level with the coefficients R_l c. The splines sum to one, and a polynomial has the coefficients that it
has on each level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.dof_map import DofMap, build_patches, dof_map_from_patches
from cpmkit.forms.galerkin.refinement.regions import Regions, codes_of_cells, is_among
from cpmkit.forms.galerkin.space.levels import two_scale, two_scale_shares
from cpmkit.types import Bools, Floats, Ints, SparseMatrix


@dataclass(frozen=True, eq=False)
class LevelSplines:
    """The splines of one level."""

    #: The dof map over the region of the level and its halo; ``dof_map.patch`` (s,) are patches of the samples there.
    dof_map: DofMap
    rows: Ints  #: (s,): the numbers of these samples, ascending.
    inside: Bools  #: (p,): whether each patch is in the region of this level.
    subdivided: Bools  #: (p,): whether each patch is in the region of the next level.
    #: csr_array (n, m): prolongation from the splines of the level before; None for level 0.
    prolongation: SparseMatrix | None

    @property
    def candidates(self) -> Bools:
        """(n,) whether all patches that read a spline lie in the region of this level."""
        return ~self.is_read_by(~self.inside)

    @property
    def active(self) -> Bools:
        """(n,) whether a spline is a candidate that a patch outside the region of the next level reads."""
        return self.candidates & self.is_read_by(~self.subdivided)

    def is_read_by(self, patches: Bools) -> Bools:
        """Return (n,) whether each spline is read by a patch for which ``patches`` (p,) is true."""
        is_read = np.zeros(self.dof_map.size, dtype=bool)
        is_read[self.dof_map.unknowns[patches]] = True
        return is_read

    def patch_of(self, samples: Ints) -> Ints:
        """Return (k,) the patch of each of the ``samples`` (k,), which are among :attr:`rows`."""
        return np.asarray(self.dof_map.patch[np.searchsorted(self.rows, samples)])


def level_splines(first: DofMap, points: Floats, corners: Any, cell: Any, regions: Regions) -> list[LevelSplines]:
    """Return the splines of all levels.

    ``first``: the dof map of level 0, over all samples.
    ``points`` (q, d): the samples, relative to the lattice's origin.
    ``corners`` (m, k) int: the vertices of the cells of the mesh after cutting.
    ``cell`` (q,) int32: the mesh cell of each sample.
    ``regions``: the subdivided cells.
    """
    everywhere = np.ones(len(first.cells), dtype=bool)
    subdivided = _is_subdivided(first.cells, everywhere, regions, 0)
    levels = [LevelSplines(first, np.arange(len(points)), everywhere, subdivided, None)]
    for number in range(1, regions.finest + 1):
        levels.append(_finer_level(levels[-1], number, points, corners, cell, regions))
    return levels


def _finer_level(
    coarse: LevelSplines, number: int, points: Floats, corners: Any, cell: Any, regions: Regions
) -> LevelSplines:
    """Return the splines of level ``number``, the level after ``coarse``; see :func:`level_splines`."""
    from scipy.sparse import csr_array

    in_region_or_halo = coarse.is_read_by(coarse.subdivided)[coarse.dof_map.unknowns].any(axis=1)
    chosen = in_region_or_halo[coarse.dof_map.patch]
    rows, coarse_patch = coarse.rows[chosen], coarse.dof_map.patch[chosen]
    cells_of_rows = regions.cells(points[rows], number)
    patch, first, touching = build_patches(codes_of_cells(cells_of_rows), corners, cell[rows])
    cells, parent = cells_of_rows[first], coarse_patch[first]
    spacing, isolated = coarse.dof_map.spacing / 2, np.zeros(len(first), dtype=bool)
    dof_map = dof_map_from_patches(spacing, cells, touching, patch, isolated)
    inside = coarse.subdivided[parent]
    fine = cells, dof_map.unknowns, dof_map.size
    coarser = coarse.dof_map.cells, coarse.dof_map.unknowns, two_scale_shares(dof_map.degree)
    starts, columns, weights = two_scale(*fine, parent.astype(np.int64), *coarser)
    shape = dof_map.size, coarse.dof_map.size
    prolongation = csr_array((weights.astype(np.float64), columns, starts), shape=shape)
    return LevelSplines(dof_map, rows, inside, _is_subdivided(cells, inside, regions, number), prolongation)


def _is_subdivided(cells: Ints, inside: Bools, regions: Regions, level: int) -> Bools:
    """Return (p,) whether patches with the ``cells`` (p, d) of a level are subdivided; only those ``inside`` can be."""
    if level >= regions.finest:
        return np.zeros(len(cells), dtype=bool)
    return inside & is_among(codes_of_cells(cells), regions.subdivided[level])


def representations(levels: Sequence[LevelSplines], cap: int) -> list[SparseMatrix]:
    """Return the representations R_l (n_l, n), l = 0 to ``cap``, for the space whose finest level is ``cap``."""
    from scipy.sparse import csr_array, diags_array

    actives = [level.candidates if number == cap else level.active for number, level in enumerate(levels[: cap + 1])]
    starts = np.cumsum([0, *(int(active.sum()) for active in actives)])
    matrices: list[SparseMatrix] = []
    for level, active, start in zip(levels, actives, starts, strict=False):
        rows: Ints = np.flatnonzero(active)
        entries = np.ones(len(rows)), (rows, start + np.arange(len(rows)))
        matrix = csr_array(entries, shape=(level.dof_map.size, starts[-1]))
        if level.prolongation is not None:
            matrix = matrix + diags_array(1.0 - level.candidates) @ (level.prolongation @ matrices[-1])
        matrices.append(matrix.tocsr())
    return matrices


def prolongation_to(levels: Sequence[LevelSplines], cap: int, coarser: SparseMatrix) -> SparseMatrix:
    """Return the prolongation from the space with the finest level ``cap - 1`` to that with the finest level ``cap``.

    It is (m, n) for m and n active splines. ``coarser`` is the last of the :func:`representations` of the former space.
    Truncated splines keep their coefficients on finer levels; the coefficients of the splines of level ``cap`` follow
    from the two-scale relation.
    """
    from scipy.sparse import csr_array, vstack

    before = [level.candidates if number == cap - 1 else level.active for number, level in enumerate(levels[:cap])]
    stays = np.concatenate([level.active[candidates] for level, candidates in zip(levels[:cap], before, strict=True)])
    rows = np.flatnonzero(stays)
    same = csr_array((np.ones(len(rows)), (np.arange(len(rows)), rows)), shape=(len(rows), len(stays)))
    level = levels[cap]
    assert level.prolongation is not None
    return vstack([same, (level.prolongation @ coarser)[level.candidates]], format="csr")
