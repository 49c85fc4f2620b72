"""A source relative to the lattice's origin, with a count of its queries and the measured noise of its answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partialmethod
from typing import Any

import numpy as np

from cpmkit.manifold.abilities import (
    HasCreases,
    HasLeft,
    HasLocalMinima,
    HasMembers,
    HasNormals,
    HasSmoothSurface,
    HasTangents,
    members_of,
)
from cpmkit.manifold.source import ClosestPoints, ClosestPointSource, check_answer
from cpmkit.runtime.deprecation import warn_renamed
from cpmkit.types import Floats, Ints


def _has_ability(ability: type, of_members: bool = False) -> cached_property[bool]:
    """Return a property of a local source: whether its source, or each of its members, has the ``ability``."""
    return cached_property(
        lambda local: all(isinstance(member.source, ability) for member in (local.members if of_members else [local]))
    )


@dataclass(frozen=True, eq=False)
class LocalSource:
    """A source whose queries and answers are relative to ``origin``.

    A source that can be translated (``HasTranslation``) is translated once and keeps its accuracy far from zero; any
    other is shifted query by query, which rounds coordinates.
    """

    source: ClosestPointSource  #: Answers the queries.
    shift: Floats  #: (d,): added to queries and subtracted from answers; zero where the source was translated.
    #: ``queries["points"]`` is the number of closest point queries so far.
    queries: Counter[str] = field(default_factory=Counter)
    origin: Floats | None = None  #: (d,): position of zero in the scene, for messages; by default ``shift``.
    of: ClosestPointSource | None = None  #: The source before translation: the key of caches that hold at every place.
    noise: float = 0.0  #: Root mean square of the random error of a foot's coordinate; zero unless measured.
    slight_creases: bool = False  #: Whether contouring found creases that turn by 6 to 30 degrees.

    @property
    def dim(self) -> int:
        """Dimension d of the space."""
        return self.source.dim

    @property
    def manifold_dim(self) -> int | None:
        """Dimension of the manifold; None for a union of members of different dimensions."""
        return self.source.manifold_dim

    @property
    def bounds(self) -> Floats:
        """(2, d) bounds relative to the origin."""
        return np.asarray(self.source.bounds, dtype=np.float64) - self.shift

    @property
    def scene_origin(self) -> Floats:
        """(d,) position of zero in the scene."""
        return self.shift if self.origin is None else self.origin

    @cached_property
    def members(self) -> tuple[LocalSource, ...]:
        """The members of a union relative to the same origin, with ``noise`` 0; the source itself if it is no union."""
        if not self.is_union:
            return (self,)
        members = members_of(self.source)
        originals = (None,) * len(members) if self.of is None else members_of(self.of)
        return tuple(
            LocalSource(member, self.shift, self.queries, self.origin, original)
            for member, original in zip(members, originals, strict=True)
        )

    @cached_property
    def is_union(self) -> bool:
        """Whether the source has members."""
        return isinstance(self.source, HasMembers)

    @property
    def largest_dim(self) -> int:
        """Dimension of the manifold; of a union the largest of its members'; if unknown, that of the space."""
        return largest_dim(self.source)

    def smooth_surface(self) -> LocalSource:
        """Return the source with closest points on the smooth surface that it stands for, if they are on flat cells."""
        source = self.source
        return replace(self, source=source.smooth_surface()) if isinstance(source, HasSmoothSurface) else self

    def dimensions_at(self, feet: ClosestPoints) -> Ints:
        """Return the dimension (n,) of the member that contains each of ``feet``; if unknown, that of the space."""
        dims = np.array([self.dim if member.manifold_dim is None else member.manifold_dim for member in self.members])
        return np.full(len(feet), dims[0]) if len(dims) == 1 else dims[feet.element]

    def feet_by_member(self, feet: ClosestPoints) -> Iterator[tuple[LocalSource, Ints, ClosestPoints]]:
        """Yield each member that contains some of ``feet``, the rows (k,) of these, and their closest points on it."""
        if self.members[0] is self:
            yield self, np.arange(len(feet)), feet
            return
        assert feet.element is not None
        for number in np.unique(feet.element):
            rows = np.flatnonzero(feet.element == number)
            yield self.members[number], rows, self.members[number].closest_point(feet.points[rows])

    def knows_directions(self, dimension: int) -> bool:
        """Return whether all members of this ``dimension``, if any, have tangents (if 1) or normals of their own."""
        members = [member for member in self.members if member.manifold_dim == dimension]
        return all(member.has_tangents if dimension == 1 else member.has_normals for member in members)

    #: Whether the source has the ability.
    has_normals = _has_ability(HasNormals)
    has_creases = _has_ability(HasCreases)
    has_tangents = _has_ability(HasTangents)
    #: Whether the source, or each member of a union, has the ability.
    has_local_minima = _has_ability(HasLocalMinima, of_members=True)
    has_left = _has_ability(HasLeft, of_members=True)

    def closest_point(self, x: Floats) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d), both relative to the origin, and count the queries in ``queries``.

        Raises InputError for an answer that :func:`check_answer` refuses.
        """
        self.queries["points"] += len(x)
        answer = self.source.closest_point(np.ascontiguousarray(x + self.shift))
        check_answer(answer, x, self.source, self.scene_origin, self.is_union)
        return self._shift(answer, -self.shift)

    def local_minima(self, x: Floats, radius: float) -> tuple[Ints, ClosestPoints]:
        """Return the rows (k,) of ``x`` (n, d) of all feet within ``radius``, and these feet, relative to the origin.

        Rows ascend, the feet of a row by distance; a row counts as one query. Only for sources with local minima.
        Raises InputError for an answer that :func:`check_answer` refuses.
        """
        source: Any = self.source
        self.queries["points"] += len(x)
        rows, feet = source.local_minima(np.ascontiguousarray(x + self.shift), radius)
        check_answer(feet, x[rows], self.source, self.scene_origin, self.is_union)
        return rows, self._shift(feet, -self.shift)

    def _directions(self, name: str, feet: ClosestPoints) -> Floats:
        """Return the vectors (n, d) that the source's method ``name`` returns at ``feet``, relative to the origin."""
        return np.asarray(getattr(self.source, name)(self._shift(feet, self.shift)))

    normals = partialmethod(_directions, "normals")
    facet_normals = partialmethod(_directions, "facet_normals")
    tangents = partialmethod(_directions, "tangents")
    leftward = partialmethod(_directions, "leftward")

    def _shift(self, feet: ClosestPoints, offset: Floats) -> ClosestPoints:
        """Return a copy of ``feet`` moved by ``offset`` (d,); ``feet`` unchanged where the source was translated."""
        return replace(feet, points=feet.points + offset) if self.shift.any() else feet


