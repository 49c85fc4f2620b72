"""A boundary as it is seen along the surface, where several sheets of the surface share a band.

The boundary's point nearest in space may lie on another sheet. For a point of the surface, only the part of the
boundary on the point's own sheet counts: whether there is one within reach, and where the foot on it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.forms.collocation.sheets.sheets import SHEET_HEIGHT_SPACINGS, same_sheet
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints, Rows
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.manifold.walking import walk
from cpmkit.types import Bools, Floats

#: Below this cosine of their normals, height does not decide whether two points lie on one sheet, unless they are
#: within ``NEAR_BOUNDARY_SPACINGS`` spacings, on both sides of a crease.
LEVEL_NORMALS_COSINE, NEAR_BOUNDARY_SPACINGS = 0.5, 4.0
#: Number of nearest boundary samples searched for one on a point's own sheet; points that are searched for at a time.
NEAREST_SAMPLES, SEARCH_CHUNK_POINTS = 64, 4096
#: A point is on another sheet if its height above a boundary's point exceeds this share of the chord. A smaller share
#: would misjudge points of a rough surface and let values leak across the boundary.
STEEP_CHORD_SHARE = 0.5
#: A walk that ends within so many spacings of its goal has reached it; the next sheet is farther away.
REACHED_GOAL_SPACINGS = 0.25


@dataclass(frozen=True, eq=False)
class SurfacePoints(Rows):
    """Points of a surface, with its normals there.

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
    samples : SurfacePoints
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
            The boundary's samples are searched within this distance.

        Returns
        -------
        feet : ClosestPoints
            On the boundary.
        offset : (n, d) float64
            From the feet to the points: the chord, or as long as that in the direction of the walk along the surface.
        on_sheet : (n,) bool
            False where the boundary has no part within reach that is on the point's sheet.
        """
        targets = SurfacePoints.on(self.surface, points, self.spacing)
        offset, on_sheet = self._offsets(SurfacePoints.on(self.surface, nearest.points, self.spacing), targets)
        rows = np.flatnonzero(~on_sheet)
        start, has_sample = self._nearest_samples(targets.take(rows), radius)
        rows = rows[has_sample]
        if not len(rows):
            return nearest, offset, on_sheet
        feet, offset[rows], on_sheet[rows] = self._from_samples(start.take(has_sample), targets.take(rows))
        return nearest.replace_rows(rows, feet), offset, on_sheet

    def _from_samples(self, start: ClosestPoints, targets: SurfacePoints) -> tuple[ClosestPoints, Floats, Bools]:
        """Return the feet of points, walked to along the boundary from samples; the rest as :meth:`relative_to`.

        Where the walk strays to another sheet, over a sharp rim, the sample is the foot.
        """
        feet = walk(self.source, targets.points, start, self.spacing, lengthened=False).feet
        offset, on_sheet = self._offsets(SurfacePoints.on(self.surface, feet.points, self.spacing), targets)
        strayed = np.flatnonzero(~on_sheet)
        samples = start.take(strayed)
        from_samples = SurfacePoints.on(self.surface, samples.points, self.spacing)
        offset[strayed], on_sheet[strayed] = self._offsets(from_samples, targets.take(strayed))
        return feet.replace_rows(strayed, samples), offset, on_sheet

    def _offsets(self, base: SurfacePoints, targets: SurfacePoints) -> tuple[Floats, Bools]:
        """Return the vectors from boundary points ``base`` to ``targets``, and which of these are on the same sheet.

        Where the normals leave it open (at creases, or where the surface bends sharply between the two), the same sheet
        means that one point is reached from the other by walking along the surface.
        """
        possible = same_sheet(
            base.points, base.normals, targets.points, targets.normals, self.spacing, self.signed, STEEP_CHORD_SHARE
        )
        on_sheet, offset = possible & self._is_level(base, targets), targets.points - base.points
        for start, goal, forward in ((targets, base, False), (base, targets, True)):
            rows = np.flatnonzero(possible & ~on_sheet)
            if not len(rows):
                break
            walked = walk(self.surface, goal.points[rows], start.feet.take(rows), self.spacing, lengthened=False)
            missed = np.linalg.norm(walked.feet.points - goal.points[rows], axis=1)
            on_sheet[rows] = missed <= REACHED_GOAL_SPACINGS * self.spacing
            if not forward:
                along = on_sheet[rows] & walked.last.any(axis=1)
                length = np.linalg.norm(offset[rows], axis=1, keepdims=True)
                offset[rows[along]] = -(length * walked.last)[along]
        return offset, on_sheet

    def _is_level(self, feet: SurfacePoints, targets: SurfacePoints) -> Bools:
        """Return which pairs lie at one height over their mean normal, as on a smooth sheet however it curves.

        Points on the two slopes of a ridge do too: where normals turn farther than that, only close points count.
        """
        along = np.sum(feet.normals * targets.normals, axis=1)
        other = targets.normals if self.signed else np.where(along[:, None] < 0, -targets.normals, targets.normals)
        height = 0.5 * np.abs(np.sum((targets.points - feet.points) * (feet.normals + other), axis=1))
        comparable = (along if self.signed else np.abs(along)) >= LEVEL_NORMALS_COSINE
        comparable |= np.linalg.norm(targets.points - feet.points, axis=1) <= NEAR_BOUNDARY_SPACINGS * self.spacing
        return np.asarray(comparable & (height <= SHEET_HEIGHT_SPACINGS * self.spacing))

    def _nearest_samples(self, targets: SurfacePoints, radius: float) -> tuple[ClosestPoints, Bools]:
        """Return the boundary's record of the sample nearest to each point that may be on its sheet, and where any is.

        Samples that are level with the point come before those that are so up to a bend of the surface.
        """
        from scipy.spatial import cKDTree

        tree, count = cKDTree(self.samples.points), min(NEAREST_SAMPLES, len(self.samples.points))
        best, has_sample = np.zeros(len(targets.points), dtype=np.int64), np.zeros(len(targets.points), dtype=bool)
        for begin in range(0, len(best), SEARCH_CHUNK_POINTS):
            rows = np.arange(begin, min(begin + SEARCH_CHUNK_POINTS, len(best)))
            query = tree.query(targets.points[rows], k=np.arange(1, count + 1))
            distance, nearest = query[0], query[1].astype(np.int64)
            row, column = np.nonzero(distance <= radius)
            sample, target = self.samples.take(nearest[row, column]), targets.take(rows[row])
            up_to_bend = same_sheet(
                sample.points, sample.normals, target.points, target.normals, self.spacing, self.signed
            )
            rank = np.full(nearest.shape, np.inf)
            level_first = column + np.where(self._is_level(sample, target), 0, count)
            rank[row, column] = np.where(up_to_bend, level_first, np.inf)
            choice = rank.argmin(axis=1)
            best[rows], has_sample[rows] = nearest[rows - begin, choice], np.isfinite(rank[rows - begin, choice])
        return self.source.closest_point(self.samples.points[best]), has_sample
