"""Boxes: rectangles in the plane and cuboids in space, with all that is inside."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from cpmkit.plugin import Floats, Ints, rectangle
from cpmkit_analytic.shapes import Feet


@dataclass(frozen=True, eq=False)
class Box:
    """The points whose coordinate k is at most ``half[k]`` from zero.

    Attributes
    ----------
    half : (d,) float64
        Half the lengths of the sides.
    """

    half: Floats

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return len(self.half)

    @property
    def manifold_dim(self) -> int:
        """Dimension of the space: a box is solid."""
        return len(self.half)

    def feet(self, q: Floats) -> Feet:
        """Return the closest points of ``q`` (n, d); of points in the box or on a side, themselves with ``edge`` -1.

        Else ``edge`` is the side beyond which the query lies farthest: 2 k where coordinate k is least, 2 k + 1 where
        it is greatest.
        """
        beyond = np.abs(q) - self.half
        axis = beyond.argmax(axis=1)
        rows = np.arange(len(q))
        face = 2 * axis + (q[rows, axis] > 0)
        return Feet(np.clip(q, -self.half, self.half), np.where(beyond[rows, axis] > 0, face, -1))

    def support(self, u: Floats) -> Floats:
        """Return (n,) the largest ``u . p`` over the box for each of ``u`` (n, d)."""
        return np.asarray(np.abs(u) @ self.half)

    def mesh(self, spacing: float) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and triangles (m, 3), counterclockwise, in the rectangle or on the cuboid's sides.

        Edges are of about ``spacing``; each side of a cuboid has vertices of its own.
        """
        if self.dim == 2:
            return rectangle(-self.half, self.half, spacing)
        vertices, triangles, first = [], [], 0
        for axis, sign in product(range(3), (-1, 1)):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            half = self.half[[u, v]]
            flat, cells = rectangle(-half, half, spacing)
            points = np.empty((len(flat), 3))
            points[:, axis], points[:, u], points[:, v] = sign * self.half[axis], flat[:, 0], flat[:, 1]
            vertices.append(points)
            triangles.append((cells if sign > 0 else cells[:, ::-1]) + first)
            first += len(points)
        return np.concatenate(vertices), np.concatenate(triangles)

    def scale_by(self, factor: float) -> Box:
        """Return the box ``factor`` times as large."""
        return replace(self, half=factor * self.half)
