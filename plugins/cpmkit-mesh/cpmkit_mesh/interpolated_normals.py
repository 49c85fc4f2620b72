"""Closest points of the smooth surface that a mesh samples, along normals interpolated between its vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, run_parcels, unit
from cpmkit_mesh.box_tree import BoxTree, Nearest, as_frames
from cpmkit_mesh.topology import Topology

#: Cosine of the turn of a boundary loop above which a vertex is a corner, not the sample of a smooth curve.
CORNER_COSINE = np.cos(np.deg2rad(45.0))


@dataclass(frozen=True, eq=False)
class InterpolatedNormals:
    """Normals at the corners of triangles, and the paths from triangle to triangle, in the order of a tree's slots.

    Attributes
    ----------
    normals : (m, 3, 3) float64
        The normal at the first corner and the differences of the other two from it.
    neighbours : (m, 3) int64
        The slot across each edge; -2 - k for boundary edge k; -1 where three or more triangles share the edge.
    rim : five arrays
        For each boundary edge its ends, normals and tangents (k, 2, 3), the end of another boundary edge that each of
        its ends touches (k, 2) as 2 edge + end or -1, and its slot and the edge of the triangle (k, 2).
    tiny : float
        The distance up to which a query lies on the mesh.
    """

    normals: Floats
    neighbours: Ints
    rim: tuple[Floats, Floats, Floats, Ints, Ints]
    tiny: float


def interpolated_normals(
    vertices: Floats, adjacency: Topology, normals_at_corners: Floats, order: Ints
) -> InterpolatedNormals:
    """Return the normals and adjacency of triangles as :func:`follow_normals` reads them, by the slots of a tree.

    ``vertices`` (k, 3) are positions, ``adjacency`` that of the triangles, ``normals_at_corners`` (m, 3, 3) unit
    normals at their corners, and ``order`` (m,) the triangle in each slot.
    """
    slot = np.empty(len(order), dtype=np.int64)
    slot[order] = np.arange(len(order))
    neighbours = adjacency.neighbours[order]
    inner = neighbours >= 0
    neighbours[inner] = slot[neighbours[inner]]
    return InterpolatedNormals(
        normals=as_frames(normals_at_corners[order]),
        neighbours=neighbours,
        rim=_rim_arrays(vertices, adjacency, normals_at_corners, slot),
        tiny=_rounding_distance(vertices),
    )


def translate_normals(field: InterpolatedNormals, vertices: Floats, adjacency: Topology) -> InterpolatedNormals:
    """Return ``field`` for a mesh translated to ``vertices`` (k, 3), with the same ``adjacency`` and order of slots."""
    return replace(field, rim=(vertices[adjacency.boundary], *field.rim[1:]), tiny=_rounding_distance(vertices))


def _rounding_distance(vertices: Floats) -> float:
    """Return the rounding of distances between points of the size and at the position of ``vertices`` (k, 3)."""
    return 1e-13 * float(np.ptp(vertices, axis=0).max()) + 4e-16 * float(np.abs(vertices).max())


def follow_normals(tree: BoxTree, field: InterpolatedNormals, x: Floats, nearest: Nearest) -> Bools:
    """Move the points ``nearest``, in place, to points of triangles whose interpolated normal leads to ``x`` (n, 3).

    ``tree`` and ``field`` are those of the triangles. Return (n,) whether there is no such point near by: the nearest
    point stays then. Distances stay those from the triangles.
    """
    from cpmkit_mesh import interpolated_normals_kernels

    doubtful = np.empty(len(x), dtype=np.bool_)
    mesh = (tree.frames, field.normals, field.neighbours)
    arrays = (field.tiny, mesh, field.rim, nearest.slot, nearest.local, nearest.point, nearest.distance, doubtful)
    run_parcels(lambda start, stop: interpolated_normals_kernels.follow_normals(x, start, stop, *arrays), len(x))
    return doubtful


def _rim_arrays(
    vertices: Floats, adjacency: Topology, normals_at_corners: Floats, slot: Ints
) -> tuple[Floats, Floats, Floats, Ints, Ints]:
    """Return the five arrays of the boundary edges that :class:`InterpolatedNormals` describes.

    ``slot`` (m,) is the slot of each triangle, ``normals_at_corners`` (m, 3, 3) its normals.
    """
    ends = vertices[adjacency.boundary]
    face, edge = adjacency.boundary_face, adjacency.boundary_edge
    normals = np.stack([normals_at_corners[face, (edge + 1) % 3], normals_at_corners[face, (edge + 2) % 3]], axis=1)
    links = _rim_links(adjacency.boundary)
    tangents = _rim_tangents(unit(ends[:, 1] - ends[:, 0]), links)
    return ends, normals, tangents, links, np.stack([slot[face], edge], axis=1)


def _rim_links(boundary: Ints) -> Ints:
    """Return (k, 2) the other end, as 2 edge + end, at each end of ``boundary`` (k, 2), -1 unless there is just one."""
    vertex = boundary.ravel()
    order = np.argsort(vertex, kind="stable")
    first = np.flatnonzero(np.diff(vertex[order], prepend=-1))
    pairs = first[np.diff(np.r_[first, len(vertex)]) == 2]
    links = np.full(len(vertex), -1)
    links[order[pairs]], links[order[pairs + 1]] = order[pairs + 1], order[pairs]
    return links.reshape(-1, 2)


def _rim_tangents(direction: Floats, links: Ints) -> Floats:
    """Return (k, 2, 3) unit tangents at both ends of each boundary edge: the mean over the two edges that meet there.

    At corners (:data:`CORNER_COSINE`), and where not two edges meet, an edge has its own direction. ``direction``
    (k, 3) are the edges' unit vectors, ``links`` (k, 2) the touching ends as in :func:`_rim_links`.
    """
    beyond = direction[links // 2]
    towards = np.where(links % 2 == np.array([1, 0]), 1.0, -1.0)
    beyond = beyond * towards[:, :, None]
    directions = np.repeat(direction[:, None, :], 2, axis=1)
    smooth = (links >= 0) & (np.einsum("kej,kej->ke", directions, beyond) > CORNER_COSINE)
    return np.where(
        smooth[:, :, None], unit((directions + beyond).reshape(-1, 3)).reshape(directions.shape), directions
    )
