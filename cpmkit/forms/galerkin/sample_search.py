"""The nearest samples of points of the manifold: those in the lattice cells around, or out of a tree."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.samples import QuantisedSamples, Samples
from cpmkit.forms.galerkin.space.dof_map import DofMap
from cpmkit.grid.lattice import Codes
from cpmkit.types import Bools, Floats, Ints

#: Points are looked up by boxes of so many spacings, which takes half the time: what a box needs is in the cache.
NEAR_SPACINGS = 4.0
#: Cells around are looked through where they hold so many times the samples that are wanted, or more.
PLENTY = 0.5


@dataclass(frozen=True, eq=False)
class SampleSearch:
    """The samples of a parting, by their places.

    Attributes
    ----------
    dof_map : Parting
    samples : Samples or FixedSamples
        Those of the parting.
    """

    dof_map: DofMap
    samples: Samples | QuantisedSamples

    def of(self, points: Floats, count: int) -> tuple[Floats, Ints]:
        """Return the distances (k, count) of the samples nearest to points (k, d), ascending, and their numbers.

        ``count`` is at most that of the samples.
        """
        distance, near = np.empty((len(points), count)), np.empty((len(points), count), dtype=np.int64)
        order = np.lexsort(np.floor(points.T / (NEAR_SPACINGS * self.dof_map.spacing)))
        if self._in_cells is not None and PLENTY * count * len(self._in_cells.codes) <= len(self.samples):
            distance[order], near[order], complete = self._in_cells.nearest(points[order], count)
            order = order[~complete]
        if len(order):
            found = self._tree.query(points[order], count)
            distance[order], near[order] = (one.reshape(len(order), count) for one in found)
        return distance, near

    @cached_property
    def _in_cells(self) -> SamplesInCells | None:
        return samples_in_cells(self.dof_map, self.samples) if type(self.dof_map) is DofMap else None

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.samples.points, balanced_tree=False)


@dataclass(frozen=True, eq=False)
class SamplesInCells:
    """Samples patch by patch, and the lattice cells of these.

    Attributes
    ----------
    spacing : float
        Of the lattice.
    points : (q, d) float64
        In spacings.
    order : (q,) integers
        The number of each.
    codes, starts : (p,) and (p + 1,) int64
        The code of the cell of each patch, ascending, and where its samples begin.
    numbering : Codes
        Of the cells and those around them.
    """

    spacing: float
    points: Floats
    order: Ints
    codes: Ints
    starts: Ints
    numbering: Codes

    def nearest(self, points: Floats, count: int) -> tuple[Floats, Ints, Bools]:
        """Return distances (k, count), numbers (k, count), and of which points (k,) these are all: others lie apart."""
        from cpmkit.forms.galerkin.locator_kernels import nearest_in_cells

        around = np.array(sorted(product((0, -1, 1), repeat=points.shape[1]), key=lambda step: np.abs(step).sum()))
        lower, strides = self.numbering.lower, self.numbering.strides
        squares, near, complete = nearest_in_cells(
            points / self.spacing, around, lower, strides, self.codes, self.starts, self.points, count
        )
        return self.spacing * np.sqrt(squares), self.order[near], complete


def samples_in_cells(dof_map: DofMap, samples: Samples | QuantisedSamples) -> SamplesInCells:
    """Return the samples patch by patch."""
    from cpmkit.runtime.inverse_index import inverse_index

    starts, order = inverse_index(dof_map.patch, len(dof_map.cells))
    numbering = Codes.around(dof_map.cells, 1)
    points = samples.points[order] / dof_map.spacing
    return SamplesInCells(dof_map.spacing, points, order, numbering.encode(dof_map.cells), starts, numbering)
