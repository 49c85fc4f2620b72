"""The fine lattice round a surface: its nodes, what they see of the surface, and where several sheets may be near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.band import cell_levels
from cpmkit.grid.lattice import Codes
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, unit
from cpmkit.meshing.contouring.marching import KNOWN_NOISES, feet_and_normals
from cpmkit.protocols import Bools, Floats, Ints

#: Where nodes lie beside a query on the surface, as shares of the spacing: planes of symmetry and boxes miss this way.
BESIDE = np.array([0.1717, 0.2203, 0.2411])
#: Corners of a cell agree on one plane: their normals up to this cosine, their distances up to this share of a side.
ALIKE_COSINE, ALIKE_DISTANCE = 0.8, 0.15
#: Nodes nearer than this share of the spacing lie on the surface: they are taken to be beside it, on one side.
ON_SURFACE = 1e-6
#: Below this share of the spacing the direction from a foot is not trusted to be normal.
TRUSTED_DISTANCE = 0.02


@dataclass(frozen=True, eq=False)
class Nodes:
    """Corners of the cells that a surface may meet; edge k of a node leads to its neighbour along axis k.

    Attributes
    ----------
    spacing : float
        s, of this lattice.
    offsets : (3,) float64
        Where the nodes lie in the cells, as shares of the spacing.
    codes : Codes
        The numbering of nodes and cells; a cell has the index of its lowest corner.
    table : (n,) int64
        The sorted codes of the nodes.
    index, positions : (n, 3)
        The nodes as integers, and where they lie.
    feet, normals : (n, 3) float64
        Their closest points, and the unit vectors from those to the nodes.
    distance : (n,) float64
        To the foot.
    rim : (n,) bool
        Whether the foot lies on a rim.
    unlike : (n, 3) bool
        Edges of cells whose corners do not all see one plane.
    """

    spacing: float
    offsets: Floats
    codes: Codes
    table: Ints
    index: Ints
    positions: Floats
    feet: Floats
    normals: Floats
    distance: Floats
    rim: Bools
    unlike: Bools

    def place(self, index: Ints) -> Floats:
        """Return the positions of nodes (..., 3)."""
        return np.asarray((index - self.offsets) * self.spacing)


def surrounding_nodes(source: LocalSource, spacing: float, offsets: Floats) -> Nodes:
    """Return the corners of all cells that the surface may meet, with their closest points.

    Raises
    ------
    ResolutionError
        If the source has no point inside its bounds.
    """
    for _, found in cell_levels(source, spacing, offsets):
        cells = found
    if not len(cells):
        raise ResolutionError(
            "The source has no point inside its own bounds: its closest points and bounds contradict each other."
        )
    codes = Codes.around(cells, 3)
    corners = codes.encode(cells)[:, None] + CORNERS @ codes.strides
    table, at = np.unique(corners, return_inverse=True)
    index = codes.decode(table)
    positions = np.asarray((index - offsets) * spacing)
    answer = source.closest_point(positions)
    away = positions - answer.points
    distance, normals = np.sqrt(dots(away, away)), unit(away)
    on = np.flatnonzero(distance < ON_SURFACE * spacing)
    beside = positions[on] + TRUSTED_DISTANCE * spacing * BESIDE
    normals[on] = unit(beside - source.closest_point(beside).points)
    if source.noise:
        near = np.flatnonzero(distance < KNOWN_NOISES * source.noise)
        feet, beside = feet_and_normals(source, positions[near], normals[near], spacing)
        below = dots(beside, positions[near] - feet) < 0
        normals[near] = np.where(below[:, None], -beside, beside)
    rim = answer.edge >= 0
    at = at.reshape(-1, 8)
    unlike = _unlike_edges(_unlike_cells(positions, answer.points, normals, distance, rim, at, spacing), at, len(table))
    return Nodes(spacing, offsets, codes, table, index, positions, answer.points, normals, distance, rim, unlike)


#: (8, 3) the corners of a cell.
CORNERS = np.stack(np.meshgrid(*[np.arange(2)] * 3, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int64)


def _unlike_cells(x: Floats, feet: Floats, n: Floats, d: Floats, rim: Bools, at: Ints, spacing: float) -> Bools:
    """Return the cells (c,) whose corners ``at`` (c, 8) do not all see the plane that the nearest sees."""
    trusted = d > TRUSTED_DISTANCE * spacing
    nearest = np.argmin(np.where(trusted[at], d[at], np.inf), axis=1)
    base = at[np.arange(len(at)), nearest][:, None]
    height = np.abs(dots(x[at] - feet[base], n[base]))
    alike = (np.abs(dots(n[at], n[base])) > ALIKE_COSINE) | ~trusted[at]
    alike &= (np.abs(height - d[at]) < ALIKE_DISTANCE * spacing) & ~rim[at]
    return np.asarray(~alike.all(axis=1))


def _unlike_edges(unlike: Bools, at: Ints, count: int) -> Bools:
    """Return the edges (count, 3) of the ``unlike`` cells."""
    edges = np.zeros((count, 3), dtype=bool)
    for axis in range(3):
        edges[at[unlike][:, CORNERS[:, axis] == 0], axis] = True
    return edges
