"""A source whose feet are off at random, by another vector at each query, the same each time that it is asked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit import ClosestPointSource

#: Of the random numbers, which are hashes of the query.
_MIX = np.array([[127.1, 311.7, 74.7], [269.5, 183.3, 246.1], [113.5, 271.9, 124.6]])


@dataclass(frozen=True, eq=False)
class Noisy:
    """Each coordinate of the feet of ``of`` is off by up to ``size``, at random."""

    of: ClosestPointSource
    size: float
    exact = False

    @property
    def dim(self):
        return self.of.dim

    @property
    def manifold_dim(self):
        return self.of.manifold_dim

    @property
    def bounds(self):
        return self.of.bounds

    def closest_point(self, x):
        answer = self.of.closest_point(x)
        hashed = np.sin(x @ _MIX[: self.dim, : self.dim]) * 43758.5453
        points = answer.points + self.size * (2 * (hashed - np.floor(hashed)) - 1)
        return replace(answer, points=points, distance=np.linalg.norm(x - points, axis=1))
