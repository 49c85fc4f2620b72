"""Where distances are measured from: points, curves, several at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.errors import InputError, shown
from cpmkit.plugin import norms
from cpmkit.protocols import ClosestPointSource, Floats, HasGivenMesh, Ints

#: So many points are gone through one by one: a tree takes five times as long.
FEW = 4


@dataclass(frozen=True, eq=False)
class Origins:
    """Points (k, d) of a manifold, and curves in it.

    Attributes
    ----------
    surface : ClosestPointSource
        The manifold.
    points : (k, d) float64
        On it.
    curves : sequence of ClosestPointSource
        In it.
    """

    surface: ClosestPointSource
    points: Floats
    curves: Sequence[ClosestPointSource]

    def closest(self, points: Floats) -> tuple[Floats, Floats, Ints]:
        """Return the straight distance (n,) from ``points`` (n, d) to the nearest origin, its place and its number.

        Points are numbered first, then curves.
        """
        count = len(self.points)
        best, number = self._nearest_point(points)
        found = self.points[number] if count else np.zeros_like(points)
        for k, curve in enumerate(self.curves):
            feet = curve.closest_point(points)
            nearer = feet.distance < best
            best, found = np.where(nearer, feet.distance, best), np.where(nearer[:, None], feet.points, found)
            number = np.where(nearer, count + k, number)
        return best, found, number

    def distances(self, points: Floats) -> tuple[Floats, Ints]:
        """Return the same distance and number without the place."""
        if self.curves:
            best, _, number = self.closest(points)
            return best, number
        return self._nearest_point(points)

    def _nearest_point(self, points: Floats) -> tuple[Floats, Ints]:
        """Return the distance (n,) to the nearest of the points, infinity where there is none, and its number."""
        if len(self.points) > FEW:
            best, number = self._tree.query(points)
            return best, number
        best, number = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
        for k, one in enumerate(self.points):
            away = norms(points - one)
            number[away < best] = k
            best = np.minimum(best, away)
        return best, number

    def samples(self, spacing: float) -> tuple[Floats, Ints]:
        """Return points (k, d) on all of them, on curves about a ``spacing`` apart, and whose each is."""
        at, owner = [self.points], [np.arange(len(self.points))]
        for number, curve in enumerate(self.curves, len(self.points)):
            at.append(ck.boundary_points(curve, self.surface, spacing).points)
            owner.append(np.full(len(at[-1]), number))
        return np.concatenate(at), np.concatenate(owner)

    def source(self, spacing: float, reach: float) -> ck.PointSource:
        """Return what heats all of them: one a length of the spacing on curves, and points as much as to be as warm.

        Heat of time t = reach^2 from a curve falls as exp(-s / reach), that from a point as the Bessel function
        K0(s / reach) / pi, sqrt(2 reach / (pi s)) / 2 as large. They are equal where s is a quarter of the manifold's
        size, and ridges between both lie half way, but for a share of the reach.
        """
        far = 0.25 * float(np.ptp(self.surface.bounds, axis=0).max())
        one = np.pi * reach / spacing * np.sqrt(2 * far / (np.pi * reach))
        at, strength = [self.points], [np.full(len(self.points), one)]
        for curve in self.curves:
            along = ck.boundary_points(curve, self.surface, spacing)
            at.append(along.points)
            strength.append(along.weights / spacing)
        return ck.PointSource(np.concatenate(at), np.concatenate(strength))

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.points)


def origins_of(given: Any, surface: ClosestPointSource) -> Origins:
    """Return the origins: points (k, d) or (d,), numbers of vertices, a source of a curve or of points, or several.

    Raises
    ------
    InputError
        If there are none, or one is neither.
    """
    points, curves = [np.zeros((0, surface.dim))], []
    accepted = f"origins are finite points (k, {surface.dim}), numbers of vertices of a mesh, or sources of curves"
    for one in _listed(given):
        if _are_vertices(one, surface):
            one = ck.Boundary("origins", one, both=ck.Neumann(0.0)).on(surface).source
        if isinstance(one, ClosestPointSource):
            if one.manifold_dim == 0:
                points.append(ck.boundary_points(one, surface, 1.0).points)
            else:
                curves.append(one)
            continue
        try:
            array = np.atleast_2d(np.asarray(one, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise InputError(f"{accepted}, got {shown(one)}.") from error
        if array.ndim != 2 or array.shape[1] != surface.dim or not np.isfinite(array).all():
            raise InputError(f"{accepted}, got {shown(one)}.")
        points.append(surface.closest_point(array).points)
    found = np.concatenate(points)
    if not len(found) and not curves:
        raise InputError("distances are measured from something: give origins, points or a source of a curve.")
    return Origins(surface, found, curves)


def _are_vertices(given: Any, surface: ClosestPointSource) -> bool:
    """Whether whole numbers, one or in a row, stand for vertices: on a mesh; elsewhere d of them are a point."""
    try:
        array = np.asarray(given)
    except ValueError:  # rows of unlike lengths
        return False
    whole = array.dtype.kind in "iu" and array.ndim < 2 and array.size > 0
    return whole and (isinstance(surface, HasGivenMesh) or array.size != surface.dim)


def _listed(given: Any) -> list[Any]:
    if isinstance(given, ClosestPointSource):
        return [given]
    if isinstance(given, Sequence) and any(isinstance(one, ClosestPointSource) for one in given):
        return list(given)
    return [given]
