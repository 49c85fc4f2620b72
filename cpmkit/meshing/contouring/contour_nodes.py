"""The nodes of a fine lattice around a surface, their closest points, and the cells where the surface is not planar."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.grid.lattice import Codes, cell_levels
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.types import Bools, Floats, Ints

#: Normals count as those of one plane if their cosines are at least this; with a larger bound smooth surfaces look
#: creased.
PLANE_COSINE = 0.8
#: A normal is computed from a closest point at least this share of the spacing away: for nearer ones it is rounding.
NORMAL_DISTANCE = 0.02
#: The least distance for a normal in units of the noise of closest points: the direction is then known to 1/20.
NORMAL_NOISES = 20.0
#: Where closest points are noisy, normals are computed from points moved off the surface by so many noises.
OFFSET_NOISES = 30.0
#: (8, 3) the corners of a cell relative to its lowest one.
CELL_CORNERS = np.stack(np.meshgrid(*[np.arange(2)] * 3, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int64)


@dataclass(frozen=True, eq=False)
class LatticeNodes:
    """The corners of the lattice cells that a surface may meet.

    Edge k of a node leads to its neighbour along axis k.
    """

    spacing: float  #: Spacing of this lattice.
    offsets: Floats  #: (3,): the shift of the lattice against the origin, in spacings.
    codes: Codes  #: The numbering of nodes and cells; a cell has the index of its lowest corner.
    table: Ints  #: (n,): the codes of the nodes, sorted.
    #: index, positions (n, 3): the nodes as integers, and their positions.
    index: Ints
    positions: Floats
    #: closest, normals (n, 3): the closest points of the nodes, and the unit vectors from these to the nodes.
    closest: Floats
    normals: Floats
    distance: Floats  #: (n,): distance of each node from its closest point.
    on_rim: Bools  #: (n,): whether the closest point lies on a rim of the surface.
    #: (n, 3): whether the edge from a node along each axis belongs to a cell in which the surface does not look planar.
    nonplanar: Bools

    @property
    def near_creases(self) -> Bools:
        """(n,) whether a node is within a spacing of the surface, in a cell where that is not planar or meets a rim."""
        return np.asarray(self.nonplanar.any(axis=1) & (self.distance < self.spacing))

    def position_of(self, index: Ints) -> Floats:
        """Return the positions (..., 3) of the nodes with integer coordinates ``index`` (..., 3)."""
        return np.asarray((index - self.offsets) * self.spacing)


def lattice_nodes(source: LocalSource, spacing: float, offsets: Floats) -> LatticeNodes:
    """Return the corners of all lattice cells that the surface may meet, with their closest points.

    The lattice has the ``spacing``, and is shifted against the origin by ``offsets`` (3,) spacings. Raises
    ResolutionError if the source has no point inside its bounds, or cells cannot be numbered.
    """
    for _, level in cell_levels(source, spacing, offsets):
        cells = level
    if not len(cells):
        raise ResolutionError(
            "The source has no point inside its own bounds: its closest points and bounds contradict each other."
        )
    codes = Codes.from_points(cells, 3)
    corners = codes.encode(cells)[:, None] + CELL_CORNERS @ codes.strides
    table, corner_nodes = np.unique(corners, return_inverse=True)
    index = codes.decode(table)
    positions = np.asarray((index - offsets) * spacing)
    answer = source.closest_point(positions)
    away = positions - answer.points
    distance, normals = np.sqrt(dots(away, away)), unit(away)
    # Nodes on the surface are taken to lie on one side of it. The direction avoids planes of symmetry and of boxes.
    on_surface = np.flatnonzero(distance < 1e-6 * spacing)
    moved = positions[on_surface] + NORMAL_DISTANCE * spacing * np.array([0.1717, 0.2203, 0.2411])
    normals[on_surface] = unit(moved - source.closest_point(moved).points)
    if source.noise:
        uncertain = np.flatnonzero(distance < NORMAL_NOISES * source.noise)
        closest, better = closest_points_and_normals(source, positions[uncertain], normals[uncertain], spacing)
        below = dots(better, positions[uncertain] - closest) < 0
        normals[uncertain] = np.where(below[:, None], -better, better)
    on_rim, corner_nodes = answer.edge >= 0, corner_nodes.reshape(-1, 8)
    cell_is_nonplanar = _nonplanar_cells(positions, answer.points, normals, distance, on_rim, corner_nodes, spacing)
    nonplanar = np.zeros((len(table), 3), dtype=bool)
    for axis in range(3):
        nonplanar[corner_nodes[cell_is_nonplanar][:, CELL_CORNERS[:, axis] == 0], axis] = True
    return LatticeNodes(
        spacing, offsets, codes, table, index, positions, answer.points, normals, distance, on_rim, nonplanar
    )


def _nonplanar_cells(
    positions: Floats, closest: Floats, normals: Floats, distance: Floats, on_rim: Bools, corners: Ints, spacing: float
) -> Bools:
    """Return whether (c,) the surface in each cell, with nodes ``corners`` (c, 8), differs from a plane.

    In a planar cell the distances and normals of all corners agree with the tangent plane at the closest point of the
    nearest corner, and no closest point lies on a rim. The other arguments are fields of :class:`LatticeNodes`.
    """
    trusted = distance > NORMAL_DISTANCE * spacing
    nearest = np.argmin(np.where(trusted[corners], distance[corners], np.inf), axis=1)
    base = corners[np.arange(len(corners)), nearest][:, None]
    height = np.abs(dots(positions[corners] - closest[base], normals[base]))
    agrees = (np.abs(dots(normals[corners], normals[base])) > PLANE_COSINE) | ~trusted[corners]
    agrees &= (np.abs(height - distance[corners]) < 0.15 * spacing) & ~on_rim[corners]
    return np.asarray(~agrees.all(axis=1))


def closest_points_and_normals(
    source: LocalSource, points: Floats, directions: Floats, length: float
) -> tuple[Floats, Floats]:
    """Return closest points (n, 3) and unit normals (n, 3) of a noisy surface, from queries moved off the surface.

    ``points`` (n, 3): points near the surface.
    ``directions`` (n, 3): approximate normals, along which points are moved. Where such a step leads along the surface,
        the points are moved along the coordinate axis that leads farthest away from the surface.
    ``length``: the spacing; points are moved by at least a tenth of it.
    """
    step = max(OFFSET_NOISES * source.noise, 0.1 * length)
    moved = points + step * directions
    closest = source.closest_point(moved).points
    rows = np.flatnonzero(norms(moved - closest) < 0.6 * step)
    along_axes = points[rows] + step * np.eye(3)[:, None]
    closest_along_axes = source.closest_point(along_axes.reshape(-1, 3)).points.reshape(3, -1, 3)
    farthest = norms(along_axes - closest_along_axes).argmax(axis=0), np.arange(len(rows))
    moved[rows], closest[rows] = along_axes[farthest], closest_along_axes[farthest]
    return closest, unit(moved - closest)
