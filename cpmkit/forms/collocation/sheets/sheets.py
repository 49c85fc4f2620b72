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
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints

#: Normals of one sheet have at least this cosine.
SAME_SHEET_COSINE = -0.4
#: Feet farther from each other than this many spacings, along their mean normal, lie on different sheets.
SHEET_HEIGHT_SPACINGS = 0.5


def same_sheet(
    feet: Floats,
    normals: Floats,
    other_feet: Floats,
    other_normals: Floats,
    spacing: float,
    signed: bool,
    slope: float = 0.0,
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
    alike = np.sum(normals * other_normals, axis=-1) >= SAME_SHEET_COSINE
    allowed = SHEET_HEIGHT_SPACINGS * spacing + bend
    if slope:
        allowed += slope * np.linalg.norm(chord, axis=-1)
    return np.asarray(alike & (height <= allowed))


def has_signed_normals(source: LocalSource) -> bool:
    """Tell whether a surface's normals have a sign of their own everywhere."""
    return all(member.has_normals for member in source.members)


@dataclass(frozen=True, eq=False)
class Unserved:
    """Stencil entries (row, column) for which no site exists on the stencil's own sheet."""

    row: Ints
    column: Ints


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
    first : (n + 1,) int64
        ``twins[first[k]:first[k + 1]]`` are the twins of site k; a twin has none itself.
    twins : (t,) int64
        Numbers of sites.
    mixed : (m,) int64
        Sites whose stencils still read a node of another sheet, because no foot on their own was found for it.
    """

    source: LocalSource
    spacing: float
    nodes: Ints
    feet: ClosestPoints
    normals: Floats
    first: Ints
    twins: Ints
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
            fit = (found[left] < 0) & readable[twin]
            left, twin = left[fit], twin[fit]
            own = self._own(at.points[row[left]], normals[row[left]], twin)
            found[left[own]] = twin[own]
        selected[row, column] = np.where(found >= 0, found, site)
        return selected, Unserved(row[found < 0], column[found < 0])

    def _own(self, feet: Floats, normals: Floats, site: Ints) -> Bools:
        return same_sheet(feet, normals, self.feet.points[site], self.normals[site], self.spacing, self.signed)

    def _twins_of(self, site: Ints) -> Iterator[tuple[Ints, Ints]]:
        """Yield, for each place in the lists of twins, which of the sites (k,) have one there, and the twins."""
        count = self.counts(site)
        for place in range(int(count.max(initial=0))):
            some = np.flatnonzero(count > place)
            yield some, self.twins[self.first[site[some]] + place]
