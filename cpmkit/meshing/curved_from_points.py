"""Quadratic cells from closest points: vertices are moved onto the manifold, and each edge gets a midpoint there.

A boundary is inserted along chords, and its vertices are moved onto it afterwards. Other vertices near the chords are
displaced along with the boundary, so that no thin triangle between turns over.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.projected_boundary import nearest_on_projection
from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.adjacency import Rim, rim_of_edges, rim_of_vertices
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.subdivision import split_at_knot_planes
from cpmkit.meshing.sharp_creases import sharpen_midpoints, sharpen_vertices
from cpmkit.meshing.untangling import flip_chords, remove_double_boundary_edges, untangle_midpoints, untangle_vertices
from cpmkit.types import Bools, Floats, Ints

#: A midpoint of a chord whose closest point is farther than this share of the chord stays there: the chord crosses a
#: crease.
CREASED_EDGE_SHARE = 0.15
#: A vertex moves onto its boundary if that is nearer than this share of the longest edge there (smooth: the shortest).
ONTO_BOUNDARY_EDGE_SHARE = 0.3


def curve_cells_by_closest_points(
    mesh: Mesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = (), spacing: float | None = None
) -> Mesh:
    """Return quadratic cells with nodes on the manifold; nodes of facets on boundaries and rims lie on these.

    Nodes of creased edges lie on creases; midpoints of edges across creases stay on chords. Vertices far from their
    boundary, or whose triangles would turn over, stay off it. Edges are flipped where triangles beside boundaries are
    thin or would turn over, and at slivers with all corners on creases; facets on boundaries may be replaced.

    ``mesh``: flat cells near the manifold, subdivided, with the boundaries inserted. ``source``: the manifold.
    ``boundaries``: in the order of their numbers in ``mesh.owner``; None for a boundary that keeps its vertices.
    ``spacing``: spacing of the lattice: segments are split where the curve crosses its knot planes; None: no splits.
    """
    mesh = move_vertices_to_manifold(mesh, source, boundaries)
    if mesh.manifold_dim == 1:
        mesh = mesh if spacing is None else split_at_knot_planes(mesh, spacing, source)
        return add_midpoints(mesh, source, boundaries)
    sharp = sharpen_vertices(mesh, source)
    curved = add_midpoints(sharp, source, boundaries)
    return curved if sharp is mesh else sharpen_midpoints(curved, source)


def move_vertices_to_manifold(mesh: Mesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = ()) -> Mesh:
    """Return the mesh with its vertices on the manifold, rim vertices on its rim, boundary vertices on the boundaries.

    Vertices farther from their boundary than ``ONTO_BOUNDARY_EDGE_SHARE`` of their longest edge stay off it; facets
    past a tip lie on the manifold alone. Vertices beside boundaries are displaced too; facets and cells change where
    triangles would turn over. ``source`` is the manifold, ``boundaries`` as in :func:`curve_cells_by_closest_points`.
    """
    rim = rim_of_vertices(mesh)
    points = _project_to_manifold(source, mesh.vertices, rim)
    on_rim = np.zeros(len(points), dtype=bool)
    on_rim[rim.rows] = True
    on_boundaries = [boundary_vertices(mesh, owner) for owner in range(len(boundaries))]
    times = np.bincount(np.concatenate([on_rim.nonzero()[0], *on_boundaries]), minlength=len(points))
    if not times.any():
        return mesh.with_same_cells(vertices=points)
    reach = ONTO_BOUNDARY_EDGE_SHARE * extreme_edge_lengths(mesh, np.flatnonzero(times), np.maximum, 0.0)
    before = points.copy()
    for turn in range(4):  # alternating projections of vertices on several boundaries, or on one and the rim
        for vertices, boundary in zip(on_boundaries, boundaries, strict=True):
            rows = vertices if turn == 0 else vertices[times[vertices] > 1]
            if boundary is None or not len(rows):
                continue
            feet, _ = nearest_on_projection(boundary, source, points[rows])
            points[rows] = _project_to_manifold(source, feet.points, rim.subset(rows))
    too_far = norms(points - before) > reach
    points[too_far] = before[too_far]
    if mesh.manifold_dim == 2:
        mesh, released = remove_double_boundary_edges(mesh, before, points)
        points[released], times[released] = before[released], 0
    rows, neighbours = move_neighbours(mesh, before, points, times == 0)
    points[rows] = source.closest_point(neighbours).points
    mesh = mesh.with_same_cells(vertices=untangle_vertices(mesh, before, points))
    return flip_chords(mesh) if mesh.manifold_dim == 2 and len(mesh.cut) else mesh


def add_midpoints(mesh: Mesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = ()) -> Mesh:
    """Return the mesh with a midpoint for each edge, on the manifold and on the edge's boundary or rim.

    Midpoints of edges across creases are those of the chords.

    Arguments are those of :func:`curve_cells_by_closest_points`; vertices are on the manifold.
    """
    edges, length = mesh.edges, mesh.edge_lengths
    straight = 0.5 * (mesh.vertices[edges.ends[:, 0]] + mesh.vertices[edges.ends[:, 1]])
    positions = straight.copy()
    if mesh.manifold_dim == 2:
        on_cut = mesh.cut_edges
        for owner, boundary in enumerate(boundaries):
            rows = np.unique(on_cut[(mesh.owner == owner) & ~mesh.beyond_tip])
            if boundary is not None and len(rows):
                positions[rows] = nearest_on_projection(boundary, source, straight[rows])[0].points
    midpoints = straighten_creased_edges(_project_to_manifold(source, positions, rim_of_edges(mesh)), straight, length)
    if mesh.manifold_dim == 2 and len(mesh.cut):
        on_boundary = on_cut[~mesh.beyond_tip]
        arguments = midpoints, straight, source, lambda x: source.closest_point(x).points
        midpoints = straighten_creased_edges(untangle_midpoints(mesh, on_boundary, *arguments), straight, length)
    return mesh.with_same_cells(midpoints=midpoints[edges.of_cells])


def move_neighbours(mesh: Mesh, before: Floats, moved: Floats, may_move: Bools) -> tuple[Ints, Floats]:
    """Return the vertices (k,) beside boundaries that are displaced with the boundary, and their new positions (k, d).

    Each vertex gets the displacement of the nearest of the quarter points of facets on boundaries, reduced linearly to
    zero at a distance of half the longest facet. Vertices that would not move are left out; for segments, all are.
    ``before``, ``moved`` (v, d): the vertices, and the same with those on boundaries moved onto the true boundaries.
    ``may_move`` (v,): which vertices may move.
    """
    from scipy.spatial import cKDTree

    none = np.zeros(0, dtype=np.int64)
    edges = mesh.cut[~mesh.beyond_tip]
    if mesh.manifold_dim == 1 or not len(edges) or np.array_equal(before, moved):
        return none, before[none]
    shares = np.array([0.0, 0.25, 0.5, 0.75])[:, None, None]  # of an edge
    positions, displacements = (
        ((1 - shares) * values[edges[:, 0]] + shares * values[edges[:, 1]]).reshape(-1, mesh.dim)
        for values in (before, moved - before)
    )
    reach = 0.5 * float(norms(before[edges[:, 1]] - before[edges[:, 0]]).max())
    used = np.zeros(len(before), dtype=bool)
    used[mesh.cells] = True
    rows = np.flatnonzero(may_move & used)
    distance, nearest = cKDTree(positions).query(before[rows], distance_upper_bound=reach)
    within = np.isfinite(distance)
    displacement = (1 - distance[within] / reach)[:, None] * displacements[nearest[within]]
    moving = np.flatnonzero(displacement.any(axis=1))
    rows = rows[within][moving]
    return rows, before[rows] + displacement[moving]


def boundary_vertices(mesh: Mesh, owner: int) -> Ints:
    """Return the vertices (k,) on boundary ``owner``, without vertices only on its continuations past tips."""
    return np.unique(mesh.cut[(mesh.owner == owner) & ~mesh.beyond_tip])


def extreme_edge_lengths(mesh: Mesh, rows: Ints, extreme: np.ufunc, none: float) -> Floats:
    """Return the ``extreme`` (np.minimum, np.maximum) edge length (v,) at vertices ``rows``, ``none`` elsewhere."""
    chosen = np.zeros(len(mesh.vertices), dtype=bool)
    chosen[rows] = True
    lengths = np.full(len(mesh.vertices), none)
    edges = np.flatnonzero(chosen[mesh.edges.ends].any(axis=1))
    for end in mesh.edges.ends[edges].T:
        extreme.at(lengths, end, mesh.edge_lengths[edges])
    lengths[~chosen] = none
    return lengths


def straighten_creased_edges(midpoints: Floats, straight: Floats, length: Floats) -> Floats:
    """Return the ``midpoints`` (e, d) of edges, replaced by midpoints ``straight`` (e, d) of chords across creases.

    An edge crosses a crease if the two differ by more than ``CREASED_EDGE_SHARE`` of its ``length`` (e,).
    """
    return np.where((norms(midpoints - straight) > CREASED_EDGE_SHARE * length)[:, None], straight, midpoints)


def _project_to_manifold(source: LocalSource, points: Floats, rim: Rim) -> Floats:
    """Return the closest points (n, d) of ``points`` (n, d); those of the rows in ``rim`` lie on the manifold's rim.

    For these rows the points are moved outwards, by up to four edge lengths, until their closest point is on a rim.
    """
    positions = np.array(points)
    positions[rim.rows] += 1e-6 * rim.outward  # beyond rounding
    closest = source.closest_point(positions)
    moved = np.array(closest.points)
    remaining = np.flatnonzero(closest.edge[rim.rows] < 0)
    for share in (0.5, 1.0, 2.0, 4.0):  # of the edge length
        if not len(remaining):
            break
        rows = rim.rows[remaining]
        beyond = source.closest_point(np.ascontiguousarray(points[rows] + share * rim.outward[remaining]))
        on_rim = beyond.edge >= 0
        moved[rows[on_rim]] = beyond.points[on_rim]
        remaining = remaining[~on_rim]
    return moved
