"""Origins of distances, points and curves, and the connected pieces of a manifold that they lie on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

import cpmkit as ck
from cpmkit.errors import InputError, shown
from cpmkit.plugin import ClosestPointSource, Discretized, HasGivenMesh, Terms
from cpmkit.preparing import Prepared
from cpmkit.types import Floats, Ints


@dataclass(frozen=True, eq=False)
class Origins:
    """Points (k, d) of a manifold, and curves in it.

    Attributes
    ----------
    surface : ClosestPointSource
        The manifold.
    points : (k, d) float64
        Points of the manifold.
    curves : sequence of ClosestPointSource
        Curves in the manifold.
    """

    surface: ClosestPointSource
    points: Floats
    curves: Sequence[ClosestPointSource]

    def closest(self, points: Floats) -> tuple[Floats, Floats, Ints]:
        """Return the distances (n,) of ``points`` (n, d) from the nearest origins, the places, and the numbers (n,).

        Distances are straight, and the places (n, d) are the points of the origins that are nearest to ``points``.
        Origins that are points are numbered first, then curves.
        """
        count = len(self.points)
        best, number = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.int64)
        if count:
            best, number = self._tree.query(points)
        places = self.points[number] if count else np.zeros_like(points)
        for k, curve in enumerate(self.curves):
            feet = curve.closest_point(points)
            nearer = feet.distance < best
            best, places = np.where(nearer, feet.distance, best), np.where(nearer[:, None], feet.points, places)
            number = np.where(nearer, count + k, number)
        return best, places, number

    def samples(self, spacing: float) -> tuple[Floats, Ints]:
        """Return points (k, d) on all origins, about a ``spacing`` apart on curves, and their origins' numbers (k,)."""
        at, owner = [self.points], [np.arange(len(self.points))]
        for number, curve in enumerate(self.curves, len(self.points)):
            at.append(ck.boundary_points(curve, self.surface, spacing).points)
            owner.append(np.full(len(at[-1]), number))
        return np.concatenate(at), np.concatenate(owner)

    def heat_source(self, spacing: float, reach: float) -> ck.PointSource:
        """Return heat sources on all origins: of strength 1 per spacing on curves, and stronger at points.

        Heat of time t = reach^2 from a curve decays as exp(-s / reach), heat from a point as the Bessel function
        K0(s / reach) / pi, which is sqrt(2 reach / (pi s)) / 2 as large. The strength of points makes both equal at a
        distance s of a quarter of the manifold's size: ridges between points and curves then lie half way, up to a
        fraction of the reach.
        """
        far = 0.25 * float(np.ptp(self.surface.bounds, axis=0).max())
        of_point = np.pi * reach / spacing * np.sqrt(2 * far / (np.pi * reach))
        at, strength = [self.points], [np.full(len(self.points), of_point)]
        for curve in self.curves:
            along = ck.boundary_points(curve, self.surface, spacing)
            at.append(along.points)
            strength.append(along.weights / spacing)
        return ck.PointSource(np.concatenate(at), np.concatenate(strength))

    @cached_property
    def _tree(self) -> Any:
        """Search tree of the points."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points)


def origins_of(origins: Any, surface: ClosestPointSource) -> Origins:
    """Return origins that are given as points (k, d) or (d,), numbers of vertices, sources, or a sequence of these.

    Raises
    ------
    InputError
        If there are no origins, or an entry is none of these.
    """
    points, curves = [np.zeros((0, surface.dim))], []
    accepted = f"origins are finite points (k, {surface.dim}), numbers of vertices of a mesh, or sources of curves"
    several = isinstance(origins, Sequence) and any(isinstance(entry, ClosestPointSource) for entry in origins)
    for entry in origins if several else [origins]:
        if _are_vertices(entry, surface):
            entry = ck.Boundary("origins", entry, both=ck.Neumann(0.0)).on(surface).source
        if isinstance(entry, ClosestPointSource):
            if entry.manifold_dim == 0:
                points.append(ck.boundary_points(entry, surface, 1.0).points)
            else:
                curves.append(entry)
            continue
        try:
            array = np.atleast_2d(np.asarray(entry, dtype=np.float64))
        except (TypeError, ValueError) as error:
            raise InputError(f"{accepted}, got {shown(entry)}.") from error
        if array.ndim != 2 or array.shape[1] != surface.dim or not np.isfinite(array).all():
            raise InputError(f"{accepted}, got {shown(entry)}.")
        points.append(surface.closest_point(array).points)
    every = np.concatenate(points)
    if not len(every) and not curves:
        raise InputError("a distance needs origins: give points or the source of a curve.")
    return Origins(surface, every, curves)


def _are_vertices(numbers: Any, surface: ClosestPointSource) -> bool:
    """Return whether whole numbers stand for vertices rather than for the coordinates of a point.

    On a mesh they always do; elsewhere d of them are a point.
    """
    try:
        array = np.asarray(numbers)
    except ValueError:  # rows of different lengths
        return False
    whole = array.dtype.kind in "iu" and array.ndim < 2 and array.size > 0
    return whole and (isinstance(surface, HasGivenMesh) or array.size != surface.dim)


@dataclass(frozen=True, eq=False)
class Pieces:
    """The connected pieces of a prepared manifold with barriers.

    Attributes
    ----------
    count : int
        Number of pieces.
    of_unknown : (n,) int64
        The number of the piece of each unknown.
    of_point : (p,) int64
        The number of the piece of each point of the prepared scene.
    """

    count: int
    of_unknown: Ints
    of_point: Ints

    def numbers_at(self, form: Discretized, points: Floats) -> Ints:
        """Return the numbers (k,) of the pieces to which ``points`` (k, d) belong."""
        if self.count == 1 or not len(points):
            return np.zeros(len(points), dtype=np.int64)
        numbers: Ints = np.rint(form.rows(points) @ self.of_unknown.astype(np.float64)).astype(np.int64)
        return numbers


#: Cache of :func:`pieces_of` by discretised scene.
_CACHE: WeakKeyDictionary[Discretized, Pieces] = WeakKeyDictionary()


def pieces_of(prepared: Prepared) -> Pieces:
    """Return the connected pieces of a prepared scene whose boundaries are barriers; computed once per scene."""
    form = prepared.discretized
    if form not in _CACHE:
        border = form.free_constants(form.stiffness(Terms()))
        numbers = np.zeros(form.size) if border is None else border.indicator @ np.arange(border.indicator.shape[1])
        of_unknown = np.rint(numbers).astype(np.int64)
        of_point = np.rint(form.at_points(numbers[:, None].astype(np.float64))[:, 0]).astype(np.int64)
        _CACHE[form] = Pieces(int(of_unknown.max()) + 1, of_unknown, of_point)
    return _CACHE[form]
