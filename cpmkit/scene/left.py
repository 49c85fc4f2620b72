"""Which side of a boundary is left: found once a scene, whatever the spacing and the lattice."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.manifold.conormal import axis_and_left
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.orientation import AS_GIVEN, Orientation
from cpmkit.protocols import BoundarySet, Floats, HasMembers, NamesLeft
from cpmkit.scene.left_parts import LEAST_DIFFERENCE_SHARE, TELLING_CHORD_COSINE, LeftPart, NamedBy, cosines_to_left


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
    contradicted : bool
        True where the sources' own left is not that of the boundary's ``left_of``.
    """

    across: Orientation
    along: Orientation
    named_by: NamedBy
    travels: bool
    origin: Floats
    beside: Floats | None = None
    queries: tuple[int, int] = (0, 0)
    contradicted: bool = False

    @property
    def known(self) -> bool:
        """True where signs agree all along the boundary."""
        return self.named_by != "nothing"

    @property
    def signs(self) -> tuple[Orientation, Orientation]:
        """Those across and those along the boundary."""
        return self.across, self.along

    def seen_from(self, origin: Floats) -> Left:
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
        return Left(AS_GIVEN, AS_GIVEN, "source", True, origin, queries=queries, contradicted=against)
    lacking = [number for number, member in enumerate(source.members) if not member.has_left]
    parts = [LeftPart.of(source.members[number], manifold, dimension) for number in lacking]
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
