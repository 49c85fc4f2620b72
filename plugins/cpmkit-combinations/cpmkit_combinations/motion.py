"""The kind ``moved``: any source turned, scaled and shifted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partialmethod
from itertools import product
from typing import Any

import numpy as np

from cpmkit.plugin import (
    Advice,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    Ints,
    advice_of,
    as_points,
    as_rotation,
    as_vector,
    check_source,
    positive,
    rotate,
    source_repr,
)
from cpmkit_combinations.union import Union, union
from cpmkit_combinations.wrapper import Wrapper, with_abilities


@dataclass(frozen=True, eq=False)
class Moved(Wrapper):
    """The points ``translation + scale * rotation @ p`` for p on another source.

    Attributes
    ----------
    of : ClosestPointSource
        What is moved.
    rotation : (d, d) float64
        Proper rotation.
    translation : (d,) float64
    scale : float
        Above zero.
    """

    rotation: Floats
    translation: Floats
    scale: float

    __repr__ = source_repr

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the box around the moved box."""
        corners = self._to_world(np.array(list(product(*np.asarray(self.of.bounds, dtype=np.float64).T))))
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d); ``edge``, ``element`` and ``local`` are those of what is moved.

        Raises
        ------
        InputError
            If ``x`` holds NaN or infinity, or its shape is not (n, d).
        """
        return self._world_record(self.of.closest_point(self._to_own(as_points(x, self.dim))))

    def _to_own(self, x: Floats) -> Floats:
        return np.ascontiguousarray(rotate(self.rotation.T, x - self.translation) / self.scale)

    def _to_world(self, p: Floats) -> Floats:
        return self.scale * rotate(self.rotation, p) + self.translation

    def _world_record(self, feet: ClosestPoints) -> ClosestPoints:
        return replace(feet, points=self._to_world(feet.points), distance=self.scale * feet.distance)

    def _own_record(self, feet: ClosestPoints) -> ClosestPoints:
        return replace(feet, points=self._to_own(feet.points), distance=feet.distance / self.scale)

    def _turned(self, name: str, feet: ClosestPoints, /) -> Floats:
        """Return the unit vectors (n, d) of what is moved that it calls ``name``, turned with it."""
        return rotate(self.rotation, getattr(self.of, name)(self._own_record(feet)))

    _normals = partialmethod(_turned, "normals")
    _facet_normals = partialmethod(_turned, "facet_normals")
    _tangents = partialmethod(_turned, "tangents")
    _leftward = partialmethod(_turned, "leftward")

    @property
    def _left_of(self) -> Floats | None:
        """(d,) the point on the left that what is moved names, moved with it."""
        point = self.of.left_of
        return None if point is None else self._to_world(as_vector(point, self.dim, "left_of")[None])[0]

    def _local_minima(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return the rows (k,) of ``x`` (n, d) and their feet within ``radius``, the nearest first."""
        own = self._to_own(as_points(x, self.dim))
        rows, feet = self.of.local_minima(own, positive(radius, "radius") / self.scale)
        return rows, self._world_record(feet)

    def _interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return ``values`` (value_count, ...) interpolated at ``feet``."""
        return np.asarray(self.of.interpolate(values, self._own_record(feet)))

    def _mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and cells (m, k) of about ``spacing``."""
        vertices, cells = self.of.mesh(positive(spacing, "spacing") / self.scale)
        return self._to_world(vertices), cells

    @property
    def _given_mesh(self) -> tuple[Floats, Ints]:
        """The vertices (n, d) that what is moved was made from, moved with it, and their cells."""
        vertices, cells = self.of.given_mesh
        return self._to_world(vertices), cells

    def _translated(self, offset: Floats, /) -> Moved:
        """Return the same source moved by ``offset`` (d,); the translation alone is rounded, once."""
        return replace(self, translation=self.translation + as_vector(offset, self.dim, "offset"))

    @property
    def _members(self) -> Sequence[Any]:
        """The members, each moved."""
        parts = {"rotation": self.rotation, "translation": self.translation, "scale": self.scale}
        return [moved(of=member, **parts) for member in self.of.members]

    def _advice(self, spacing: float, /) -> Advice:
        """Return what the source that is moved has to say at this spacing, in its own coordinates."""
        return advice_of(self.of, spacing / self.scale)


def moved(*, of: ClosestPointSource, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Any:
    """Return ``translation + scale * rotation @ x`` for the points x of a source, with the abilities that it has.

    Parameters
    ----------
    of : source
        What is moved. The members of a union are moved one by one.
    rotation : angle in the plane, (3,) rotation vector or (d, d) matrix, optional
        Vectors and angles in radians.
    translation : (d,) numbers, optional
    scale : number above zero

    Raises
    ------
    InputError
        If ``of`` is no source, the matrix is not a proper rotation, a length is wrong or the scale is not above zero.

    Examples
    --------
    >>> import cpmkit as ck
    >>> ring = ck.source("moved", of=ck.source("analytic.circle"), scale=2.0, translation=[1.0, 0.0])
    >>> ring.closest_point([[9.0, 0.0]]).points.tolist()
    [[3.0, 0.0]]
    """
    check_source(of, "what is moved")
    if isinstance(of, Union):
        return union(
            members=[moved(of=member, rotation=rotation, translation=translation, scale=scale) for member in of.members]
        )
    turn = as_rotation(rotation, of.dim)
    offset = as_vector(np.zeros(of.dim) if translation is None else translation, of.dim, "translation")
    return with_abilities(Moved, "moved", of)(of, turn, offset, positive(scale, "scale"))
