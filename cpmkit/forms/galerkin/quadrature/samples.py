"""TODO."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.protocols import Floats, Ints


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of the manifold with weights, from which every integral over it is summed.

    Attributes
    ----------
    points : (q, d) float64
        Relative to the lattice's origin.
    weights : (q,) float64
        Share of the manifold's measure; zero for points that only read u beside a boundary.
    normals : (q, c, d) float64
        Orthonormal vectors that span the normal space, c = d - manifold_dim of them.
    cell : (q,) int32
        The cell of the mesh that each lies in.
    """

    points: Floats
    weights: Floats
    normals: Floats
    cell: Any

    def __post_init__(self) -> None:
        object.__setattr__(self, "cell", np.ascontiguousarray(self.cell, dtype=np.int32))

    def __len__(self) -> int:
        return len(self.points)

    def points_at(self, rows: slice | Ints) -> Floats:
        """Return (..., d) the points of the samples ``rows`` (...)."""
        return np.asarray(self.points[rows])

    def normals_at(self, rows: slice | Ints) -> Floats:
        """Return (..., c, d) the normals of the samples ``rows`` (...)."""
        return np.asarray(self.normals[rows])

    def cell_at(self, rows: Ints) -> Ints:
        """Return (...) the cells of the samples ``rows`` (...)."""
        return np.asarray(self.cell[rows])
