"""Alignment of the normals under each spline, which shows where the manifold is thin or folded on the lattice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.space.energy import load
from cpmkit.forms.galerkin.space.quantised_samples import SAMPLES_AT_ONCE
from cpmkit.forms.galerkin.space.spline_space import SplineSpace
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Floats

#: Length of the mean normal under a spline below which the spline is unresolved, and below which the manifold bends
#: about as sharply as the spacing.
ALIGNED_LENGTH, BENDING_LENGTH = 0.6, 0.85


@dataclass(frozen=True, eq=False)
class NormalSpread:
    """The share of the manifold under splines whose normals spread: limbs, creases, folds and thin edges.

    Attributes
    ----------
    unresolved_share : float
        Share of the manifold's measure under unresolved splines.
    place : (d,) float64
        The node, relative to the lattice's origin, of the spline whose normals cancel most; NaN if all are resolved.
    bending_share : float
        Share under splines on which the manifold bends about as sharply as the spacing, unresolved ones included.
    """

    unresolved_share: float
    place: Floats
    bending_share: float


def normal_alignment(space: SplineSpace, mesh: Mesh, winding: Any = None) -> Floats:
    """Return the integrals (n, 1 + d) of each spline, and of its product with the oriented normal or tangent.

    Cells are oriented consistently over common facets. On one-sided components this is impossible: splines near a facet
    where two cells disagree have NaN in place of the normal.

    Parameters
    ----------
    space : SplineSpace
    mesh : Mesh
    winding : (m,) int8, optional
        ``mesh.winding``, computed if it is not given.
    """
    samples, dof_map = space.samples, space.dof_map
    winding, cells = mesh.winding if winding is None else winding, samples.cell
    signs = np.where(winding == 0, np.nan, winding)
    integrals = np.zeros((dof_map.size, 1 + mesh.dim))
    if mesh.manifold_dim == 2:
        from cpmkit.forms.galerkin.normal_alignment_kernels import add_oriented_normals
        from cpmkit.forms.galerkin.space.energy_kernels import SPLINES

        arrays = samples.places, samples.directions, samples.weights
        add_oriented_normals(dof_map.unknowns, dof_map.patch, SPLINES[dof_map.degree], arrays, cells, signs, integrals)
        return integrals
    ends = mesh.vertices[mesh.cells]
    for start in range(0, len(samples), SAMPLES_AT_ONCE):
        rows = slice(start, min(start + SAMPLES_AT_ONCE, len(samples)))
        values = np.ones((rows.stop - start, 1 + mesh.dim))
        values[:, 1:] = unit(ends[cells[rows], 1] - ends[cells[rows], 0]) * signs[cells[rows], None]
        integrals += load(space, values, rows)
    return integrals


def normal_spread(space: SplineSpace, integrals: Floats) -> NormalSpread:
    """Return the share of the manifold under splines N with |sum w N n| < .6 sum w N, n the normals at samples.

    ``integrals`` (n, 1 + d) are both sums, see :func:`normal_alignment`.
    """
    area, length = integrals[:, 0], norms(integrals[:, 1:])
    is_unresolved = length < ALIGNED_LENGTH * area  # false where the normal is NaN
    bending = float(area[length < BENDING_LENGTH * area].sum() / area.sum())
    if not is_unresolved.any():
        return NormalSpread(0.0, np.full(space.dof_map.dim, np.nan), bending)
    heavy = np.flatnonzero(is_unresolved & (area >= np.median(area[is_unresolved])))
    worst = heavy[np.argmin(length[heavy] / area[heavy])]
    return NormalSpread(float(area[is_unresolved].sum() / area.sum()), space.dof_map.places[worst], bending)
