"""Which samples see which unknowns: patches of lattice cells, and the copies of nodes that they read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class DofMap:
    """The space of splines: a patch is what of the manifold hangs together inside one lattice cell.

    Lattice cells are bounded by knot planes: cell r holds the points that r is the nearest lattice point of. Splines of
    even degree p are centred at lattice points, of odd degree half a spacing below them along every axis: in any case a
    cell reads the p + 1 nodes an axis from r - p // 2 on.

    Attributes
    ----------
    spacing : float
        h, of the lattice, in the scene's unit.
    cells : (p, d) int64
        The lattice cell of each patch.
    unknowns : (p, (degree + 1)^d) int32
        The unknowns at the nodes that a patch reads, the last axis running fastest.
    nodes : (n, d) int64
        The node of each unknown.
    touching : (t, 2) int32
        Pairs of patches with samples that touch, each pair once.
    patch : (q,) int32
        The patch of each sample.
    degree : int
        Of the splines: 1, 2 or 3.
    """

    spacing: float
    cells: Ints
    unknowns: Any
    nodes: Ints
    touching: Any
    patch: Any
    degree: int = 2

    @property
    def size(self) -> int:
        """Number of unknowns, n."""
        return len(self.nodes)

    @property
    def dim(self) -> int:
        """Dimension d of the space."""
        return int(self.nodes.shape[1])

    @property
    def width(self) -> int:
        """Number of splines along an axis that a cell reads: one more than the degree."""
        return self.degree + 1

    @property
    def strides(self) -> tuple[int, ...]:
        """How far apart neighbours along each axis stand among the unknowns of a patch."""
        return tuple(self.width**axis for axis in reversed(range(self.dim)))

    @property
    def places(self) -> Floats:
        """(n, d) where the spline of each unknown is centred, relative to the lattice's origin."""
        return np.asarray(self.spacing * (self.nodes - 0.5 * (self.degree % 2)))
