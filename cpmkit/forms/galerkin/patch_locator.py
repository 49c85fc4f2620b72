"""Through which patch a point of the manifold is read: that of the nearest sample on its own sheet and side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.quadrature.samples import QuantisedSamples, Samples
from cpmkit.forms.galerkin.sample_search import SampleSearch
from cpmkit.forms.galerkin.sheet_separation import SheetSeparation
from cpmkit.forms.galerkin.space.dof_map import DofMap
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.source import ClosestPoints
from cpmkit.mesh.adjacency import HalfFacets
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.types import Bools, Floats, Ints, Side

#: Sides are known so many spacings from a boundary: a point is compared with its nearest samples alone.
REACH_SPACINGS = 2.0


@dataclass(frozen=True, eq=False)
class CellSides:
    """Sides spread from the half facets of a boundary over the corners that cells share, never across it.

    Around an open end both sides meet: there a cell has the side that comes to it first, or none.

    Attributes
    ----------
    corners : (m, k) int64
        The vertices of the cells after cutting.
    places : (m, d) float64
        A point of each cell.
    spacing : float
        h, of the lattice.
    half : HalfFacets
        Facets on boundaries, seen from the cells beside them.
    owner : (n,) int64
        The number of the boundary that each lies on, -1 on rims and past tips.
    left : (n,) bool
        Whether each is on its boundary's left.
    """

    corners: Ints
    places: Floats
    spacing: float
    half: HalfFacets
    owner: Ints
    left: Bools

    def of_boundary(self, number: int) -> Ints:
        """Return the sides (m,) of all cells: 1 on the left of a boundary, -1 on its right, 0 where it is not told."""
        if number not in self._found:
            self._found[number] = self._spread(number)
        return self._found[number]

    @cached_property
    def _found(self) -> dict[int, Ints]:
        return {}

    def _spread(self, number: int) -> Ints:
        from scipy.spatial import cKDTree

        cells, rows = np.zeros(len(self.corners), dtype=np.int64), np.flatnonzero(self.owner == number)
        if not len(rows):
            return cells
        reach, k = REACH_SPACINGS * self.spacing, self.corners.shape[1]
        beside = cKDTree(self.places[self.half.cell[rows]])
        near = np.flatnonzero(np.isfinite(beside.query(self.places, distance_upper_bound=reach)[0]))
        sign = np.where(self.left[rows], 1, -1)
        corner = np.zeros(int(self.corners.max()) + 1, dtype=np.int64)
        ends = (self.half.facet[rows, None] + np.arange(1, k)) % k
        np.add.at(corner, self.corners[self.half.cell[rows, None], ends], sign[:, None])
        corner = np.sign(corner)
        cells[self.half.cell[rows]] = sign
        corners, known = self.corners[near], -1
        while known < (count := int(np.count_nonzero(cells))):
            known = count
            cells[near] = np.where(cells[near] == 0, np.sign(corner[corners].sum(axis=1)), cells[near])
            reached = np.zeros(len(corner), dtype=np.int64)
            np.add.at(reached, corners, cells[near, None])
            corner = np.where(corner == 0, np.sign(reached), corner)
        return cells


#: So many of the nearest samples are compared; more, where all of these lie across a boundary.
NEIGHBOURS = (12, 96, 768)
#: And so many, where patches that do not touch are among them: on the cells of these sheets are told apart.
NEIGHBOURS_ON_SHEETS = 48
#: Such points are looked at so many at a time.
SHEETS_AT_ONCE = 1 << 14
#: A sample whose tangent plane a point is off counts as this much farther away: it may lie on another sheet.
HEIGHT_FACTOR = 10.0
#: Points nearer to a boundary than this many spacings are read from the side that the caller names: its points and
#: their feet on the manifold are apart by up to 1e-6. Where no side is named, the left is that of points on it alone.
READ_FROM_SIDE_SPACINGS, ON_BOUNDARY_SPACINGS = 1e-3, 1e-9
#: Samples on boundaries lie nearer to any point of these than so many spacings.
ON_BOUNDARIES_SPACINGS = 0.15
#: Step of differences, where a boundary's sources give no directions of their own, in spacings.
DIFFERENCE_SPACINGS = 0.5


@dataclass(frozen=True, eq=False)
class PatchLocator:
    """The samples of the manifold, by which points find their patches.

    Attributes
    ----------
    lattice : Lattice
    samples : Samples or FixedSamples
        Those on boundaries included.
    dof_map : Parting
        Of these samples.
    sides : SidesOfCells
        On which sides of boundaries the cells beside them lie.
    boundaries : sequence of OrientedBoundary
        By their numbers.
    sheets : OwnSheets
        What tells sheets apart that lie beside one another.
    """

    lattice: Lattice
    samples: Samples | QuantisedSamples
    dof_map: DofMap
    sides: CellSides
    boundaries: Sequence[OrientedBoundary]
    sheets: SheetSeparation

    def patches(self, feet: ClosestPoints, wanted: Mapping[int, Side]) -> tuple[Ints, Ints]:
        """Return the patches (k,) that read the manifold at ``feet`` (k,), and the samples (k,) that led there.

        Of two values on boundary number b, that on the side ``wanted[b]``, on the left where none is named.
        """
        points = feet.points
        patch, nearest = (np.empty(len(points), dtype=np.int64) for _ in range(2))
        parted = np.zeros(len(points), dtype=bool)
        rows = np.arange(len(points))
        for count in NEIGHBOURS:
            distance, near = self._nearest.of(points[rows], min(count, len(self.samples)))
            apart, shut = self._apart(points[rows], near, distance, wanted)
            first = near[np.arange(len(rows)), apart.argmin(axis=1)]
            patch[rows], beside = self._read_through(points[rows], near, apart, first)
            parted[rows] = beside & ~shut if count == NEIGHBOURS[0] else False  # the few nearest ones do for these
            nearest[rows], rows = first, rows[shut]
            if not len(rows):
                break
        rows = np.flatnonzero(parted)
        if self.sheets.known:
            for start in range(0, len(rows), SHEETS_AT_ONCE):
                some = rows[start : start + SHEETS_AT_ONCE]
                patch[some], nearest[some] = self._on_own_sheet(feet.take(some), wanted)
        return patch, nearest

    def _read_through(self, points: Floats, near: Ints, apart: Floats, first: Ints) -> tuple[Ints, Bools]:
        """Return the patches (k,) to read ``points`` through whose nearest sample of ``near`` (k, q) is ``first`` (k,).

        And beside which points there are samples of patches that do not touch the nearest one's.
        """
        patch, found = self.dof_map.patch[first], self.dof_map.patch[near]
        touch = (found == patch[:, None]) | self._touch(found, patch[:, None])
        joined = touch & np.isfinite(apart)
        return self._own_cell(points, found, np.where(joined, apart, np.inf), patch), ~touch.all(axis=1)

    def _on_own_sheet(self, feet: ClosestPoints, wanted: Mapping[int, Side]) -> tuple[Ints, Ints]:
        """Return the same as :meth:`patches`, of feet beside several sheets."""
        from cpmkit.forms.galerkin.locator_kernels import grouped

        points, rows = feet.points, np.arange(len(feet.points))
        distance, near = self._nearest.of(points, min(NEIGHBOURS_ON_SHEETS, len(self.samples)))
        apart, _ = self._apart(points, near, distance, wanted)
        patches = np.asarray(self.dof_map.patch[near], dtype=np.int64)
        group = np.where(np.isfinite(apart), grouped(patches, self._pairs, len(self.dof_map.cells)), -1)
        own = group[rows, apart.argmin(axis=1)][:, None]
        several = np.flatnonzero(((group != own) & (group >= 0)).any(axis=1))
        group, own = group[several], own[several]
        element = None if feet.element is None else feet.element[several]
        cells = self.samples.cell_at(near[several])
        scores, least = self.sheets.scores(points[several], element, cells, group)
        nearer = scores.min(axis=1) < np.where(group == own, scores, np.inf).min(axis=1) - least
        chosen = np.where(nearer[:, None], np.take_along_axis(group, scores.argmin(axis=1)[:, None], axis=1), own)
        apart[several] = np.where(group == chosen, apart[several], np.inf)
        first = near[rows, apart.argmin(axis=1)]
        return self._read_through(points, near, apart, first)[0], first

    def _apart(self, points: Floats, near: Ints, distance: Floats, wanted: Mapping[int, Side]) -> tuple[Floats, Bools]:
        """Return how far the samples ``near`` (k, q) count from their point, squared, infinite across a boundary.

        And the points (k,) for which a boundary would shut out all that others leave: there it shuts out none.
        """
        off = points[:, None] - self.samples.points_at(near)
        height = np.einsum("kqcd,kqd->kqc", self.samples.normals_at(near), off)
        apart = distance**2 + HEIGHT_FACTOR**2 * (height**2).sum(axis=2)
        shut = np.zeros(len(points), dtype=bool)
        if not self.boundaries or not len(points):
            return apart, shut
        reach = distance[:, -1] + ON_BOUNDARIES_SPACINGS * self.lattice.spacing
        beside = self._to_boundaries(points, float(reach.max())) < reach
        for number in range(len(self.boundaries)):
            across = self._across(number, points, near, beside, wanted.get(number))
            none = np.min(np.where(across, np.inf, apart), axis=1) == np.inf
            apart[across & ~none[:, None]] = np.inf
            shut |= none
        return apart, shut

    def _across(self, number: int, points: Floats, near: Ints, beside: Bools, side: Side | None) -> Bools:
        """Return which of the samples ``near`` (k, q) lie across boundary ``number`` from their point.

        Asked where both of its sides are among them, and of points ``beside`` (k,) a boundary.
        """
        signs = self.sides.of_boundary(number)[self.samples.cell_at(near)]
        across = np.zeros(near.shape, dtype=bool)
        first, second = np.any(signs > 0, axis=1), np.any(signs < 0, axis=1)
        rows = np.flatnonzero(np.where(beside, first | second, first & second))
        if len(rows):
            signed = self.signed_distance(number, points[rows])
            within = ON_BOUNDARY_SPACINGS if side is None else READ_FROM_SIDE_SPACINGS
            signed[np.abs(signed) < within * self.lattice.spacing] = -1.0 if side == "right" else 1.0
            across[rows] = signs[rows] * np.nan_to_num(signed)[:, None] < 0
        return across

    def signed_distance(self, number: int, points: Floats) -> Floats:
        """Return how far (k,) points of the manifold are from a boundary, positive on its left, NaN past its ends."""
        oriented = self.boundaries[number]
        at = self.lattice.to_scene(points) - oriented.left.origin
        return oriented.signed_distance(at, DIFFERENCE_SPACINGS * self.lattice.spacing)

    def _own_cell(self, points: Floats, found: Ints, apart: Floats, patch: Ints) -> Ints:
        """Return, in place of each ``patch`` (k,), the nearest of ``found`` (k, q) that has the point in its cell.

        Of those that are ``apart`` by a finite distance.
        """
        own = np.floor(points / self.lattice.spacing + 0.5).astype(np.int64)
        fits = (self.dof_map.cells[found] == own[:, None]).all(axis=2) & np.isfinite(apart)
        best = np.where(fits, apart, np.inf).argmin(axis=1)
        rows = np.arange(len(points))
        return np.where(fits[rows, best], found[rows, best], patch)

    def _touch(self, first: Ints, second: Ints) -> Bools:
        """Tell which pairs of patches have samples that touch."""
        count = len(self.dof_map.cells)
        target = np.minimum(first, second).astype(np.int64) * count + np.maximum(first, second)
        if not len(self._pairs):
            return np.zeros(target.shape, dtype=bool)
        place = np.minimum(np.searchsorted(self._pairs, target), len(self._pairs) - 1)
        return np.asarray(self._pairs[place] == target)

    @cached_property
    def _pairs(self) -> Ints:
        pairs = np.sort(self.dof_map.touching, axis=1).astype(np.int64)
        return np.sort(pairs[:, 0] * len(self.dof_map.cells) + pairs[:, 1])

    def _to_boundaries(self, points: Floats, reach: float) -> Floats:
        """Return how far (k,) points are from the nearest sample on a boundary, infinite beyond ``reach``."""
        return np.asarray(self._boundary_tree.query(points, distance_upper_bound=reach)[0])

    @cached_property
    def _boundary_tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.samples.points_at(np.flatnonzero(self.samples.weights == 0)))

    @cached_property
    def _nearest(self) -> SampleSearch:
        return SampleSearch(self.dof_map, self.samples)
