"""Boundaries on a lattice: how far surface points are from a boundary, and on which side of it.

For a surface point z and a boundary C: y = cp_S(cp_C(z)), snapped to the surface, n its normal at y, t the direction of
travel of C at y, v = n x t, which points to the left; in an area of the plane n is the third axis, and in a
solid in space v is the normal of the surface C. The side of a point is decided here once, as the
director D, and used everywhere: two points are on opposite sides where D_i . D_j < 0. D is (z - y) . v
times one fixed vector, or times n, which is local and does not see the sign of n, where that comes back reversed.
King et al. (2024): z - y is eq. 10 (there y is cp_C(x)), (z - y) . v is eq. 11, ((z - y) . v) v is eq. 17.
In its section 4, C lies in S; here C may be off it by its ``gap``, and is snapped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.collocation.sheets.sheets import NEAR_BOUNDARY_SPACINGS, BoundaryOnSheets, Sheets, SurfacePoints
from cpmkit.grid.band import surface_cells
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.source import ClosestPoints, Rows
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.scene.boundary import BoundarySet
from cpmkit.scene.data import Data
from cpmkit.scene.oriented import OrientedBoundary, dimension_along
from cpmkit.types import Bools, Floats, Ints

#: A point nearer to the boundary than this many spacings counts as left of it.
#: (Differs from King et al. (2024), section 4.2: 0.1 spacing^2, on either side.)
ON_BOUNDARY_SPACINGS = 1e-9
#: Closest points are looked for in blocks of this many spacings before the points in them are.
BLOCK_SPACINGS = 4
#: Where several sheets share a band: if the chord from a boundary points to neither side by more than this (cosine),
#: the walk along the surface decides; if that does not either, points farther than ``NEAR_BOUNDARY_SPACINGS`` have no
#: side.
UNCLEAR_SIDE_COSINE = 0.5


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


def points_near(source: LocalSource, points: Floats, radius: float, spacing: float) -> tuple[Ints, ClosestPoints]:
    """Return which of ``points`` (n, d) lie within ``radius`` of the source, and their closest points.

    Closest points of blocks are found first, and those of single points only where the block is near enough.
    """
    side = BLOCK_SPACINGS * spacing
    blocks, member = np.unique(np.floor(points / side).astype(np.int64), axis=0, return_inverse=True)
    reach = radius + 0.5 * np.sqrt(source.dim) * side
    distance = source.closest_point(np.asarray((blocks + 0.5) * side, dtype=np.float64)).distance
    is_near = distance <= reach * (1 + ON_BOUNDARY_SPACINGS)
    rows = np.flatnonzero(is_near[member.ravel()])
    feet = source.closest_point(points[rows])
    within = feet.distance <= radius
    return rows[within], feet.take(within)


@dataclass(frozen=True, eq=False)
class BoundaryOnLattice:
    """An oriented boundary as a lattice sees it.

    Attributes
    ----------
    oriented : OrientedBoundary
        Where it lies and what defines its left, relative to the lattice's origin.
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
        rows, feet = points_near(self.source, points, radius + self.gap, spacing)
        walked = None
        if self.on_sheets is not None and len(rows):
            feet, walked, on_sheet = self.on_sheets.relative_to(points[rows], feet, radius + self.gap)
            rows, feet, walked = rows[on_sheet], feet.take(on_sheet), walked[on_sheet]
        on = self.surface.closest_point(feet.points)
        offset = points[rows] - on.points
        distance = np.linalg.norm(offset, axis=1)
        if not self.has_sides:
            director = self._from_point(on, offset, spacing)
            unsigned = np.full(len(rows), np.nan)
            return SideView(rows, on.points, np.zeros(len(rows), dtype=bool), distance, unsigned, 0 * offset, director)
        axis, left = self.oriented.axis_and_left(feet, on, 0.5 * spacing)
        signed = np.sum(offset * left, axis=1)
        if walked is not None:
            unclear = np.abs(signed) < UNCLEAR_SIDE_COSINE * distance
            signed = np.where(unclear, np.sum(walked * left, axis=1), signed)
        signed = np.where(np.abs(signed) < ON_BOUNDARY_SPACINGS * spacing, ON_BOUNDARY_SPACINGS * spacing, signed)
        director = signed[:, None] * self._director_axis(axis, left)
        end = self.oriented.open_ends(feet, on, 0.5 * spacing)
        view = SideView(rows, on.points, end, distance, signed, left, director)
        if walked is None:
            return view
        clear = np.abs(signed) >= UNCLEAR_SIDE_COSINE * distance
        return view.take(clear | (distance <= NEAR_BOUNDARY_SPACINGS * spacing))

    def _from_point(self, on_surface: ClosestPoints, offset: Floats, spacing: float) -> Floats:
        """Return directors T (z - y), seen from a point on a surface.

        King et al. (2024), section 4.5 and eq. 17 without the tangent.
        A foot on the point itself gets a tiny director along one tangent, chosen once, so that stencils
        see the point there too. (Differs from "zero means no crossing": on a lattice with a node above the
        point, a whole line of nodes then has its foot there and none of them would feel the condition; a pin
        of 1 at the pole of a sphere, a ring of 0.1 elsewhere, read 0.06 at spacing 0.05 instead of 0.9.)
        """
        director = project_tangent(self.surface, on_surface, offset, 0.5 * spacing)
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
            return np.asarray(np.eye(self.surface.dim)[0], dtype=np.float64)
        return axis if self.oriented.left.has_direction else left


