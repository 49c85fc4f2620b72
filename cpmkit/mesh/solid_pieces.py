"""The connected parts of a solid in each lattice cell: its patches, their moments, and which of them touch.

The pieces of the skin in a cell form connected components. Each component divides the cell into an inner side, from
which its normals point away, and an outer side. Two components bound the same part of the solid if each lies on the
inner side of the other, and both on the same side of any third one. A part with k components is the cell less the
outer sides of these, which are disjoint: its moments are the sum of those of the k inner sides, less k - 1 times those
of the cell. Nested, separate and touching parts need no further case. Pieces in faces of a cell divide nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.mesh.piece_kernels import Geometry, add_upper_faces, group_components, parts_at
from cpmkit.mesh.skin_pieces import SkinPieces
from cpmkit.mesh.solid_moments import CellTable, full_cells, moments_of, sum_moments, sums_above
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Bools, Floats, Ints

#: A face of two cells joins them if the solid's share of it is more than this: rounding.
LEAST_FACE = 1e-9
#: The volume of the parts of a cell may exceed that of the solid in it by this share of the cell: rounding.
LARGEST_SURPLUS = 1e-6
#: Faces of cells are tested at this offset from their centres, in spacings: boundaries inside may contain the centres.
OFF_MIDDLE = (0.0173, 0.0411, 0.0297)
#: The factors of the moments of fine and coarse facets of a curved skin: those of Richardson's extrapolation.
FINE, COARSE = 4 / 3, -1 / 3


@dataclass(frozen=True, eq=False)
class Components:
    """The connected components of the pieces of a skin in single lattice cells."""

    of_piece: Ints  #: (m,): the component of each piece, -1 for those in faces.
    row: Ints  #: (k,): the row in the table of the cell of each component, ascending.
    starts: Ints  #: (c + 1,): where the components of each cell of the table start.
    order: Ints  #: The pieces that are not in faces, by component.
    piece_starts: Ints  #: (k + 1,): where the pieces of each component start in ``order``.

    @property
    def counts(self) -> Ints:
        """(c,) the number of components in each cell."""
        return np.diff(self.starts)


def components_of(pieces: SkinPieces, row: Ints, cells: int) -> Components:
    """Return the components of ``pieces``, which share parts of facets; ``row`` (m,) < ``cells`` is a piece's cell."""
    count, (piece, facet) = len(pieces.cell), pieces.bounds.T
    walls = np.flatnonzero(~pieces.in_face)
    keep = ~pieces.in_face[piece]
    piece, code = piece[keep], (facet * cells + row[piece])[keep]
    number: Any = np.unique(code, return_inverse=True)[1]
    pairs = np.stack([piece, count + number.ravel()], axis=1)
    label = connected_components(count + int(number.max(initial=-1)) + 1, pairs)[1][:count]
    first, inverse = np.unique(row[walls] * np.int64(count + 1) + label[walls], return_inverse=True)
    of_piece = np.full(count, -1)
    of_piece[walls] = inverse.ravel()
    of_row = first // (count + 1)
    starts = np.concatenate([[0], np.cumsum(np.bincount(of_row, minlength=cells))])
    piece_starts = np.concatenate([[0], np.cumsum(np.bincount(inverse.ravel(), minlength=len(first)))])
    return Components(of_piece, of_row, starts, walls[np.argsort(inverse.ravel(), kind="stable")], piece_starts)


