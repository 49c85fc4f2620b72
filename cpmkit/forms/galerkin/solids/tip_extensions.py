"""Continuations of boundaries inside a solid past their tips, the ends of curves or rims of surfaces.

A patch in which a boundary ends would have the same splines on both sides, so that u would be continuous before the
boundary ends. Therefore each boundary is continued straight on past its tips, where a condition makes u continuous.
"""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.meeting_curves import FlatCurve
from cpmkit.types import Bools, Floats, Ints

#: A boundary is continued over so many spacings, up to patches that share no spline with the patch of the tip.
EXTENDED_SPACINGS = 3.0
#: The direction of a curve at its end is that of a chord of this share of its last segment.
TANGENT_SHARE = 1e-3


def extended_curve_ends(mesh: Mesh, curve: LocalSource | FlatCurve, ends: Ints, length: float) -> Mesh:
    """Return segments of ``length`` that continue a ``curve`` straight on at the ``ends`` (k,) of its flat ``mesh``.

    Vertex 2 i is end i, and vertex 2 i + 1 is new; a segment has the direction of the curve's segment at the end.
    """
    cell, corner = _cells_at(mesh, ends)
    tips, behind = mesh.vertices[ends], mesh.vertices[mesh.cells[cell, 1 - corner]]
    near = curve.closest_point(tips + TANGENT_SHARE * (behind - tips)).points
    vertices = np.stack([tips, tips + length * unit(tips - near)], axis=1).reshape(-1, mesh.dim)
    pairs = np.arange(2 * len(ends)).reshape(-1, 2)
    return Mesh.of(vertices, np.where(corner[:, None] == 1, pairs, pairs[:, ::-1]))


def _cells_at(mesh: Mesh, ends: Ints) -> tuple[Ints, Ints]:
    """Return the cell (k,) of each of the vertices ``ends`` (k,), and the number (k,) of its corner there."""
    order = np.argsort(mesh.cells, axis=None, kind="stable")
    at = order[np.searchsorted(mesh.cells.ravel()[order], ends)]
    return np.divmod(at, mesh.cells.shape[1])


def with_extended_rims(mesh: Mesh, length: float) -> tuple[Mesh, Bools]:
    """Return triangles with a strip of width ``length`` added at their rim, and whether (m,) each triangle is new.

    The strip has two triangles at each edge of the rim, in the planes of the triangles there.
    """
    numbers = mesh.connectivity.facet_numbers
    cell, facet = np.nonzero(mesh.connectivity.on_rim[numbers])
    count = len(mesh.cells)
    if not len(cell):
        return mesh, np.zeros(count, dtype=bool)
    a, b = (mesh.cells[cell, (facet + k) % 3] for k in (1, 2))
    across = _outward(mesh, cell, a, b)
    rim, place = np.unique(np.stack([a, b]), return_inverse=True)
    place = place.reshape(2, -1)
    mean = np.zeros((len(rim), mesh.dim))
    for column in place:
        np.add.at(mean, column, across)
    new = len(mesh.vertices) + place
    cells = np.concatenate([mesh.cells, np.stack([b, a, new[0]], axis=1), np.stack([b, new[0], new[1]], axis=1)])
    vertices = np.concatenate([mesh.vertices, mesh.vertices[rim] + length * unit(mean)])
    midpoints = None
    if mesh.midpoints is not None:
        corners = vertices[cells[count:]]
        straight = 0.5 * (corners.sum(axis=1, keepdims=True) - corners)
        straight[: len(cell), 2] = mesh.midpoints[cell, facet]  # the edge that the strip shares with the rim
        midpoints = np.concatenate([mesh.midpoints, straight])
    return Mesh.of(vertices, cells, midpoints), np.arange(len(cells)) >= count


def _outward(mesh: Mesh, cell: Ints, a: Ints, b: Ints) -> Floats:
    """Return unit vectors (k, 3) out of triangles ``cell`` (k,), in their planes and normal to the edges a b (k,)."""
    corners = mesh.vertices[mesh.cells[cell]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return unit(np.cross(mesh.vertices[b] - mesh.vertices[a], normals))
