"""Regions of finer splines: lattice cells that are halved along every axis; and meshes graded by the cells' sizes.

Level l has the spacing h_l = h / 2^l; its cells are those of level l - 1, each subdivided along every axis. The cell of
a point depends on its position alone, so that the mesh of the manifold may be made anew for each set of regions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.solution_warnings import ends_inside
from cpmkit.grid.lattice import find_codes
from cpmkit.mesh.cell_quadrature import Samples, quadrature, triangles_to_clip
from cpmkit.mesh.mesh import CellGeometry, Mesh
from cpmkit.mesh.subdivision import halve_long_edges
from cpmkit.types import Bools, Floats, Ints

#: Bits of a cell's code for its place along an axis; place 0 is stored as half of their range.
BITS = 21
HALF = 1 << (BITS - 1)


@dataclass(frozen=True, eq=False)
class Regions:
    """The subdivided cells, by level."""

    spacing: float  #: Spacing h of level 0.
    dim: int  #: Dimension of the space.
    #: tuple of (k_l,) int64: codes of the cells of level l that are subdivided into cells of level l + 1, ascending;
    #: each lies in a subdivided cell of the level before.
    subdivided: tuple[Ints, ...] = ()

    @property
    def finest(self) -> int:
        """The finest level; 0 where no cell is subdivided."""
        return len(self.subdivided)

    def cells(self, points: Floats, level: int) -> Ints:
        """Return (q, d) the cells of a level that contain ``points`` (q, d), given relative to the lattice's origin."""
        return np.floor(2.0**level * (points / self.spacing + 0.5)).astype(np.int64)

    def levels_at(self, points: Floats, around: float = 0.0) -> Ints:
        """Return (q,) the finest level of the splines at or around each of the ``points`` (q, d).

        Points are relative to the lattice's origin. Around a point means at the corners of a box, displaced from the
        point along all axes by the share ``around`` of the spacing of the coarser level.
        """
        level_of_point, rows = np.zeros(len(points), dtype=np.int64), np.arange(len(points))
        signs = 2 * np.indices((2,) * self.dim).reshape(self.dim, -1).T - 1 if around else np.zeros((1, self.dim))
        for level, codes in enumerate(self.subdivided):
            steps = around * self.spacing / 2**level * signs
            near = [codes_of_cells(self.cells(points[rows] + step, level)) for step in steps]
            rows = rows[np.any([find_codes(codes, displaced) >= 0 for displaced in near], axis=0)]
            level_of_point[rows] = level + 1
        return level_of_point

    def with_subdivided(self, levels: Ints, cells: Ints, most: int) -> Regions:
        """Return regions in which also the ``cells`` (k, d) of ``levels`` (k,) from 0 to ``most`` - 1 are subdivided.

        Their neighbours are subdivided too, and coarser cells until neighbouring cells differ by at most one level.
        """
        codes = [
            self.subdivided[level] if level < self.finest else np.zeros(0, dtype=np.int64) for level in range(most)
        ]
        for level in range(most):
            codes[level] = np.union1d(codes[level], codes_of_cells(with_neighbours(cells[levels == level])))
        for level in range(most - 1, 0, -1):
            around = with_neighbours(cells_of_codes(codes[level], self.dim))
            codes[level - 1] = np.union1d(codes[level - 1], codes_of_cells(around >> 1))
        return Regions(self.spacing, self.dim, tuple(level for level in codes if len(level)))

    def table(self) -> Ints:
        """Return the subdivided cells as rows (k, 1 + d) of integers: the level, then the position of the cell."""
        rows = [
            np.column_stack([np.full(len(codes), level), cells_of_codes(codes, self.dim)])
            for level, codes in enumerate(self.subdivided)
        ]
        return np.concatenate([np.zeros((0, 1 + self.dim), dtype=np.int64), *rows])


def codes_of_cells(cells: Ints) -> Ints:
    """Return (k,) an integer code for each of the ``cells`` (k, d), unique for entries from -2^20 to 2^20 - 1."""
    code = np.zeros(len(cells), dtype=np.int64)
    for column in cells.T:
        code = (code << BITS) + column + HALF
    return code


def cells_of_codes(codes: Ints, dim: int) -> Ints:
    """Return (k, d) the cells, in a space of dimension ``dim``, with the ``codes`` (k,)."""
    shifts = BITS * np.arange(dim - 1, -1, -1)
    return np.asarray((codes[:, None] >> shifts & (2 * HALF - 1)) - HALF)


def with_neighbours(cells: Ints) -> Ints:
    """Return (m, d) the distinct ``cells`` (k, d) and all cells that share a corner with one of them."""
    dim = cells.shape[1]
    steps = np.indices((3,) * dim).reshape(dim, -1).T - 1
    codes = codes_of_cells((cells[:, None] + steps).reshape(-1, dim))
    return cells_of_codes(np.unique(codes), dim)


#: Edges near a tip are no longer than this share of their distance from the tip, but need not be shorter than so many
#: spacings: one such edge has 1/1000 of the energy within a spacing.
LONGEST_EDGE_SHARE, LEAST_EDGE_SPACINGS = 0.5, 1e-3


