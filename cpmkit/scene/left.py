"""Which side of a boundary is left: found once a scene, whatever the spacing and the lattice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from cpmkit.grid.band import cell_levels
from cpmkit.manifold.conormal import axis_and_left
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.orientation import (
    AS_GIVEN,
    Orientation,
    Propagated,
    neighbours,
    piece_masks,
    propagate_signs,
    sign_by_rule,
)
from cpmkit.manifold.tangent_space import tangents_and_corners, unit_normals, unit_tangents
from cpmkit.protocols import Bools, BoundarySet, ClosestPoints, Floats, HasMembers, Ints, NamesLeft

#: Samples along the largest side of a boundary, by its dimension: more are taken until neighbours agree.
BOUNDARY_SAMPLES = {0: (32,), 1: (32, 64, 128, 256, 512), 2: (16, 32, 64)}
#: Samples nearer than this share of their spacing are one.
THINNED_SPACING_SHARE = 0.25
#: The least step of differences on the manifold, and its spacing of samples for a single point, as shares of its size.
LEAST_DIFFERENCE_SHARE, POINT_SAMPLING_SHARE = 1e-4, 1 / 64
#: A point determines the left of a piece if the cosine between its chord and the left direction exceeds this.
TELLING_CHORD_COSINE = 1e-3
#: The two points that name the sides lie so far from the boundary, as a share of its size.
NAMING_POINT_SHARE = 0.1

#: What says which side is left: the sources themselves, a point, or a rule. Nothing: the sign comes back reversed.
NamedBy = Literal["source", "left_of", "rule", "nothing"]


@dataclass(frozen=True, eq=False)
class OrientedPart:
    """A source that is no union, a boundary or a member of one, with signs along it."""

    source: LocalSource
    surface: LocalSource
    dimension: int
    samples: ClosestPoints
    on: ClosestPoints
    across: Orientation
    along: Orientation
    given_across: Bools
    given_along: bool
    piece: Ints
    consistent: bool
    travels: bool
    sure: bool
    spacing: float

    @classmethod
    def of(cls, source: LocalSource, surface: LocalSource, dimension: int) -> OrientedPart:
        """Return it sampled densely enough, signs carried."""
        for found, spacing in samplings(source, surface):
            part = cls._sampled(source, surface, dimension, _off_corners(source, found, 0.5 * spacing), spacing)
            if part.sure:
                break
        return part

    @classmethod
    def _sampled(
        cls, source: LocalSource, surface: LocalSource, dimension: int, samples: ClosestPoints, spacing: float
    ) -> OrientedPart:
        step, on_surface = 0.5 * spacing, surface.closest_point(samples.points)
        wide = max(step, LEAST_DIFFERENCE_SHARE * float(np.ptp(surface.bounds, axis=0).max()))
        travel = unit_tangents(source, samples, step) if source.manifold_dim == 1 else None
        travelled = unit_tangents(surface, on_surface, wide) if dimension == 1 else travel
        pairs = neighbours(samples.points, spacing, travelled)
        along, across, found = AS_GIVEN, AS_GIVEN, []
        given_across = np.ones(len(samples), dtype=bool)
        given_along = source.manifold_dim == 0 or source.knows_directions(source.manifold_dim or 0)
        if source.manifold_dim:
            directions = unit_normals(source, samples, step) if travel is None else travel
            is_given = np.full(len(samples), given_along)
            found.append(_with_agreeing_signs(samples.points, directions, pairs, spacing, travel is not None, is_given))
            along = Orientation(samples.points, found[0].directions, spacing, travel is not None)
        travels = all(carried.consistent for carried in found)
        if dimension < source.dim:
            directions = (
                travelled if dimension == 1 and travelled is not None else unit_normals(surface, on_surface, wide)
            )
            given_across = _own_directions(surface, on_surface, dimension)
            found.append(
                _with_agreeing_signs(on_surface.points, directions, pairs, spacing, dimension == 1, given_across)
            )
            across = Orientation(on_surface.points, found[-1].directions, spacing, dimension == 1)
        signs = across, along, given_across, given_along, found[0].piece
        consistent, sure = (all(getattr(carried, name) for carried in found) for name in ("consistent", "sure"))
        return cls(source, surface, dimension, samples, on_surface, *signs, consistent, travels, sure, spacing)

    def turned(self, left_of: Floats | None) -> tuple[OrientedPart, set[NamedBy]]:
        """Return it with each piece's left chosen by a point (d,), where one is given, else by a rule."""
        flipped = np.ones(len(self.samples))
        named: set[NamedBy] = set()
        leans = None if left_of is None else self._lean(left_of)
        for number, mask in enumerate(piece_masks(self.piece)):
            if self.given_along and self.given_across[mask].any():
                continue
            if leans is not None and abs(leans[number]) > TELLING_CHORD_COSINE:
                named.add("left_of")
                flipped[mask] = np.sign(leans[number])
            else:
                named.add("rule")
                flipped[mask] = self._ruled(mask)
        open_sign = "across" if self.across is not AS_GIVEN else "along"
        turned = getattr(self, open_sign)
        turned = replace(turned, directions=turned.directions * flipped[:, None])
        return replace(self, **{open_sign: turned}), named

    def _ruled(self, mask: Bools) -> float:
        """Return the sign that makes what a piece does not know by itself follow the rule."""
        sign = 1.0
        if not self.given_across[mask].any():
            sign *= _sign_of_mean(self.across, mask, self.surface.bounds.mean(axis=0))
        if not self.given_along:
            sign *= _sign_of_mean(self.along, mask, self.source.bounds.mean(axis=0))
        return sign

    def _lean(self, point: Floats) -> Floats:
        """Return, for each piece, the cosine of the angle at its nearest point between left and the way to a point."""
        goal = self.surface.closest_point(point[None]).points[0]
        distance = np.linalg.norm(self.on.points - goal, axis=1)
        pieces = piece_masks(self.piece)
        nearest = np.array([np.flatnonzero(mask)[distance[mask].argmin()] for mask in pieces])
        feet = self.source.closest_point(goal[None])
        at = self.piece[np.linalg.norm(self.samples.points - feet.points[0], axis=1).argmin()]
        feet = self.samples.take(nearest).replaced(np.array([at]), feet)
        on = self.surface.closest_point(feet.points)
        _, left = axis_and_left(self.source, self.surface, (self.across, self.along), on, feet, 0.5 * self.spacing)
        return cosines_to_left(goal - on.points, left)

    def beside(self) -> Floats:
        """Return a point of the manifold on the left and one on the right, (2, d)."""
        middle = np.array([len(self.samples) // 2])
        feet, on = self.samples.take(middle), self.on.take(middle)
        _, left = axis_and_left(self.source, self.surface, (self.across, self.along), on, feet, 0.5 * self.spacing)
        size = float(np.ptp(self.source.bounds, axis=0).max()) or self.spacing
        ways = NAMING_POINT_SHARE * size * np.array([[1.0], [-1.0]]) * left
        return self.surface.closest_point(on.points + ways).points


def cosines_to_left(ways: Floats, left: Floats) -> Floats:
    """Return the cosines (n,) of ``ways`` (n, d) with unit vectors; zero of no way."""
    length = np.linalg.norm(ways, axis=1)
    return np.asarray(np.sum(ways * left, axis=1) / np.where(length > 0, length, 1.0))


def _sign_of_mean(signs: Orientation, mask: Bools, centre: Floats) -> float:
    assert signs.points is not None
    assert signs.directions is not None
    return sign_by_rule(signs.points[mask], signs.directions[mask], centre, signs.travel)


def samplings(source: LocalSource, surface: LocalSource) -> Iterator[tuple[ClosestPoints, float]]:
    """Yield samples of a source, denser and denser, and their spacing."""
    size = float(np.ptp(source.bounds, axis=0).max())
    if not size > 0:
        middle = source.bounds.mean(axis=0)[None]
        yield source.closest_point(middle), POINT_SAMPLING_SHARE * float(np.ptp(surface.bounds, axis=0).max())
        return
    for count in BOUNDARY_SAMPLES[source.manifold_dim or 0]:
        spacing = size / count
        cells = next(blocks for side, blocks in cell_levels(source, spacing, 0.5) if side == 1)
        points = source.closest_point(np.asarray(cells * spacing, dtype=np.float64)).points
        _, kept = np.unique(np.round(points / (THINNED_SPACING_SHARE * spacing)), axis=0, return_index=True)
        yield source.closest_point(points[np.sort(kept)]), spacing


def _off_corners(source: LocalSource, samples: ClosestPoints, step: float) -> ClosestPoints:
    """Return the samples at which a curve has a direction; all, where it has none anywhere."""
    if source.manifold_dim != 1 or source.has_tangents:
        return samples
    corner = tangents_and_corners(source, samples, step)[1]
    return samples if corner.all() else samples.take(~corner)


def _own_directions(surface: LocalSource, on_surface: ClosestPoints, dimension: int) -> Bools:
    """Return at which feet (n,) the manifold gives its own normals, or tangents, where it is a curve."""
    given = np.zeros(len(on_surface), dtype=bool)
    for member, rows, _ in surface.by_member(on_surface):
        given[rows] = member.has_tangents if dimension == 1 else member.has_normals
    return given


def _with_agreeing_signs(
    points: Floats, directions: Floats, pairs: Ints, spacing: float, travel: bool, is_given: Bools
) -> Propagated:
    """Carry signs, of each piece such that they agree with those that the source itself gives there."""
    found = propagate_signs(points, directions, pairs, spacing, travel)
    for mask in piece_masks(found.piece):
        given = mask & is_given
        if np.sum(found.directions[given] * directions[given]) < 0:
            found.directions[mask] *= -1
    return found


@dataclass(frozen=True, eq=False)
class Left:
    """What tells the left of a boundary.

    Attributes
    ----------
    across : Orientation
        Signs of the surface's normals (of its tangents, where the surface is a curve) along the boundary.
    along : Orientation
        Signs of the boundary's own tangents; of its normals, where it is a surface.
    named_by : str
        "source", "left_of", "rule" or "nothing".
    travels : bool
        True where the signs along the boundary are consistent, whatever those across are.
    origin : (d,) float64
        In the scene's coordinates; the signs are known relative to it.
    beside : (2, d) float64 or None
        Where a rule names the left: two points, one on each side, in the scene's coordinates.
    queries : tuple of int
        Closest points asked of the surface and of the boundary to find it.
    contradicts_left_of : bool
        True where the sources' own left is not that of the boundary's ``left_of``.
    """

    across: Orientation
    along: Orientation
    named_by: NamedBy
    travels: bool
    origin: Floats
    beside: Floats | None = None
    queries: tuple[int, int] = (0, 0)
    contradicts_left_of: bool = False

    @property
    def known(self) -> bool:
        """True where signs agree all along the boundary."""
        return self.named_by != "nothing"

    @property
    def signs(self) -> tuple[Orientation, Orientation]:
        """Those across and those along the boundary."""
        return self.across, self.along

    def relative_to(self, origin: Floats) -> Left:
        """Return the same relative to another origin (d,)."""
        offset = self.origin - origin
        return replace(self, across=self.across.moved(offset), along=self.along.moved(offset), origin=origin)


def find_left(
    boundary: BoundarySet, source: LocalSource, manifold: LocalSource, dimension: int, origin: Floats
) -> Left:
    """Return what tells the left of ``boundary`` in a ``manifold`` that has ``dimension`` there.

    Where sources know their signs, nothing is asked. Otherwise the boundary is sampled at a density of its own, and
    denser until neighbouring directions agree; signs are carried from sample to sample, and of each connected piece
    ``left_of`` chooses the one that is left open, or else a rule. ``source`` is the boundary's, and like the manifold
    seen from ``origin`` (d,).
    """
    if source.manifold_dim != dimension - 1:
        return Left(AS_GIVEN, AS_GIVEN, "nothing", False, origin)
    travel = source.manifold_dim == 0 or source.knows_directions(source.manifold_dim)
    if source.has_left or (travel and (dimension == source.dim or manifold.knows_directions(dimension))):
        against = boundary.left_of is not None and _contradicts(source, manifold, boundary.left_of - origin)
        queries = manifold.queries["points"], source.queries["points"]
        return Left(AS_GIVEN, AS_GIVEN, "source", True, origin, queries=queries, contradicts_left_of=against)
    lacking = [number for number, member in enumerate(source.members) if not member.has_left]
    parts = [OrientedPart.of(source.members[number], manifold, dimension) for number in lacking]
    named: set[NamedBy] = {"source"}
    points = [_left_points(boundary)[number] for number in lacking]
    ruled: int | None = None
    for number, (part, given) in enumerate(zip(parts, points, strict=True)):
        if part.consistent:
            parts[number], by = part.turned(None if given is None else given - origin)
            named |= by
            ruled = number if "rule" in by and ruled is None else ruled
    across = Orientation.joined([part.across for part in parts]) if dimension < source.dim else AS_GIVEN
    along = AS_GIVEN if travel else Orientation.joined([part.along for part in parts])
    consistent, travels = (all(getattr(part, name) for part in parts) for name in ("consistent", "travels"))
    order: tuple[NamedBy, ...] = ("rule", "left_of", "source")
    by_what = next(name for name in order if name in named) if consistent else "nothing"
    beside = parts[ruled].beside() + origin if by_what == "rule" and ruled is not None else None
    queries = manifold.queries["points"], source.queries["points"]
    return Left(across, along, by_what, travels, origin, beside, queries)


def _contradicts(source: LocalSource, surface: LocalSource, left_of: Floats) -> bool:
    """Tell whether a point is on the right, as the sources' own directions have it."""
    on_surface = surface.closest_point(left_of[None])
    feet = source.closest_point(on_surface.points)
    step = LEAST_DIFFERENCE_SHARE * float(np.ptp(surface.bounds, axis=0).max())
    at_boundary = surface.closest_point(feet.points)
    left = axis_and_left(source, surface, (AS_GIVEN, AS_GIVEN), at_boundary, feet, step)[1]
    return bool(cosines_to_left(on_surface.points - at_boundary.points, left)[0] < -TELLING_CHORD_COSINE)


def _left_points(boundary: BoundarySet) -> list[Floats | None]:
    """Return the point that is left of each member of the boundary's source, where one is named."""
    source: Any = boundary.source
    members = source.members if isinstance(source, HasMembers) else [source]
    if boundary.left_of is not None:
        return [np.asarray(boundary.left_of, dtype=np.float64)] * len(members)
    points = [member.left_of if isinstance(member, NamesLeft) else None for member in members]
    return [None if point is None else np.asarray(point, dtype=np.float64) for point in points]
