"""Whether the border of a triangulation lies beside a rim of the surface, or is a crack."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms
from cpmkit.meshing.contouring.contour_edges import Border
from cpmkit.protocols import Bools, Floats

#: How far beyond a border edge its rim is looked for, in spacings, and how far from the edge it may lie.
BORDER_REACHES, RIM_DISTANCE = (0.05, 1.2, 2.0), 2.0
#: Without edge numbers: past a rim the foot stays, to this share of the query's way, however the query is moved across
#: by that share of it; and so far back from it, in spacings, there is one sheet, to that share of the way.
RIM_STAYS, ACROSS, INWARD_REACH, INWARD_MOVES = 0.2, 0.7, 0.1, 0.3


@dataclass(frozen=True, eq=False)
class RimTest:
    """Decides where a surface ends, on a lattice of one spacing.

    Attributes
    ----------
    source : LocalSource
        The surface.
    spacing : float
        Of the lattice.
    by_edge_numbers : bool
        Whether the source says which feet lie on rims; else queries on both sides of the surface decide.
    """

    source: LocalSource
    spacing: float
    by_edge_numbers: bool

    def beyond(self, points: Floats, outward: Floats, across: Floats, reach: Floats) -> tuple[Floats, Bools]:
        """Return the feet (n, 3) of points pushed ``outward`` by ``reach`` (n,) and whether these lie on a rim near by.

        ``across`` (n, 3) are unit normals of the surface.
        """
        answer = self.source.closest_point(points + reach[:, None] * outward)
        feet = answer.points
        near = norms(feet - points) <= RIM_DISTANCE * self.spacing
        if self.by_edge_numbers:
            return feet, np.asarray(near & (answer.edge >= 0))
        stays = near & (dots(feet - points, outward) < (1 - 0.25 * RIM_STAYS) * reach)
        for side in (-ACROSS, ACROSS):
            rows = np.flatnonzero(stays)
            moved = self._moved(points[rows], outward[rows] + side * across[rows], reach[rows], feet[rows])
            stays[rows] = moved <= RIM_STAYS
        for side in (-1.0, 1.0):
            rows = np.flatnonzero(stays)
            back, way = -outward[rows], np.full(len(rows), INWARD_REACH * self.spacing)
            flat_foot = feet[rows] + way[:, None] * back
            moved = self._moved(feet[rows], back + side * across[rows], way, flat_foot)
            stays[rows] = moved <= INWARD_MOVES
        return feet, stays

    def _moved(self, points: Floats, direction: Floats, reach: Floats, expected: Floats) -> Floats:
        """Return how far the feet of pushed points are from those expected, as shares of the way."""
        feet = self.source.closest_point(points + reach[:, None] * direction).points
        return norms(feet - expected) / reach

    def of_border(self, vertices: Floats, border: Border) -> Bools:
        """Return which edges of ``border`` (b,) lie beside a rim."""
        yes = np.zeros(len(border.edge), dtype=bool)
        across = border.across(vertices)
        for reach in BORDER_REACHES:
            rows = np.flatnonzero(~yes)
            if len(rows):
                way = np.full(len(rows), reach * self.spacing)
                yes[rows] = self.beyond(border.middles[rows], border.conormals[rows], across[rows], way)[1]
        return yes