def grade_mesh(mesh: Mesh, regions: Regions, spacings: float) -> Mesh:
    """Return flat triangles whose edges are at most ``spacings`` times as long as the spacing of the splines there.

    Longer edges are halved, and the longest edge of each triangle with a halved edge too, so that no needles arise.
    """
    first = regions.subdivided[0] if regions.finest else np.zeros(0, dtype=np.int64)
    near_codes = codes_of_cells(with_neighbours(cells_of_codes(first, regions.dim)))
    return halve_long_edges(mesh, lambda mesh: _mark_longest_edges(_is_long(mesh, regions, near_codes, spacings), mesh))


def _is_long(mesh: Mesh, regions: Regions, near_codes: Ints, spacings: float) -> Bools:
    """Return (e,) whether each edge is longer than ``spacings`` times the spacing of the finest splines along it.

    Outside the cells of level 0 with the codes ``near_codes`` all splines have level 0.
    """
    vertices, ends, lengths, longest = mesh.vertices, mesh.edges.ends, mesh.edge_lengths, spacings * regions.spacing
    long = lengths > longest * 0.5**regions.finest
    midpoints = vertices[ends[long]].mean(axis=1)
    rows = np.flatnonzero(long)[find_codes(near_codes, codes_of_cells(regions.cells(midpoints, 0))) >= 0]
    first, second = vertices[np.sort(ends[rows], axis=1)].transpose(1, 0, 2)
    level = np.zeros(len(rows), dtype=np.int64)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        level = np.maximum(level, regions.levels_at((1 - share) * first + share * second, 0.25))
    long[:] = False
    long[rows] = lengths[rows] > longest * 0.5**level
    return long


def _mark_longest_edges(long: Bools, mesh: Mesh) -> Bools:
    """Return ``long`` (e,), changed in place, with the longest edge of each triangle with a marked edge marked too.

    Marking is repeated until the longest edge of each triangle with a marked edge is marked.
    """
    of_cells = mesh.edges.of_cells
    longest = of_cells[np.arange(len(of_cells)), mesh.lengths_of_cells.argmax(axis=1)]
    rows = np.flatnonzero(~long[longest])
    while True:
        rows = rows[~long[longest[rows]]]
        new = longest[rows[long[of_cells[rows]].any(axis=1)]]
        if not len(new):
            return long
        long[new] = True


def graded_samples(
    mesh: Mesh, regions: Regions, sampling: str, geometry: CellGeometry, further: Samples | None
) -> Samples:
    """Return the samples of triangles in the order of the triangles, followed by the samples ``further``, if any.

    Each triangle is clipped at the knot planes of the finest level at its corners and its centroid, if
    :func:`triangles_to_clip` selects it for the option ``sampling`` and the ``geometry`` of cells.
    """
    middle = mesh.vertices[mesh.cells].mean(axis=1)
    corners = [mesh.vertices[vertices] for vertices in mesh.cells.T]
    levels = np.max([regions.levels_at(points) for points in (middle, *corners)], axis=0)
    by_level = [
        _samples_of_level(mesh, np.flatnonzero(levels == level), regions, level, sampling, geometry)
        for level in range(regions.finest + 1)
    ]
    samples = Samples.join(by_level)
    samples = samples.take(np.argsort(samples.cell, kind="stable"))
    return samples if further is None else Samples.join([samples, further])


def _samples_of_level(
    mesh: Mesh, chosen: Ints, regions: Regions, level: int, sampling: str, geometry: CellGeometry
) -> Samples:
    """Return the samples of the triangles ``chosen`` (k,), clipped, if ``sampling`` says so, at the level's planes."""
    shift = shift_of(regions.spacing, level)
    midpoints = None if mesh.midpoints is None else mesh.midpoints[chosen] + shift
    shifted = replace(mesh, vertices=mesh.vertices + shift, cells=mesh.cells[chosen], midpoints=midpoints)
    spacing = regions.spacing / 2**level
    samples = quadrature(shifted, spacing, clipped=triangles_to_clip(shifted, sampling, geometry, spacing))
    return Samples(samples.points - shift, samples.weights, samples.normals, chosen[samples.cell])


def shift_of(spacing: float, level: Any) -> Any:
    """Return the distance along each axis from node 0 of ``level`` to node 0 of level 0, which has the ``spacing``."""
    return 0.5 * spacing * (1 - 0.5**level)


def grade_towards_tips(mesh: Mesh, spacing: float) -> Mesh:
    """Return flat triangles whose edges are at most half as long as their distance from a boundary's end inside.

    The ``mesh`` has flat triangles. Edges shorter than a thousandth of the ``spacing`` h are not subdivided.
    """
    from scipy.spatial import cKDTree

    tips = np.concatenate([np.zeros(0, dtype=np.int64), *(ends_inside(mesh, k) for k in np.unique(mesh.owner))])
    if not len(tips):
        return mesh
    tree = cKDTree(mesh.vertices[tips])

    def is_long(mesh: Mesh) -> Bools:
        """Return (e,) whether edges are longer than half their distance from the nearest tip."""
        lengths = mesh.edge_lengths
        distance = tree.query(mesh.vertices, distance_upper_bound=lengths.max() / LONGEST_EDGE_SHARE)[0]  # or infinite
        nearer = distance[mesh.edges.ends].min(axis=1)
        return np.asarray(lengths > np.maximum(LONGEST_EDGE_SHARE * nearer, LEAST_EDGE_SPACINGS * spacing))

    return halve_long_edges(mesh, is_long)
