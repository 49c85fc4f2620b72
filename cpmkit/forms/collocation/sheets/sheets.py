"""Several sheets of a surface in one band: a lattice node may hold one unknown for each sheet on which it has a foot.

King et al. (2024), section 8, proposes such unknowns.

A site is a node together with a foot. Every node of the band has one, its closest point; where another sheet's
stencils need the node too, it gets a twin, a further site at the same node with its foot on that sheet.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.source import ClosestPoints
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from cpmkit.grid.band import Band

#: Normals of one sheet have at least this cosine.
SAME_SHEET_COSINE = -0.4
#: Feet farther from each other than this many spacings, along their mean normal, lie on different sheets.
SHEET_HEIGHT_SPACINGS = 0.5
#: The direction to a node nearer to its foot than this many spacings is not the normal.
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
    """Return which pairs of surface points (..., d) lie on one sheet.

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
    similar = np.sum(normals * other_normals, axis=-1) >= SAME_SHEET_COSINE
    allowed = SHEET_HEIGHT_SPACINGS * spacing + bend
    if slope:
        allowed += slope * np.linalg.norm(chord, axis=-1)
    return np.asarray(similar & (height <= allowed))


def has_signed_normals(source: LocalSource) -> bool:
    """Return whether a surface's normals have a sign of their own everywhere."""
    return all(member.has_normals for member in source.members)


@dataclass(frozen=True, eq=False)
class FootDirections:
    """Directions and distances from feet to their nodes: the direction is the normal of the surface at the foot.

    Attributes
    ----------
    unit : (n, d) float64
        Directions; zero where the node lies on its foot.
    length : (n,) float64
        Distances, in units of length.
    reliable : (n,) bool
        Whether the direction is the normal: not at an edge, nor where the foot is doubtful or too near to the node.
    """

    unit: Floats
    length: Floats
    reliable: Bools


def foot_directions(band: Band) -> FootDirections:
    """Return the directions from the feet of all sites of the band to their nodes; no source is asked."""
    offset = band.positions - band.feet.points
    length = np.linalg.norm(offset, axis=1)
    reliable = (length > ON_FOOT_SPACINGS * band.spacing) & (band.feet.edge < 0)
    if band.feet.doubtful is not None:
        reliable &= ~band.feet.doubtful
    return FootDirections(offset / np.where(length > 0, length, 1.0)[:, None], length, reliable)


@dataclass(frozen=True, eq=False)
class Sheets:
    """The twins of a band's nodes, and which site of a node lies on the sheet of a stencil.

    Attributes
    ----------
    source : LocalSource
        The surface.
    spacing : float
        Of the lattice.
    feet : ClosestPoints
        Of all sites of the band.
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
    feet: ClosestPoints
    normals: Floats
    first: Ints
    twins: Ints
    mixed: Ints

    @property
    def signed(self) -> bool:
        """Whether the surface's normals have a sign of their own."""
        return has_signed_normals(self.source)

    def counts(self, sites: Ints) -> Ints:
        """Return how many twins each of ``sites`` (...) has."""
        return np.asarray(self.first[sites + 1] - self.first[sites])

    def select_twins(
        self, at: ClosestPoints, normals: Floats, columns: Ints, readable: Bools, every: bool = False
    ) -> tuple[Ints, tuple[Ints, Ints]]:
        """Return stencils (n, s) with sites of another sheet replaced by twins on their own.

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
            True to look at sites without twins, too: for the entries without a site.

        Returns
        -------
        selected : (n, s) int
            The sites read in their place.
        missing : two (k,) int64
            Row and column of the entries for which no site exists on the stencil's own sheet.
        """
        selected = columns.copy()
        row, column = np.nonzero(np.ones_like(columns) if every else self.counts(columns))
        site = columns[row, column]
        foreign = ~self._on_sheet(at.points[row], normals[row], site)
        row, column, site = row[foreign], column[foreign], site[foreign]
        replacement = np.full(len(row), -1)
        for entry, twin in self._twins_of(site):
            open_entry = (replacement[entry] < 0) & readable[twin]
            entry, twin = entry[open_entry], twin[open_entry]
            on_sheet = self._on_sheet(at.points[row[entry]], normals[row[entry]], twin)
            replacement[entry[on_sheet]] = twin[on_sheet]
        selected[row, column] = np.where(replacement >= 0, replacement, site)
        return selected, (row[replacement < 0], column[replacement < 0])

    def _on_sheet(self, feet: Floats, normals: Floats, site: Ints) -> Bools:
        return same_sheet(feet, normals, self.feet.points[site], self.normals[site], self.spacing, self.signed)

    def _twins_of(self, site: Ints) -> Iterator[tuple[Ints, Ints]]:
        """Yield, for each place in the lists of twins, which of the sites (k,) have a twin there, and the twins."""
        count = self.counts(site)
        for index in range(int(count.max(initial=0))):
            entries = np.flatnonzero(count > index)
            yield entries, self.twins[self.first[site[entries]] + index]
