"""The kind ``moved``: a rotated, scaled and shifted source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partialmethod
from itertools import product
from typing import Any

import numpy as np

from cpmkit.plugin import (
    Advice,
    Bools,
    ClosestPoints,
    ClosestPointSource,
    Floats,
    Ints,
    advice_of,
    as_points,
    as_rotation,
    as_source,
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
        The source that is moved.
    rotation : (d, d) float64
        Proper rotation.
    translation : (d,) float64
        Added after rotation and scaling.
    scale : float
        Above zero.
    """

    rotation: Floats
    translation: Floats
    scale: float

    __repr__ = source_repr

    @property
    def bounds(self) -> Floats:
        """(2, d) corners of the bounding box of the moved box."""
        corners = self._to_world(np.array(list(product(*np.asarray(self.of.bounds, dtype=np.float64).T))))
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    def closest_point(self, x: Floats, /) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d); ``edge``, ``element``, ``local`` are those of the source inside.

        Raise InputError if ``x`` holds NaN or infinity, or its shape is not (n, d).
        """
        return self._world_record(self.of.closest_point(self._to_inner(as_points(x, self.dim))))

    def _to_inner(self, x: Floats) -> Floats:
        return np.ascontiguousarray(rotate(self.rotation.T, x - self.translation) / self.scale)

    def _to_world(self, p: Floats) -> Floats:
        return self.scale * rotate(self.rotation, p) + self.translation

    def _world_record(self, feet: ClosestPoints) -> ClosestPoints:
        """Return records ``feet`` of the source inside as records of the moved source."""
        return replace(feet, points=self._to_world(feet.points), distance=self.scale * feet.distance)

    def _inner_record(self, feet: ClosestPoints) -> ClosestPoints:
        return replace(feet, points=self._to_inner(feet.points), distance=feet.distance / self.scale)

    def _directions(self, name: str, feet: ClosestPoints, /) -> Floats:
        """Return unit vectors (n, d) at ``feet`` by the method ``name`` of the source inside, rotated."""
        return rotate(self.rotation, getattr(self.of, name)(self._inner_record(feet)))

    _normals = partialmethod(_directions, "normals")
    _facet_normals = partialmethod(_directions, "facet_normals")
    _tangents = partialmethod(_directions, "tangents")
    _leftward = partialmethod(_directions, "leftward")

    def _closest_point_and_inside(self, x: Floats, /) -> tuple[ClosestPoints, Bools]:
        """Return the closest points of ``x`` (n, d), and (n,) whether each of ``x`` lies inside or on the source."""
        feet, inside = self.of.closest_point_and_inside(self._to_inner(as_points(x, self.dim)))
        return self._world_record(feet), inside

    @property
    def left_of(self) -> Floats | None:
        """(d,) a point on the left of the boundary: that of the source inside, moved; None if that has none."""
        point = getattr(self.of, "left_of", None)
        return None if point is None else self._to_world(as_vector(point, self.dim, "left_of")[None])[0]

    def _local_minima(self, x: Floats, radius: float, /) -> tuple[Ints, ClosestPoints]:
        """Return rows (k,) of ``x`` (n, d), ascending, and their feet within ``radius``, by row the nearest first."""
        inner = self._to_inner(as_points(x, self.dim))
        rows, feet = self.of.local_minima(inner, positive(radius, "radius") / self.scale)
        return rows, self._world_record(feet)

    def _interpolate(self, values: Floats, feet: ClosestPoints, /) -> Floats:
        """Return (n, ...) ``values`` (value_count, ...) of the source inside, interpolated at ``feet``."""
        return np.asarray(self.of.interpolate(values, self._inner_record(feet)))

    def _mesh(self, spacing: float, /) -> tuple[Floats, Ints]:
        """Return vertices (v, d) and cells (m, k) of about ``spacing``."""
        vertices, cells = self.of.mesh(positive(spacing, "spacing") / self.scale)
        return self._to_world(vertices), cells

    @property
    def _given_mesh(self) -> tuple[Floats, Ints]:
        """The user's vertices (n, d) of the source inside, moved with it, and their cells."""
        vertices, cells = self.of.given_mesh
        return self._to_world(vertices), cells

    def _translate(self, offset: Floats, /) -> Moved:
        """Return the source moved by ``offset`` (d,); only the translation is rounded."""
        return replace(self, translation=self.translation + as_vector(offset, self.dim, "offset"))

    @property
    def _members(self) -> Sequence[Any]:
        """The moved members."""
        motion = {"rotation": self.rotation, "translation": self.translation, "scale": self.scale}
        return [moved_source(of=member, **motion) for member in self.of.members]

    def _with_members(self, numbers: Sequence[int], /) -> Any:
        """Return the union of the moved members with these ``numbers``; of one number the moved member itself."""
        chosen = [self._members[number] for number in numbers]
        return chosen[0] if len(chosen) == 1 else union(members=chosen)

    @property
    def _skin(self) -> ClosestPointSource:
        """The moved boundary of a solid."""
        moved: ClosestPointSource = moved_source(
            of=self.of.skin, rotation=self.rotation, translation=self.translation, scale=self.scale
        )
        return moved

    def _advice(self, spacing: float, /) -> Advice:
        """Return the error estimates and warnings of the source inside at grid ``spacing``, converted to its unit."""
        return advice_of(self.of, spacing / self.scale)


def moved_source(*, of: ClosestPointSource, rotation: Any = None, translation: Any = None, scale: Any = 1.0) -> Any:
    """Return the points ``translation + scale * rotation @ x`` for x on a source, with the source's abilities.

    Reading a mesh as flat triangles is not among them. Raise InputError if ``of`` is no source, the rotation is none
    of the forms below or not proper, the translation has another length than d, or the scale is not above zero.

    Parameters
    ----------
    of : source or mesh
        The members of a union are moved one by one.
    rotation : angle in the plane, (3,) rotation vector or (d, d) matrix, optional
        Angles, and lengths of rotation vectors, in radians, counterclockwise. By default none.
    translation : (d,) numbers, optional
        Zero by default.
    scale : number above zero
        The factor of all lengths, 1 by default.

    Examples
    --------
    >>> import cpmkit as ck
    >>> ring = ck.source("moved", of=ck.source("analytic.circle"), scale=2.0, translation=[1.0, 0.0])
    >>> ring.closest_point([[9.0, 0.0]]).points.tolist()
    [[3.0, 0.0]]
    """
    of = as_source(of)
    check_source(of, "the source to move")
    if isinstance(of, Union):
        motion = {"rotation": rotation, "translation": translation, "scale": scale}
        return union(members=[moved_source(of=member, **motion) for member in of.members])
    matrix = as_rotation(rotation, of.dim)
    offset = as_vector(np.zeros(of.dim) if translation is None else translation, of.dim, "translation")
    return with_abilities(Moved, "moved", of)(of, matrix, offset, positive(scale, "scale"))
