"""Surface points as one boundary sees them: how far, and on which side.

For a surface point z and a boundary C: y = cp_S(cp_C(z)), snapped to the surface, n its normal at y, t the direction of
travel of C at y, v = n x t, which points to the left; in an area of the plane n is the third axis, and in a
solid in space v is the normal of the surface C. The side of a point is decided here once, as the
director D, and used everywhere: two points are on opposite sides where D_i . D_j < 0. D is (z - y) . v
times one fixed vector, or times n, which is local and does not see the sign of n, where that comes back reversed.
King et al. (2024): z - y is eq. 10 (there y is cp_C(x)), (z - y) . v is eq. 11, ((z - y) . v) v is eq. 17.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cpmkit.forms.collocation.sheets.boundary_on_sheets import NEAR_BOUNDARY_SPACINGS, BoundaryOnSheets, SurfacePoints
from cpmkit.forms.collocation.sheets.sheets import Sheets
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.protocols import Bools, ClosestPoints, Floats, Ints, Rows
from cpmkit.scene.oriented import OrientedBoundary

#: A point nearer to the boundary than this many spacings counts as left of it.
#: (Differs from King et al. (2024), section 4.2: 0.1 spacing^2, on either side.)
ON_BOUNDARY_SPACINGS = 1e-9
#: Blocks of this many spacings are asked before the points in them are.
BLOCK_SPACINGS = 4
#: Where several sheets share a band: if the chord from a boundary points to neither side by more than this (cosine),
#: the way along the surface tells which one it is; if that does not either, points farther than
#: ``NEAR_BOUNDARY_SPACINGS`` have none.
UNCLEAR_SIDE_COSINE = 0.5
#: The direction of a director whose sign alone counts.
SIGN_DIRECTION = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class SideView(Rows):
    """Some of a batch of surface points, as one boundary sees them.

    Attributes
    ----------
    rows : (k,) int64
        Which points of the batch these are, ascending.
    foot : (k, d) float64
        y, the closest point on the boundary, snapped to the manifold.
    end : (k,) bool
        True where y is an end of an open curve inside the manifold, not one on its rim.
    distance : (k,) float64
        ``|z - y|``.
    signed : (k,) float64
        ``(z - y) . v``, positive on the left; NaN where the boundary has no sides.
    conormal : (k, d) float64
        v, the one that points to the left; zero where the boundary has no sides.
    director : (k, d) float64
        D; zero where nothing is crossed.
    """

    rows: Ints
    foot: Floats
    end: Bools
    distance: Floats
    signed: Floats
    conormal: Floats
    director: Floats

    def reversed(self) -> SideView:
        """Return the same as seen from the opposite side."""
        return replace(self, director=-self.director, signed=-self.signed)


def stack(side_views: Sequence[tuple[int, SideView]]) -> SideView:
    """Return several as one, the rows of each moved up by the number beside it."""
    return SideView.join([replace(view, rows=view.rows + offset) for offset, view in side_views])


def near(source: LocalSource, points: Floats, radius: float, spacing: float) -> tuple[Ints, ClosestPoints]:
    """Return which of ``points`` (n, d) lie within ``radius`` of the source, and their closest points.

    Points are asked in blocks first, and one by one only where the block is near enough.
    """
    side = BLOCK_SPACINGS * spacing
    blocks, member = np.unique(np.floor(points / side).astype(np.int64), axis=0, return_inverse=True)
    reach = radius + 0.5 * np.sqrt(source.dim) * side
    distance = source.closest_point(np.asarray((blocks + 0.5) * side, dtype=np.float64)).distance
    close = distance <= reach * (1 + ON_BOUNDARY_SPACINGS)
    rows = np.flatnonzero(close[member.ravel()])
    feet = source.closest_point(points[rows])
    kept = feet.distance <= radius
    return rows[kept], feet.take(kept)


@dataclass(frozen=True, eq=False)
class BoundaryOnLattice:
    """An oriented boundary as a lattice sees it.

    Attributes
    ----------
    oriented : OrientedBoundary
        Where it lies and what tells its left, relative to the lattice's origin.
    gap : float
        How far the boundary is from the manifold at most, where it was sampled: by so much it is snapped.
    samples : (s, d) float64
        Points of the boundary, ``spacing`` apart or less.
    spacing : float
        Of the lattice.
    sheets : Sheets or None
        Where the manifold has several sheets in one band: the boundary is seen on its own alone.
    """

    oriented: OrientedBoundary
    gap: float
    samples: Floats
    spacing: float
    sheets: Sheets | None = None

    @property
    def source(self) -> LocalSource:
        """Where the boundary lies."""
        return self.oriented.source

    @property
    def surface(self) -> LocalSource:
        """The manifold it lies in."""
        return self.oriented.surface

    @property
    def has_sides(self) -> bool:
        """True where the boundary cuts the manifold in two locally."""
        return self.oriented.has_sides

    @cached_property
    def on_sheets(self) -> BoundaryOnSheets | None:
        """The boundary as each sheet sees it, where several share a band."""
        if self.sheets is None:
            return None
        samples = SurfacePoints.on(self.surface, self.samples, self.spacing)
        return BoundaryOnSheets(self.source, self.surface, samples, self.spacing, self.sheets.signed)

    def side_view(self, points: Floats, radius: float, spacing: float) -> SideView:
        """Return how the boundary sees those surface ``points`` (n, d) that lie within ``radius`` of it.

        Where several sheets share a band, it sees those alone on whose sheet it runs, from its nearest part there.
        """
        rows, feet = near(self.source, points, radius + self.gap, spacing)
        way = None
        if self.on_sheets is not None and len(rows):
            feet, way, own = self.on_sheets.relative_to(points[rows], feet, radius + self.gap)
            rows, feet, way = rows[own], feet.take(own), way[own]
        on = self.surface.closest_point(feet.points)
        away = points[rows] - on.points
        distance = np.linalg.norm(away, axis=1)
        if not self.has_sides:
            director = self._from_point(on, away, spacing)
            nowhere = np.zeros(len(rows), dtype=bool)
            unsigned = np.full(len(rows), np.nan)
            return SideView(rows, on.points, nowhere, distance, unsigned, 0 * away, director)
        axis, left = self.oriented.axis_and_left(feet, on, 0.5 * spacing)
        signed = np.sum(away * left, axis=1)
        if way is not None:
            signed = np.where(np.abs(signed) < UNCLEAR_SIDE_COSINE * distance, np.sum(way * left, axis=1), signed)
        signed = np.where(np.abs(signed) < ON_BOUNDARY_SPACINGS * spacing, ON_BOUNDARY_SPACINGS * spacing, signed)
        director = signed[:, None] * self._director_axis(axis, left)
        end = self.oriented.open_ends(feet, on, 0.5 * spacing)
        view = SideView(rows, on.points, end, distance, signed, left, director)
        if way is None:
            return view
        clear = np.abs(signed) >= UNCLEAR_SIDE_COSINE * distance
        return view.take(clear | (distance <= NEAR_BOUNDARY_SPACINGS * spacing))

    def _from_point(self, on_surface: ClosestPoints, away: Floats, spacing: float) -> Floats:
        """Return directors T (z - y), seen from a point on a surface.

        King et al. (2024), section 4.5 and eq. 17 without the tangent.
        A foot on the point itself gets a tiny director along one tangent, chosen once, so that stencils
        see the point there too. (Differs from "zero means no crossing": on a lattice with a node above the
        point, a whole line of nodes then has its foot there and none of them would feel the condition; a pin
        of 1 at the pole of a sphere, a ring of 0.1 elsewhere, read 0.06 at spacing 0.05 instead of 0.9.)
        """
        director = project_tangent(self.surface, on_surface, away, 0.5 * spacing)
        touching = np.linalg.norm(director, axis=1) < ON_BOUNDARY_SPACINGS * spacing
        for axis in np.eye(self.surface.dim):
            axes = np.tile(axis, (touching.sum(), 1))
            tangent = project_tangent(self.surface, on_surface.take(touching), axes, 0.5 * spacing)
            longer = np.linalg.norm(tangent, axis=1) > 0.5
            director[np.flatnonzero(touching)[longer]] = ON_BOUNDARY_SPACINGS * spacing * tangent[longer]
        return director

    def _director_axis(self, axis: Floats, left: Floats) -> Floats:
        """Return the vectors, (d,) or (n, d), whose multiples by (z - y) . v are the directors.

        Where signs agree all along the boundary, the sign of (z - y) . v is the director, times one vector for all
        points. Differs from King et al. (2024), section 4.2, and from D = ((z - y) . v) n, which compare vectors at two
        points: where the normals there differ by more than a right angle (a tube two spacings thick, a steep ridge
        under a curve, a bare sphere at a spacing of a fifth of its radius) points of one side seem to face each other,
        and values bleed across the curve. Where the normal comes back reversed, that is D; where the direction of
        travel does, D = ((z - y) . v) v, which sees the sign of neither.
        """
        if self.oriented.left.known:
            return SIGN_DIRECTION[: self.surface.dim]
        return axis if self.oriented.left.has_direction else left
