"""Boundaries as geometry: their positions in the manifold and their left sides, without a lattice."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.errors import SceneError, shown
from cpmkit.manifold.abilities import members_of
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.meetings import touching_distance
from cpmkit.manifold.orientation import AS_GIVEN, Orientation
from cpmkit.manifold.projected_boundary import nearest_on_projection, tangents_of_projection
from cpmkit.manifold.source import ClosestPoints, ClosestPointSource
from cpmkit.manifold.tangent_space import left_conormals, outward_conormals, unit_normals, unit_tangents
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.conditions import depends_on_sides, same_condition
from cpmkit.scene.left import MIN_CHORD_COSINE, Left, SampledBoundary, samplings
from cpmkit.types import Bools, Floats, Ints


@dataclass(frozen=True, eq=False)
class OrientedBoundary:
    """A boundary in its manifold, with its orientation; :meth:`cpmkit.Scene.oriented` computes it once per boundary.

    Points and vectors are relative to ``left.origin``. For a point z of the manifold, y is its closest point on the
    projection of the boundary to the manifold, and z is on the left if (z - y) . v > 0, v the conormal to the left.
    """

    boundary: Boundary  #: The boundary of the scene.
    #: source, surface: The closest-point sources of the boundary and of the manifold.
    source: LocalSource
    surface: LocalSource
    dimension: int  #: Dimension of the manifold along the boundary.
    left: Left  #: Orientation of the boundary.

    @property
    def has_sides(self) -> bool:
        """True if the boundary has one dimension less than the manifold, and so divides the manifold locally."""
        return self.source.manifold_dim == self.dimension - 1

    @property
    def has_left(self) -> bool:
        """True if the boundary has sides, and the left side is consistent along all of it."""
        return self.has_sides and self.left.known

    def relative_to(self, origin: Floats, source: LocalSource, surface: LocalSource) -> OrientedBoundary:
        """Return the boundary with its points relative to another ``origin`` (d,), in the scene's coordinates.

        ``source`` and ``surface``, the sources of the boundary and of the manifold, are relative to this origin.
        """
        signs = self.left.signs
        if signs.points is not None:
            signs = replace(signs, points=signs.points + (self.left.origin - origin))
        return replace(self, source=source, surface=surface, left=replace(self.left, signs=signs, origin=origin))

    def feet(self, points: Floats) -> tuple[ClosestPoints, ClosestPoints]:
        """Return the boundary points with the projections nearest to ``points`` (n, d), and these projections."""
        return nearest_on_projection(self.source, self.surface, points)

    def leftward(self, feet: ClosestPoints, on_surface: ClosestPoints, step: float) -> Floats:
        """Return the unit conormals v (n, d) to the left.

        ``feet`` and ``on_surface`` are the results of :meth:`feet` for n points. Directions that the sources do not
        provide are differences of closest points over the length ``step``.
        """
        left = left_conormals(self.source, self.surface, self.left.signs, on_surface, feet, step)
        if self.dimension == 2 and self.source.manifold_dim == 1 and self.surface.dim == 3:
            rows, along = tangents_of_projection(self.source, self.surface, feet, on_surface, step)
            left[rows] = unit(left[rows] - dots(left[rows], along)[:, None] * along)
        return left

    def tangents(self, feet: ClosestPoints, on_surface: ClosestPoints, left: Floats, step: float) -> Floats:
        """Return the unit tangents (n, d) of a boundary curve in its direction of travel.

        ``feet`` and ``on_surface`` are those of :meth:`feet`, ``left`` (n, d) that of :meth:`leftward`; ``step`` is the
        length of finite differences. A curve whose source has no tangents travels with ``left`` on its left, seen from
        the tip of the manifold's normals; if its source has no normals, these point away from the manifold's centre.
        """
        if self.source.knows_directions(1):
            return unit_tangents(self.source, feet, step)
        if self.surface.dim == 2:
            return np.stack([left[:, 1], -left[:, 0]], axis=1)
        normals = unit_normals(self.surface, on_surface, step)
        if not self.surface.knows_directions(2):
            away = on_surface.points - self.surface.bounds.mean(axis=0)
            normals = np.where(dots(normals, away)[:, None] < 0, -normals, normals)
        return np.cross(left, normals)

    def open_ends(self, feet: ClosestPoints, on_surface: ClosestPoints, step: float) -> Bools:
        """Return whether each closest point is at an open end (n,), around which the solution is continuous.

        ``feet`` and ``on_surface`` are those of :meth:`feet`. Unlike King et al. (2024), eq. 16, an end on the rim of
        the manifold (less than the length ``step`` from it) is not open, since the curve divides the manifold there.
        """
        end = feet.edge >= 0
        rows = np.flatnonzero(end)
        ahead = outward_conormals(self.source, feet.take(rows), step)
        end[rows] = self.surface.closest_point(on_surface.points[rows] + step * ahead).edge < 0
        return end

    def signed_distance(self, points: Floats, step: float) -> Floats:
        """Return (z - y) . v (n,) for ``points`` z (n, d) of the manifold, positive on the left.

        y is the closest point on the projected boundary, v the unit conormal to the left; ``step`` is the length of
        finite differences. King et al. (2024), eq. 11. NaN beyond an open end, or without a left side.
        """
        if not self.has_left:
            return np.full(len(points), np.nan)
        feet, on = self.feet(points)
        signed = np.sum((points - on.points) * self.leftward(feet, on, step), axis=1)
        return np.where(self.open_ends(feet, on, step), np.nan, signed)

    @property
    def missing_directions(self) -> str:
        """The normals or tangents that the sources of boundary and manifold do not provide, in words; "" if none."""
        source, surface, missing, names = self.source, self.surface, [], ("normals", "tangents")
        if self.dimension < surface.dim and not surface.knows_directions(self.dimension):
            missing.append(f"the manifold has no {names[self.dimension == 1]} of its own")
        if source.manifold_dim and not source.knows_directions(source.manifold_dim):
            missing.append(f"the boundary has no {names[source.manifold_dim == 1]} of its own")
        return " and ".join(missing)

    @property
    def left_description(self) -> str:
        """How the left side is determined, and which normals or tangents finite differences replace, in words.

        Empty if the boundary has no sides, or if the sources provide all normals and tangents.
        """
        if not self.has_sides or self.left.named_by == "source":
            return ""
        reason = {
            "left_of": "left is named by left_of",
            "rule": "left is named by a rule alone",
            "nothing": "it has no left side, since left and right exchange along it",
        }[self.left.named_by]
        return f"{self.missing_directions}: taken by differences, {reason}"


def orient(boundary: Boundary, surface: ClosestPointSource) -> OrientedBoundary:
    """Return ``boundary`` with its orientation in the manifold ``surface``, relative to the centre of its own bounds.

    The orientation does not depend on the spacing. Raises SceneError if the boundary's dimension does not fit,
    ``left_of`` is on the right, or its conditions need a left side that is missing or undetermined.
    """
    origin: Floats = np.asarray(boundary.source.bounds, dtype=np.float64).mean(axis=0)
    source, manifold = localize(boundary.source, origin), localize(surface, origin)
    dimensions = np.array([manifold.largest_dim])
    if len({member.manifold_dim for member in manifold.members}) > 1:
        samples, _ = next(samplings(source, manifold))
        dimensions = _dimensions_along(samples.points, source, manifold)
    dimension = dimension_along(boundary.name, source, manifold, dimensions)
    oriented = OrientedBoundary(boundary, source, manifold, dimension, Left(AS_GIVEN, "nothing", origin))
    if oriented.has_sides:
        left = _find_left(oriented, origin)
        queries = manifold.queries["points"], source.queries["points"]
        oriented = replace(oriented, left=replace(left, queries=queries))
    _check_sides(oriented)
    return oriented


def _dimensions_along(points: Floats, source: LocalSource, surface: LocalSource) -> Ints:
    """Return the dimensions (n,) of a union at ``points`` (n, d) of the boundary ``source``.

    Where members lie on each other, the lowest dimension above the boundary's counts, if its members touch all points.
    """
    touching = touching_distance(surface.source)
    for dim in sorted({member.largest_dim for member in surface.members}):
        members = [member for member in surface.members if member.largest_dim == dim]
        gaps = np.min([norms(member.closest_point(points).points - points) for member in members], axis=0)
        if dim > (source.manifold_dim or 0) and gaps.max() <= touching:
            return np.full(len(points), dim)
    return surface.dimensions_at(surface.closest_point(points))


def dimension_along(name: str, source: LocalSource, surface: LocalSource, dimensions: Ints) -> int:
    """Return the dimension of the manifold ``surface`` along the boundary ``source``, which messages call ``name``.

    ``dimensions`` (n,) are those of the manifold at points of the boundary. Raises SceneError if they differ, a
    dimension is unknown or mixed, or that of the manifold is not above that of the boundary.
    """
    if source.manifold_dim is None:
        raise SceneError(f"boundary {name!r} is of mixed dimension; make a boundary of each of its dimensions.")
    if any(member.manifold_dim is None for member in surface.members):
        raise SceneError("boundaries need to know the manifold's dimension, got None; unite sources by `union`.")
    different = np.unique(dimensions)
    if len(different) > 1:
        raise SceneError(
            f"boundary {name!r} runs over pieces of the dimensions {' and '.join(map(str, different))}; part it where "
            "they meet."
        )
    if source.manifold_dim >= different[0]:
        raise SceneError(
            f"boundary {name!r} has dimension {source.manifold_dim}, the manifold {different[0]}; "
            "a boundary is a point on a curve, a point or curve on a surface, or anything of those in a solid."
        )
    return int(different[0])


def _find_left(oriented: OrientedBoundary, origin: Floats) -> Left:
    """Return the left side of a boundary that has sides; its sources are relative to ``origin`` (d,).

    If the sources provide all directions, only ``left_of`` is compared with them. Otherwise the boundary is sampled
    more and more densely until the conormals of neighbours agree; signs are propagated from sample to sample, and
    ``left_of`` or a rule chooses the sign of each piece where the sources provide none. ``queries`` stays (0, 0).
    """
    boundary, source, manifold = oriented.boundary, oriented.source, oriented.surface
    if source.has_left or not oriented.missing_directions:
        left_of = boundary.left_of
        against = False
        if left_of is not None:
            on_surface = manifold.closest_point((left_of - origin)[None])
            feet, at_boundary = oriented.feet(on_surface.points)
            left = oriented.leftward(feet, at_boundary, 1.0)  # no differences with this step are needed
            against = bool(dots(unit(on_surface.points - at_boundary.points), left)[0] < -MIN_CHORD_COSINE)
        return Left(AS_GIVEN, "source", origin, contradicts_left_of=against)
    parts, side_points = [], None
    named: set[str] = set()
    for member, original in zip(source.members, members_of(boundary.source), strict=True):
        if member.has_left:
            continue
        part = SampledBoundary.sample(member, manifold, oriented.dimension)
        left_of = getattr(original, "left_of", None) if boundary.left_of is None else boundary.left_of
        part, by = part.with_left_chosen(None if left_of is None else np.asarray(left_of, dtype=np.float64) - origin)
        if "rule" in by and side_points is None:
            side_points = part.side_points() + origin
        named |= by
        parts.append(part)
    points, directions = ([getattr(part.signs, name) for part in parts] for name in ("points", "directions"))
    signs = Orientation(np.concatenate(points), np.concatenate(directions), min(part.spacing for part in parts))
    if not all(part.consistent for part in parts):
        return Left(signs, "nothing", origin)
    return Left(signs, "rule" if "rule" in named else "left_of" if named else "source", origin, side_points)


def _check_sides(oriented: OrientedBoundary) -> None:
    """Check that a boundary whose conditions couple or differ has a left side, determined by more than a rule.

    Raises SceneError otherwise, or if ``left_of`` is on the right according to the sources. If the solution does not
    change when the sides are exchanged, any left side is accepted.
    """
    boundary = oriented.boundary
    on_left, on_right = boundary.condition("left"), boundary.condition("right")
    unlike = on_left.couples or not same_condition(on_left, on_right)
    if not oriented.has_sides and unlike:
        raise SceneError(
            f"boundary {boundary.name!r} has dimension {oriented.source.manifold_dim} where the manifold has "
            f"{oriented.dimension}, so it has no left and right; give `both`, one of Dirichlet, Neumann or Robin."
        )
    if not oriented.left.known and unlike:
        raise SceneError(
            f"boundary {boundary.name!r} has no left side: left and right exchange along it, as on a Moebius strip; "
            "give one condition for both sides."
        )
    if not depends_on_sides(on_left, on_right):
        return
    if oriented.left.contradicts_left_of:
        raise SceneError(
            f"boundary {boundary.name!r} has left_of={shown(boundary.left_of)} on its right, as the surface's "
            "own normal and the boundary's own direction have it; leave left_of out, or exchange the conditions."
        )
    if oriented.left.side_points is not None:
        reason = (
            "nothing says which side is left"
            if boundary.left_of is None
            else f"left_of={shown(boundary.left_of)} is on neither side of some piece of it"
        )
        apart = float(np.linalg.norm(np.subtract(*oriented.left.side_points)))
        digits = max(0, 3 - int(np.floor(np.log10(apart))))
        first, second = (np.round(point, digits).tolist() for point in oriented.left.side_points)
        raise SceneError(
            f"boundary {boundary.name!r} has unlike conditions on its sides, and {reason}: "
            f"{oriented.missing_directions}; give left_of, a point on the left, here {first} for one side or {second} "
            "for the other."
        )
