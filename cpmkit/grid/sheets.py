"""Several sheets of a surface in one band: a lattice node may hold one unknown for each sheet on which it has a foot.

A site is a node together with a foot. Every node of the band has one, its closest point; where another sheet's
stencils need the node too, it gets a twin, a further site at the same node with its foot on that sheet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.localized import Localized
from cpmkit.protocols import Bools, Floats, Ints

#: Normals that face each other more than this do not belong to one sheet (cosine).
FACING = -0.4
#: Feet farther from each other than this many spacings, along their mean normal, lie on different sheets.
APART = 0.5


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
    facing = np.sum(normals * other_normals, axis=-1) >= FACING
    allowed = APART * spacing + bend
    if slope:
        allowed += slope * np.linalg.norm(chord, axis=-1)
    return np.asarray(facing & (height <= allowed))


@dataclass(frozen=True, eq=False)
class Sheets:
    """The twins of a band's nodes, and what tells whose they are.

    Attributes
    ----------
    source : Localized
        The surface.
    signed : bool
        True where its normals have a sign of their own.
    normals : (n, d) float64
        At the feet of all sites of the band.
    first : (n + 1,) int64
        ``twins[first[k]:first[k + 1]]`` are the twins of site k; a twin has none itself.
    twins : (t,) int64
        Numbers of sites.
    mixed : (m,) int64
        Sites whose stencils still read a node of another sheet, because no foot on their own was found for it.
    """

    source: Localized
    signed: bool
    normals: Floats
    first: Ints
    twins: Ints
    mixed: Ints

    def counts(self, sites: Ints) -> Ints:
        """Return how many twins each of ``sites`` (...) has."""
        return np.asarray(self.first[sites + 1] - self.first[sites])

    def choose(
        self, feet: Floats, normals: Floats, columns: Ints, site_feet: Floats, spacing: float, readable: Bools
    ) -> None:
        """Replace, in stencils, sites of another sheet by twins on the stencil's own.

        Parameters
        ----------
        feet, normals : (n, d) float64
            Where the stencils are centred, and the surface's normals there.
        columns : (n, s) int
            Sites that they read; changed in place.
        site_feet : (sites, d) float64
            Feet of all sites.
        spacing : float
            Of the lattice.
        readable : (sites,) bool
            Which twins can be read here.
        """
        row, column = np.nonzero(self.counts(columns))
        site = columns[row, column]
        foreign = ~same_sheet(feet[row], normals[row], site_feet[site], self.normals[site], spacing, self.signed)
        row, column, site = row[foreign], column[foreign], site[foreign]
        found = np.full(len(row), -1)
        for place in range(int(self.counts(site).max(initial=0))):
            left = np.flatnonzero((found < 0) & (self.counts(site) > place))
            twin = self.twins[self.first[site[left]] + place]
            centre = row[left]
            own = same_sheet(feet[centre], normals[centre], site_feet[twin], self.normals[twin], spacing, self.signed)
            own &= readable[twin]
            found[left[own]] = twin[own]
        kept = found >= 0
        columns[row[kept], column[kept]] = found[kept]
