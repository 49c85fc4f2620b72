"""The splines of all levels over one set of samples, as one space on one lattice: each level magnified.

A patch of level l, magnified by 2^l about the lattice's node, lies on a lattice of spacing h as those of level 0 do. So
every level is a piece of manifold of its own, and all of them together are a space of splines like any other: its
unknowns are those of each level that its patches read, one level after another, and what ties them is
``R`` (N, n), the active splines in terms of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.samples import QuantisedSamples, Samples
from cpmkit.forms.galerkin.refinement.graded_mesh import shift_of
from cpmkit.forms.galerkin.refinement.hierarchical_splines import LevelSplines, build_patches
from cpmkit.forms.galerkin.refinement.regions import Regions, codes_of_cells
from cpmkit.forms.galerkin.space.dof_map import DofMap
from cpmkit.forms.galerkin.space.spline_space import SplineSpace, build_spline_space
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False, kw_only=True)
class RefinedDofMap(DofMap):
    """A parting whose patches are of several levels; its cells and nodes are those of the magnified levels.

    Attributes
    ----------
    levels : (p,) int64
        The level of each patch.
    node_levels : (n,) int64
        That of each unknown.
    """

    levels: Ints
    node_levels: Ints

    @property
    def places(self) -> Floats:
        """(n, d) where the node of each unknown lies, relative to the lattice's origin."""
        level = self.node_levels[:, None]
        return np.asarray(0.5**level * self.spacing * self.nodes - shift_of(self.spacing, level))

    def magnified(self, patch: Ints, points: Floats) -> Floats:
        """Return where the magnification puts ``points`` (k, d) that lie in the patches ``patch`` (k,)."""
        level = self.levels[patch][..., None]
        return np.asarray(2.0**level * (points + shift_of(self.spacing, level)))

    def reduced(self, patch: Ints, points: Floats) -> Floats:
        """Return the points that :meth:`magnified` brings to ``points`` (..., d)."""
        level = self.levels[patch][..., None]
        return np.asarray(0.5**level * points - shift_of(self.spacing, level))

    def scales(self, patch: Any) -> Floats:
        """Return (k,) by how much patches are magnified."""
        return np.asarray(2.0 ** self.levels[patch])


@dataclass(frozen=True, eq=False)
class RefinedSamples(QuantisedSamples):
    """Samples that are held where the magnification puts them, and are read where they are."""

    def points_at(self, rows: slice | Ints) -> Floats:
        """Return (..., d) the points of the samples ``rows`` (...)."""
        assert isinstance(self.dof_map, RefinedDofMap)
        return self.dof_map.reduced(self.dof_map.patch[rows], super().points_at(rows))


@dataclass(frozen=True, eq=False)
class RefinedSpace:
    """The splines of a set of regions.

    Attributes
    ----------
    space : Space
        The magnified levels.
    dof_map : RefinedParting
        Its own.
    levels : sequence of LevelSplines
        Each level by itself.
    used : sequence of (k_l,) int64
        Those of a level's splines that the space has, in its order.
    """

    space: SplineSpace
    dof_map: RefinedDofMap
    levels: Sequence[LevelSplines]
    used: Sequence[Ints]

    def stacked(self, representations: Sequence[csr_array]) -> csr_array:
        """Return R (N, n) of the :func:`~cpmkit.forms.galerkin.refinement.hierarchical_splines.representations` R_l."""
        from scipy.sparse import vstack

        return vstack([own[used] for own, used in zip(representations, self.used, strict=True)], format="csr")


def build_refined_space(
    samples: Samples, corners: Any, levels: Sequence[LevelSplines], regions: Regions
) -> RefinedSpace:
    """Return the space of these levels over ``samples``, those of boundaries among them."""
    dof_map, used = _build_refined_dof_map(samples, corners, levels, regions)
    placed = Samples(dof_map.magnified(dof_map.patch, samples.points), samples.weights, samples.normals, samples.cell)
    fixed = QuantisedSamples.of(placed, dof_map)
    own = RefinedSamples(*[getattr(fixed, name) for name in QuantisedSamples.__dataclass_fields__])
    return RefinedSpace(build_spline_space(dof_map, own), dof_map, levels, used)


def _build_refined_dof_map(
    samples: Samples, corners: Any, levels: Sequence[LevelSplines], regions: Regions
) -> tuple[RefinedDofMap, list[Ints]]:
    level_of_sample = regions.levels(samples.points)
    code, taken = np.empty(len(samples), dtype=np.int64), 0
    for number in range(len(levels)):
        rows = np.flatnonzero(level_of_sample == number)
        lattice_cells = codes_of_cells(regions.cells(samples.points[rows], number))
        names, place = np.unique(lattice_cells, return_inverse=True)
        code[rows] = taken + place
        taken += len(names)
    patch, first, touching = build_patches(code, corners, samples.cell)
    level_of_patch = level_of_sample[first]
    d = samples.points.shape[1]
    cells = np.empty((len(first), d), dtype=np.int64)
    unknowns = np.empty((len(first), 3**d), dtype=np.int32)
    nodes, used, size = [], [], 0
    for number, level in enumerate(levels):
        own = np.flatnonzero(level_of_patch == number)
        there = level.patch_of(first[own])
        cells[own] = level.dof_map.cells[there]
        read, place = np.unique(level.dof_map.unknowns[there], return_inverse=True)
        unknowns[own] = size + place.reshape(len(own), 3**d)
        nodes.append(level.dof_map.nodes[read])
        used.append(read)
        size += len(read)
    every = np.concatenate(nodes)
    spacing = levels[0].dof_map.spacing
    of_node = np.repeat(np.arange(len(levels)), [len(one) for one in used])
    return (
        RefinedDofMap(spacing, cells, unknowns, every, touching, patch, levels=level_of_patch, node_levels=of_node),
        used,
    )
