"""All local minima of the distance from a query to a mesh: one for each sheet of the surface, and now and then more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, run_parcels, unit
from cpmkit_mesh.box_tree import BoxTree, Nearest, project_onto_primitives
from cpmkit_mesh.face_geometry import face_normals
from cpmkit_mesh.topology import Topology

#: Minima nearer to each other than this share of their distance, or of the mesh's size, are one.
SAME_POINT_DISTANCE_SHARE, SAME_POINT_SIZE_SHARE = 1e-6, 1e-9


@dataclass(frozen=True, eq=False)
class VertexTriangles:
    """The triangles around each vertex, by the slots of a tree, and cones that bound their normals.

    Attributes
    ----------
    vertices : (m, 3) int64
        The corners of the triangle in each slot.
    first : (k + 1,) int64
        Positions in ``around``; k vertices.
    around : (3 m,) int64
        ``around[first[v] : first[v + 1]]`` are the slots of the triangles around vertex v.
    cones : (nodes, 5) float64
        Axis, cosine and sine of a cone that contains the normals in each box of the tree; cosine 0 where there is none.
    """

    vertices: Ints
    first: Ints
    around: Ints
    cones: Floats


@dataclass(frozen=True, eq=False)
class LocalMinima:
    """Local minima of the distance.

    Attributes
    ----------
    rows : (k,) int64
        The query of each minimum, as a row of the queries, ascending.
    points : Nearest
        The points of the surface at which the distance has the minima.
    measured : int
        The number of triangles whose distance was computed.
    """

    rows: Ints
    points: Nearest
    measured: int


def vertex_triangles(tree: BoxTree, positions: Floats, faces: Ints, adjacency: Topology) -> VertexTriangles:
    """Return, for :func:`local_minima`, the slots of the triangles at each vertex and cones of normals by tree node.

    ``tree`` is built over the triangles ``faces`` (m, 3) between vertices at ``positions`` (k, 3); ``adjacency`` is
    that of the triangles.
    """
    from cpmkit_mesh import box_tree_kernels

    vertices = faces[tree.order]
    corner = vertices.ravel()
    first = np.r_[0, np.cumsum(np.bincount(corner, minlength=len(positions)))]
    cones = box_tree_kernels.bound_normals(tree.nodes, vertices, *_vertex_cones(positions, faces, adjacency))
    return VertexTriangles(vertices, first, np.argsort(corner, kind="stable") // 3, cones)


def _vertex_cones(positions: Floats, faces: Ints, adjacency: Topology) -> tuple[Floats, Floats]:
    """Return axes (k, 3) and angles (k,), in radians, of cones about the normals of the triangles at each vertex.

    At a local minimum at a vertex or on an edge the direction to the query is a mean, with positive weights, of these
    normals, where they all lie within a right angle of one direction. At rims and branches it need not be: the angle is
    pi at all corners of the triangles there, and everywhere if the winding is inconsistent.
    """
    normal_of_corner, corner = np.repeat(face_normals(positions, faces), 3, axis=0), faces.ravel()
    axes = unit(np.stack([np.bincount(corner, normal_of_corner[:, k], len(positions)) for k in range(3)], axis=1))
    angles = np.zeros(len(positions))
    np.maximum.at(angles, corner, np.arccos(np.clip(np.einsum("ij,ij->i", axes[corner], normal_of_corner), -1.0, 1.0)))
    angles[faces[(adjacency.neighbours < 0).any(axis=1)]] = np.pi
    return axes, angles if adjacency.consistent else np.full(len(angles), np.pi)


def local_minima(tree: BoxTree, triangles: VertexTriangles, x: Floats, radius: float) -> LocalMinima:
    """Return local minima, up to ``radius``, of the distance from each of ``x`` (n, 3) to the triangles in ``tree``.

    ``triangles`` is the answer of :func:`vertex_triangles` for this tree. Minima of one query are in no special order.
    """
    from cpmkit_mesh import query_kernels

    meeting = (triangles.vertices, triangles.first, triangles.around)
    arrays = (radius, tree.boxes, tree.nodes, tree.frames, tree.shape, meeting, triangles.cones)
    answers = {}

    def work(start: int, stop: int) -> None:
        answers[start] = query_kernels.find_local_minima(x, start, stop, *arrays)

    run_parcels(work, len(x))
    parts = [answers[start] for start in sorted(answers)]
    rows, slot = (np.concatenate([np.zeros(0, dtype=np.int64), *[part[k] for part in parts]]) for k in range(2))
    points, measured = project_onto_primitives(tree, x[rows], slot), sum(part[2] for part in parts)
    within = points.distance <= radius
    return LocalMinima(rows[within], points.take(within), measured)


def merge_nearest(nearest: Nearest, radius: float, minima: LocalMinima) -> LocalMinima:
    """Return the nearest point of each query within ``radius``, then its local ``minima`` by increasing distance.

    ``nearest`` has a row for each query. The nearest point occurs twice for most queries, since it is a minimum too: of
    several triangles that share it, the search may name another than the minima do.
    """
    in_reach = np.flatnonzero(nearest.distance <= radius)
    rows, is_other = (
        np.concatenate([in_reach, minima.rows]),
        np.repeat([False, True], [len(in_reach), len(minima.rows)]),
    )
    both = [(getattr(nearest, name)[in_reach], getattr(minima.points, name)) for name in nearest.__dataclass_fields__]
    points = Nearest(*[np.concatenate(pair) for pair in both])
    order = np.lexsort((points.distance, is_other, rows))
    return LocalMinima(rows[order], points.take(order), minima.measured)


def distinct_minima(x: Floats, rows: Ints, points: Nearest, size: float) -> Bools:
    """Return (k,) whether each minimum is to be kept: no earlier minimum of its query lies at the same point.

    ``rows`` (k,), ascending, are the queries of the minima, rows of ``x`` (n, 3); ``points`` are the minima after a
    move along normals, with their distances before it; ``size`` is the longest side of the mesh's bounding box. Minima
    that are nearer to their query after the move are left out too: they are on another sheet.
    """
    from cpmkit_mesh import query_kernels

    tolerances = SAME_POINT_DISTANCE_SHARE, SAME_POINT_SIZE_SHARE * size
    first = np.empty(len(rows), dtype=np.bool_)
    query_kernels.mark_distinct_minima(rows, points.point, points.distance, *tolerances, first)
    reach = np.linalg.norm(x[rows] - points.point, axis=1)
    return np.asarray(first & (reach >= (1.0 - tolerances[0]) * points.distance - tolerances[1]))
