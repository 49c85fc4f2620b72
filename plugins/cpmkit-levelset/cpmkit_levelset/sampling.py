"""Points spread over a level set, found by moving nodes of a lattice onto it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Bools, Floats, InputError, norms
from cpmkit_levelset.fields import Field
from cpmkit_levelset.manifold import ZeroSet

#: Rows that are evaluated at a time: temporary arrays stay in the cache.
FIELD_CHUNK_ROWS = 32768
#: How far, in spacings of the lattice, a point can be from the nearest sample: 0.67 was the most that was measured.
COVERING_SPACINGS = 0.7


@dataclass(frozen=True, eq=False)
class SampleLattice:
    """A lattice over the bounds, with the values of phi on it.

    Attributes
    ----------
    lower, spacing : (d,) float64
        The first node, and how far the others are apart.
    values : (n0, n1[, n2]) float64
        phi at the nodes.
    """

    lower: Floats
    spacing: Floats
    values: Floats

    @property
    def nodes(self) -> Floats:
        """(n, d) all nodes, the last coordinate running fastest."""
        index = np.indices(self.values.shape).reshape(self.values.ndim, -1).T
        nodes: Floats = self.lower + self.spacing * index
        return nodes


def sample_lattice(field: Field, bounds: Floats, spacing: float) -> SampleLattice:
    """Return a lattice that fills ``bounds`` (2, d), spaced by at most ``spacing``, with the values of ``field`` on it.

    Raise InputError if a value is not finite.
    """
    extent = bounds[1] - bounds[0]
    # the tolerance keeps a box of whole spacings from getting a cell more by rounding
    cells = np.maximum(np.ceil(extent / spacing - 1e-9).astype(int), 1)
    lattice = SampleLattice(bounds[0], extent / cells, np.zeros(tuple(cells + 1)))
    nodes = lattice.nodes
    values = evaluate_chunked(field.value, nodes)
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise InputError(
            f"phi must be finite in the bounds: it is NaN or infinite at {len(bad)} of {len(nodes)} lattice points, "
            f"first {nodes[bad[0]].tolist()}; change the bounds or phi."
        )
    return replace(lattice, values=values.reshape(lattice.values.shape))


def surface_samples(zero_set: ZeroSet, lattice: SampleLattice) -> Floats:
    """Return points (n, d) of the level set, one within 0.7 spacings (``COVERING_SPACINGS``) of each of its points.

    Every node that is about half a cell's diagonal or less from the level set, to first order, is moved onto it: each
    point of the level set has such a node. Where phi vanishes together with its gradient nothing is found: that is not
    part of the level set. Raise InputError if there is no such point.
    """
    nodes = lattice.nodes
    reach = float(norms(lattice.spacing[None])[0])
    near = evaluate_chunked(zero_set.distance_estimate, nodes) <= 0.55 * reach
    points, converged = zero_set.project(nodes[near], 0.55 * reach)
    points = points[converged]
    if not len(points):
        values = lattice.values
        raise InputError(
            f"phi has no zero set in the bounds: on {values.size} lattice points it goes from {values.min():.6g} "
            f"to {values.max():.6g}, and no zero with a gradient was found; change the bounds or phi."
        )
    return points


def exit_points(lattice: SampleLattice, keep: Bools) -> Floats:
    """Return points (n, d) where the level set leaves the bounds: nodes on these beside a change of sign along them.

    Only changes between two nodes that are both in ``keep``, (number of nodes,) bool, count.
    """
    positive, kept = lattice.values > 0, keep.reshape(lattice.values.shape)
    hit = np.zeros(positive.shape, dtype=bool)
    for axis in range(positive.ndim):
        ahead, behind = (
            tuple(part if k == axis else slice(None) for k in range(positive.ndim))
            for part in (slice(1, None), slice(None, -1))
        )
        hit[behind] |= (
            (positive[ahead] != positive[behind]) & kept[ahead] & kept[behind] & _boundary_edges(positive, axis)
        )
    return lattice.nodes[hit.ravel()]


def _boundary_edges(values: Bools, axis: int) -> Bools:
    """Return which lattice edges along ``axis`` lie in the boundary; of the shape of ``values``, less 1 along axis."""
    shape = list(values.shape)
    shape[axis] -= 1
    outside = np.ones(shape, dtype=bool)
    outside[tuple(slice(None) if k == axis else slice(1, -1) for k in range(values.ndim))] = False
    return outside


def evaluate_chunked(function: Callable[[Floats], Floats], points: Floats) -> Floats:
    """Return the values (n,) of a function of points (n, d), evaluated 32768 at a time; empty for no points."""
    parts = [function(points[start : start + FIELD_CHUNK_ROWS]) for start in range(0, len(points), FIELD_CHUNK_ROWS)]
    return np.concatenate(parts) if parts else np.zeros(0)
