"""The parting of the next coarser lattice, and its splines in terms of the finer ones.

The coarser lattice has spacing 2h and its origin at h/2, so that its knot planes are every other one of the finer's: a
cell lies in one coarser cell, a patch in one coarser patch. Which of the copies of a coarser node a finer unknown hangs
on is told by any patch that reads the unknown: such patches are joined by touching ones that all read it, their coarser
patches touch or are one, and all of these read the coarser node.
"""

from __future__ import annotations

from math import comb
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.forms.galerkin.dof_map import DofMap
from cpmkit.forms.galerkin.space.parted import components, dof_map_of
from cpmkit.protocols import Bools, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: A piece of the manifold within so many cells along every axis has one unknown. What is within three cells, as is all
#: that a finer level gives one unknown, lies within two coarser ones.
SPECK_CELLS = 2


def coarser(dof_map: DofMap) -> tuple[DofMap, csr_array]:
    """Return the parting of the lattice of twice the spacing, and the matrix P (n, m) from its unknowns to the finer.

    Notes
    -----
    A spline of degree p and spacing 2h is the sum of p + 2 of spacing h with the binomials of p + 1 over 2^p along
    every axis, (1, 3, 3, 1)/4 of degree 2: node J's of 2J + p // 2 - p and following. Rows of P sum to 1. Coarser
    patches are components of the patches of one coarser cell that touch; unknowns are made of them as of the finer
    ones. Samples keep their order.
    """
    from scipy.sparse import csr_array

    from cpmkit.forms.galerkin.hierarchy.two_scale_kernels import two_scale

    inside = (dof_map.cells[dof_map.touching[:, 0]] >> 1 == dof_map.cells[dof_map.touching[:, 1]] >> 1).all(axis=1)
    count, label = components(len(dof_map.cells), dof_map.touching[inside])
    cells = np.empty((count, dof_map.dim), dtype=np.int64)
    cells[label] = dof_map.cells >> 1
    touching = _pairs(label[dof_map.touching[~inside]], count)
    further = _specks(cells, touching), dof_map.degree
    coarse = dof_map_of(2 * dof_map.spacing, cells, touching, label[dof_map.patch], *further)
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


def _specks(cells: Ints, touching: Ints) -> Bools:
    """Return (p,) whether a patch is of a piece that has one unknown."""
    from cpmkit.forms.galerkin.space.dof_map_kernels import bounds

    pieces, label = components(len(cells), touching)
    each = np.arange(len(cells), dtype=np.int32)
    small: Bools = bounds(cells.astype(np.float64), each, label, pieces).max(axis=1) < SPECK_CELLS
    return small[label]
