"""The source of a shape at a position: one wrapper for all kinds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from cpmkit.plugin import (
    ClosestPoints,
    Floats,
    Ints,
    as_points,
    as_rotation,
    as_vector,
    length,
    norms,
    positive,
    rotate,
    source_repr,
)
from cpmkit_analytic.shapes import HasShapeNormals, HasShapeTangents, Shape


@dataclass(frozen=True, eq=False)
class Placed:
    """The points ``center + axes @ p`` for p on a canonical shape.

    Distances are measured in the frame of the shape, after the centre has been taken off: they
    keep their accuracy however far from zero the shape lies.

    Attributes
    ----------
    shape : Shape
        The shape in canonical position, at its final size.
    center : (d,) float64
        Where the origin of its frame lies.
    axes : (d, d) float64
        Proper rotation; its columns are the axes of the frame.
    """

    shape: Shape
    center: Floats
    axes: Floats

    def __repr__(self) -> str:
        return source_repr(self, type(self.shape).__name__)

    @property
    def dim(self) -> int:
        """Dimension of the space."""
        return self.shape.dim

    @property
    def manifold_dim(self) -> int:
        """Dimension of the shape."""
        return self.shape.manifold_dim

    @property
    def exact(self) -> bool:
        """True: closed forms are true nearest points."""
        return True

    @cached_property
    def bounds(self) -> Floats:
        """(2, d) corners of the smallest box around the shape."""
        box = np.stack([self.center - self.shape.support(-self.axes), self.center + self.shape.support(self.axes)])
        box.flags.writeable = False
        return box

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d); ``local`` is the angle, the share of a segment, or None.

        Raise InputError if ``x`` holds NaN or infinity, or its shape is not (n, d).
        """
        q = self._to_shape(as_points(x, self.dim))
        feet = self.shape.feet(q)
        return ClosestPoints(self._to_world(feet.points), norms(q - feet.points), feet.edge, local=feet.local)

    def mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) on the shape and cells (m, k) with edges of about ``spacing``.

        Cells are the point (k = 1), segments in order of travel (2), or triangles (3), counterclockwise seen from
        outside; those of a cuboid cover its sides. Raise InputError if ``spacing`` is not a number above zero.
        """
        vertices, cells = self.shape.mesh(positive(spacing, "spacing"))
        return self._to_world(vertices), cells

    def translate(self, offset: Floats, /) -> Placed:
        """Return the same shape moved by ``offset`` (d,); the centre alone is rounded, once.

        Raise InputError if ``offset`` is not d finite numbers.
        """
        return replace(self, center=self.center + as_vector(offset, self.dim, "offset"))

    def move(self, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Placed:
        """Return the shape of the points ``translation + scale * rotation @ x`` for the points x of this one.

        Raise InputError if the matrix is not a proper rotation, a vector's length is wrong or the scale is not above
        zero.

        Parameters
        ----------
        rotation : (d, d) matrix, (3,) rotation vector, or angle in the plane, optional
            Vectors and angles in radians.
        translation : (d,) numbers, optional
        scale : number above zero
        """
        factor = length(scale, "scale")
        turn = as_rotation(rotation, self.dim)
        offset = as_vector(np.zeros(self.dim) if translation is None else translation, self.dim, "translation")
        center = offset + factor * rotate(turn, self.center[None])[0]
        return replace(self, shape=self.shape.scale_by(factor), center=center, axes=rotate(turn, self.axes.T).T)

    def _to_shape(self, x: Floats) -> Floats:
        return rotate(self.axes.T, x - self.center)

    def _to_world(self, p: Floats) -> Floats:
        return rotate(self.axes, p) + self.center


class PlacedSurface(Placed):
    """A hypersurface at its place, with outward normals."""

    def normals(self, feet: ClosestPoints, /) -> Floats:
        """Return outward unit normals (n, d) at ``feet``; of a curve in the plane, at the right hand of travel."""
        shape = cast("HasShapeNormals", self.shape)
        return rotate(self.axes, shape.normals(self._to_shape(feet.points)))


class PlacedCurve(Placed):
    """A curve at its place, with tangents."""

    def tangents(self, feet: ClosestPoints, /) -> Floats:
        """Return the unit tangents (n, d) at ``feet`` in the direction of travel."""
        shape = cast("HasShapeTangents", self.shape)
        return rotate(self.axes, shape.tangents(self._to_shape(feet.points)))


class PlacedPlaneCurve(PlacedCurve, PlacedSurface):
    """A curve at its place in the plane, with tangents and normals."""


def place_shape(shape: Shape, center: Floats, axes: Floats) -> Placed:
    """Return ``shape`` with its origin at ``center`` (d,) and its axes in the columns of a rotation ``axes`` (d, d)."""
    abilities = (shape.manifold_dim == 1, shape.manifold_dim == shape.dim - 1)
    classes = {
        (False, False): Placed,
        (False, True): PlacedSurface,
        (True, False): PlacedCurve,
        (True, True): PlacedPlaneCurve,
    }
    return classes[abilities](shape, center, axes)
