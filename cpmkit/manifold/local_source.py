"""A source seen from the lattice: queries relative to its origin, and a count of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partialmethod

import numpy as np

from cpmkit.manifold.answers import check_answer
from cpmkit.protocols import (
    ClosestPoints,
    ClosestPointSource,
    Floats,
    HasCreases,
    HasLeft,
    HasLocalMinima,
    HasMembers,
    HasNormals,
    HasTangents,
    HasTranslation,
    Ints,
)


@dataclass(frozen=True, eq=False)
class LocalSource:
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
    origin : (d,) float64, optional
        Where zero lies in the scene, for messages; ``shift`` unless given.
    of : ClosestPointSource, optional
        The source as it stands in the scene, by which is kept what no place changes.
    noise : float
        Root mean square of the error of a foot's coordinate, as far as it varies at random; zero unless measured.
    """

    source: ClosestPointSource
    shift: Floats
    queries: Counter[str] = field(default_factory=Counter)
    origin: Floats | None = None
    of: ClosestPointSource | None = None
    noise: float = 0.0

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
    def scene_origin(self) -> Floats:
        """(d,) where zero lies in the scene."""
        return self.shift if self.origin is None else self.origin

    @cached_property
    def members(self) -> tuple[LocalSource, ...]:
        """The members of a union, seen from the same origin; the source itself where it is none."""
        if not isinstance(self.source, HasMembers):
            return (self,)
        of = self.of.members if isinstance(self.of, HasMembers) else (None,) * len(self.source.members)
        return tuple(
            LocalSource(member, self.shift, self.queries, self.origin, own)
            for member, own in zip(self.source.members, of, strict=True)
        )

    @property
    def largest_dim(self) -> int:
        """The largest dimension of a member: counts of nodes grow with it."""
        return largest_dim(self.source)

    def dimensions_at(self, feet: ClosestPoints) -> Ints:
        """Return the dimension (n,) of the manifold at ``feet``; of a mixed union, the member's."""
        dims = np.array([self.dim if member.manifold_dim is None else member.manifold_dim for member in self.members])
        return np.full(len(feet), dims[0]) if len(dims) == 1 else dims[feet.element]

    def by_member(self, feet: ClosestPoints) -> Iterator[tuple[LocalSource, Ints, ClosestPoints]]:
        """Yield each member that holds some of ``feet``, their rows, and the member's own records of them."""
        if self.members[0] is self:
            yield self, np.arange(len(feet)), feet
            return
        assert feet.element is not None
        for number in np.unique(feet.element):
            rows = np.flatnonzero(feet.element == number)
            yield self.members[number], rows, self.members[number].closest_point(feet.points[rows])

    def knows_directions(self, dimension: int) -> bool:
        """True if all members of this dimension give their own tangents (of a curve) or normals (of a surface)."""
        target = [member for member in self.members if member.manifold_dim == dimension]
        return all(member.has_tangents if dimension == 1 else member.has_normals for member in target)

    @cached_property
    def has_normals(self) -> bool:
        """True if the source gives its own normals."""
        return isinstance(self.source, HasNormals)

    @cached_property
    def has_creases(self) -> bool:
        """True if the source keeps its creases beside normals of a smooth surface."""
        return isinstance(self.source, HasCreases)

    @cached_property
    def has_tangents(self) -> bool:
        """True if the source gives its own tangents."""
        return isinstance(self.source, HasTangents)

    @cached_property
    def has_local_minima(self) -> bool:
        """True if the source, and each member of a union, finds feet on other sheets than the nearest."""
        return all(isinstance(member.source, HasLocalMinima) for member in self.members)

    @cached_property
    def has_left(self) -> bool:
        """True if the source, and each member of a union, knows its left by itself."""
        return all(isinstance(member.source, HasLeft) for member in self.members)

    def closest_point(self, x: Floats) -> ClosestPoints:
        """Return the closest points of ``x`` (n, d), both relative to the origin.

        Raises
        ------
        InputError
            If the answer is not what a source has to give: the source is at fault, not what is computed from it.
        """
        self.queries["points"] += len(x)
        answer = self.source.closest_point(np.ascontiguousarray(x + self.shift))
        self._check(answer, x)
        return self._moved(answer, -self.shift)

    def local_minima(self, x: Floats, radius: float) -> tuple[Ints, ClosestPoints]:
        """Return the rows (k,) of ``x`` (n, d), ascending, and their feet within ``radius``, the nearest first.

        Counted as one query a row.
        """
        assert isinstance(self.source, HasLocalMinima)
        self.queries["points"] += len(x)
        rows, feet = self.source.local_minima(np.ascontiguousarray(x + self.shift), radius)
        self._check(feet, x[rows])
        return rows, self._moved(feet, -self.shift)

    def _check(self, answer: ClosestPoints, x: Floats) -> None:
        check_answer(answer, x, self.source, self.scene_origin, self._is_union)

    @cached_property
    def _is_union(self) -> bool:
        return isinstance(self.source, HasMembers)

    def _directions(self, name: str, feet: ClosestPoints) -> Floats:
        """Return the source's own unit vectors (n, d) at ``feet``, those that it calls ``name``."""
        return np.asarray(getattr(self.source, name)(self._moved(feet, self.shift)))

    normals = partialmethod(_directions, "normals")
    facet_normals = partialmethod(_directions, "facet_normals")
    tangents = partialmethod(_directions, "tangents")
    leftward = partialmethod(_directions, "leftward")

    def _moved(self, feet: ClosestPoints, offset: Floats) -> ClosestPoints:
        return replace(feet, points=feet.points + offset) if self.shift.any() else feet


def largest_dim(source: ClosestPointSource) -> int:
    """Return the largest dimension of a source's members; the space's where it is not known."""
    members = source.members if isinstance(source, HasMembers) else [source]
    return max(source.dim if member.manifold_dim is None else member.manifold_dim for member in members)


def localize(source: ClosestPointSource, origin: Floats) -> LocalSource:
    """Return ``source`` as seen from ``origin`` (d,)."""
    if origin.any() and isinstance(source, HasTranslation):
        return LocalSource(source.translated(-origin), np.zeros_like(origin), origin=np.array(origin), of=source)
    return LocalSource(source, np.array(origin), of=source)