@dataclass(frozen=True, eq=False)
class BoundariesOnBand:
    """All boundaries of a scene, and how the band's nodes see them.

    Attributes
    ----------
    definitions : sequence of BoundarySet
        Their names and conditions, as the scene gives them.
    on_lattice : sequence of BoundaryOnLattice
        As the lattice sees them.
    side_views : sequence of SideView
        How the band's nodes see each boundary.
    behind : (k,) int64
        The nodes past an edge that read their feet, because their mirror points lie beyond a boundary.
    diffusivity : Data
        Of the problem.
    """

    definitions: Sequence[BoundarySet]
    on_lattice: Sequence[BoundaryOnLattice]
    side_views: Sequence[SideView]
    behind: Ints
    diffusivity: Data = 1.0


def put_on_lattice(
    boundary: BoundarySet,
    surface: LocalSource,
    lattice: Lattice,
    radius: float,
    oriented: Callable[[BoundarySet], OrientedBoundary],
    sheets: Sheets | None = None,
) -> BoundaryOnLattice:
    """Return ``boundary`` as the lattice sees it.

    Parameters
    ----------
    boundary : BoundarySet
        A point or curve of lower dimension than the surface.
    surface : LocalSource
        The manifold.
    lattice : Lattice
        Its origin and spacing.
    radius : float
        How far the boundary may be from the surface: the radius of the tube.
    oriented : callable
        Of a boundary: :meth:`cpmkit.Scene.oriented`, which caches its result. Called once the boundary lies well.
    sheets : Sheets, optional
        Where the manifold has several in one band.

    Raises
    ------
    SceneError
        If the boundary is of the wrong dimension, too far from the surface, or has no sides where the scene needs them.
    """
    source = localize(boundary.source, lattice.origin)
    if source.dim != surface.dim:
        raise SceneError(
            f"boundary {boundary.name!r} lies in {source.dim}D, the surface in {surface.dim}D; both must be the same."
        )
    cells = surface_cells(source, lattice.spacing, 3)
    samples = source.closest_point(np.asarray((cells + 0.5) * lattice.spacing, dtype=np.float64)).points
    on = surface.closest_point(samples)
    dimension_along(boundary.name, source, surface, surface.dimensions_at(on))
    gap = float(on.distance.max())
    if gap > radius:
        raise SceneError(
            f"boundary {boundary.name!r} is up to {gap:.3g} away from the surface, more than the tube's radius "
            f"{radius:.3g}; move it onto the surface, or check its unit of length."
        )
    placed = oriented(boundary).relative_to(lattice.origin, source, surface)
    surface.queries["points"] += placed.left.queries[0]
    source.queries["points"] += placed.left.queries[1]
    return BoundaryOnLattice(placed, gap, samples, lattice.spacing, sheets)
