"""A boundary as it is seen along the surface, where several sheets of that share a band.

The boundary's point nearest in space may lie on another sheet. What counts for a point is the part of the boundary on
its own: whether there is one within reach, and where the foot on it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import SHEET_HEIGHT_SPACINGS, same_sheet
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.manifold.walking import walk
from cpmkit.protocols import Bools, ClosestPoints, Floats, Rows

#: Below this cosine of their normals, whether two points lie on one sheet is not decided by height,
LEVEL_NORMALS_COSINE = 0.5
#: unless they are within so many spacings, on both sides of a crease.
NEAR_BOUNDARY_SPACINGS = 4.0
#: Number of nearest boundary samples searched for one on a point's own sheet.
LOOKED_AT_SAMPLES = 64
#: A point is on another sheet if its height above a boundary's point exceeds this share of the chord. A smaller share
#: would misjudge points of a rough surface and let values leak across the boundary.
STEEP_CHORD_SHARE = 0.5
#: Points whose samples are looked at at a time.
SHEET_PARCEL_POINTS = 4096
#: A walk that ends within so many spacings of its goal has reached it; the next sheet is farther away.
REACHED_GOAL_SPACINGS = 0.25


@dataclass(frozen=True, eq=False)
class SurfacePoints(Rows):
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
    def on(cls, surface: LocalSource, points: Floats, spacing: float) -> SurfacePoints:
        """Return ``points`` (n, d), moved onto the surface."""
        feet = surface.closest_point(points)
        return cls(feet, unit_normals(surface, feet, 0.5 * spacing))

    @property
    def points(self) -> Floats:
        """(n, d) where they are."""
        return self.feet.points


@dataclass(frozen=True, eq=False)
class BoundaryOnSheets:
    """A boundary on a surface of several sheets in one band.

    Attributes
    ----------
    source, surface : LocalSource
        The boundary and the surface.
    samples : Placed
        Points of the boundary on the surface, a spacing apart or less.
    spacing : float
        Of the lattice.
    signed : bool
        True where the surface's normals have a sign of their own.
    """

    source: LocalSource
    surface: LocalSource
    samples: SurfacePoints
    spacing: float
    signed: bool

    def relative_to(self, points: Floats, nearest: ClosestPoints, radius: float) -> tuple[ClosestPoints, Floats, Bools]:
        """Return the feet on the boundary, each on its point's own sheet.

        Parameters
        ----------
        points : (n, d) float64
            Of the surface.
        nearest : ClosestPoints
            Their closest points on the boundary.
        radius : float
            Beyond this the boundary is not looked for.

        Returns
        -------
        feet : ClosestPoints
            On the boundary.
        away : (n, d) float64
            From the feet to the points: the chord, or as long as that in the direction of the way along the surface.
        on_sheet : (n,) bool
            False where the boundary has no part within reach that is on the point's sheet.
        """
        targets = SurfacePoints.on(self.surface, points, self.spacing)
        away, on_sheet = self._ways(SurfacePoints.on(self.surface, nearest.points, self.spacing), targets)
        rows = np.flatnonzero(~on_sheet)
        start, found = self._nearest_samples(targets.take(rows), radius)
        rows = rows[found]
        if not len(rows):
            return nearest, away, on_sheet
        feet, away[rows], on_sheet[rows] = self._from_samples(start.take(found), targets.take(rows))
        return nearest.replaced(rows, feet), away, on_sheet

    def _from_samples(self, start: ClosestPoints, targets: SurfacePoints) -> tuple[ClosestPoints, Floats, Bools]:
        """Return the feet of points, walked to along the boundary from samples; the rest as :meth:`relative_to`.

        Where the walk strays to another sheet, over a sharp rim, the sample is the foot.
        """
        feet = walk(self.source, targets.points, start, self.spacing, lengthened=False).feet
        away, on_sheet = self._ways(SurfacePoints.on(self.surface, feet.points, self.spacing), targets)
        strayed = np.flatnonzero(~on_sheet)
        samples = start.take(strayed)
        from_samples = SurfacePoints.on(self.surface, samples.points, self.spacing)
        away[strayed], on_sheet[strayed] = self._ways(from_samples, targets.take(strayed))
        return feet.replaced(strayed, samples), away, on_sheet

    def _ways(self, base: SurfacePoints, targets: SurfacePoints) -> tuple[Floats, Bools]:
        """Return the vectors from boundary points ``base`` to ``targets``, and which of these are on the same sheet.

        Where the normals leave it open (at creases, or where the surface bends sharply between the two), one of the two
        has to be reached from the other by walking along the surface.
        """
        possible = same_sheet(
            base.points, base.normals, targets.points, targets.normals, self.spacing, self.signed, STEEP_CHORD_SHARE
        )
        on_sheet, away = possible & self._level(base, targets), targets.points - base.points
        for start, goal, forth in ((targets, base, False), (base, targets, True)):
            rows = np.flatnonzero(possible & ~on_sheet)
            if not len(rows):
                break
            walked = walk(self.surface, goal.points[rows], start.feet.take(rows), self.spacing, lengthened=False)
            missed = np.linalg.norm(walked.feet.points - goal.points[rows], axis=1)
            on_sheet[rows] = missed <= REACHED_GOAL_SPACINGS * self.spacing
            if not forth:
                along = on_sheet[rows] & walked.last.any(axis=1)
                length = np.linalg.norm(away[rows], axis=1, keepdims=True)
                away[rows[along]] = -(length * walked.last)[along]
        return away, on_sheet

    def _level(self, feet: SurfacePoints, targets: SurfacePoints) -> Bools:
        """Tell which pairs lie at one height over their mean normal, as on a smooth sheet however it curves.

        Points on the two slopes of a ridge do too: where normals turn farther than that, only near ones are taken.
        """
        along = np.sum(feet.normals * targets.normals, axis=1)
        other = targets.normals if self.signed else np.where(along[:, None] < 0, -targets.normals, targets.normals)
        height = 0.5 * np.abs(np.sum((targets.points - feet.points) * (feet.normals + other), axis=1))
        alike = (along if self.signed else np.abs(along)) >= LEVEL_NORMALS_COSINE
        alike |= np.linalg.norm(targets.points - feet.points, axis=1) <= NEAR_BOUNDARY_SPACINGS * self.spacing
        return np.asarray(alike & (height <= SHEET_HEIGHT_SPACINGS * self.spacing))

    def _nearest_samples(self, targets: SurfacePoints, radius: float) -> tuple[ClosestPoints, Bools]:
        """Return the boundary's record of the sample nearest to each point that may be on its sheet, and where any is.

        Samples that are level with the point come before those that are so up to a bend of the surface.
        """
        from scipy.spatial import cKDTree

        tree, count = cKDTree(self.samples.points), min(LOOKED_AT_SAMPLES, len(self.samples.points))
        best, found = np.zeros(len(targets.points), dtype=np.int64), np.zeros(len(targets.points), dtype=bool)
        for begin in range(0, len(best), SHEET_PARCEL_POINTS):
            rows = np.arange(begin, min(begin + SHEET_PARCEL_POINTS, len(best)))
            found_each = tree.query(targets.points[rows], k=np.arange(1, count + 1))
            distance, near = found_each[0], found_each[1].astype(np.int64)
            row, column = np.nonzero(distance <= radius)
            around, target = self.samples.take(near[row, column]), targets.take(rows[row])
            bent = same_sheet(around.points, around.normals, target.points, target.normals, self.spacing, self.signed)
            rank = np.full(near.shape, np.inf)
            rank[row, column] = np.where(bent, column + np.where(self._level(around, target), 0, count), np.inf)
            choice = rank.argmin(axis=1)
            best[rows], found[rows] = near[rows - begin, choice], np.isfinite(rank[rows - begin, choice])
        return self.source.closest_point(self.samples.points[best]), found
