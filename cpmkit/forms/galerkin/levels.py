"""The parting of the next coarser lattice, and its splines in terms of the finer ones.

The coarser lattice has spacing 2h and its origin at h/2, so that its knot planes are every other one of the finer's: a
cell lies in one coarser cell, a patch in one coarser patch. Which of the copies of a coarser node a finer unknown hangs
on is told by any patch that reads the unknown: such patches are joined by touching ones that all read it, their coarser
patches touch or are one, and all of these read the coarser node.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.space.dof_map import DofMap, components, dof_map_from_patches
from cpmkit.linear.multigrid.cycle import Level
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@compiled
def two_scale(
    cells: Ints, unknowns: Ints, n: int, parent: Ints, coarse_cells: Ints, coarse_unknowns: Ints, shares: Floats
) -> tuple[Any, Any, Any]:
    """Return pointers, columns (ascending in each row) and weights of P.

    ``cells`` (p, d) and ``unknowns`` (p, (degree + 1)^d) of n are those of the finer patches, ``parent`` (p,) their
    coarser ones, whose cells and unknowns follow. ``shares`` (degree + 2,): what a coarser spline is of finer ones.
    """
    p, d = cells.shape
    width, along = unknowns.shape[1], len(shares) - 1
    before = (along - 1) // 2
    reader = np.full(n, -1)
    for a in range(p):
        for place in range(width):
            if reader[unknowns[a, place]] < 0:
                reader[unknowns[a, place]] = a * width + place
    most = (along + 2) // 2  # coarser splines an axis that a finer one is part of
    pointers = np.zeros(n + 1, dtype=np.int32)
    columns = np.empty(n * most**d, dtype=np.int32)
    weights = np.empty(n * most**d, dtype=np.float32)  # of multiples of 2^(-degree d), exactly
    own, at = np.empty((d, most)), np.empty((d, most), dtype=np.int64)
    counts = np.empty(d, dtype=np.int64)
    used = 0
    for i in range(n):
        a = reader[i] // width
        b, rest = parent[a], reader[i] % width
        stride, ways = 1, 1
        for axis in range(d - 1, -1, -1):
            node, first = cells[a, axis] + rest % along - before, coarse_cells[b, axis] - before
            counts[axis] = 0
            for place in range(along):
                k = node - 2 * (first + place) + along - 1 - before
                if 0 <= k < len(shares):
                    own[axis, counts[axis]], at[axis, counts[axis]] = shares[k], place * stride
                    counts[axis] += 1
            ways *= counts[axis]
            rest //= along
            stride *= along
        begin = used
        for choice in range(ways):
            weight, place, left = 1.0, 0, choice
            for axis in range(d):
                weight *= own[axis, left % counts[axis]]
                place += at[axis, left % counts[axis]]
                left //= counts[axis]
            used = _put(columns, weights, begin, used, coarse_unknowns[b, place], weight)
        pointers[i + 1] = used
    return pointers, columns[:used].copy(), weights[:used].copy()


@compiled
def _put(columns: Any, weights: Any, begin: int, used: int, column: int, weight: float) -> int:
    """Add a weight to the row that starts at ``begin`` and return where it ends now."""
    at = begin
    while at < used and columns[at] < column:
        at += 1
    if at < used and columns[at] == column:  # of a speck, all of whose nodes are one unknown
        weights[at] += weight
        return used
    for k in range(used, at, -1):
        columns[k], weights[k] = columns[k - 1], weights[k - 1]
    columns[at], weights[at] = column, weight
    return used + 1


#: A piece of the manifold within so many cells along every axis has one unknown. What is within three cells, as is all
#: that a finer level gives one unknown, lies within two coarser ones.
ISOLATED_CELLS = 2


def coarsen(dof_map: DofMap) -> tuple[DofMap, csr_array]:
    """Return the parting of the lattice of twice the spacing, and the matrix P (n, m) from its unknowns to the finer.

    Notes
    -----
    A spline of degree p and spacing 2h is the sum of p + 2 of spacing h with the binomials of p + 1 over 2^p along
    every axis, (1, 3, 3, 1)/4 of degree 2: node J's of 2J + p // 2 - p and following. Rows of P sum to 1. Coarser
    patches are components of the patches of one coarser cell that touch; unknowns are made of them as of the finer
    ones. Samples keep their order.
    """
    from scipy.sparse import csr_array

    inside = (dof_map.cells[dof_map.touching[:, 0]] >> 1 == dof_map.cells[dof_map.touching[:, 1]] >> 1).all(axis=1)
    count, label = components(len(dof_map.cells), dof_map.touching[inside])
    cells = np.empty((count, dof_map.dim), dtype=np.int64)
    cells[label] = dof_map.cells >> 1
    touching = _pairs(label[dof_map.touching[~inside]], count)
    further = _is_isolated(cells, touching), dof_map.degree
    coarse = dof_map_from_patches(2 * dof_map.spacing, cells, touching, label[dof_map.patch], *further)
    fine = dof_map.cells, dof_map.unknowns, dof_map.size
    indptr, indices, weights = two_scale(*fine, label, cells, coarse.unknowns, two_scale_shares(dof_map.degree))
    return coarse, csr_array((weights, indices, indptr), shape=(dof_map.size, coarse.size))


def two_scale_shares(degree: int) -> Floats:
    """Return (degree + 2,) what a spline of spacing 2h is of those of spacing h, along an axis."""
    return np.array([comb(degree + 1, k) for k in range(degree + 2)]) / 2.0**degree


def _pairs(pairs: Ints, count: int) -> Ints:
    """Return the distinct pairs of two numbers below ``count``, the smaller first."""
    codes = np.unique(pairs.min(axis=1) * count + pairs.max(axis=1))
    return np.stack([codes // count, codes % count], axis=1)


def _is_isolated(cells: Ints, touching: Ints) -> Bools:
    """Return (p,) whether a patch is of a piece that has one unknown."""
    from cpmkit.forms.galerkin.space.dof_map_kernels import bounds

    pieces, label = components(len(cells), touching)
    each = np.arange(len(cells), dtype=np.int32)
    small: Bools = bounds(cells.astype(np.float64), each, label, pieces).max(axis=1) < ISOLATED_CELLS
    return small[label]


#: No coarser level is made of fewer unknowns: they are solved for exactly.
COARSEST_UNKNOWNS = 400
#: Nor of a level that has more than this share of the finer one's unknowns: all that is left are specks.
LEAST_GAIN = 0.9


def coarser_levels(dof_map: DofMap, beside: Ints) -> list[Level]:
    """Return the steps to coarser levels, from the finest on.

    Parameters
    ----------
    dof_map : Parting
        The finest.
    beside : (k,) int64
        The patches that boundary samples lie in: on each level the unknowns that these read, or that the coarser
        patches that hold these read, are the strip.
    """
    level = replace(dof_map, patch=np.unique(beside))
    levels: list[Level] = []
    while level.size > COARSEST_UNKNOWNS:
        strip = np.unique(level.unknowns[level.patch])
        level, prolongation = coarsen(level)
        if level.size > LEAST_GAIN * prolongation.shape[0]:
            break
        levels.append(Level(prolongation, strip, lines=_lines(level) if level.degree > 2 else None))
    return levels


def _lines(dof_map: DofMap) -> Ints:
    """Return (r, degree + 1) the unknowns on the lines along the axes inside all patches, each line once."""
    width, dim = dof_map.width, dof_map.dim
    blocks = dof_map.unknowns.reshape(-1, *(width,) * dim)
    lines = np.unique(
        np.concatenate([np.moveaxis(blocks, 1 + axis, -1).reshape(-1, width) for axis in range(dim)]), axis=0
    )
    return np.asarray(lines[lines[:, 0] != lines[:, -1]])  # specks have one unknown all along