@dataclass(frozen=True, eq=False)
class SolidPatches:
    """The parts of a solid in lattice cells: first those in cells that the skin cuts, then full cells."""

    pieces: SkinPieces  #: The skin.
    table: CellTable  #: The cells that the skin cuts.
    components: Components  #: The components of the skin in these cells.
    #: (k,): the number, within its cell, of the part of the solid that each component bounds.
    part: Ints
    #: is_inner, side_starts (s,), (c + 1,): for each cell with several components, whether component j lies on the
    #: inner side of component i, row by row, and where the entries of each cell start.
    is_inner: Bools
    side_starts: Ints
    patch_starts: Ints  #: (c + 1,): the first patch of each cell of the table.
    full: Ints  #: (f, d): the cells inside the solid.
    merged: Bools  #: (c,): whether the parts of a cell were merged, since their volumes were wrong.

    @property
    def cut(self) -> int:
        """Number of patches in cells that the skin cuts, which come first."""
        return int(self.patch_starts[-1])

    @cached_property
    def cells(self) -> Ints:
        """(p, d) the lattice cell of each patch."""
        return np.concatenate([np.repeat(self.table.cells, np.diff(self.patch_starts), axis=0), self.full])

    @cached_property
    def all_cells(self) -> tuple[CellTable, Ints]:
        """All cells of the solid, and the first patch (k,) of each."""
        table = CellTable.of(self.cells)
        first = np.full(len(table.cells), -1)
        rows = table.find(self.cells)
        first[rows[::-1]] = np.arange(len(rows))[::-1]
        return table, first

    def patches_at(self, cells: Ints, points: Floats) -> Ints:
        """Return the patch (n,) of ``points`` (n, d), in spacings, in lattice ``cells`` (n, d); -1 if there is none."""
        table, first = self.all_cells
        rows = table.find(cells)
        patch = np.where(rows >= 0, first[rows], -1)
        cut = self.table.find(cells)
        several = np.flatnonzero((cut >= 0) & (np.diff(self.patch_starts)[cut] > 1))
        if len(several):
            part = self._parts_at(cut[several], points[several])
            patch[several] = np.where(part >= 0, self.patch_starts[cut[several]] + part, -1)
        return patch

    def _parts_at(self, rows: Ints, points: Floats) -> Ints:
        """Return the number (n,) of the part of cells ``rows`` (n,) that contains ``points`` (n, d), or -1."""
        own, sides = self.components, (self.is_inner, self.side_starts)
        return parts_at(rows, np.ascontiguousarray(points), own.starts, self.part, *sides, self._geometry)

    @cached_property
    def _geometry(self) -> Geometry:
        """The arrays by which kernels find the sides of components."""
        return geometry_of(self.pieces, self.components)

    @cached_property
    def of_piece(self) -> Ints:
        """(m,) the patch that each piece of the skin bounds."""
        row, component = self.table.find(self.pieces.cell), self.components.of_piece
        patch: Ints = self.patch_starts[row] + np.append(self.part, 0)[component]  # 0 for pieces in faces
        several = np.flatnonzero((component < 0) & (np.diff(self.patch_starts)[row] > 1))
        if len(several):
            area = self.pieces.normals[several]
            inside = self.pieces.centres[several] - 1e-6 * area / np.abs(area).max(axis=1, keepdims=True)
            patch[several] += np.maximum(self._parts_at(row[several], inside), 0)
        return patch

    def moments(self, coarse: SkinPieces | None = None) -> tuple[Floats, Floats]:
        """Return the moments (k, 5, 5^(d-1)) of the patches in cut cells, and the sums (c,) over columns of cells.

        With the ``coarse`` pieces of a curved skin the moments are extrapolated, unless this changes the volume of a
        patch by more than half: the volume of a cell that the skin grazes would become negative.
        """
        cells = self.table.cells
        moments, total = moments_of(self.pieces, self.table)
        if coarse is not None:
            both = CellTable.of(np.concatenate([cells, coarse.cell]))
            further, coarse_total = moments_of(coarse, both)
            rows = both.find(cells)
            extrapolated, total = (
                FINE * moments + COARSE * further[rows],
                np.maximum(np.abs(total), abs(coarse_total[rows])),
            )
            near = np.abs(extrapolated[:, 0, 0] - moments[:, 0, 0]) < 0.5 * moments[:, 0, 0]
            moments = np.where(near[:, None, None], extrapolated, moments)
        counts = np.diff(self.patch_starts)
        row = np.repeat(np.arange(len(cells)), counts)
        of_patches = moments[row]
        several = np.flatnonzero(counts[self.components.row] > 1)
        if len(several):
            own, numbers = self._component_moments(several), self.patch_starts[self.components.row[several]]
            patch = numbers + self.part[several]
            split = np.unique(patch)
            of_patches[split] = 0.0
            np.add.at(of_patches, patch, own)
            of_patches[split, 0, 0] -= np.bincount(patch, minlength=len(row))[split] - 1.0
            if coarse is not None:
                other = solid_patches(coarse)
                mine, others = self._matches(split, other)
                extrapolated = FINE * of_patches[mine] + COARSE * other.moments()[0][others]
                near = np.abs(extrapolated[:, 0, 0] - of_patches[mine, 0, 0]) < 0.5 * of_patches[mine, 0, 0]
                of_patches[mine[near]] = extrapolated[near]
        return of_patches, total

    def _matches(self, chosen: Ints, coarse: SolidPatches) -> tuple[Ints, Ints]:
        """Return the patches (k,) among ``chosen`` that match a patch of ``coarse``, and the numbers (k,) of these.

        Each coarse facet is divided into several facets of this skin, whose numbers are equal to its own modulo the
        number of coarse facets. Two patches of one cell match if they share a coarse facet, and match no other patch.
        """
        count = int(coarse.pieces.facet.max(initial=-1)) + 1
        codes = []
        for patches in (self, coarse):
            row = coarse.table.find(patches.pieces.cell)
            own = np.flatnonzero(~patches.pieces.in_face & (row >= 0))
            code, first = np.unique(row[own] * count + patches.pieces.facet[own] % count, return_index=True)
            codes.append((code, patches.of_piece[own[first]]))
        _, mine, others = np.intersect1d(codes[0][0], codes[1][0], assume_unique=True, return_indices=True)
        pairs = np.unique(np.stack([codes[0][1][mine], codes[1][1][others]], axis=1), axis=0)
        single = [np.bincount(column)[column] == 1 for column in pairs.T]
        mine, others = pairs[single[0] & single[1] & np.isin(pairs[:, 0], chosen)].T
        return mine, others

    @property
    def volumes(self) -> Floats:
        """(c,) the solid's share of each cut cell, by the divergence theorem: the first of its moments."""
        pieces = self.pieces
        row = self.table.find(pieces.cell)[pieces.piece]
        height = pieces.points[:, 0] - self.table.cells[row, 0] + 0.5
        own = np.bincount(row, pieces.areas[:, 0] * height, len(self.table.cells))
        return np.asarray(self.face_shares[0][:, 0] + own)

    def has_wrong_volume(self) -> Bools:
        """Return whether (c,) the volumes of several parts of each cut cell do not add up to the solid's volume.

        This happens where the skin lies within rounding of a face of the cell and crosses the face many times.
        """
        counts, row = np.diff(self.patch_starts), self.components.row
        several = np.flatnonzero(counts[row] > 1)
        if not len(several):
            return np.zeros(len(counts), dtype=bool)
        inner = np.bincount(row[several], self._component_moments(several)[:, 0, 0], len(counts))
        surplus = inner - (self.components.counts - counts) - self.volumes
        return (counts > 1) & (np.abs(surplus) > LARGEST_SURPLUS)

    def _component_moments(self, chosen: Ints) -> Floats:
        """Return the moments (n, 5, 5^(d-1)) of the inner sides of the components ``chosen`` (n,), ascending."""
        pieces, own = self.pieces, self.components
        cells = self.table.cells[own.row[chosen]]
        place = np.full(len(own.row) + 1, -1)  # the last is that of pieces in faces
        place[chosen] = np.arange(len(chosen))
        moments = np.zeros((len(chosen), 5, 5 ** (cells.shape[1] - 1)))
        sum_moments(pieces.points, pieces.areas, place[own.of_piece[pieces.piece]], cells, moments, moments[:, 0] * 0)
        add_upper_faces(chosen, cells, moments, self._geometry)
        return moments

    @cached_property
    def face_shares(self) -> tuple[Floats, Floats]:
        """(c, d) twice: the solid's share of the upper and the lower face of each cut cell along each axis."""
        cells, row = self.table.cells, self.table.find(self.pieces.cell)
        sums = [np.bincount(row, column, len(cells)) for column in self.pieces.normals.T]
        fluxes: Floats = np.stack(sums, axis=1).astype(np.float64)
        upper = [sums_above(cells, axis, fluxes[:, axis : axis + 1]) for axis in range(cells.shape[1])]
        return np.hstack(upper), np.hstack(upper) + fluxes

    def touching(self) -> Ints:
        """Return the pairs (t, 2) of patches that share a part of a face of their cells."""
        return np.concatenate([*self._pairs_across_faces(), *self._pairs_along_skin()])

    def _pairs_across_faces(self) -> Iterator[Ints]:
        """Yield pairs of patches of cells with a common face: both cells have one part, or the face is all inside."""
        (table, first), cut = self.all_cells, self.table.find(self.all_cells[0].cells)
        single = (cut < 0) | (np.diff(self.patch_starts)[cut] == 1)
        for axis, step in enumerate(np.eye(table.cells.shape[1], dtype=np.int64)):
            low = np.arange(len(table.cells))
            high = table.find(table.cells + step)
            low, high = low[high >= 0], high[high >= 0]
            share = np.where(cut[high] >= 0, self.face_shares[1][cut[high], axis], 1.0)
            share = np.where(cut[low] >= 0, self.face_shares[0][cut[low], axis], share)
            plain = single[low] & single[high] & (share > LEAST_FACE)
            yield np.stack([first[low[plain]], first[high[plain]]], axis=1)
            whole = np.flatnonzero(~(single[low] & single[high]) & (share > 1 - LEAST_FACE))
            middles = table.cells[low[whole]] + 0.5 * step + (1 - step) * np.array(OFF_MIDDLE)[: len(step)]
            pair = [self.patches_at(table.cells[side[whole]], middles) for side in (low, high)]
            found = (pair[0] >= 0) & (pair[1] >= 0)
            yield np.stack([side[found] for side in pair], axis=1)

    def _pairs_along_skin(self) -> Iterator[Ints]:
        """Yield pairs of patches in adjacent cells that are bounded by the same cell of the skin, or two neighbours."""
        pieces, count = self.pieces, len(self.table.cells)
        own = np.stack([np.arange(len(pieces.cell)), pieces.facet], axis=1)
        for piece, facet in (entries[~pieces.in_face[entries[:, 0]]].T for entries in (own, pieces.bounds)):
            codes, place = np.unique(facet * count + self.table.find(pieces.cell[piece]), return_index=True)
            for step in np.eye(pieces.cell.shape[1], dtype=np.int64):
                row = self.table.find(pieces.cell[piece] + step)
                at = np.searchsorted(codes, facet * count + row)
                at[at == len(codes)] = 0
                found = (row >= 0) & (codes[at] == facet * count + row)
                yield np.stack([self.of_piece[piece[found]], self.of_piece[piece[place[at[found]]]]], axis=1)


