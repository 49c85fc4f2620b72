"""Boundaries on a lattice: the distances of surface points from a boundary, and on which of its sides they are.

For a surface point z and a boundary C: y = cp_S(cp_C(z)), snapped to the surface, n its normal at y, t the direction of
travel of C at y, v = n x t, which points to the left; in an area of the plane n is the third axis, and in a solid in
space v is the normal of the surface C. The side of a point is represented by its director D: two points are on opposite
sides if D_i . D_j < 0. D is (z - y) . v times one fixed vector, or times v (so that the sign of v does not matter)
where the surface is not orientable along C.
King et al. (2024): z - y is eq. 10 (there y is cp_C(x)), (z - y) . v is eq. 11, ((z - y) . v) v is eq. 17.
In its section 4, C is a part of S; here C may be off S by its ``gap``, and is snapped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from cpmkit.errors import SceneError
from cpmkit.forms.collocation.band_sheets import NEAR_BOUNDARY_SPACINGS, BoundaryOnSheets, Sheets, SurfacePoints
from cpmkit.grid.band import surface_cells
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource, localize
from cpmkit.manifold.source import ClosestPoints, Rows
from cpmkit.manifold.tangent_space import project_tangent
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.data import Data
from cpmkit.scene.oriented import OrientedBoundary, dimension_along
from cpmkit.types import Bools, Floats, Ints

#: A point nearer to the boundary than this many spacings counts as left of it.
#: (Differs from King et al. (2024), section 4.2: 0.1 spacing^2, on either side.)
ON_BOUNDARY_SPACINGS = 1e-9
#: Closest points of the centres of blocks of this many spacings are computed before those of the points in the blocks.
BLOCK_SPACINGS = 4
#: Where several sheets share a band: if the chord from a boundary points to neither side with a cosine above this, a
#: walk along the surface decides; if the walk does not, points farther than ``NEAR_BOUNDARY_SPACINGS`` have no side.
UNCLEAR_SIDE_COSINE = 0.5
#: Cosine of the angle up to which two boundaries run side by side.
ALONGSIDE_COSINE = 0.9
#: Boundaries nearer than this many spacings enclose a strip too narrow for a stencil. They are at the same place if
#: nearer than the second number; curves are compared at so many points.
STRIP_SPACINGS, SAME_PLACE_SPACINGS, SAME_PLACE_SAMPLES = 1.0, 1e-3, 3


@dataclass(frozen=True, eq=False)
class SideView(Rows):
    """The distances and sides of surface points that are near one boundary, as rows of a batch of points."""

    rows: Ints  #: (k,): numbers of the points in the batch, ascending.
    foot: Floats  #: (k, d): y, the closest point on the boundary, snapped to the manifold.
    end: Bools  #: (k,): whether y is an end of an open curve inside the manifold, not on its rim.
    distance: Floats  #: (k,): ``|z - y|``.
    signed: Floats  #: (k,): ``(z - y) . v``, positive on the left; NaN where the boundary has no sides.
    conormal: Floats  #: (k, d): v, the conormal that points to the left; zero where the boundary has no sides.
    #: (k, d): the directors D: those of points on opposite sides have a negative product; zero without sides.
    director: Floats


def find_near_points(source: LocalSource, points: Floats, radius: float, spacing: float) -> tuple[Ints, ClosestPoints]:
    """Return the numbers (k,) of ``points`` (n, d) within ``radius`` of a boundary, and the k closest points on it.

    Only points in blocks, of four ``spacing`` a side, whose centres are near enough are queried.
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
    """An oriented boundary, snapped to the manifold, which decides on which side points are."""

    oriented: OrientedBoundary  #: The boundary with the definition of its left, relative to the lattice's origin.
    gap: float  #: Largest distance of the boundary's samples from the manifold, by which it is moved at most.
    samples: Floats  #: (s, d): points of the boundary, ``spacing`` apart or less.
    spacing: float  #: Spacing of the lattice.
    #: Given where the manifold has several sheets in one band: a point then sees only the boundary on its own sheet.
    sheets: Sheets | None = None

    @property
    def source(self) -> LocalSource:
        """The source of the boundary."""
        return self.oriented.source

    @property
    def surface(self) -> LocalSource:
        """The manifold that the boundary is on."""
        return self.oriented.surface

    @property
    def has_sides(self) -> bool:
        """Whether the boundary cuts the manifold in two locally."""
        return self.oriented.has_sides

    @cached_property
    def on_sheets(self) -> BoundaryOnSheets | None:
        """The boundary with its samples on each sheet, where several share a band; otherwise None."""
        if self.sheets is None:
            return None
        samples = SurfacePoints.project(self.surface, self.samples, self.spacing)
        return BoundaryOnSheets(self.source, self.surface, samples, self.spacing, self.sheets.signed)

    def side_view(self, points: Floats, radius: float, spacing: float) -> SideView:
        """Return the distances and sides of those ``points`` (n, d) of the surface within ``radius`` of the boundary.

        Points up to twice the gap farther may be included. If several sheets share a band, only points with a part of
        the boundary on their own sheet and a clear side are included; the nearest such part counts. Normals and
        tangents that the sources do not provide are differences over half of ``spacing``.
        """
        rows, feet = find_near_points(self.source, points, radius + self.gap, spacing)
        walked = None
        if self.on_sheets is not None and len(rows):
            feet, walked, on_sheet = self.on_sheets.find_feet(points[rows], feet, radius + self.gap)
            rows, feet, walked = rows[on_sheet], feet.take(on_sheet), walked[on_sheet]
        on = self.surface.closest_point(feet.points)
        offset = points[rows] - on.points
        distance = norms(offset)
        if not self.has_sides:
            director = self._point_directors(on, offset, spacing)
            unsigned = np.full(len(rows), np.nan)
            return SideView(rows, on.points, np.zeros(len(rows), dtype=bool), distance, unsigned, 0 * offset, director)
        left = self.oriented.leftward(feet, on, 0.5 * spacing)
        signed = dots(offset, left)
        if walked is not None:
            unclear = np.abs(signed) < UNCLEAR_SIDE_COSINE * distance
            signed = np.where(unclear, dots(walked, left), signed)
        signed = np.where(np.abs(signed) < ON_BOUNDARY_SPACINGS * spacing, ON_BOUNDARY_SPACINGS * spacing, signed)
        # Where left is known by sign all along the boundary, D is one vector for all points times (z - y) . v, so that
        # only its sign counts. King et al. (2024), section 4.2, compare vectors at two points: where the normals there
        # differ by more than a right angle, values leak across the curve. D = ((z - y) . v) v where v changes sign.
        director = signed[:, None] * (np.eye(self.surface.dim)[0] if self.oriented.left.known else left)
        end = self.oriented.open_ends(feet, on, 0.5 * spacing)
        view = SideView(rows, on.points, end, distance, signed, left, director)
        if walked is None:
            return view
        clear = np.abs(signed) >= UNCLEAR_SIDE_COSINE * distance
        return view.take(clear | (distance <= NEAR_BOUNDARY_SPACINGS * spacing))

    def _point_directors(self, on_surface: ClosestPoints, offset: Floats, spacing: float) -> Floats:
        """Return the directors T (z - y) (n, d) of a boundary that is a point y, T the tangential projection at y.

        ``offset`` (n, d) are z - y, ``on_surface`` the records of y. Where z is y, the director is a tiny vector along
        a fixed tangent, from differences over half of ``spacing``: stencils cross the point there too, as a line of
        nodes may have this closest point. King et al. (2024), section 4.5 and eq. 17 without the tangent.
        """
        director = project_tangent(self.surface, on_surface, offset, 0.5 * spacing)
        touching = norms(director) < ON_BOUNDARY_SPACINGS * spacing
        for axis in np.eye(self.surface.dim):
            axes = np.tile(axis, (touching.sum(), 1))
            tangent = project_tangent(self.surface, on_surface.take(touching), axes, 0.5 * spacing)
            longer = norms(tangent) > 0.5
            director[np.flatnonzero(touching)[longer]] = ON_BOUNDARY_SPACINGS * spacing * tangent[longer]
        return director


