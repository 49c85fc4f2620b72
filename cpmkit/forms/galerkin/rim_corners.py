"""Reentrant corners of the rim of a surface, and a warning on thin necks that begin there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cpmkit.errors import place
from cpmkit.forms.galerkin.chart_kernels import FACING_COSINE
from cpmkit.forms.galerkin.refinement.regions import Regions
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.adjacency import Rim, rim_of_edges
from cpmkit.mesh.mesh import Mesh
from cpmkit.types import Floats

#: A corner of the rim is reentrant if its interior angle, in degrees, is above this.
REENTRANT_DEGREES = 240.0
#: A neck below this width, in spacings, is reported: the first eigenvalue of two plates that it joins is off by 4 to 5
#: percent.
NECK_SPACINGS = 1 / 3


@dataclass(frozen=True, eq=False)
class RimCorners:
    """Reentrant corners of the rim, and the two edges of the rim that meet at each."""

    places: Floats  #: (c, d)
    inward: Floats  #: (c, 2, d): unit vectors into the surface, normal to its edges.


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
    at, vertex = at[order], ends[at, end][order][:, 0]
    return RimCorners(mesh.vertices[vertex], -unit(rim.outward[at]))


def neck_warnings(mesh: Mesh, lattice: Lattice, regions: Regions | None = None) -> Iterator[str]:
    """Yield a warning on very thin necks: where one begins, the rim on one side of a corner faces a near rim.

    On the other side it faces none so near: a strip of one width is no neck. With ``regions`` spacings are those there.
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
            f'about 5 percent; use spacing={2.5 * width[worst]:.2g} or less, or for steady problems refine="auto".'
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
    offset = tail + np.clip(dots(x - tail, way) / dots(way, way), 0.0, 1.0)[:, None] * way - x
    distance, width = norms(offset), np.full(len(points), np.inf)
    for normals in (corners.inward.reshape(-1, mesh.dim)[row], unit(rim.outward[edge])):
        distance[dots(offset, normals) <= FACING_COSINE * norms(offset)] = np.inf
    np.minimum.at(width, row, distance)
    return width.reshape(-1, 2)
