"""Samples on the skin of a solid and on both sides of boundaries inside, at which conditions are imposed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.solids.skin import Skin
from cpmkit.grid.lattice import find_codes
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.cell_quadrature import quadrature
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.solid_pieces import SolidPatches
from cpmkit.types import Bools, Floats, Ints

#: Flat triangles whose median edge is shorter than this, in spacings, have samples as on surfaces.
FINE_SPACINGS = 0.25
#: Coefficients at the skin are compared with those so many spacings inside.
INSIDE_SPACINGS = 0.25
#: The lattice cell of a sample is that of a point at this distance from it, in spacings, on its side of the boundary.
ASIDE_SPACINGS = 1e-6
#: For a search among the pieces of one cell alone, cells are set apart by so many times the size of the skin.
APART = 4.0


def skin_samples(skin: Skin, patches: SolidPatches, spacing: float) -> tuple[BoundarySamples, Bools]:
    """Return samples on the skin, and whether each (b,) is on the left of its boundary.

    Samples are the quadrature points of pieces of the skin (its facets cut at knot planes), or fewer on quadratic or
    small triangles. On boundaries inside both sides have samples at the same points.
    """
    points, weights, normals, cell = _points_on_one_side(skin, patches, spacing)
    beside = PatchesBeside(skin, patches)
    patch, facet = beside.find(points / spacing, normals, cell), np.full(len(points), -1)
    rows = np.flatnonzero(skin.owner[cell] >= 0)
    if len(rows):
        facet[rows] = np.arange(len(rows))
        twin = skin.twin[cell[rows]]
        patch = np.concatenate([patch, beside.find(points[rows] / spacing, -normals[rows], twin)])
        points, weights, facet = (np.concatenate([each, each[rows]]) for each in (points, weights, facet))
        normals, cell = np.concatenate([normals, -normals[rows]]), np.concatenate([cell, twin])
    order = np.argsort(patch, kind="stable")
    points, weights, normals, patch = points[order], weights[order], normals[order], patch[order]
    count, cell, d = len(points), cell[order], points.shape[1]
    samples = BoundarySamples(
        points,
        weights,
        normals,
        np.zeros((count, 0, d)),
        patch,
        points - INSIDE_SPACINGS * spacing * normals,
        np.arange(count),
        facet[order],
        np.zeros(count, dtype=np.int64),
        skin.owner[cell],
        skin.beyond_tip[cell],
    )
    return samples, skin.left[cell]


def _points_on_one_side(skin: Skin, patches: SolidPatches, spacing: float) -> tuple[Floats, Floats, Floats, Ints]:
    """Return quadrature points (n, d) of the skin and of one side of boundaries inside, weights, normals and cells."""
    pieces, mesh = patches.pieces, skin.mesh
    first = (skin.twin < 0) | (np.arange(len(skin.twin)) < skin.twin)
    is_fine = mesh.midpoints is None and float(np.median(mesh.edge_lengths)) < FINE_SPACINGS * spacing
    by_pieces = np.full(len(mesh.cells), mesh.dim == 2) | (skin.is_flat & (not is_fine))
    weights = norms(pieces.areas)
    # the facets of quadratic triangles are four times the triangles, see Skin.facets
    cell = pieces.facet[pieces.piece] % len(mesh.cells)
    kept = (weights > 0) & (by_pieces & first)[cell]
    points, normals, cell = spacing * pieces.points[kept], pieces.areas[kept] / weights[kept, None], cell[kept]
    weights = weights[kept] * spacing ** (mesh.dim - 1)
    curved = np.flatnonzero(~by_pieces & first)
    if len(curved):
        midpoints = None if mesh.midpoints is None else mesh.midpoints[curved]
        made = quadrature(Mesh.of(mesh.vertices, mesh.cells[curved], midpoints), spacing)
        points, normals = np.concatenate([points, made.points]), np.concatenate([normals, made.normals[:, 0]])
        weights, cell = np.concatenate([weights, made.weights]), np.concatenate([cell, curved[made.cell]])
    return points, weights, normals, cell


@dataclass(frozen=True, eq=False)
class PatchesBeside:
    """The search for the patch that a cell of the skin bounds at a point: by the pieces of this cell."""

    skin: Skin
    patches: SolidPatches

    def find(self, points: Floats, normals: Floats, cell: Ints) -> Ints:
        """Return the patch (n,) at ``points`` (n, d), in spacings, on the skin's cells ``cell`` (n,).

        The patch is bounded by the piece of the cell in the lattice cell of the point, or else by the cell's nearest
        piece. ``normals`` (n, d) point out of the patch.
        """
        table, count = self.patches.table, len(self.skin.mesh.cells)
        row = table.find(np.floor(points - ASIDE_SPACINGS * normals + 0.5).astype(np.int64))
        codes, piece = self._pieces
        at = np.where(row >= 0, find_codes(codes, row * count + cell), -1)
        found = piece[at]
        missing = np.flatnonzero(at < 0)
        if len(missing):
            nearest = self._tree.query(self._spread(points[missing], cell[missing]))[1]
            found[missing] = self.patches.pieces.piece[nearest]
        return np.asarray(self.patches.of_piece[found])

    @cached_property
    def _pieces(self) -> tuple[Ints, Ints]:
        """Codes (k,) of lattice cells and cells of the skin, ascending, and the first piece (k,) of each."""
        pieces, count = self.patches.pieces, len(self.skin.mesh.cells)
        codes, first = np.unique(self.patches.table.find(pieces.cell) * count + pieces.facet % count, return_index=True)
        return codes, first

    @cached_property
    def _tree(self) -> Any:
        """The k-d tree of the quadrature points of pieces, those of different cells far from each other."""
        from scipy.spatial import cKDTree

        pieces = self.patches.pieces
        return cKDTree(self._spread(pieces.points, pieces.facet[pieces.piece] % len(self.skin.mesh.cells)))

    def _spread(self, points: Floats, cell: Ints) -> Floats:
        """Return ``points`` (n, d) with a further coordinate that sets those of each ``cell`` (n,) far apart."""
        size = float(np.ptp(self.patches.pieces.points, axis=0).max())
        return np.column_stack([points, APART * size * cell])
