"""Coarser levels for multigrid: dof maps of lattices of twice the spacing, and prolongations between their splines.

The coarser lattice has spacing 2h and its origin at h/2, so that its knot planes are every other knot plane of the
finer lattice: a cell lies in one coarser cell, a patch in one coarser patch. A coarser node may have several unknowns.
To interpolate a finer unknown, any patch that reads it is chosen; the unknown is interpolated from those that the
coarser patch containing this patch reads. The choice does not matter: all patches that read the finer unknown are
connected by touching, so that their coarser patches touch or are equal, and read the same coarser unknowns.
"""

from __future__ import annotations

from dataclasses import replace
from math import comb

import numpy as np

from cpmkit.forms.galerkin.dof_map import DofMap, distinct_pairs, dof_map_from_patches, isolated_patches
from cpmkit.linear.multigrid.solver import Level
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Floats, Ints, SparseMatrix


def prolongation_between(fine: DofMap, coarse: DofMap, parent: Ints) -> SparseMatrix:
    """Return the prolongation P (n, m) from the splines of ``coarse``, of twice the spacing, to those of ``fine``.

    Patch i of ``fine`` lies in the patch ``parent[i]`` of ``coarse``. Weights are float32: multiples of 2^(-degree d).
    """
    from scipy.sparse import csr_array

    along = fine.width
    shares = np.append(two_scale_shares(fine.degree), 0.0).astype(np.float32)
    reader = np.empty(fine.size, dtype=np.int64)  # any patch that reads an unknown, and the unknown's place there
    reader[fine.unknowns.ravel()] = np.arange(fine.unknowns.size)
    patch, place = np.divmod(reader, fine.unknowns.shape[1])
    entries, at = np.ones((fine.size, 1), dtype=np.float32), np.zeros((fine.size, 1), dtype=np.int64)
    for axis, stride in enumerate(fine.strides):
        node = fine.cells[patch, axis] + place // stride % along
        last = (node - 2 * coarse.cells[parent[patch], axis] + along - 1)[:, None]
        places = np.maximum((last - along + 1) // 2, 0) + np.arange((along + 2) // 2)
        k = last - 2 * places
        weights = shares[np.where((k >= 0) & (places < along), k, -1)]
        entries = (entries[:, :, None] * weights[:, None]).reshape(fine.size, -1)
        at = (at[:, :, None] + stride * places[:, None]).reshape(fine.size, -1)
    used = entries != 0
    starts = np.append(0, np.cumsum(used.sum(axis=1))).astype(np.int32)
    columns = coarse.unknowns[np.repeat(parent[patch], np.diff(starts)), at[used]]
    matrix = csr_array((entries[used], columns, starts), shape=(fine.size, coarse.size))
    matrix.sum_duplicates()  # an isolated piece has the same unknown at all nodes
    return matrix


def coarsen(dof_map: DofMap) -> tuple[DofMap, SparseMatrix]:
    """Return the dof map of the lattice of twice the spacing, and the prolongation P (n, m) from its unknowns.

    A spline of degree p and spacing 2h at node J is the sum of p + 2 splines of spacing h at the nodes from 2J + p // 2
    - p on along every axis, with the binomials of p + 1 over 2^p as coefficients: (1, 3, 3, 1)/4 for degree 2. Rows of
    P sum to 1. A coarser patch is a connected component of touching patches in a coarser cell.
    """
    inside = (dof_map.cells[dof_map.touching[:, 0]] >> 1 == dof_map.cells[dof_map.touching[:, 1]] >> 1).all(axis=1)
    count, label = connected_components(len(dof_map.cells), dof_map.touching[inside])
    cells = np.empty((count, dof_map.dim), dtype=np.int64)
    cells[label] = dof_map.cells >> 1
    touching = distinct_pairs(label[dof_map.touching[~inside]], count)
    # Pieces with one unknown on the finer level extend over at most three cells there, or two coarser cells.
    isolated = isolated_patches(cells.astype(np.float64), np.arange(count), touching, count, 1.0)
    patch = label[dof_map.patch]
    coarse = dof_map_from_patches(2 * dof_map.spacing, cells, touching, patch, isolated, dof_map.degree)
    return coarse, prolongation_between(dof_map, coarse, label)


def two_scale_shares(degree: int) -> Floats:
    """Return the coefficients (degree + 2,) of a spline of spacing 2h in splines of spacing h, along an axis."""
    return np.array([comb(degree + 1, k) for k in range(degree + 2)]) / 2.0**degree


#: A level of at most so many unknowns is the coarsest: its systems are solved by a factorisation.
COARSEST_UNKNOWNS = 400
#: Connected pieces of at most so many patches belong wholly to the strip that the smoother solves exactly: they have
#: modes that converge slowly, which vanish at ties or occur beside rims in knot planes.
STRIP_PATCHES = 64
#: Coarsening ends where a level has more than this share of the unknowns of the finer level, as for isolated pieces.
LARGEST_REMAINING_SHARE = 0.9


def coarser_levels(dof_map: DofMap, boundary_patches: Ints, in_blocks: bool = False) -> list[Level]:
    """Return the coarser levels of a multigrid hierarchy with their prolongations, the finest first.

    ``dof_map`` is that of the finest level, ``boundary_patches`` (k,) are the patches with samples on boundaries. The
    unknowns read by these and by small pieces, or by coarser patches that contain them, are the smoother's strip,
    which is solved exactly, or in overlapping blocks if ``in_blocks``.
    """
    count, piece = connected_components(len(dof_map.cells), dof_map.touching)  # ties do not connect
    in_small_pieces = np.flatnonzero((np.bincount(piece, minlength=count) <= STRIP_PATCHES)[piece])
    level = replace(dof_map, patch=np.union1d(boundary_patches, in_small_pieces))
    levels: list[Level] = []
    while level.size > COARSEST_UNKNOWNS:
        strip = np.unique(level.unknowns[level.patch])
        level, prolongation = coarsen(level)
        if level.size > LARGEST_REMAINING_SHARE * prolongation.shape[0]:
            break
        levels.append(Level(prolongation, strip, None, _lines(level) if level.degree > 2 else None, in_blocks))
    return levels


def _lines(dof_map: DofMap) -> Ints:
    """Return the lines (r, degree + 1) of unknowns along the axes inside all patches, each line once."""
    width, dim = dof_map.width, dof_map.dim
    blocks = dof_map.unknowns.reshape(-1, *(width,) * dim)
    lines = np.unique(
        np.concatenate([np.moveaxis(blocks, 1 + axis, -1).reshape(-1, width) for axis in range(dim)]), axis=0
    )
    return np.asarray(lines[lines[:, 0] != lines[:, -1]])  # isolated pieces have one unknown all along
