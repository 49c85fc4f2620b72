"""Several sheets of a surface in one band: a lattice node may have one unknown for each sheet with a foot of the node.

King et al. (2024), section 8, proposes such unknowns.

A foot of a node is a point of the surface whose normal passes through the node; a site is a node together with one of
its feet. Every node of the band has a site with its closest point; where stencils of another sheet need the node too,
it gets a twin, a further site at the same node with its foot on that sheet.

The nearest point of a boundary may be on another sheet, too. For a point of the surface, only the part of the boundary
on the point's own sheet counts: whether that part is within reach, and its nearest point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.grid.band import Band
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints, Rows
from cpmkit.manifold.tangent_space import unit_normals, walk
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.types import Bools, Floats, Ints

#: Normals at two points of one sheet have at least this cosine.
SAME_SHEET_COSINE = -0.4
#: Two feet are on different sheets if they are farther apart than this many spacings along their mean normal.
SHEET_HEIGHT_SPACINGS = 0.5
#: A node nearer to its foot than this many spacings counts as on the surface: the vector between gives no normal.
ON_FOOT_SPACINGS = 0.1


def same_sheet(
    feet: Floats,
    normals: Floats,
    other_feet: Floats,
    other_normals: Floats,
    spacing: float,
    signed: bool,
    slope: float = 0.0,
) -> Bools:
    """Return whether (...) two surface points (..., d), given with their normals (..., d), are on one sheet.

    On a smooth sheet the chord between two points is perpendicular to the mean of their normals, up to the third order
    of its length: ``|chord . (n + n')| / 2`` is small for any curvature, while between parallel sheets it is their
    distance. Across a crease it is at most ``|chord| |n - n'| / 2``, which is added to the tolerance of half a
    ``spacing``. Normals that are not ``signed`` are first turned to the same direction; points whose signed normals
    have a cosine below -0.4 are on two sheets. A ``slope`` above zero increases the tolerance by that multiple of the
    chord, for points farther apart than the width of a stencil.
    """
    if not signed:
        along = dots(normals, other_normals)
        other_normals = np.where(along[..., None] < 0, -other_normals, other_normals)
    chord, turn = other_feet - feet, other_normals - normals
    height = 0.5 * np.abs(dots(chord, normals + other_normals))
    bend = 0.5 * np.sqrt(dots(chord, chord) * dots(turn, turn))
    similar = dots(normals, other_normals) >= SAME_SHEET_COSINE
    allowed = SHEET_HEIGHT_SPACINGS * spacing + bend
    if slope:
        allowed += slope * norms(chord)
    return np.asarray(similar & (height <= allowed))


def has_signed_normals(source: LocalSource) -> bool:
    """Return whether all members of a surface provide normals, whose sign is consistent everywhere."""
    return all(member.has_normals for member in source.members)


@dataclass(frozen=True, eq=False)
class FootDirections:
    """Unit vectors and distances from feet to their nodes; reliable vectors are normals of the surface at the feet."""

    unit: Floats  #: (n, d): unit vectors; zero where the node is its own foot.
    length: Floats  #: (n,): distances, in units of length.
    #: (n,): whether the vector is the normal: not at an edge, nor where the foot is doubtful or too near to the node.
    reliable: Bools


def foot_directions(band: Band) -> FootDirections:
    """Return the directions from the feet of all sites of the band to their nodes, without closest point queries."""
    offset = band.positions - band.feet.points
    length = norms(offset)
    reliable = (length > ON_FOOT_SPACINGS * band.spacing) & (band.feet.edge < 0)
    if band.feet.doubtful is not None:
        reliable &= ~band.feet.doubtful
    return FootDirections(offset / np.where(length > 0, length, 1.0)[:, None], length, reliable)


@dataclass(frozen=True, eq=False)
class Sheets:
    """The twins of a band (copies of nodes for further sheets), and the choice of the site on a stencil's sheet."""

    source: LocalSource  #: The surface.
    spacing: float  #: Spacing of the lattice.
    feet: ClosestPoints  #: Feet of all sites of the band.
    normals: Floats  #: (n, d): unit normals at the feet.
    first: Ints  #: (n + 1,): ``twins[first[k]:first[k + 1]]`` are the twins of site k; a twin has none itself.
    twins: Ints  #: (t,): numbers of the sites that are twins.
    mixed: Ints  #: (m,): sites whose stencils still read another sheet, at nodes without a foot on the sites' sheet.

    @property
    def signed(self) -> bool:
        """Whether the sign of the surface's normals is consistent everywhere."""
        return has_signed_normals(self.source)

    def twin_counts(self, sites: Ints) -> Ints:
        """Return the number of twins (...) of each of ``sites`` (...)."""
        return np.asarray(self.first[sites + 1] - self.first[sites])

    def select_twins(
        self, at: ClosestPoints, normals: Floats, columns: Ints, readable: Bools, every: bool = False
    ) -> tuple[Ints, tuple[Ints, Ints]]:
        """Return stencils (n, s) with sites of other sheets replaced by twins on the stencil's own sheet.

        ``at``: the centres of the stencils, n points of the surface.
        ``normals`` (n, d): unit normals there.
        ``columns`` (n, s) int: sites that the stencils read.
        ``readable`` (sites,): whether a site may be chosen as a replacement.
        ``every``: True to test also sites without twins, for a complete list of ``missing``.
        Returned ``selected`` (n, s) int: the sites after replacement.
        Returned ``missing``: row (m,) and column (m,) of the entries without a site on the stencil's own sheet.
        """
        selected = columns.copy()
        row, column = np.nonzero(np.ones_like(columns) if every else self.twin_counts(columns))
        site = columns[row, column]
        foreign = ~self._is_on_sheet(at.points[row], normals[row], site)
        row, column, site = row[foreign], column[foreign], site[foreign]
        replacement = np.full(len(row), -1)
        count = self.twin_counts(site)
        for index in range(int(count.max(initial=0))):
            entry = np.flatnonzero((count > index) & (replacement < 0))
            twin = self.twins[self.first[site[entry]] + index]
            entry, twin = entry[readable[twin]], twin[readable[twin]]
            on_sheet = self._is_on_sheet(at.points[row[entry]], normals[row[entry]], twin)
            replacement[entry[on_sheet]] = twin[on_sheet]
        selected[row, column] = np.where(replacement >= 0, replacement, site)
        return selected, (row[replacement < 0], column[replacement < 0])

    def _is_on_sheet(self, feet: Floats, normals: Floats, site: Ints) -> Bools:
        """Return whether (k,) each ``site`` (k,) is on the sheet of a surface point with normal, each (k, d)."""
        return same_sheet(feet, normals, self.feet.points[site], self.normals[site], self.spacing, self.signed)


#: If the cosine of the angle between their normals is below this, the heights of two points do not decide whether they
#: are on one sheet, unless they are within ``NEAR_BOUNDARY_SPACINGS`` spacings, on both sides of a crease.
LEVEL_NORMALS_COSINE, NEAR_BOUNDARY_SPACINGS = 0.5, 4.0
#: Number of nearest samples of a boundary that are tested for a point's own sheet.
NEAREST_SAMPLES = 64
#: A point is on another sheet if its height above a boundary's point exceeds this share of the chord. A smaller share
#: would misjudge points of a rough surface and let values leak across the boundary.
STEEP_CHORD_SHARE = 0.5
#: A walk that ends within this many spacings of its goal has reached it; the next sheet is farther away.
REACHED_GOAL_SPACINGS = 0.25


@dataclass(frozen=True, eq=False)
class SurfacePoints(Rows):
    """Points of a surface with normals, by which a band decides which part of a boundary is on a point's sheet."""

    feet: ClosestPoints  #: The surface's records of the points.
    normals: Floats  #: (n, d): unit normals of the surface there.

    @classmethod
    def project(cls, surface: LocalSource, points: Floats, spacing: float) -> SurfacePoints:
        """Return ``points`` (n, d), moved to their closest points on the surface, with the normals there.

        Normals that the surface does not give are made by differences over half the lattice's ``spacing``.
        """
        feet = surface.closest_point(points)
        return cls(feet, unit_normals(surface, feet, 0.5 * spacing))

    @property
    def points(self) -> Floats:
        """(n, d) the points."""
        return self.feet.points


@dataclass(frozen=True, eq=False)
class BoundaryOnSheets:
    """A boundary on a surface that has several sheets in one band."""

    #: source, surface: The boundary and the surface.
    source: LocalSource
    surface: LocalSource
    samples: SurfacePoints  #: Points of the boundary on the surface, a spacing apart or less.
    spacing: float  #: Spacing of the lattice.
    signed: bool  #: Whether the sign of the surface's normals is consistent everywhere.

    def find_feet(self, points: Floats, nearest: ClosestPoints, radius: float) -> tuple[ClosestPoints, Floats, Bools]:
        """Return for each of ``points`` the nearest point of the boundary that is on the same sheet.

        ``points`` (n, d): points of the surface.
        ``nearest``: their closest points on the boundary, on any sheet.
        ``radius``: the boundary's samples are searched within this distance.
        Returned ``feet``: the points of the boundary.
        Returned ``offset`` (n, d): vectors from there to the points: the chord, or a vector of its length in the
            direction of the walk on the surface.
        Returned ``on_sheet`` (n,): False where the boundary has no part within reach that is on the point's sheet.
        """
        targets = SurfacePoints.project(self.surface, points, self.spacing)
        offset, on_sheet = self._offsets(SurfacePoints.project(self.surface, nearest.points, self.spacing), targets)
        rows = np.flatnonzero(~on_sheet)
        start, has_sample = self._nearest_samples(targets.take(rows), radius)
        rows = rows[has_sample]
        if not len(rows):
            return nearest, offset, on_sheet
        feet = start.take(has_sample)
        samples = SurfacePoints.project(self.surface, feet.points, self.spacing)
        offset[rows], on_sheet[rows] = self._offsets(samples, targets.take(rows))
        return nearest.replace_rows(rows, feet), offset, on_sheet

    def _offsets(self, base: SurfacePoints, targets: SurfacePoints) -> tuple[Floats, Bools]:
        """Return the vectors (n, d) from boundary points ``base`` to ``targets``, and whether (n,) they share a sheet.

        If the normals do not decide (at creases and sharp bends), the two points are on one sheet if a walk along the
        surface from one reaches the other; the vector then has the walk's last direction and the length of the chord.
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
            missed = norms(walked.feet.points - goal.points[rows])
            on_sheet[rows] = missed <= REACHED_GOAL_SPACINGS * self.spacing
            if not forward:
                along = on_sheet[rows] & walked.last.any(axis=1)
                length = np.linalg.norm(offset[rows], axis=1, keepdims=True)
                offset[rows[along]] = -(length * walked.last)[along]
        return offset, on_sheet

    def _is_level(self, feet: SurfacePoints, targets: SurfacePoints) -> Bools:
        """Return whether (n,) the points of a pair have the same height along their mean normal, as on a smooth sheet.

        Points on the two slopes of a ridge have the same height too: if normals differ much, only close pairs are True.
        """
        along = dots(feet.normals, targets.normals)
        other = targets.normals if self.signed else np.where(along[:, None] < 0, -targets.normals, targets.normals)
        height = 0.5 * np.abs(dots(targets.points - feet.points, feet.normals + other))
        comparable = (along if self.signed else np.abs(along)) >= LEVEL_NORMALS_COSINE
        comparable |= norms(targets.points - feet.points) <= NEAR_BOUNDARY_SPACINGS * self.spacing
        return np.asarray(comparable & (height <= SHEET_HEIGHT_SPACINGS * self.spacing))

    def _nearest_samples(self, targets: SurfacePoints, radius: float) -> tuple[ClosestPoints, Bools]:
        """Return the boundary's records of the sample nearest to each target on its sheet, and whether (n,) one exists.

        Of the 64 nearest samples those within ``radius`` count; samples at the target's height are preferred to samples
        beyond a bend. If none exists, the record is that of any sample.
        """
        from scipy.spatial import cKDTree

        count = min(NEAREST_SAMPLES, len(self.samples.points))
        query = cKDTree(self.samples.points).query(targets.points, k=np.arange(1, count + 1))
        distance, nearest = query[0], query[1].astype(np.int64)
        row, column = np.nonzero(distance <= radius)
        sample, target = self.samples.take(nearest[row, column]), targets.take(row)
        up_to_bend = same_sheet(sample.points, sample.normals, target.points, target.normals, self.spacing, self.signed)
        rank = np.full(nearest.shape, np.inf)
        level_first = column + np.where(self._is_level(sample, target), 0, count)
        rank[row, column] = np.where(up_to_bend, level_first, np.inf)
        best = np.take_along_axis(nearest, rank.argmin(axis=1)[:, None], axis=1)[:, 0]
        return self.source.closest_point(self.samples.points[best]), np.isfinite(rank.min(axis=1))
