"""A boundary as it is seen along the surface, where several sheets of that share a band.

The boundary's point nearest in space may lie on another sheet. What counts for a point is the part of the boundary on
its own: whether there is one within reach, and where the foot on it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import APART, same_sheet
from cpmkit.manifold.localized import Localized
from cpmkit.manifold.tangent_space import normals
from cpmkit.manifold.walking import walk
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints

#: Normals that turn farther than this (cosine) do not tell whether two points lie on one sheet,
ALIKE = 0.5
#: unless these are within so many spacings: on both sides of a crease.
NEAR = 4.0
#: So many points of a boundary around a point are looked at for one on its sheet.
LOOKED_AT = 64
#: A point that lies higher above a boundary's than this share of the chord is on another sheet. Less would take points
#: of a rough surface for that, and let values bleed across the boundary.
STEEP = 0.5
#: Points whose samples are looked at at a time.
PARCEL = 4096
#: A walk that ends within so many spacings of its goal has reached it; the next sheet is farther away.
REACHED = 0.25


@dataclass(frozen=True, eq=False)
class Placed:
    """Points of a surface with its normals there.

    Attributes
    ----------
    feet : ClosestPoints
        The surface's records of the points.
    normals : (n, d) float64
        Of the surface.
    """

    feet: ClosestPoints
    normals: Floats

    @classmethod
    def on(cls, surface: Localized, points: Floats, spacing: float) -> Placed:
        """Return ``points`` (n, d), moved onto the surface."""
        feet = surface.closest_point(points)
        return cls(feet, normals(surface, feet, 0.5 * spacing))

    @property
    def points(self) -> Floats:
        """(n, d) where they are."""
        return self.feet.points

    def take(self, index: Ints | Bools) -> Placed:
        """Return those at ``index``."""
        return Placed(self.feet.take(index), self.normals[index])


@dataclass(frozen=True, eq=False)
class BoundaryOnSheets:
    """A boundary on a surface of several sheets in one band.

    Attributes
    ----------
    source, surface : Localized
        The boundary and the surface.
    samples : Placed
        Points of the boundary on the surface, a spacing apart or less.
    spacing : float
        Of the lattice.
    signed : bool
        True where the surface's normals have a sign of their own.
    """

    source: Localized
    surface: Localized
    samples: Placed
    spacing: float
    signed: bool

    def seen_from(self, points: Floats, first: ClosestPoints, radius: float) -> tuple[ClosestPoints, Floats, Bools]:
        """Return the feet on the boundary, each on its point's own sheet.

        Parameters
        ----------
        points : (n, d) float64
            Of the surface.
        first : ClosestPoints
            Their closest points on the boundary.
        radius : float
            Beyond this the boundary is not looked for.

        Returns
        -------
        feet : ClosestPoints
            On the boundary.
        away : (n, d) float64
            From the feet to the points: the chord, or as long as that in the direction of the way along the surface.
        own : (n,) bool
            False where the boundary has no part within reach that is on the point's sheet.
        """
        at = Placed.on(self.surface, points, self.spacing)
        away, own = self._ways(Placed.on(self.surface, first.points, self.spacing), at)
        rows = np.flatnonzero(~own)
        start, found = self._nearest_samples(at.take(rows), radius)
        rows = rows[found]
        if not len(rows):
            return first, away, own
        feet, away[rows], own[rows] = self._from_samples(start.take(found), at.take(rows))
        return first.replaced(rows, feet), away, own

    def _from_samples(self, start: ClosestPoints, at: Placed) -> tuple[ClosestPoints, Floats, Bools]:
        """Return the feet of points, walked to along the boundary from samples; the rest as :meth:`seen_from`.

        Where the walk strays to another sheet, over a sharp rim, the sample is the foot.
        """
        feet = walk(self.source, at.points, start, self.spacing).feet
        away, own = self._ways(Placed.on(self.surface, feet.points, self.spacing), at)
        strayed = np.flatnonzero(~own)
        samples = start.take(strayed)
        from_samples = Placed.on(self.surface, samples.points, self.spacing)
        away[strayed], own[strayed] = self._ways(from_samples, at.take(strayed))
        return feet.replaced(strayed, samples), away, own

    def _ways(self, on: Placed, at: Placed) -> tuple[Floats, Bools]:
        """Return the vectors from the boundary's points ``on`` to points ``at``, and which of these are on their sheet.

        Where the normals leave it open (at creases, or where the surface bends sharply between the two), one of the two
        has to be reached from the other by walking along the surface.
        """
        possible = same_sheet(on.points, on.normals, at.points, at.normals, self.spacing, self.signed, STEEP)
        own, away = possible & self._level(on, at), at.points - on.points
        for start, goal, forth in ((at, on, False), (on, at, True)):
            rows = np.flatnonzero(possible & ~own)
            if not len(rows):
                break
            walked = walk(self.surface, goal.points[rows], start.feet.take(rows), self.spacing)
            missed = np.linalg.norm(walked.feet.points - goal.points[rows], axis=1)
            own[rows] = missed <= REACHED * self.spacing
            if not forth:
                along = own[rows] & walked.last.any(axis=1)
                length = np.linalg.norm(away[rows], axis=1, keepdims=True)
                away[rows[along]] = -(length * walked.last)[along]
        return away, own

    def _level(self, feet: Placed, at: Placed) -> Bools:
        """Tell which pairs lie at one height over their mean normal, as on a smooth sheet however it curves.

        Points on the two slopes of a ridge do too: where normals turn farther than that, only near ones are taken.
        """
        along = np.sum(feet.normals * at.normals, axis=1)
        other = at.normals if self.signed else np.where(along[:, None] < 0, -at.normals, at.normals)
        height = 0.5 * np.abs(np.sum((at.points - feet.points) * (feet.normals + other), axis=1))
        alike = (along if self.signed else np.abs(along)) >= ALIKE
        alike |= np.linalg.norm(at.points - feet.points, axis=1) <= NEAR * self.spacing
        return np.asarray(alike & (height <= APART * self.spacing))

    def _nearest_samples(self, at: Placed, radius: float) -> tuple[ClosestPoints, Bools]:
        """Return the boundary's record of the sample nearest to each point that may be on its sheet, and where any is.

        Samples that are level with the point come before those that are so up to a bend of the surface.
        """
        from scipy.spatial import cKDTree

        tree, count = cKDTree(self.samples.points), min(LOOKED_AT, len(self.samples.points))
        best, found = np.zeros(len(at.points), dtype=np.int64), np.zeros(len(at.points), dtype=bool)
        for begin in range(0, len(best), PARCEL):
            rows = np.arange(begin, min(begin + PARCEL, len(best)))
            distance, near = (np.reshape(each, (len(rows), count)) for each in tree.query(at.points[rows], k=count))
            near = near.astype(np.int64)
            row, column = np.nonzero(distance <= radius)
            around, here = self.samples.take(near[row, column]), at.take(rows[row])
            bent = same_sheet(around.points, around.normals, here.points, here.normals, self.spacing, self.signed)
            rank = np.full(near.shape, np.inf)
            rank[row, column] = np.where(bent, column + np.where(self._level(around, here), 0, count), np.inf)
            choice = rank.argmin(axis=1)
            best[rows], found[rows] = near[rows - begin, choice], np.isfinite(rank[rows - begin, choice])
        return self.source.closest_point(self.samples.points[best]), found
