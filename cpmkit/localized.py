"""A source seen from the lattice: queries relative to its origin, and a count of them."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from cpmkit.protocols import (
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasNormals,
    HasTangents,
    HasTranslation,
)


@dataclass(frozen=True, eq=False)
class Localized:
    """A source that is asked and answers relative to ``origin``.

    A source that can translate itself (``HasTranslation``) is restated once and keeps its accuracy
    however far from zero it lies; any other is shifted query by query, which costs the rounding
    of its coordinates.

    Attributes
    ----------
    source : ClosestPointSource
        The source that is asked.
    shift : (d,) float64
        Added to queries and taken from answers; zero where the source was translated.
    queries : Counter
        ``queries["points"]`` counts the closest point queries made so far.
    """

    source: ClosestPointSource
    shift: Floats
    queries: Counter[str] = field(default_factory=Counter)

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return self.source.dim

    @property
    def manifold_dim(self) -> int | None:
        """Dimension of the manifold."""
        return self.source.manifold_dim

    @property
    def bounds(self) -> Floats:
        """(2, d) bounds relative to the origin."""
        return np.asarray(self.source.bounds, dtype=np.float64) - self.shift

    @property
    def has_normals(self) -> bool:
        """True if the source gives its own normals."""
        return isinstance(self.source, HasNormals)

    @property
    def has_tangents(self) -> bool:
        """True if the source gives its own tangents."""
        return isinstance(self.source, HasTangents)

    def closest_point(self, x: Floats) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d), both relative to the origin."""
        self.queries["points"] += len(x)
        return self._moved(self.source.closest_point(np.ascontiguousarray(x + self.shift)), -self.shift)

    def normals(self, feet: ClosestPoints) -> Floats:
        """Return the source's own normals (n, d) at ``feet``."""
        assert isinstance(self.source, HasNormals)
        return self.source.normals(self._moved(feet, self.shift))

    def tangents(self, feet: ClosestPoints) -> Floats:
        """Return the source's own tangents (n, d) at ``feet``."""
        assert isinstance(self.source, HasTangents)
        return self.source.tangents(self._moved(feet, self.shift))

    def _moved(self, feet: ClosestPoints, offset: Floats) -> ClosestPoints:
        return replace(feet, points=feet.points + offset) if self.shift.any() else feet


def localize(source: ClosestPointSource, origin: Floats) -> Localized:
    """Return ``source`` as seen from ``origin`` (d,)."""
    if origin.any() and isinstance(source, HasTranslation):
        return Localized(source.translated(-origin), np.zeros_like(origin))
    return Localized(source, np.array(origin))
