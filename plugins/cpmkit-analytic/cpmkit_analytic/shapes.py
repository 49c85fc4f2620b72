"""What a shape says of itself in its own frame; :mod:`cpmkit_analytic.placed` carries it into the world."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from cpmkit.plugin import Floats, Ints


class Feet(NamedTuple):
    """Closest points (n, d) in the frame of the shape, ``edge`` (n,), -1 for none, and ``local`` (n, m) or None."""

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
        """Return the closest points of ``q`` (n, d), in the frame of the shape."""

    def support(self, u: Floats) -> Floats:
        """Return the largest ``u . p`` over the shape for each row of ``u`` (n, d): its extent along u."""

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the shape and cells (m, k), k = 1, 2 or 3, with edges of about ``spacing``."""

    def scale_by(self, factor: float) -> Shape:
        """Return the shape ``factor`` times as large."""


class HasShapeNormals(Shape, Protocol):
    """A hypersurface with outward normals."""

    def normals(self, p: Floats) -> Floats:
        """Return outward unit normals (n, d) at points ``p`` (n, d) of the shape."""


class HasShapeTangents(Shape, Protocol):
    """A curve with tangents."""

    def tangents(self, p: Floats) -> Floats:
        """Return unit tangents (n, d) in the direction of travel at points ``p`` (n, d) of the shape."""


def no_edge_entries(q: Floats) -> Ints:
    """Return (n,) -1, the ``edge`` entries of feet that lie on no edge, one for each row of ``q``."""
    return np.full(len(q), -1, dtype=np.int64)
