"""What a shape says of itself in its own frame; :mod:`cpmkit_analytic.placed` carries it into the world."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from cpmkit.plugin import Floats, Ints


class Feet(NamedTuple):
    """Closest points (n, d) in the frame of the shape, with their ``edge`` and ``local`` entries."""

    points: Floats
    edge: Ints
    local: Floats | None = None


class Shape(Protocol):
    """A shape in canonical position: centred at zero, its axis along the last coordinate."""

    @property
    def dim(self) -> int:
        """Dimension of the space."""

    @property
    def manifold_dim(self) -> int:
        """Dimension of the shape."""

    def feet(self, q: Floats) -> Feet:
        """Return the closest points of ``q`` (n, d)."""

    def support(self, u: Floats) -> Floats:
        """Return the largest ``u . p`` over the shape for each row of ``u`` (n, d): its extent along u."""

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices on the shape and cells of about the size ``spacing``."""

    def scale_by(self, factor: float) -> Shape:
        """Return the shape ``factor`` times as large."""


class HasShapeNormals(Shape, Protocol):
    """A hypersurface with outward normals."""

    def normals(self, p: Floats) -> Floats:
        """Return unit normals (n, d) at points of the shape."""


class HasShapeTangents(Shape, Protocol):
    """A curve with tangents."""

    def tangents(self, p: Floats) -> Floats:
        """Return unit tangents (n, d) at points of the shape."""


def no_edge_entries(q: Floats) -> Ints:
    """Return (n,) -1, the ``edge`` entries of feet that lie on no edge, one for each row of ``q``."""
    return np.full(len(q), -1, dtype=np.int64)