@dataclass(frozen=True, eq=False)
class BoundariesOnBand:
    """All boundaries of a scene, with the distances and sides of the band's nodes."""

    definitions: Sequence[Boundary]  #: Their names and conditions, as the scene gives them.
    on_lattice: Sequence[BoundaryOnLattice]  #: The boundaries on the lattice.
    side_views: Sequence[SideView]  #: For each boundary, the distances and sides of the band's nodes near it.
    #: (k,): the nodes past an edge that read their closest points, as a boundary separates them from mirror points.
    behind: Ints
    diffusivity: Data = 1.0  #: The diffusivity of the problem.


@dataclass(frozen=True, eq=False)
class ParallelPair:
    """Two boundaries that run side by side, less than a spacing apart, or that lie at the same place."""

    numbers: tuple[int, int]  #: Numbers of the boundaries.
    point: Floats  #: (d,): the place where they are nearest, relative to the lattice's origin.
    width: float  #: Their distance there.
    same_place: bool  #: Whether they lie at the same place.
    reversed: bool  #: Whether the left of the first boundary is the right of the second.


def find_parallel_pairs(boundaries: BoundariesOnBand, spacing: float) -> list[ParallelPair]:
    """Return the pairs of boundaries with sides that run side by side, less than a ``spacing`` apart."""
    with_sides, pairs = [number for number, each in enumerate(boundaries.on_lattice) if each.has_sides], []
    for first, second in combinations(with_sides, 2):
        view = boundaries.side_views[first]
        cells = np.floor(view.foot / (0.5 * spacing)).astype(np.int64)  # one point for each cell
        view = view.take(np.sort(np.unique(cells, axis=0, return_index=True)[1]))
        seen = boundaries.on_lattice[second].side_view(view.foot, STRIP_SPACINGS * spacing, spacing)
        along = dots(view.conormal[seen.rows], seen.conormal)
        beside = (np.abs(along) > ALONGSIDE_COSINE) & ~seen.end & ~view.end[seen.rows]
        rows = np.flatnonzero(beside & (seen.distance < STRIP_SPACINGS * spacing))
        if len(rows):
            nearest = rows[seen.distance[rows].argmin()]
            same = np.count_nonzero(seen.distance[rows] < SAME_PLACE_SPACINGS * spacing)
            same_place = bool(same >= min(SAME_PLACE_SAMPLES, len(view.rows)))
            point, width = view.foot[seen.rows[nearest]], float(seen.distance[nearest])
            pairs.append(ParallelPair((first, second), point, width, same_place, bool(along[nearest] < 0)))
    return pairs


def put_on_lattice(
    boundary: Boundary,
    surface: LocalSource,
    lattice: Lattice,
    radius: float,
    oriented: Callable[[Boundary], OrientedBoundary],
    sheets: Sheets | None = None,
) -> BoundaryOnLattice:
    """Return ``boundary`` on the lattice, snapped to the surface and oriented.

    Raises SceneError if the boundary is of the wrong dimension or space, too far from the surface, or has no sides
    where the scene needs them.

    ``boundary``: points, a curve or a surface, of lower dimension than the manifold.
    ``surface``: the manifold.
    ``lattice``: origin and spacing.
    ``radius``: largest distance of the boundary from the surface: the radius of the tube.
    ``oriented``: :meth:`cpmkit.Scene.oriented`, which returns a boundary's orientation and caches it; called last.
    ``sheets``: given where the manifold has several sheets in one band.
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
