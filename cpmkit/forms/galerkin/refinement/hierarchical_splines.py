"""Every level's own splines over the region where they are needed, and which of them are active.

Level l is parted over the samples of its region and of a halo: those patches of level l - 1 that read an unknown with a
patch of the region. So all patches that read an unknown of the region are there, and its copies are what they would be
were the whole manifold parted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.levels import two_scale, two_scale_shares
from cpmkit.forms.galerkin.refinement.regions import Regions, codes_of_cells, is_among
from cpmkit.forms.galerkin.space.dof_map import DofMap, dof_map_from_patches
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class LevelSplines:
    """The splines of one level.

    Attributes
    ----------
    dof_map : Parting
        Over the region and its halo; ``parting.patch`` (s,) is that of the samples there.
    rows : (s,) int64
        These samples, ascending.
    inside : (p,) bool
        The patches that lie in the region of this level.
    parted : (p,) bool
        Those of them that lie in the region of the next one.
    prolongation : csr_array (n, m), optional
        From the splines of the level before; None of level 0.
    """

    dof_map: DofMap
    rows: Ints
    inside: Bools
    parted: Bools
    prolongation: csr_array | None

    @property
    def size(self) -> int:
        """Number n of splines."""
        return self.dof_map.size

    @property
    def candidates(self) -> Bools:
        """(n,) the splines all of whose patches lie in the region."""
        return ~self._read_by(~self.inside)

    @property
    def active(self) -> Bools:
        """(n,) those of them that have a patch outside the region of the next level."""
        return self.candidates & self._read_by(~self.parted)

    def _read_by(self, patches: Bools) -> Bools:
        found = np.zeros(self.size, dtype=bool)
        found[self.dof_map.unknowns[patches]] = True
        return found

    def patch_of(self, samples: Ints) -> Ints:
        """Return (k,) the patches of ``samples`` (k,) among :attr:`rows`."""
        return np.asarray(self.dof_map.patch[np.searchsorted(self.rows, samples)])


def level_splines(first: DofMap, points: Floats, corners: Any, cell: Any, regions: Regions) -> list[LevelSplines]:
    """Return the splines of all levels.

    Parameters
    ----------
    first : Parting
        Of level 0, over all samples.
    points : (q, d) float64
        The samples, relative to the lattice's origin.
    corners : (m, k) int
        The vertices of the cells of the mesh after cutting.
    cell : (q,) int32
        The cell of the mesh that each sample lies in.
    regions : Regions
        Where levels are.
    """
    everywhere = np.ones(len(first.cells), dtype=bool)
    parted = _is_subdivided(first.cells, everywhere, regions, 0)
    levels = [LevelSplines(first, np.arange(len(points)), everywhere, parted, None)]
    for number in range(1, regions.finest + 1):
        levels.append(_finer_level(levels[-1], number, points, corners, cell, regions))
    return levels


def _finer_level(
    coarse: LevelSplines, number: int, points: Floats, corners: Any, cell: Any, regions: Regions
) -> LevelSplines:
    from scipy.sparse import csr_array

    read = coarse._read_by(coarse.parted)
    near = read[coarse.dof_map.unknowns].any(axis=1)
    chosen = near[coarse.dof_map.patch]
    rows, coarse_patch = coarse.rows[chosen], coarse.dof_map.patch[chosen]
    cells_of_rows = regions.cells(points[rows], number)
    patch, first, touching = build_patches(codes_of_cells(cells_of_rows), corners, cell[rows])
    cells, parent = cells_of_rows[first], coarse_patch[first]
    spacing, single = coarse.dof_map.spacing / 2, np.zeros(len(first), dtype=bool)
    dof_map = dof_map_from_patches(spacing, cells, touching, patch, single)
    inside = coarse.parted[parent]
    fine = cells, dof_map.unknowns, dof_map.size
    coarser = coarse.dof_map.cells, coarse.dof_map.unknowns, two_scale_shares(dof_map.degree)
    starts, columns, weights = two_scale(*fine, parent.astype(np.int64), *coarser)
    shape = dof_map.size, coarse.size
    prolongation = csr_array((weights.astype(np.float64), columns, starts), shape=shape)
    return LevelSplines(dof_map, rows, inside, _is_subdivided(cells, inside, regions, number), prolongation)


def build_patches(code: Ints, corners: Any, cell: Any) -> tuple[Any, Ints, Any]:
    """Return the patch (s,) of samples, a sample (p,) of each patch, and the pairs (t, 2) of patches that touch.

    ``code`` (s,): the lattice cell of each; ``cell`` (s,): that of the mesh, whose corners are ``corners`` (m, k).
    """
    from cpmkit.forms.galerkin.space.dof_map_kernels import join_samples, touching_pairs

    cell = np.ascontiguousarray(cell, dtype=np.int32)
    root, first, after, holder = join_samples(code, np.ascontiguousarray(corners), cell, int(corners.max()) + 1)
    roots = np.flatnonzero(root == np.arange(len(root)))
    roots = roots[np.argsort(code[roots], kind="stable")]
    numbers = np.empty(len(code), dtype=np.int32)
    numbers[roots] = np.arange(len(roots))
    patch = numbers[root]
    return patch, roots, touching_pairs(patch, len(roots), first, after, holder)


def _is_subdivided(cells: Ints, inside: Bools, regions: Regions, level: int) -> Bools:
    if level >= regions.finest:
        return np.zeros(len(cells), dtype=bool)
    return inside & is_among(codes_of_cells(cells), regions.parted[level])


def active_numbers(levels: Sequence[LevelSplines]) -> list[Ints]:
    """Return the numbers of the active splines of each level, among those of all levels, one level after another."""
    counts = np.cumsum([0, *(int(level.active.sum()) for level in levels)])
    return [np.arange(counts[one], counts[one + 1]) for one in range(len(levels))]


def representations(levels: Sequence[LevelSplines], cap: int) -> list[csr_array]:
    """Return R_l (n_l, n), l from 0 to ``cap``, of the space in which level ``cap`` is the finest."""
    actives = [level.candidates if number == cap else level.active for number, level in enumerate(levels[: cap + 1])]
    starts = np.cumsum([0, *(int(one.sum()) for one in actives)])
    found: list[csr_array] = []
    for number, (level, active) in enumerate(zip(levels, actives, strict=False)):
        own = _selection(active, int(starts[number]), int(starts[-1]))
        if level.prolongation is not None:
            own = own + select_rows(~level.candidates, level.prolongation @ found[-1])
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


def select_rows(keep: Bools, matrix: csr_array) -> csr_array:
    """Return a matrix with the rows emptied that are not to be kept (n,)."""
    from scipy.sparse import csr_array

    matrix = matrix.tocsr()
    counts = np.where(keep, np.diff(matrix.indptr), 0)
    entries = np.repeat(keep, np.diff(matrix.indptr))
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(matrix.indptr.dtype)
    return csr_array((matrix.data[entries], matrix.indices[entries], starts), shape=matrix.shape)
