"""Which samples see which unknowns: patches of lattice cells, and the copies of nodes that they read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class Parting:
    """The space of splines: a patch is what of the manifold hangs together inside one lattice cell.

    Lattice cells are bounded by knot planes, half-way between nodes: cell r holds the points that r is the nearest node
    of, and reads the nodes from r - 1 to r + 1.

    Attributes
    ----------
    spacing : float
        h, of the lattice, in the scene's unit.
    cells : (p, d) int64
        The lattice cell of each patch.
    unknowns : (p, 3^d) int32
        The unknowns at the nodes r - 1 to r + 1 that a patch reads, the last axis running fastest.
    nodes : (n, d) int64
        The node of each unknown.
    touching : (t, 2) int32
        Pairs of patches with samples that touch, each pair once.
    patch : (q,) int32
        The patch of each sample.
    """

    spacing: float
    cells: Ints
    unknowns: Any
    nodes: Ints
    touching: Any
    patch: Any

    @property
    def size(self) -> int:
        """Number of unknowns, n."""
        return len(self.nodes)

    @property
    def dim(self) -> int:
        """Dimension d of the space."""
        return int(self.nodes.shape[1])

    @property
    def places(self) -> Floats:
        """(n, d) where the node of each unknown lies, relative to the lattice's origin."""
        return np.asarray(self.spacing * self.nodes)
