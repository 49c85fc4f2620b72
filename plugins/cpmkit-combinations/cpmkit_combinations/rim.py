"""The edge that trimming makes: a curve on a surface, one or two points on a curve."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from cpmkit.plugin import ClosestPoints, ClosestPointSource, Floats, InputError, Ints, dots
from cpmkit_combinations.curve import TracedCurve
from cpmkit_combinations.level_cut import LevelCut
from cpmkit_combinations.points import PointSet


class MeshRim(Protocol):
    """The points at which a manifold is cut off."""

    @property
    def source(self) -> ClosestPointSource:
        """Where it lies."""

    @property
    def deviation(self) -> float:
        """How far it may lie from where it should."""

    def outward(self, feet: ClosestPoints, /) -> Floats:
        """Return unit vectors (n, d) along the manifold, at feet on the rim, to where it is cut away."""

    def numbers(self, feet: ClosestPoints, /) -> Ints:
        """Return the ``edge`` (n,) of feet on the rim."""

    def numbers_of_whole(self, edge: Ints, /) -> Ints:
        """Return the ``edge`` (n,) of feet inside the part, given those that the whole says."""

    def translated(self, offset: Floats, /) -> MeshRim:
        """Return the rim moved by ``offset`` (d,)."""


@dataclass(frozen=True, eq=False)
class CurveRim:
    """The rim of a trimmed surface, at whose left the surface is cut away."""

    source: TracedCurve

    @property
    def deviation(self) -> float:
        """How far the curve may lie from where trim vanishes."""
        return self.source.deviation

    def outward(self, feet: ClosestPoints, /) -> Floats:
        """Return the unit conormals (n, d) to the left."""
        return self.source.leftward(feet)

    def numbers(self, feet: ClosestPoints, /) -> Ints:
        """Return the numbers of the curve's pieces, the longest first."""
        return self.source.piece(feet)

    def numbers_of_whole(self, edge: Ints, /) -> Ints:
        """Return the whole's edges, numbered on after the pieces of the rim."""
        return np.where(edge >= 0, edge + len(self.source.pieces), edge)

    def translated(self, offset: Floats, /) -> CurveRim:
        """Return the rim moved by ``offset`` (d,)."""
        return CurveRim(self.source.translated(offset))


@dataclass(frozen=True, eq=False)
class PointRim:
    """The new ends of a trimmed curve.

    Attributes
    ----------
    source : PointSet
    directions : (k, d) float64
        Unit vectors along the curve to where it is cut away.
    ends : (k,) int64
        0 for the start and 1 for the end of the part, one a point.
    """

    source: PointSet
    directions: Floats
    ends: Ints

    deviation = 0.0

    def outward(self, feet: ClosestPoints, /) -> Floats:
        """Return the directions at the feet, (n, d)."""
        return np.asarray(self.directions[feet.element])

    def numbers(self, feet: ClosestPoints, /) -> Ints:
        """Return 0 at the start and 1 at the end."""
        return np.asarray(self.ends[feet.element], dtype=np.int64)

    def numbers_of_whole(self, edge: Ints, /) -> Ints:
        """Return the end of the whole that is left, if one is, by the number that the rim leaves over."""
        return np.where(edge >= 0, 1 - self.ends[0], edge)

    def translated(self, offset: Floats, /) -> PointRim:
        """Return the rim moved by ``offset`` (d,)."""
        return replace(self, source=self.source.translated(offset))


def point_rim(cut: LevelCut, points: PointSet, own_ends: Ints) -> PointRim:
    """Return the rim of a trimmed curve.

    Parameters
    ----------
    cut : LevelCut
    points : PointSet
        Where trim vanishes on the curve.
    own_ends : (k,) int64
        Which ends of the whole are kept.

    Raises
    ------
    InputError
        If not one piece with two ends is left.
    """
    feet = cut.surface.closest_point(points.positions)
    outward = cut.directions(feet)[1]
    count = len(points.positions)
    if count + len(own_ends) != 2:
        raise InputError(
            f"trim must leave one piece of the curve, with two ends, got {count} cuts and {len(own_ends)} ends of its "
            "own; use the kind union for several pieces."
        )
    if len(own_ends):
        ends = 1 - own_ends
    elif cut.surface.has_tangents:
        ends = (dots(outward, cut.surface.tangents(feet)) > 0).astype(np.int64)
    else:
        ends = np.arange(2)
    return PointRim(points, outward, ends)