def largest_dim(source: ClosestPointSource) -> int:
    """Return the dimension of a source, of a union the largest of its members; if unknown, that of the space."""
    return max(source.dim if member.manifold_dim is None else member.manifold_dim for member in members_of(source))


def localize(source: ClosestPointSource, origin: Floats) -> LocalSource:
    """Return ``source`` with queries and answers relative to ``origin`` (d,).

    Unless ``origin`` is zero, the source is translated if it has a method for that, else queries and feet are shifted.
    The deprecated method ``translated`` is called where ``translate`` is missing, with a warning.
    """
    if not origin.any():
        return LocalSource(source, np.array(origin), of=source)
    translate: Any = getattr(source, "translate", None)
    if translate is None and hasattr(source, "translated"):
        warn_renamed(f"{type(source).__name__}.translated", "translate")
        translate = source.translated
    if translate is not None:
        return LocalSource(translate(-origin), np.zeros_like(origin), origin=np.array(origin), of=source)
    return LocalSource(source, np.array(origin), of=source)


def measure_noise(source: LocalSource, spacing: float) -> LocalSource:
    """Return a copy of the source with its ``noise``, the random error of feet, measured near 25 random feet.

    All points of the segment from a query to its foot have the same foot. Computed feet of such points coincide if they
    are exact, and lie on a smooth curve if their error is smooth: third differences along the segment have 20 times the
    variance of the random error. Queries lie within half a ``spacing`` of a foot along each axis. The noise is the root
    of the median variance, or 0 if it is mere rounding.
    """
    rng = np.random.default_rng(0)
    low, high = source.bounds
    around = source.closest_point(rng.uniform(low, high, (25, source.dim))).points  # 25 segments
    queries = around + rng.uniform(-0.5, 0.5, around.shape) * spacing
    feet = source.closest_point(queries).points

    def feet_at(share: float) -> Floats:
        """Return the feet (n, d) of the points at ``share`` of the way from the feet to the queries."""
        return source.closest_point(feet + share * (queries - feet)).points

    third = feet - 3 * feet_at(0.75) + 3 * feet_at(0.5) - feet_at(0.25)
    variances = (third * third).mean(axis=1) / 20.0  # of 1 + 9 + 9 + 1 independent errors
    noise = float(np.sqrt(np.median(variances)))
    return replace(source, noise=noise if noise > 1e-10 * spacing else 0.0)  # else rounding
