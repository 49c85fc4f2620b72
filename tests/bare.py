"""A source stripped of every ability but closest points, as a user's own object may be."""

from __future__ import annotations

from dataclasses import dataclass

from cpmkit import ClosestPointSource


@dataclass(frozen=True, eq=False)
class Bare:
    """Answers closest point queries through ``source`` and knows nothing else."""

    source: ClosestPointSource

    @property
    def dim(self):
        return self.source.dim

    @property
    def manifold_dim(self):
        return self.source.manifold_dim

    @property
    def bounds(self):
        return self.source.bounds

    @property
    def exact(self):
        return self.source.exact

    def closest_point(self, x, /):
        return self.source.closest_point(x)
