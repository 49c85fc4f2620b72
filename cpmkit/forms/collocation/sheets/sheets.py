"""Several sheets of a surface in one band: a lattice node may hold one unknown for each sheet on which it has a foot.

King et al. (2024), section 8, proposes such unknowns.

A site is a node together with a foot. Every node of the band has one, its closest point; where another sheet's
stencils need the node too, it gets a twin, a further site at the same node with its foot on that sheet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.unfolding import unfold
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints

#: Normals of one sheet have at least this cosine.
SAME_SHEET_COSINE = -0.4
#: The same where the surface is unfolded.
UNFOLDED_SHEET_COSINE = 0.6
#: Feet farther from each other than this many spacings, along their mean normal, lie on different sheets.
SHEET_HEIGHT_SPACINGS = 0.5
#: Tolerances (spacings) for reusing a foot in place of an unfolded one: for interpolation, where a new foot costs an
#: unknown,
REUSED_FOOT_SPACINGS = 0.75
#: and for differences, where a new foot costs a row of E only.
REUSED_ROW_SPACINGS = 0.1


def same_sheet(
    feet: Floats,
    normals: Floats,
    other_feet: Floats,
    other_normals: Floats,
    spacing: float,
    signed: bool,
    slope: float = 0.0,
    facing: float = SAME_SHEET_COSINE,
) -> Bools:
    """Tell which pairs of surface points (..., d) lie on one sheet.

    On a smooth sheet the chord between two points is at right angles to the mean of their normals, up to the third
    order of its length: so ``|chord . (n + n')| / 2`` is small however the sheet curves, while between parallel sheets
    it is their distance. Across a crease it is at most ``|chord| |n - n'| / 2``, which is allowed for.
    Normals without a sign are taken to point the same way. A ``slope`` above zero allows for more, in proportion to
    the chord: for points farther apart than a stencil is wide.
    """
    if not signed:
        along = np.sum(normals * other_normals, axis=-1, keepdims=True)
        other_normals = np.where(along < 0, -other_normals, other_normals)
    chord, turn = other_feet - feet, other_normals - normals
    height = 0.5 * np.abs(np.sum(chord * (normals + other_normals), axis=-1))
    bend = 0.5 * np.sqrt(np.sum(chord * chord, axis=-1) * np.sum(turn * turn, axis=-1))
    alike = np.sum(normals * other_normals, axis=-1) >= facing
    allowed = SHEET_HEIGHT_SPACINGS * spacing + bend
    if slope:
        allowed += slope * np.linalg.norm(chord, axis=-1)
    return np.asarray(alike & (height <= allowed))


def has_signed_normals(source: LocalSource) -> bool:
    """Tell whether a surface's normals have a sign of their own everywhere."""
    return all(member.has_normals for member in source.members)


@dataclass(frozen=True, eq=False)
class Unserved:
    """Stencil entries (row, column) for which no site exists on the stencil's own sheet.

    ``feet`` says where the site would have its foot if it is found by unfolding; else it is where the stencil is.
    """

    row: Ints
    column: Ints
    feet: ClosestPoints


@dataclass(frozen=True, eq=False)
class Sheets:
    """The twins of a band's nodes, and what tells whose they are.

    Attributes
    ----------
    source : LocalSource
        The surface.
    spacing : float
        Of the lattice.
    nodes : (n, d) int64
        Of all sites of the band.
    feet : ClosestPoints
        Of the sites.
    normals : (n, d) float64
        At the feet.
    anchor : (n,) int64
        The site from whose foot a twin's was found by unfolding; the site itself for all others.
    first : (n + 1,) int64
        ``twins[first[k]:first[k + 1]]`` are the twins of site k; a twin has none itself.
    twins : (t,) int64
        Numbers of sites.
    unfolded : bool
        True where the surface is unfolded.
    mixed : (m,) int64
        Sites whose stencils still read a node of another sheet, because no foot on their own was found for it.
    """

    source: LocalSource
    spacing: float
    nodes: Ints
    feet: ClosestPoints
    normals: Floats
    anchor: Ints
    first: Ints
    twins: Ints
    unfolded: bool
    mixed: Ints

    @property
    def signed(self) -> bool:
        """True where the surface's normals have a sign of their own."""
        return has_signed_normals(self.source)

    def counts(self, sites: Ints) -> Ints:
        """Return how many twins each of ``sites`` (...) has."""
        return np.asarray(self.first[sites + 1] - self.first[sites])

    def select_twins(
        self,
        at: ClosestPoints,
        normals: Floats,
        columns: Ints,
        readable: Bools,
        near: float = REUSED_FOOT_SPACINGS,
        every: bool = False,
    ) -> tuple[Ints, Unserved]:
        """Return stencils (n, s) with sites of another sheet replaced by twins on their own, and what is missed.

        Parameters
        ----------
        at : ClosestPoints
            Where the stencils are centred, n points of the surface.
        normals : (n, d) float64
            There.
        columns : (n, s) int
            Sites that they read.
        readable : (sites,) bool
            Which twins can be read here.
        near : float
            How many spacings from an unfolded foot one may lie that serves in its place.
        every : bool
            True to look at sites without twins, too: for what is missed.
        """
        selected = columns.copy()
        row, column = np.nonzero(np.ones_like(columns) if every else self.counts(columns))
        site = columns[row, column]
        foreign = ~self._own(at.points[row], normals[row], site)
        row, column, site = row[foreign], column[foreign], site[foreign]
        found = np.full(len(row), -1)
        for left, twin in self._twins_of(site):
            fit = (found[left] < 0) & readable[twin] & (self.anchor[twin] == twin)
            left, twin = left[fit], twin[fit]
            own = self._own(at.points[row[left]], normals[row[left]], twin)
            found[left[own]] = twin[own]
        selected[row, column] = np.where(found >= 0, found, site)
        row, column, site = row[found < 0], column[found < 0], site[found < 0]
        if not self.unfolded:
            return selected, Unserved(row, column, at.take(row))
        goal = np.asarray(self.spacing * self.nodes[site], dtype=np.float64)
        feet = unfold(self.source, at.take(row), normals[row], goal, self.spacing, self.signed)
        selected[row, column], distance = self._nearest(site, feet.points, readable)
        missed = distance > near * self.spacing
        return selected, Unserved(row[missed], column[missed], feet.take(missed))

    def _own(self, feet: Floats, normals: Floats, site: Ints) -> Bools:
        facing = UNFOLDED_SHEET_COSINE if self.unfolded else SAME_SHEET_COSINE
        there = self.feet.points[site], self.normals[site]
        return same_sheet(feet, normals, *there, self.spacing, self.signed, facing=facing)

    def _twins_of(self, site: Ints) -> Iterator[tuple[Ints, Ints]]:
        """Yield, for each place in the lists of twins, which of the sites (k,) have one there, and the twins."""
        count = self.counts(site)
        for place in range(int(count.max(initial=0))):
            some = np.flatnonzero(count > place)
            yield some, self.twins[self.first[site[some]] + place]

    def _nearest(self, site: Ints, points: Floats, readable: Bools) -> tuple[Ints, Floats]:
        """Return, of each site (k,) and its twins, the one with the foot nearest to ``points`` (k, d), and how near."""
        nearest, distance = site.copy(), np.linalg.norm(points - self.feet.points[site], axis=1)
        for some, twin in self._twins_of(site):
            away = np.linalg.norm(points[some] - self.feet.points[twin], axis=1)
            nearer = readable[twin] & (away < distance[some])
            nearest[some[nearer]], distance[some[nearer]] = twin[nearer], away[nearer]
        return nearest, distance