def solid_patches(pieces: SkinPieces) -> SolidPatches:
    """Return the patches of the solid that the skin ``pieces`` bound."""
    table = CellTable.of(pieces.cell)
    components = components_of(pieces, table.find(pieces.cell), len(table.cells))
    counts = components.counts
    sides = np.where(counts > 1, counts**2, 0)
    side_starts = np.concatenate([[0], np.cumsum(sides)])
    part, is_inner = np.zeros(len(components.row), dtype=np.int64), np.zeros(side_starts[-1], dtype=bool)
    geometry = geometry_of(pieces, components)
    parts = group_components(components.starts, part, is_inner, side_starts, geometry)
    patch_starts = np.concatenate([[0], np.cumsum(parts)])
    merged = np.zeros(len(parts), dtype=bool)
    first = SolidPatches(pieces, table, components, part, is_inner, side_starts, patch_starts, table.cells[:0], merged)
    wrong = first.has_wrong_volume()
    if wrong.any():
        part[wrong[components.row]] = 0
        patch_starts = np.concatenate([[0], np.cumsum(np.where(wrong, 1, parts))])
        first = replace(first, patch_starts=patch_starts)
    full = full_cells(table, first.face_shares[0][:, 0])
    return SolidPatches(pieces, table, components, part, is_inner, side_starts, patch_starts, full, wrong)


def geometry_of(pieces: SkinPieces, components: Components) -> Geometry:
    """Return the arrays of pieces that kernels take: order and starts by component, corners, normals and centres."""
    own = components.order, components.piece_starts, pieces.corners, pieces.corner_starts
    return *own, np.ascontiguousarray(pieces.normals), np.ascontiguousarray(pieces.centres)
