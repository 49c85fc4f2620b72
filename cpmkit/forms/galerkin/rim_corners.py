"""Reentrant corners of the rim of a surface: sectors around them, and a warning on thin necks that begin there.

At such a corner u behaves like a root of the distance times a function of the angle. Near voids, sectors around each
corner become charts of their own, so that different splines represent different angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.galerkin.chart_kernels import FACING_COSINE
from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.vector_algebra import dots, nearest_shares, norms, unit
from cpmkit.mesh.adjacency import Rim, rim_of_edges
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Bools, Floats, Ints

#: A corner of the rim is reentrant if its interior angle, in degrees, is above the first number. Sectors have at most
#: the second angle: three at a right angle, four at the end of a slit.
REENTRANT_DEGREES, SECTOR_DEGREES = 240.0, 100.0
#: Sectors reach up to the first distance from their corner, in spacings: a comb of slots of .2 spacings has an error of
#: 1.5 percent in its first eigenvalue with .5, .1 with 1, .14 with 1.5. Cells up to the second distance have charts
#: too, which cut sectors off all around: without, the errors of some slots and necks are twice as large.
SECTOR_SPACINGS, RING_SPACINGS = 1.0, 1.5
#: A neck below this width, in spacings, is reported: two plates that it joins have an error in the first eigenvalue of
#: 2.5 percent where it is .1 to .2 spacings wide, 1.5 at .3, and 1.1 at .5.
NECK_SPACINGS = 1 / 3


@dataclass(frozen=True, eq=False)
class RimCorners:
    """Reentrant corners of the rim, and the two edges of the rim that meet at each."""

    places: Floats  #: (c, d): the corners.
    angles: Floats  #: (c,): the interior angles.
    along: Floats  #: (c, d): vectors along the first edges, away from the corners.
    inward: Floats  #: (c, 2, d): unit vectors into the surface, normal to the two edges.

    def sectors(self, points: Floats, spacing: float) -> tuple[Ints, Bools]:
        """Return the sector (n,) around the nearest corner of ``points`` (n, d), and whether a corner is near.

        The sector is -1 where all corners are farther than a spacing; a corner is near within 1.5 spacings.
        """
        from scipy.spatial import cKDTree

        distance, corner = cKDTree(self.places).query(points, distance_upper_bound=RING_SPACINGS * spacing)
        sector, inside = np.full(len(points), -1), np.flatnonzero(distance < SECTOR_SPACINGS * spacing)
        corner = corner[inside]
        offset, angle = points[inside] - self.places[corner], self.angles[corner]
        turn = np.arctan2(dots(offset, self.inward[corner, 0]), dots(offset, unit(self.along[corner])))
        count = np.ceil(angle / np.radians(SECTOR_DEGREES))
        number = np.minimum(turn % (2 * np.pi) / angle * count // 1, count - 1)
        sector[inside] = corner * (1 + count.max(initial=0)) + number
        return sector, np.isfinite(distance)


def reentrant_corners(mesh: Mesh, rim: Rim) -> RimCorners:
    """Return the reentrant corners of a mesh with the ``rim`` of :func:`rim_of_edges`."""
    ends, count = mesh.edges.ends[rim.rows], len(mesh.vertices)
    degree = np.bincount(ends.ravel(), minlength=count)
    cells = mesh.cells[(degree == 2)[mesh.cells].any(axis=1)]
    corners = mesh.vertices[cells]
    ahead, behind = (unit(np.roll(corners, shift, axis=1) - corners) for shift in (-1, 1))
    of_cells = np.arccos(np.clip(dots(ahead, behind), -1.0, 1.0))
    angle = np.asarray(np.bincount(cells.ravel(), of_cells.ravel(), count), dtype=np.float64)
    at, end = np.nonzero(((angle > np.radians(REENTRANT_DEGREES)) & (degree == 2))[ends])
    order = np.argsort(ends[at, end], kind="stable").reshape(-1, 2)
    at, vertex, other = at[order], ends[at, end][order], ends[at, 1 - end][order]
    along, vertex = (mesh.vertices[other] - mesh.vertices[vertex])[:, 0], vertex[:, 0]
    return RimCorners(mesh.vertices[vertex], angle[vertex], along, -unit(rim.outward[at]))


def neck_warnings(mesh: Mesh, lattice: Lattice, regions: Regions | None = None) -> Iterator[str]:
    """Yield a warning on very thin necks: at a corner where a neck begins, one edge of the rim faces a near rim.

    The other edge faces no rim so near: a strip of one width is no neck. ``regions`` give the local spacings.
    """
    if not mesh.connectivity.on_rim.any():
        return
    rim = rim_of_edges(mesh)
    corners = reentrant_corners(mesh, rim)
    if not len(corners.places):
        return
    width, other = np.sort(_widths_beside(mesh, rim, corners, lattice.spacing), axis=1).T
    level = 0 if regions is None else regions.levels_at(corners.places)
    thin = np.flatnonzero((width < NECK_SPACINGS * lattice.spacing / 2.0**level) & (other > 2 * width))
    if len(thin):
        worst = thin[width[thin].argmin()]
        yield (
            f"The surface is only {width[worst]:.2g} wide near {place(lattice.to_scene(corners.places[worst]))}, less "
            "than a third of the spacing, where this neck joins a wider part: what flows through it may be off by "
            f'about 3 percent; use spacing={2.5 * width[worst]:.2g} or less, or for steady problems refine="auto".'
        )


def _widths_beside(mesh: Mesh, rim: Rim, corners: RimCorners, spacing: float) -> Floats:
    """Return the distances (c, 2) through the surface from both edges at each corner to the rim; infinite if far."""
    from scipy.spatial import cKDTree

    start, end = mesh.vertices[mesh.edges.ends[rim.rows]].transpose(1, 0, 2)
    points = corners.places.repeat(2, axis=0)
    reach = 2 * NECK_SPACINGS * spacing + 0.5 * mesh.edge_lengths[rim.rows].max()
    near = cKDTree(points).sparse_distance_matrix(cKDTree(0.5 * (start + end)), reach, output_type="ndarray")
    row, edge = near["i"], near["j"]
    x, tail, way = points[row], start[edge], (end - start)[edge]
    offset = tail + nearest_shares(x - tail, way)[:, None] * way - x
    distance, width = norms(offset), np.full(len(points), np.inf)
    for normals in (corners.inward.reshape(-1, mesh.dim)[row], unit(rim.outward[edge])):
        distance[dots(offset, normals) <= FACING_COSINE * norms(offset)] = np.inf
    np.minimum.at(width, row, distance)
    return width.reshape(-1, 2)
