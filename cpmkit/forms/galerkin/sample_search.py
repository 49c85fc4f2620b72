"""The nearest samples of points of the manifold, by lattice cells or by a k-d tree."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.dof_map import DofMap
from cpmkit.forms.galerkin.space.quantised_samples import QuantisedSamples
from cpmkit.grid.lattice import Codes
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.types import Bools, Floats, Ints

#: Points are processed by boxes of so many spacings, in half of the time: the samples of a box stay in the cache.
BOX_SPACINGS = 4.0
#: Lattice cells are searched where the mean number of samples in them is at least this times the wanted number.
LEAST_SAMPLE_RATIO = 0.5


@dataclass(frozen=True, eq=False)
class SampleSearch:
    """Search for the samples of a dof map that are nearest to points.

    Attributes
    ----------
    dof_map : DofMap
    samples : Samples or QuantisedSamples
    """

    dof_map: DofMap
    samples: Samples | QuantisedSamples

    def nearest(self, points: Floats, count: int) -> tuple[Floats, Ints]:
        """Return the ascending distances (k, count) of the nearest samples from ``points`` (k, d), and their numbers.

        ``count`` is at most the number of samples.
        """
        distance, samples = np.empty((len(points), count)), np.empty((len(points), count), dtype=np.int64)
        order = np.lexsort(np.floor(points.T / (BOX_SPACINGS * self.dof_map.spacing)))
        cells = self._by_cell
        if cells is not None and LEAST_SAMPLE_RATIO * count * len(cells.codes) <= len(self.samples):
            distance[order], samples[order], complete = cells.nearest(points[order], count)
            order = order[~complete]
        if len(order):
            answer = self._tree.query(points[order], count)
            distance[order], samples[order] = (array.reshape(len(order), count) for array in answer)
        return distance, samples

    @cached_property
    def _by_cell(self) -> SamplesByCell | None:
        """The samples ordered by patch; None for dof maps of several levels."""
        return samples_by_cell(self.dof_map, self.samples) if type(self.dof_map) is DofMap else None

    @cached_property
    def _tree(self) -> Any:
        """The k-d tree of all samples."""
        from scipy.spatial import cKDTree

        return cKDTree(self.samples.points, balanced_tree=False)


@dataclass(frozen=True, eq=False)
class SamplesByCell:
    """Samples ordered by patch, with the lattice cells of the patches.

    Attributes
    ----------
    spacing : float
        Spacing of the lattice.
    points : (q, d) float64
        The samples in units of the spacing.
    order : (q,) integers
        The original number of each sample.
    codes, starts : (p,) and (p + 1,) int64
        The code of the lattice cell of each patch, ascending, and the first sample of each patch.
    numbering : Codes
        The codes of these lattice cells and their neighbours.
    """

    spacing: float
    points: Floats
    order: Ints
    codes: Ints
    starts: Ints
    numbering: Codes

    def nearest(self, points: Floats, count: int) -> tuple[Floats, Ints, Bools]:
        """Return the ascending distances (k, count) of the nearest samples from ``points`` (k, d), numbers, and a mask.

        The numbers (k, count) are those of the samples; the mask (k,) is true if no nearer sample can exist.
        """
        from cpmkit.forms.galerkin.locator_kernels import nearest_in_cells

        around = np.array(sorted(product((0, -1, 1), repeat=points.shape[1]), key=lambda step: np.abs(step).sum()))
        lower, strides = self.numbering.lower, self.numbering.strides
        squares, samples, complete = nearest_in_cells(
            points / self.spacing, around, lower, strides, self.codes, self.starts, self.points, count
        )
        return self.spacing * np.sqrt(squares), self.order[samples], complete


def samples_by_cell(dof_map: DofMap, samples: Samples | QuantisedSamples) -> SamplesByCell:
    """Return the ``samples`` ordered by patch."""
    from cpmkit.runtime.inverse_index import inverse_index

    starts, order = inverse_index(dof_map.patch, len(dof_map.cells))
    numbering = Codes.around(dof_map.cells, 1)
    points = samples.points[order] / dof_map.spacing
    return SamplesByCell(dof_map.spacing, points, order, numbering.encode(dof_map.cells), starts, numbering)
