"""The feet of a query on every sheet of a mesh: the local minima of the distance over its triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, run_parcels, unit
from cpmkit_mesh.directions import face_normals
from cpmkit_mesh.topology import Topology
from cpmkit_mesh.tree import Nearest, Tree, nearest_in

#: Feet nearer to each other than this share of their distance, or of the mesh's size, are one.
SAME_FOOT_DISTANCE_SHARE, SAME_FOOT_SIZE_SHARE = 1e-6, 1e-9


@dataclass(frozen=True, eq=False)
class VertexPatches:
    """Which triangles meet at each vertex, by the slots of a tree.

    Attributes
    ----------
    vertices : (m, 3) int64
        Of the triangle in each slot.
    first : (k + 1,) int64
        ``around[first[v]:first[v + 1]]`` are the slots around vertex v.
    around : (3 m,) int64
    cones : (nodes, 5) float64
        Axis, cosine and sine of a cone that holds the normals in each box of the tree; cosine 0 where there is none.
    """

    vertices: Ints
    first: Ints
    around: Ints
    cones: Floats


@dataclass(frozen=True, eq=False)
class LocalMinima:
    """Local minima of the distance: the row of the query and the foot of each, and how many triangles were measured."""

    rows: Ints
    found: Nearest
    measured: int


def patches(tree: Tree, positions: Floats, faces: Ints, adjacency: Topology) -> VertexPatches:
    """Return the patches of ``faces`` (m, 3) between vertices at ``positions`` (k, 3)."""
    from cpmkit_mesh import building_kernels

    vertices = faces[tree.order]
    corner = vertices.ravel()
    first = np.r_[0, np.cumsum(np.bincount(corner, minlength=len(positions)))]
    cones = building_kernels.bound_normals(tree.nodes, vertices, *_around_vertices(positions, faces, adjacency))
    return VertexPatches(vertices, first, np.argsort(corner, kind="stable") // 3, cones)


def _around_vertices(positions: Floats, faces: Ints, adjacency: Topology) -> tuple[Floats, Floats]:
    """Return an axis (k, 3) at each vertex and the angle (k,) from it within which the normals of its triangles lie.

    The way from a local minimum at a vertex, or on an edge, is a mix of these normals with weights above zero, where
    they are all within a right angle of one direction. Where the mesh ends or branches it is not: the angle is pi.
    """
    normal_of_corner, corner = np.repeat(face_normals(positions, faces), 3, axis=0), faces.ravel()
    axes = unit(np.stack([np.bincount(corner, normal_of_corner[:, k], len(positions)) for k in range(3)], axis=1))
    angles = np.zeros(len(positions))
    np.maximum.at(angles, corner, np.arccos(np.clip(np.einsum("ij,ij->i", axes[corner], normal_of_corner), -1.0, 1.0)))
    angles[faces[(adjacency.neighbours < 0).any(axis=1)]] = np.pi
    return axes, angles if adjacency.consistent else np.full(len(angles), np.pi)


def local_minima(tree: Tree, around: VertexPatches, x: Floats, radius: float) -> LocalMinima:
    """Return the local minima of the distance from each row of ``x`` (n, 3), up to ``radius``, by ascending rows."""
    from cpmkit_mesh import tree_kernels

    meeting = (around.vertices, around.first, around.around)
    arrays = (radius, tree.boxes, tree.nodes, tree.frames, tree.shape, meeting, around.cones)
    answers = {}

    def work(start: int, stop: int) -> None:
        answers[start] = tree_kernels.minima(x, start, stop, *arrays)

    run_parcels(work, len(x))
    parts = [answers[start] for start in sorted(answers)]
    rows, slot = (np.concatenate([np.zeros(0, dtype=np.int64), *[part[k] for part in parts]]) for k in range(2))
    found, measured = nearest_in(tree, x[rows], slot), sum(part[2] for part in parts)
    within = found.distance <= radius
    return LocalMinima(rows[within], records_at(found, within), measured)


def with_nearest(nearest: Nearest, radius: float, further: LocalMinima) -> LocalMinima:
    """Return the nearest point of each query within ``radius``, then its other minima by their distance.

    Of several triangles that share the nearest point the search may name another than the minima do.
    """
    near = np.flatnonzero(nearest.distance <= radius)
    rows, behind = np.concatenate([near, further.rows]), np.repeat([False, True], [len(near), len(further.rows)])
    both = [(getattr(nearest, name)[near], getattr(further.found, name)) for name in nearest.__dataclass_fields__]
    found = Nearest(*[np.concatenate(pair) for pair in both])
    order = np.lexsort((found.distance, behind, rows))
    return LocalMinima(rows[order], records_at(found, order), further.measured)


def records_at(found: Nearest, index: Ints | Bools) -> Nearest:
    """Return the records at ``index``."""
    return Nearest(found.slot[index], found.local[index], found.foot[index], found.distance[index])


def distinct(x: Floats, rows: Ints, found: Nearest, size: float) -> Bools:
    """Return (k,) True for the first foot of each of ``rows``, ascending, at each place of a mesh of that ``size``.

    Others are left out, and so are those that are nearer to ``x`` (n, 3) than the minimum that they started from: they
    have left its surroundings.
    """
    from cpmkit_mesh import tree_kernels

    kept = np.empty(len(rows), dtype=np.bool_)
    tree_kernels.distinct(rows, found.foot, found.distance, SAME_FOOT_DISTANCE_SHARE, SAME_FOOT_SIZE_SHARE * size, kept)
    reach = np.linalg.norm(x[rows] - found.foot, axis=1)
    return np.asarray(kept & (reach >= (1.0 - SAME_FOOT_DISTANCE_SHARE) * found.distance - SAME_FOOT_SIZE_SHARE * size))
