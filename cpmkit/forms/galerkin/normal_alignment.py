"""How much of the manifold is thin or folded on the lattice: where normals under one spline point in many ways."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.samples import SAMPLES_AT_ONCE
from cpmkit.forms.galerkin.space.energy import load
from cpmkit.forms.galerkin.space.spline_space import SplineSpace
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Floats

#: A spline is not faced one way where its mean normal is shorter than this, and on what bends where it is below that.
FACED_LENGTH, BENT_LENGTH = 0.6, 0.85


@dataclass(frozen=True, eq=False)
class NormalSpread:
    """The splines under which the manifold turns: around limbs, creases, at folds and thin edges.

    Attributes
    ----------
    share : float
        Of the manifold's measure, on such splines.
    near : (d,) float64
        Relative to the lattice's origin, the node of that whose normals cancel most; NaN where there is none.
    bent : float
        What share is on splines under which the manifold bends about as sharply as the spacing, these included.
    """

    share: float
    near: Floats
    bent: float


def normal_alignment(space: SplineSpace, mesh: Mesh, winding: Any = None) -> Floats:
    """Return (n, 1 + d) the integral of each spline, and of the direction n that the manifold faces times it.

    Of curves n is the tangent. Cells are oriented by walking over the facets that two of them share. One-sided pieces
    break somewhere: on splines near that nothing is said of the direction, which is NaN there. ``winding`` (m,): what
    :attr:`Connectivity.winding` of the mesh, computed if it is not given.
    """
    samples, dof_map = space.samples, space.dof_map
    winding, cells = mesh.winding if winding is None else winding, samples.cell
    signs = np.where(winding == 0, np.nan, winding)
    found = np.zeros((dof_map.size, 1 + mesh.dim))
    if mesh.manifold_dim == 2:
        from cpmkit.forms.galerkin.normal_alignment_kernels import add_facing
        from cpmkit.forms.galerkin.space.energy_kernels import SPLINES

        own = samples.places, samples.directions, samples.weights
        add_facing(dof_map.unknowns, dof_map.patch, SPLINES[dof_map.degree], own, cells, signs, found)
        return found
    ends = mesh.vertices[mesh.cells]
    for start in range(0, len(samples), SAMPLES_AT_ONCE):
        some = slice(start, min(start + SAMPLES_AT_ONCE, len(samples)))
        faced = np.ones((some.stop - start, 1 + mesh.dim))
        faced[:, 1:] = unit(ends[cells[some], 1] - ends[cells[some], 0]) * signs[cells[some], None]
        found += load(space, faced, some)
    return found


def normal_spread(space: SplineSpace, facing: Floats) -> NormalSpread:
    """Return how much of the manifold lies on splines with ``|sum w N n| < .6 sum w N``, both sums in ``facing``."""
    area, length = facing[:, 0], norms(facing[:, 1:])
    is_turned = length < FACED_LENGTH * area  # never where nothing is said
    bent = float(area[length < BENT_LENGTH * area].sum() / area.sum())
    if not is_turned.any():
        return NormalSpread(0.0, np.full(space.dof_map.dim, np.nan), bent)
    heavy = np.flatnonzero(is_turned & (area >= np.median(area[is_turned])))
    worst = heavy[np.argmin(length[heavy] / area[heavy])]
    return NormalSpread(float(area[is_turned].sum() / area.sum()), space.dof_map.places[worst], bent)
