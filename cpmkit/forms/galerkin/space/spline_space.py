"""The space of splines over samples: what all its matrices share, whatever their coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.samples import QuantisedSamples, Samples
from cpmkit.forms.galerkin.space.dof_map import DofMap, connected_pieces
from cpmkit.types import Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_array


@dataclass(frozen=True, eq=False)
class SplineSpace:
    """Splines over samples, and the pattern of the matrices of their energies.

    Attributes
    ----------
    dof_map : Parting
        The unknowns.
    samples : FixedSamples
        In the order in which they were parted.
    heaviest : (n,) int32
        Where each unknown stands in the heaviest patch that reads it, as an index into ``parting.unknowns.ravel()``.
    runs : (r, degree + 2) int32
        Runs of neighbouring unknowns along an axis, one more than a patch reads, all ways where copies branch.
    short_runs : (s, degree + 1) int32
        Runs inside the heaviest patch of the unknowns that are in none of these, and of those of curves in space that
        keep to one layer of cells.
    indptr, indices : (n + 1,), (z,) int32 or int64
        The pattern of every matrix, columns ascending.
    """

    dof_map: DofMap
    samples: QuantisedSamples
    heaviest: Any
    runs: Any
    short_runs: Any
    indptr: Any
    indices: Any

    @property
    def manifold_dim(self) -> int:
        """Dimension m of the manifold."""
        return self.dof_map.dim - self.samples.codim

    def matrix(self, data: Floats) -> csr_array:
        """Return the (n, n) matrix with these entries, which shares the pattern with all others."""
        from scipy.sparse import csr_array

        n = self.dof_map.size
        matrix = csr_array((data, self.indices, self.indptr), shape=(n, n))
        matrix.has_canonical_format = True
        return matrix

    def by_patch(self) -> tuple[Any, Ints]:
        """Return the samples patch by patch, ``order`` (q,), and ``start`` (p + 1,), where each patch begins in it.

        Made anew each time, which takes a thirtieth of an assembly: kept they were a tenth of the samples' memory.
        """
        from cpmkit.runtime.inverse_index import inverse_index

        start, order = inverse_index(self.dof_map.patch, len(self.dof_map.cells))
        return order, start

    def means(self, values: Floats) -> Floats:
        """Return (n,) the mean of ``values`` (q,) or (1,) over the samples of the patches that read each unknown."""
        if len(values) == 1:
            return np.full(self.dof_map.size, values[0])
        patches, unknowns = len(self.dof_map.cells), self.dof_map.unknowns
        sums = np.bincount(self.dof_map.patch, values, minlength=patches)
        counts = np.bincount(self.dof_map.patch, minlength=patches).astype(float)
        width = unknowns.shape[1]
        totals = [np.bincount(unknowns.ravel(), each.repeat(width)) for each in (sums, counts)]
        return np.asarray(totals[0] / totals[1])


def build_spline_space(dof_map: DofMap, samples: Samples | QuantisedSamples) -> SplineSpace:
    """Return the space of the unknowns of ``dof_map`` over its ``samples``, which it numbers."""
    from cpmkit.forms.galerkin.space.pattern_kernels import following, pattern, runs_of
    from cpmkit.runtime.inverse_index import inverse_index

    samples = QuantisedSamples.of(samples, dof_map) if isinstance(samples, Samples) else samples
    n = dof_map.size
    patches, width = dof_map.unknowns.shape
    starts, places = inverse_index(dof_map.unknowns.ravel(), n)
    weight = np.bincount(dof_map.patch, samples.weights, minlength=patches)
    heaviest = _heaviest(weight[places // width], starts, places)
    neighbours = [following(dof_map.unknowns, n, stride, dof_map.width) for stride in dof_map.strides]
    by_axis = [runs_of(*one, dof_map.width + 1) for one in neighbours]
    del neighbours
    runs = np.concatenate(by_axis)
    alone = np.ones(n, dtype=bool)
    alone[runs] = False
    short_runs = lines_through(dof_map, heaviest[alone])
    if samples.codim > 1:
        short_runs = np.concatenate([short_runs, _across_straight_pieces(dof_map, by_axis, heaviest)])
    short_runs = np.unique(short_runs, axis=0)
    short_runs = short_runs[short_runs[:, 0] != short_runs[:, 1]]  # specks have one unknown all along
    indptr = np.zeros(n + 1, dtype=np.int32 if len(places) * width < 2**31 else np.int64)
    run_table = inverse_index(runs.ravel(), n)
    indices = pattern(dof_map.unknowns, starts, places, runs, *run_table, indptr)
    return SplineSpace(dof_map, samples, heaviest, runs, short_runs, indptr, indices)


def lines_through(dof_map: DofMap, entries: Ints) -> Ints:
    """Return (d k, degree + 1) the unknowns on the lines along the axes, inside a patch, through k of its places.

    ``entries`` (k,): indices into ``parting.unknowns.ravel()``.
    """
    flat, width = dof_map.unknowns.ravel(), dof_map.width
    lines = [(entries - entries // s % width * s)[:, None] + s * np.arange(width) for s in dof_map.strides]
    return np.asarray(flat[np.concatenate(lines)])


def _across_straight_pieces(dof_map: DofMap, by_axis: Sequence[Ints], heaviest: Ints) -> Ints:
    """Return runs inside patches along the axes in which a whole piece of a curve in space has no longer one.

    Such a piece keeps to one layer of cells. Where it is straight, y^2 z vanishes on it with all derivatives that the
    energy holds, y and z being these axes.
    """
    count, piece = connected_pieces(dof_map)
    found = []
    for axis, runs in enumerate(by_axis):
        flat = np.bincount(piece[runs[:, 0]], minlength=count) == 0
        found.append(lines_through(dof_map, heaviest[flat[piece]]).reshape(dof_map.dim, -1, dof_map.width)[axis])
    return np.concatenate(found)


def _heaviest(weights: Floats, starts: Ints, places: Ints) -> Ints:
    """Return for each unknown the one of its ``places`` whose weight is largest, the first of equal ones."""
    largest = np.maximum.reduceat(weights, starts[:-1])
    hits = np.flatnonzero(weights == largest.repeat(np.diff(starts)))
    row = np.searchsorted(starts, hits, side="right") - 1
    first = np.ones(len(hits), dtype=bool)
    first[1:] = row[1:] != row[:-1]
    return np.asarray(places[hits[first]])
