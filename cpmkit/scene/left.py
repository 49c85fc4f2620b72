"""The left side of a boundary, determined once per scene from samples of the boundary, without a lattice."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from cpmkit.grid.blocks import cell_levels
from cpmkit.manifold.abilities import HasMembers
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.orientation import (
    AS_GIVEN,
    Orientation,
    PropagatedSigns,
    neighbours,
    piece_masks,
    propagate_signs,
    sign_by_rule,
)
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.tangent_space import axis_and_left, tangents_and_corners, unit_normals, unit_tangents
from cpmkit.scene.boundary import BoundarySet
from cpmkit.types import Bools, Floats, Ints

#: Numbers of samples along the largest side of a boundary, by its dimension, tried in turn until neighbours agree.
BOUNDARY_SAMPLES = {0: (32,), 1: (32, 64, 128, 256, 512), 2: (16, 32, 64)}
#: Least step of finite differences on the manifold, as a share of its size: above rounding.
MIN_STEP_SHARE = 1e-4
#: Least cosine between the left direction and the chord to a point for that point to determine the left of a piece.
MIN_CHORD_COSINE = 1e-3

#: How left is determined: by the sources, by a point, by a rule; or there is no left side, as on a Moebius strip.
NamedBy = Literal["source", "left_of", "rule", "nothing"]


@dataclass(frozen=True, eq=False)
class OrientedPart:
    """A boundary, or a member of a union, sampled with directions whose signs agree between neighbouring samples.

    Attributes
    ----------
    source, surface : LocalSource
        The closest-point sources of the boundary and of the manifold.
    dimension : int
        Dimension of the manifold along the boundary.
    samples : ClosestPoints
        The s samples of the boundary.
    on_surface : ClosestPoints
        Closest points of the samples on the manifold.
    across : Orientation
        Signs of the manifold's normals; of its tangents if it is a curve.
    along : Orientation
        Signs of the boundary's tangents; of its normals if it is a surface.
    given_across : (s,) bool
        Where the manifold's source provides normals (tangents).
    given_along : bool
        True if the boundary's source provides tangents (normals).
    piece : (s,) int64
        Number of the connected piece of each sample.
    consistent : bool
        False if a direction is reversed after a closed path along the boundary.
    has_direction : bool
        True if the signs along the boundary are consistent.
    sure : bool
        False if denser samples may give other signs.
    spacing : float
        Distance between the samples.
    """

    source: LocalSource
    surface: LocalSource
    dimension: int
    samples: ClosestPoints
    on_surface: ClosestPoints
    across: Orientation
    along: Orientation
    given_across: Bools
    given_along: bool
    piece: Ints
    consistent: bool
    has_direction: bool
    sure: bool
    spacing: float

    @classmethod
    def of(cls, source: LocalSource, surface: LocalSource, dimension: int) -> OrientedPart:
        """Return the part with the first samples dense enough for its signs to be sure, or with the densest."""
        for samples, spacing in samplings(source, surface):
            smooth = _without_corners(source, samples, 0.5 * spacing)
            part = cls._with_samples(source, surface, dimension, smooth, spacing)
            if part.sure:
                break
        return part

    @classmethod
    def _with_samples(
        cls, source: LocalSource, surface: LocalSource, dimension: int, samples: ClosestPoints, spacing: float
    ) -> OrientedPart:
        """Return the part with these ``samples`` of the boundary, with signs propagated between neighbours.

        Directions that the sources do not provide are computed by differences, with steps of the order of ``spacing``.
        """
        step, on_surface = 0.5 * spacing, surface.closest_point(samples.points)
        surface_step = max(step, MIN_STEP_SHARE * float(np.ptp(surface.bounds, axis=0).max()))
        tangents = unit_tangents(source, samples, step) if source.manifold_dim == 1 else None
        curve_tangents = unit_tangents(surface, on_surface, surface_step) if dimension == 1 else tangents
        pairs = neighbours(samples.points, spacing, curve_tangents)
        along, across, propagated = AS_GIVEN, AS_GIVEN, []
        given_across = np.ones(len(samples), dtype=bool)
        given_along = source.manifold_dim == 0 or source.knows_directions(source.manifold_dim or 0)
        if source.manifold_dim:
            directions = unit_normals(source, samples, step) if tangents is None else tangents
            is_given, is_travel = np.full(len(samples), given_along), tangents is not None
            propagated.append(_with_agreeing_signs(samples.points, directions, pairs, spacing, is_travel, is_given))
            along = Orientation(samples.points, propagated[0].directions, spacing, is_travel)
        has_direction = all(signs.consistent for signs in propagated)
        if dimension < source.dim:
            if dimension == 1 and curve_tangents is not None:
                directions = curve_tangents
            else:
                directions = unit_normals(surface, on_surface, surface_step)
            given_across = _has_own_directions(surface, on_surface, dimension)
            propagated.append(
                _with_agreeing_signs(on_surface.points, directions, pairs, spacing, dimension == 1, given_across)
            )
            across = Orientation(on_surface.points, propagated[-1].directions, spacing, dimension == 1)
        return cls(
            *(source, surface, dimension, samples, on_surface),
            *(across, along, given_across, given_along, propagated[0].piece),
            consistent=all(signs.consistent for signs in propagated),
            has_direction=has_direction,
            sure=all(signs.sure for signs in propagated),
            spacing=spacing,
        )

    def with_left_chosen(self, left_of: Floats | None) -> tuple[OrientedPart, set[NamedBy]]:
        """Return the part with the left of each connected piece chosen, and how it was: by "left_of" or by "rule".

        Where a direction is free, left is the side of the point ``left_of`` (d,), or else determined by a rule.
        """
        signs = np.ones(len(self.samples))
        named: set[NamedBy] = set()
        cosines = None if left_of is None else self._chord_cosines(left_of)
        for number, mask in enumerate(piece_masks(self.piece)):
            if self.given_along and self.given_across[mask].any():
                continue
            if cosines is not None and abs(cosines[number]) > MIN_CHORD_COSINE:
                named.add("left_of")
                signs[mask] = np.sign(cosines[number])
            else:
                named.add("rule")
                signs[mask] = self._sign_by_rule(mask)
        free = "across" if self.across is not AS_GIVEN else "along"
        orientation = getattr(self, free)
        orientation = replace(orientation, directions=orientation.directions * signs[:, None])
        return replace(self, **{free: orientation}), named

    def _sign_by_rule(self, mask: Bools) -> float:
        """Return the sign, 1 or -1, by which the free directions of the piece with samples ``mask`` obey the rule."""
        sign = 1.0
        if not self.given_across[mask].any():
            sign *= _sign_of_mean(self.across, mask, self.surface.bounds.mean(axis=0))
        if not self.given_along:
            sign *= _sign_of_mean(self.along, mask, self.source.bounds.mean(axis=0))
        return sign

    def _chord_cosines(self, point: Floats) -> Floats:
        """Return the cosine between left and the chord to ``point`` (d,) for each piece, at its sample nearest to it.

        For the nearest piece it is computed at the closest point of ``point`` on the boundary.
        """
        goal = self.surface.closest_point(point[None]).points[0]
        distance = np.linalg.norm(self.on_surface.points - goal, axis=1)
        pieces = piece_masks(self.piece)
        nearest = np.array([np.flatnonzero(mask)[distance[mask].argmin()] for mask in pieces])
        foot = self.source.closest_point(goal[None])
        piece = self.piece[np.linalg.norm(self.samples.points - foot.points[0], axis=1).argmin()]
        feet = self.samples.take(nearest).replace_rows(np.array([piece]), foot)
        on_surface = self.surface.closest_point(feet.points)
        return cosines_to_left(goal - on_surface.points, self._left(feet, on_surface))

    def _left(self, feet: ClosestPoints, on_surface: ClosestPoints) -> Floats:
        """Return the unit conormals (k, d) to the left at k points ``feet`` of the boundary.

        ``on_surface`` are their closest points on the manifold.
        """
        signs = self.across, self.along
        return axis_and_left(self.source, self.surface, signs, on_surface, feet, 0.5 * self.spacing)[1]

    def side_points(self) -> Floats:
        """Return a point on the left and one on the right (2, d), each at a tenth of the boundary's size from it."""
        middle = np.array([len(self.samples) // 2])
        feet, on_surface = self.samples.take(middle), self.on_surface.take(middle)
        size = float(np.ptp(self.source.bounds, axis=0).max()) or self.spacing
        steps = 0.1 * size * np.array([[1.0], [-1.0]]) * self._left(feet, on_surface)
        return self.surface.closest_point(on_surface.points + steps).points


def cosines_to_left(chords: Floats, left: Floats) -> Floats:
    """Return the cosine (n,) between each chord (n, d) and the unit vector ``left`` (n, d); zero for zero chords."""
    length = np.linalg.norm(chords, axis=1)
    return np.asarray(np.sum(chords * left, axis=1) / np.where(length > 0, length, 1.0))


def _sign_of_mean(signs: Orientation, mask: Bools, centre: Floats) -> float:
    """Return the sign by which the directions of samples ``mask`` (s,) obey the rule relative to ``centre`` (d,)."""
    assert signs.points is not None
    assert signs.directions is not None
    return sign_by_rule(signs.points[mask], signs.directions[mask], centre, signs.travel)


def samplings(source: LocalSource, surface: LocalSource) -> Iterator[tuple[ClosestPoints, float]]:
    """Yield samples of a source and the distance between them, from coarse to dense; a single point is sampled once."""
    size = float(np.ptp(source.bounds, axis=0).max())
    if not size > 0:  # a single point
        yield source.closest_point(source.bounds.mean(axis=0)[None]), float(np.ptp(surface.bounds, axis=0).max()) / 64
        return
    for count in BOUNDARY_SAMPLES[source.manifold_dim or 0]:
        spacing = size / count
        cells = next(blocks for side, blocks in cell_levels(source, spacing, 0.5) if side == 1)
        points = source.closest_point(np.asarray(cells * spacing, dtype=np.float64)).points
        cells_of_points = np.round(points / (0.25 * spacing))  # one sample in each cell of a quarter of the spacing
        _, rows = np.unique(cells_of_points, axis=0, return_index=True)
        yield source.closest_point(points[np.sort(rows)]), spacing


def _without_corners(source: LocalSource, samples: ClosestPoints, step: float) -> ClosestPoints:
    """Return the samples where a curve has a tangent; all samples if it has none anywhere, or provides tangents."""
    if source.manifold_dim != 1 or source.has_tangents:
        return samples
    corner = tangents_and_corners(source, samples, step)[1]
    return samples if corner.all() else samples.take(~corner)


def _has_own_directions(surface: LocalSource, on_surface: ClosestPoints, dimension: int) -> Bools:
    """Return for each closest point (n,) whether the manifold's source provides normals there (curves: tangents)."""
    has_own = np.zeros(len(on_surface), dtype=bool)
    for member, rows, _ in surface.by_member(on_surface):
        has_own[rows] = member.has_tangents if dimension == 1 else member.has_normals
    return has_own


def _with_agreeing_signs(
    points: Floats, directions: Floats, pairs: Ints, spacing: float, travel: bool, is_given: Bools
) -> PropagatedSigns:
    """Return ``directions`` (n, d) at ``points`` (n, d) with signs propagated over the ``pairs`` of neighbours.

    The sign of each connected piece agrees with the directions that the source provides there (``is_given``, (n,)).
    """
    propagated = propagate_signs(points, directions, pairs, spacing, travel)
    for mask in piece_masks(propagated.piece):
        given = mask & is_given
        if np.sum(propagated.directions[given] * directions[given]) < 0:
            propagated.directions[mask] *= -1
    return propagated


@dataclass(frozen=True, eq=False)
class Left:
    """Orientation of a boundary, which determines its left side.

    Attributes
    ----------
    across : Orientation
        Signs of the manifold's normals along the boundary; of its tangents where the manifold is a curve.
    along : Orientation
        Signs of the boundary's tangents; of its normals where it is a surface.
    named_by : str
        How left is determined: "source", "left_of", "rule" or "nothing".
    has_direction : bool
        True if the signs along the boundary are consistent, whether or not the signs across it are.
    origin : (d,) float64
        Origin of the points of the orientations, in the scene's coordinates.
    side_points : (2, d) float64 or None
        Where a rule determines the left, a point on the left and one on the right, in the scene's coordinates.
    queries : tuple of int
        Numbers of closest-point queries of the manifold and of the boundary.
    contradicts_left_of : bool
        True if the point ``left_of`` is on the right according to the directions that the sources provide.
    """

    across: Orientation
    along: Orientation
    named_by: NamedBy
    has_direction: bool
    origin: Floats
    side_points: Floats | None = None
    queries: tuple[int, int] = (0, 0)
    contradicts_left_of: bool = False

    @property
    def known(self) -> bool:
        """True if the signs are consistent along the whole boundary, so that it has a left side."""
        return self.named_by != "nothing"

    @property
    def signs(self) -> tuple[Orientation, Orientation]:
        """The signs across the boundary and those along it."""
        return self.across, self.along

    def relative_to(self, origin: Floats) -> Left:
        """Return the orientation with coordinates relative to another ``origin`` (d,)."""
        offset = self.origin - origin
        return replace(self, across=self.across.translate(offset), along=self.along.translate(offset), origin=origin)


def find_left(
    boundary: BoundarySet, source: LocalSource, manifold: LocalSource, dimension: int, origin: Floats
) -> Left:
    """Return the orientation of ``boundary`` in a ``manifold`` of this ``dimension`` along the boundary.

    Nothing is computed where the sources provide all directions. Otherwise the boundary is sampled more and more
    densely until the directions of neighbours agree; signs are propagated from sample to sample, and the sign of each
    connected piece that remains free is chosen by ``left_of`` or by a rule. ``source``, that of the boundary, and the
    ``manifold`` are relative to ``origin`` (d,).
    """
    if source.manifold_dim != dimension - 1:
        return Left(AS_GIVEN, AS_GIVEN, "nothing", False, origin)
    travel = source.manifold_dim == 0 or source.knows_directions(source.manifold_dim)
    if source.has_left or (travel and (dimension == source.dim or manifold.knows_directions(dimension))):
        against = boundary.left_of is not None and _is_on_right(source, manifold, boundary.left_of - origin)
        queries = manifold.queries["points"], source.queries["points"]
        return Left(AS_GIVEN, AS_GIVEN, "source", True, origin, queries=queries, contradicts_left_of=against)
    free = [number for number, member in enumerate(source.members) if not member.has_left]
    parts = [OrientedPart.of(source.members[number], manifold, dimension) for number in free]
    named: set[NamedBy] = {"source"}
    points = [_left_points(boundary)[number] for number in free]
    first_ruled: int | None = None
    for number, (part, point) in enumerate(zip(parts, points, strict=True)):
        if part.consistent:
            parts[number], by = part.with_left_chosen(None if point is None else point - origin)
            named |= by
            first_ruled = number if "rule" in by and first_ruled is None else first_ruled
    across = Orientation.join([part.across for part in parts]) if dimension < source.dim else AS_GIVEN
    along = AS_GIVEN if travel else Orientation.join([part.along for part in parts])
    order: tuple[NamedBy, ...] = ("rule", "left_of", "source")
    consistent = all(part.consistent for part in parts)
    named_by = next(name for name in order if name in named) if consistent else "nothing"
    is_ruled = named_by == "rule" and first_ruled is not None
    side_points = parts[first_ruled or 0].side_points() + origin if is_ruled else None
    has_direction = all(part.has_direction for part in parts)
    queries = manifold.queries["points"], source.queries["points"]
    return Left(across, along, named_by, has_direction, origin, side_points, queries)


def _is_on_right(source: LocalSource, surface: LocalSource, left_of: Floats) -> bool:
    """Return True if the point ``left_of`` (d,) is on the right by the directions that the sources provide."""
    on_surface = surface.closest_point(left_of[None])
    feet = source.closest_point(on_surface.points)
    step = MIN_STEP_SHARE * float(np.ptp(surface.bounds, axis=0).max())
    at_boundary = surface.closest_point(feet.points)
    left = axis_and_left(source, surface, (AS_GIVEN, AS_GIVEN), at_boundary, feet, step)[1]
    return bool(cosines_to_left(on_surface.points - at_boundary.points, left)[0] < -MIN_CHORD_COSINE)


def _left_points(boundary: BoundarySet) -> list[Floats | None]:
    """Return for each member of the boundary's source the point (d,) that names its left, None if it has none."""
    source: Any = boundary.source
    members = source.members if isinstance(source, HasMembers) else [source]
    if boundary.left_of is not None:
        return [np.asarray(boundary.left_of, dtype=np.float64)] * len(members)
    points = [getattr(member, "left_of", None) for member in members]
    return [None if point is None else np.asarray(point, dtype=np.float64) for point in points]
