"""Quadrature points of a manifold with weights and normals, exact or quantised to half of the memory.

A surface has some twenty samples for each unknown. A spline space stores their positions in their lattice cells and
their normals as fixed-point numbers, rounded once, before anything is summed: to 2^-33 spacings and about 2^-30. All
integrals are then sums over the same rounded samples, so that constants, means and totals are reproduced to rounding.
Curves and solids have few samples, which are not rounded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from cpmkit.forms.galerkin.dof_map import DofMap
from cpmkit.mesh.cell_quadrature import Samples
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Floats, Ints

#: Unit of a quantised coordinate, in spacings, and of a quantised component of a normal: 1 and -1 are multiples of it.
PLACE_UNIT, NORMAL_UNIT = 2.0**-32, 2.0**-30
#: Samples that are rounded or decoded together, so that temporary arrays stay small.
SAMPLES_AT_ONCE = 1 << 16


@dataclass(frozen=True, eq=False)
class QuantisedSamples:
    """Samples stored as fixed-point numbers, relative to the lattice cells of their patches."""

    dof_map: DofMap  #: The dof map of these samples.
    #: (q, d) int32, float64 for curves and solids: position relative to the centre of the patch's cell, in
    #: `PLACE_UNIT` spacings.
    places: Any
    #: (q, c, e) int32, float64 for curves: the normals in units of `NORMAL_UNIT`, orthonormalised when they are
    #: decoded. For curves e = d; for surfaces e = 2: a position on the octahedron |x| + |y| + |z| = 1, unfolded into a
    #: square.
    directions: Any
    weights: Floats  #: (q,): quadrature weights, as of `Samples`.
    #: (m + 1,) int32: the first sample of each cell of the mesh, for the first samples, which are ordered by cell.
    cell_starts: Any
    further_cells: Any  #: (k,) int32: the cells of the k last samples, which are not ordered by cell.

    @classmethod
    def of(cls, samples: Samples, dof_map: DofMap) -> QuantisedSamples:
        """Return the ``samples`` of a dof map as quantised samples."""
        codim, d = samples.normals.shape[1:]
        is_surface = (d, codim) == (3, 1)
        places = np.empty(samples.points.shape, dtype=np.int32 if is_surface else np.float64)
        directions = np.empty((len(samples), codim, 2 if is_surface else d), dtype=places.dtype)
        largest = np.iinfo(np.int32).max
        for start in range(0, len(samples), SAMPLES_AT_ONCE):
            rows = slice(start, start + SAMPLES_AT_ONCE)
            from_node = samples.points[rows] / dof_map.spacing - dof_map.cells[dof_map.patch[rows]]
            from_node /= PLACE_UNIT
            places[rows] = np.clip(np.rint(from_node), -largest - 1, largest) if is_surface else from_node
            normals = samples.normals[rows] / NORMAL_UNIT
            directions[rows] = np.rint(_unfold_octahedron(normals)) if is_surface else normals
        descents = np.flatnonzero(samples.cell[1:] < samples.cell[:-1])
        count = int(descents[0]) + 1 if len(descents) else len(samples)
        starts = np.concatenate([[0], np.cumsum(np.bincount(samples.cell[:count]))]).astype(np.int32)
        return cls(dof_map, places, directions, samples.weights, starts, samples.cell[count:].copy())

    def __len__(self) -> int:
        return len(self.places)

    @property
    def codim(self) -> int:
        """Dimension c of the normal space."""
        return int(self.directions.shape[1])

    @property
    def points(self) -> Floats:
        """Positions (q, d) relative to the lattice's origin; decoded at each access."""
        return self.points_at(slice(None))

    @property
    def normals(self) -> Floats:
        """Orthonormal bases (q, c, d) of the normal space; decoded at each access."""
        return self.normals_at(slice(None))

    @property
    def cell(self) -> Any:
        """The cell (q,) of the mesh that contains each sample, int32; computed at each access."""
        cells = np.arange(len(self.cell_starts) - 1, dtype=np.int32)
        return np.concatenate([np.repeat(cells, np.diff(self.cell_starts)), self.further_cells])

    def points_at(self, rows: slice | Ints) -> Floats:
        """Return the points (..., d), relative to the lattice's origin, of the samples ``rows`` (...)."""
        points = PLACE_UNIT * self.places[rows]
        points += self.dof_map.cells[self.dof_map.patch[rows]]
        points *= self.dof_map.spacing
        return np.asarray(points)

    def normals_at(self, rows: slice | Ints) -> Floats:
        """Return the normals (..., c, d) of the samples ``rows`` (...)."""
        directions = self.directions[rows]
        normals = np.empty((*directions.shape[:-1], self.dof_map.dim))
        if not self.codim:
            return normals
        decode_all_normals(directions.reshape(-1, *directions.shape[-2:]), normals.reshape(-1, *normals.shape[-2:]))
        return normals

    def first_of_cells(self, cells: Ints) -> Ints:
        """Return the first sample (...) of each of the ``cells`` (...)."""
        return np.asarray(self.cell_starts[cells], dtype=np.int64)

    def cell_at(self, rows: Ints) -> Ints:
        """Return the cells (...) of the samples ``rows`` (...)."""
        count = int(self.cell_starts[-1])
        cells = np.searchsorted(self.cell_starts, np.minimum(rows, count - 1), side="right") - 1
        behind = rows >= count
        cells[behind] = self.further_cells[rows[behind] - count]
        return cells


def _unfold_octahedron(normals: Floats) -> Floats:
    """Return the positions (q, c, 2) of directions ``normals`` (q, c, 3) on the octahedron unfolded into a square.

    A normal is projected to the octahedron |x| + |y| + |z| = 1, whose lower half is folded outwards over the edges of
    the upper half. The square is scaled with the length of the normals.
    """
    size = np.abs(normals).sum(axis=-1, keepdims=True) * NORMAL_UNIT
    flat, below = normals[..., :2] / size, normals[..., 2:] < 0
    folded = (1 / NORMAL_UNIT - np.abs(flat[..., ::-1])) * np.where(flat >= 0, 1.0, -1.0)
    return np.asarray(np.where(below, folded, flat))


@compiled
def decode_normals(directions: Any, normals: Floats) -> None:
    """Fill ``normals`` (c, d) with the orthonormal normals of a sample, from its quantised ``directions`` (c, e).

    e is d where directions are components of normals, or 2 where they are positions on an unfolded octahedron.
    """
    codim, d = normals.shape
    for c in range(codim):
        if directions.shape[1] == d:
            for i in range(d):
                normals[c, i] = directions[c, i]
        else:
            x, y = NORMAL_UNIT * directions[c, 0], NORMAL_UNIT * directions[c, 1]
            z = 1 - abs(x) - abs(y)
            if z < 0:
                x, y = (1 - abs(y)) * (1.0 if x >= 0 else -1.0), (1 - abs(x)) * (1.0 if y >= 0 else -1.0)
            normals[c, 0], normals[c, 1], normals[c, 2] = x, y, z
        for other in range(c):
            along = 0.0
            for i in range(d):
                along += normals[other, i] * normals[c, i]
            for i in range(d):
                normals[c, i] -= along * normals[other, i]
        square = 0.0
        for i in range(d):
            square += normals[c, i] * normals[c, i]
        scale = 1.0 / np.sqrt(square)
        for i in range(d):
            normals[c, i] *= scale


@compiled
def decode_all_normals(directions: Any, normals: Floats) -> None:
    """Fill ``normals`` (q, c, d) with the orthonormal normals of samples, from their ``directions`` (q, c, e)."""
    for q in range(len(normals)):
        decode_normals(directions[q], normals[q])
