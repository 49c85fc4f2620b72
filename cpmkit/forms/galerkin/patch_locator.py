"""The patch in which u is evaluated at a point: the patch of the nearest sample on the point's own sheet and side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_sides import signed_distances
from cpmkit.forms.galerkin.dof_map import DofMap
from cpmkit.forms.galerkin.sheet_separation import SheetSeparation, group_touching_patches
from cpmkit.forms.galerkin.space.quantised_samples import QuantisedSamples
from cpmkit.grid.lattice import Lattice, find_codes
from cpmkit.manifold.source import ClosestPoints
from cpmkit.manifold.vector_algebra import dots, every, nearest_barycentric, nearest_shares
from cpmkit.mesh.adjacency import CellSides
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.mesh.mesh import Mesh
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.types import Bools, Floats, Ints, Side

#: Numbers of nearest samples that are compared: the second if some patches of the first samples do not touch, so that
#: sheets must be separated; more if all samples lie across a boundary.
NEIGHBOURS = (12, 96, 768)
#: The factor of distances from the tangent plane of a sample: the point may lie on another sheet.
HEIGHT_FACTOR = 10.0
#: The factor of distances from the cell of a sample beside a tie: its sides may lie in one plane, or at an acute angle.
CELL_FACTOR = 100.0
#: Points nearer to a boundary than this, in spacings, are evaluated on the side that the caller names: points of a
#: boundary and their closest points on the manifold differ by up to 1e-6. Without a named side only points on the
#: boundary itself are evaluated on the left.
READ_FROM_SIDE_SPACINGS, ON_BOUNDARY_SPACINGS = 1e-3, 1e-9
#: Largest distance, in spacings, of a point on a boundary to the nearest sample on it.
ON_BOUNDARIES_SPACINGS = 0.15


@dataclass(frozen=True, eq=False)
class PatchLocator:
    """The search for the patch in which u is evaluated at a point, by the nearest samples."""

    lattice: Lattice
    samples: Samples | QuantisedSamples  #: Samples or QuantisedSamples: all samples, those on boundaries included.
    dof_map: DofMap  #: The dof map of these samples.
    sides: CellSides  #: The side of each boundary on which the cells beside it lie.
    boundaries: Sequence[OrientedBoundary]  #: The boundaries in the order of their numbers.
    #: Distinguishes sheets that lie close together, if the manifold was made from a mesh.
    sheets: SheetSeparation | None
    mesh: Mesh  #: The mesh of the samples.

    def patches(self, feet: ClosestPoints, side_of: Mapping[int, Side]) -> tuple[Ints, Ints]:
        """Return the patches (k,) that evaluate u at ``feet`` (k,), and the samples (k,) by which they were chosen.

        Feet are relative to the lattice's origin. Those on boundary b are evaluated on ``side_of[b]``, by default left.
        """
        points = feet.points
        patch, nearest = (np.empty(len(points), dtype=np.int64) for _ in range(2))
        has_other_sheets = np.zeros(len(points), dtype=bool)
        rows = np.arange(len(points))
        for count in NEIGHBOURS:
            distance, samples = self._nearest_samples(points[rows], count)
            scores, all_across = self._score_samples(points[rows], samples, distance, side_of)
            first = samples[np.arange(len(rows)), scores.argmin(axis=1)]
            patch[rows], other_sheets = self._choose_patch(points[rows], samples, scores, first)
            # Where the few nearest samples all lie across a boundary, sheets are not separated.
            has_other_sheets[rows] = other_sheets & ~all_across if count == NEIGHBOURS[0] else False
            nearest[rows], rows = first, rows[all_across]
            if not len(rows):
                break
        rows, element = np.flatnonzero(has_other_sheets), feet.element if self.sheets is not None else None
        if (element is not None or self._is_beside_tie.any()) and len(rows):
            for some in np.array_split(rows, len(rows) // 2**14 + 1):  # so that temporary arrays stay small
                of_some = None if element is None else element[some]
                patch[some], nearest[some] = self._on_own_sheet(points[some], of_some, side_of)
        return patch, nearest

    def _choose_patch(self, points: Floats, samples: Ints, scores: Floats, first: Ints) -> tuple[Ints, Bools]:
        """Return the patches (k,) for ``points``, and whether (k,) another sheet is near each point.

        The ``first`` sample (k,) of each point is that of its ``samples`` (k, q) with the least of the ``scores``
        (k, q). Candidates are the patches of samples with a finite score that are the first sample's patch or touch it.
        The result is the candidate with the least score whose lattice cell contains the point, else the first sample's
        patch. Another sheet is near if a sample's patch neither is nor touches the first sample's patch.
        """
        patch, candidates = self.dof_map.patch[first], self.dof_map.patch[samples]
        low, high = np.minimum(candidates, patch[:, None]), np.maximum(candidates, patch[:, None])
        codes = low.astype(np.int64) * len(self.dof_map.cells) + high
        touch = (low == high) | (find_codes(self._touching_codes, codes) >= 0)
        usable = np.where(touch & np.isfinite(scores), scores, np.inf)
        magnified = self.dof_map.magnify(candidates, points[:, None])
        cells = np.floor(magnified / self.lattice.spacing + 0.5).astype(np.int64)
        contains = every(self.dof_map.cells[candidates] == cells) & np.isfinite(usable)
        rows, best = np.arange(len(points)), np.where(contains, usable, np.inf).argmin(axis=1)
        return np.where(contains[rows, best], candidates[rows, best], patch), ~touch.all(axis=1)

    def _on_own_sheet(self, points: Floats, element: Ints | None, side_of: Mapping[int, Side]) -> tuple[Ints, Ints]:
        """Return patches and samples (k,) as :meth:`patches` does, for ``points`` (k, d) close to several sheets.

        ``element`` (k,) is the source's own triangle or segment that contains each point; None if the source has none.
        """
        rows = np.arange(len(points))
        distance, samples = self._nearest_samples(points, NEIGHBOURS[1])
        scores, _ = self._score_samples(points, samples, distance, side_of)
        if element is not None:
            self._exclude_farther_sheets(points, samples, scores, element)
        first = samples[rows, scores.argmin(axis=1)]
        return self._choose_patch(points, samples, scores, first)[0], first

    def _exclude_farther_sheets(self, points: Floats, samples: Ints, scores: Floats, element: Ints) -> None:
        """Set ``scores`` (k, q) of ``samples`` (k, q), in place, to infinity on sheets farther along the manifold.

        Paths along the manifold start in the source's cell ``element`` (k,) that contains each of ``points`` (k, d).
        """
        assert self.sheets is not None
        rows = np.arange(len(points))
        patches = np.asarray(self.dof_map.patch[samples], dtype=np.int64)
        touching = group_touching_patches(patches, self._touching_codes, len(self.dof_map.cells))
        group = np.where(np.isfinite(scores), touching, -1)
        best = group[rows, scores.argmin(axis=1)][:, None]
        several = np.flatnonzero(((group != best) & (group >= 0)).any(axis=1))
        group, best = group[several], best[several]
        cells = self.samples.cell_at(samples[several])
        lengths, margin = self.sheets.total_path_lengths(points[several], element[several], cells, group)
        nearer = lengths.min(axis=1) < np.where(group == best, lengths, np.inf).min(axis=1) - margin
        shortest = np.take_along_axis(group, lengths.argmin(axis=1)[:, None], axis=1)
        chosen = np.where(nearer[:, None], shortest, best)
        scores[several] = np.where(group == chosen, scores[several], np.inf)

    def _score_samples(
        self, points: Floats, samples: Ints, distance: Floats, side_of: Mapping[int, Side]
    ) -> tuple[Floats, Bools]:
        """Return scores (k, q), the less the better, of the ``samples`` (k, q) that are nearest to ``points`` (k, d).

        A score is the squared distance of point and sample, plus the weighted squares of the distances of the point
        from the sample's tangent plane and, beside a tie (a cut where u is continuous), from the sample's cell. Samples
        across a boundary have an infinite score, unless that leaves no sample of the point: such a boundary is ignored,
        and the second result (k,) is True. ``distance`` (k, q) is that of point and sample, ascending; for ``side_of``
        see :meth:`patches`.
        """
        off = points[:, None] - self.samples.points_at(samples)
        height = np.einsum("kqcd,kqd->kqc", self.samples.normals_at(samples), off)
        scores = distance**2 + HEIGHT_FACTOR**2 * (height**2).sum(axis=2)
        rows = np.flatnonzero(self._is_beside_tie[self.dof_map.patch[samples]].any(axis=1))
        if len(rows):
            corners = self.mesh.vertices[self.mesh.cells[self.samples.cell_at(samples[rows])]]
            scores[rows] += CELL_FACTOR**2 * _squared_distances_to_cells(points[rows], corners)
        all_across = np.zeros(len(points), dtype=bool)
        if not self.boundaries or not len(points):
            return scores, all_across
        reach = distance[:, -1] + ON_BOUNDARIES_SPACINGS * self.lattice.spacing
        near_boundary = self._boundary_tree.query(points, distance_upper_bound=float(reach.max()))[0] < reach
        for number in range(len(self.boundaries)):
            across = self._is_across(number, points, samples, near_boundary, side_of.get(number))
            none_left = np.min(np.where(across, np.inf, scores), axis=1) == np.inf
            scores[across & ~none_left[:, None]] = np.inf
            all_across |= none_left
        return scores, all_across

    def _is_across(self, number: int, points: Floats, samples: Ints, near_boundary: Bools, side: Side | None) -> Bools:
        """Return (k, q) whether each of the ``samples`` (k, q) lies across boundary ``number`` from its point (k, d).

        False unless some samples lie in cells on each side of the boundary; for a point ``near_boundary`` (k,), on one
        side. Points on the boundary count as on ``side``, by default left.
        """
        signs = self._sides_by_boundary[number][self.samples.cell_at(samples)]
        across = np.zeros(samples.shape, dtype=bool)
        first, second = np.any(signs > 0, axis=1), np.any(signs < 0, axis=1)
        rows = np.flatnonzero(np.where(near_boundary, first | second, first & second))
        if len(rows):
            signed = signed_distances(self.boundaries[number], points[rows], self.lattice)
            within = ON_BOUNDARY_SPACINGS if side is None else READ_FROM_SIDE_SPACINGS
            signed[np.abs(signed) < within * self.lattice.spacing] = -1.0 if side == "right" else 1.0
            across[rows] = signs[rows] * np.nan_to_num(signed)[:, None] < 0
        return across

    @cached_property
    def _sides_by_boundary(self) -> list[Ints]:
        """The sides (m,) of cells by :meth:`CellSides.of_boundary`, for each boundary."""
        return [self.sides.of_boundary(number) for number in range(len(self.boundaries))]

    @cached_property
    def _is_beside_tie(self) -> Bools:
        """(p,) whether a patch has samples at a tie."""
        beside = np.zeros(len(self.dof_map.cells), dtype=bool)
        beside[self.dof_map.tied] = True
        return beside

    @cached_property
    def _touching_codes(self) -> Ints:
        """(t,) codes first * count + second of pairs of patches that touch, first < second, ascending."""
        pairs = np.sort(self.dof_map.touching, axis=1).astype(np.int64)
        return np.sort(pairs[:, 0] * len(self.dof_map.cells) + pairs[:, 1])

    @cached_property
    def _boundary_tree(self) -> Any:
        """The k-d tree of the samples on boundaries."""
        from scipy.spatial import cKDTree

        return cKDTree(self.samples.points_at(np.flatnonzero(self.samples.weights == 0)))

    def _nearest_samples(self, points: Floats, count: int) -> tuple[Floats, Ints]:
        """Return the distances (k, q) from ``points`` (k, d), ascending, and the numbers (k, q), of nearest samples.

        q is ``count``, or the number of all samples if that is less.
        """
        count = min(count, len(self.samples))
        distance, samples = self._sample_tree.query(points, count)
        return distance.reshape(-1, count), samples.reshape(-1, count)

    @cached_property
    def _sample_tree(self) -> Any:
        """The k-d tree of all samples."""
        from scipy.spatial import cKDTree

        return cKDTree(self.samples.points, balanced_tree=False)


def _squared_distances_to_cells(points: Floats, corners: Floats) -> Floats:
    """Return the squared distances (k, q) of ``points`` (k, d) from flat cells with the ``corners`` (k, q, c, d)."""
    own = np.broadcast_to(points[:, None], (*corners.shape[:2], points.shape[1]))
    flat, cells = own.reshape(-1, points.shape[1]), corners.reshape(-1, *corners.shape[2:])
    if cells.shape[1] == 3:
        shares = nearest_barycentric(flat, cells)
    else:
        share = nearest_shares(flat - cells[:, 0], cells[:, 1] - cells[:, 0])
        shares = np.stack([1 - share, share], axis=1)
    off = flat - np.einsum("nc,ncd->nd", shares, cells)
    return np.asarray(dots(off, off).reshape(corners.shape[:2]))
