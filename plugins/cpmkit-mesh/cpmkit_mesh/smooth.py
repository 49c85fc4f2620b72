"""A mesh as a sample of a smooth surface: feet along normals interpolated between the vertices."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, run_parcels, unit
from cpmkit_mesh.topology import Topology
from cpmkit_mesh.tree import Nearest, Tree, as_frames

#: Cosine of the turn of a boundary loop above which a vertex is a corner, not the sample of a smooth curve.
CORNER_COSINE = np.cos(np.deg2rad(45.0))


@dataclass(frozen=True, eq=False)
class SmoothPart:
    """What the walk along interpolated normals reads, in the order of a tree's slots.

    Attributes
    ----------
    normals : (m, 3, 3) float64
        The normal at the first corner and its changes towards the others.
    neighbours : (m, 3) int64
        As in :class:`Topology`, triangles by their slots.
    rim : five arrays
        For each boundary edge its ends, normals and tangents (k, 2, 3), the edge end that each of
        its ends touches (k, 2), and its slot and edge in the triangle (k, 2).
    tiny : float
        Distance at which a query counts as on the mesh.
    """

    normals: Floats
    neighbours: Ints
    rim: tuple[Floats, Floats, Floats, Ints, Ints]
    tiny: float


def smooth_part(vertices: Floats, adjacency: Topology, normals_at_corners: Floats, order: Ints) -> SmoothPart:
    """Return the arrays for the triangles in the given ``order`` of slots."""
    slot = np.empty(len(order), dtype=np.int64)
    slot[order] = np.arange(len(order))
    neighbours = adjacency.neighbours[order]
    inner = neighbours >= 0
    neighbours[inner] = slot[neighbours[inner]]
    return SmoothPart(
        normals=as_frames(normals_at_corners[order]),
        neighbours=neighbours,
        rim=_rim(vertices, adjacency, normals_at_corners, slot),
        tiny=_tiny(vertices),
    )


def moved_smooth_part(part: SmoothPart, vertices: Floats, adjacency: Topology) -> SmoothPart:
    """Return the arrays of a mesh that was moved, in the same order of slots."""
    return replace(part, rim=(vertices[adjacency.boundary], *part.rim[1:]), tiny=_tiny(vertices))


def _tiny(vertices: Floats) -> float:
    return 1e-13 * float(np.ptp(vertices, axis=0).max()) + 4e-16 * float(np.abs(vertices).max())


def follow_normals(tree: Tree, part: SmoothPart, x: Floats, found: Nearest) -> Bools:
    """Move the nearest points in ``found`` to the feet along interpolated normals; return (n,) the doubtful ones."""
    from cpmkit_mesh import walk_kernels

    doubtful = np.empty(len(x), dtype=np.bool_)
    mesh = (tree.frames, part.normals, part.neighbours)
    arrays = (part.tiny, mesh, part.rim, found.slot, found.local, found.foot, found.distance, doubtful)
    run_parcels(lambda start, stop: walk_kernels.follow(x, start, stop, *arrays), len(x))
    return doubtful


def _rim(
    vertices: Floats, adjacency: Topology, normals_at_corners: Floats, slot: Ints
) -> tuple[Floats, Floats, Floats, Ints, Ints]:
    ends = vertices[adjacency.boundary]
    face, edge = adjacency.boundary_face, adjacency.boundary_edge
    normals = np.stack([normals_at_corners[face, (edge + 1) % 3], normals_at_corners[face, (edge + 2) % 3]], axis=1)
    links = _links(adjacency.boundary)
    tangents = _tangents(unit(ends[:, 1] - ends[:, 0]), links)
    return ends, normals, tangents, links, np.stack([slot[face], edge], axis=1)


def _links(boundary: Ints) -> Ints:
    """Return (k, 2) the edge end 2 edge + end that touches each edge end; -1 where not exactly two meet."""
    vertex = boundary.ravel()
    order = np.argsort(vertex, kind="stable")
    first = np.flatnonzero(np.diff(vertex[order], prepend=-1))
    pairs = first[np.diff(np.r_[first, len(vertex)]) == 2]
    links = np.full(len(vertex), -1)
    links[order[pairs]], links[order[pairs + 1]] = order[pairs + 1], order[pairs]
    return links.reshape(-1, 2)


def _tangents(direction: Floats, links: Ints) -> Floats:
    """Return (k, 2, 3) tangents at both ends of each boundary edge: the mean of two edges, but at corners."""
    beyond = direction[links // 2]
    towards = np.where(links % 2 == np.array([1, 0]), 1.0, -1.0)
    beyond = beyond * towards[:, :, None]
    directions = np.repeat(direction[:, None, :], 2, axis=1)
    smooth = (links >= 0) & (np.einsum("kej,kej->ke", directions, beyond) > CORNER_COSINE)
    return np.where(
        smooth[:, :, None], unit((directions + beyond).reshape(-1, 3)).reshape(directions.shape), directions
    )
