"""Moving a mesh onto the manifold: vertices to their feet, and a midpoint for each edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms
from cpmkit.mesh.adjacency import Rim, rim_of_edges, rim_of_vertices
from cpmkit.mesh.mesh import Edges, Mesh, edges_of, edges_on_cut
from cpmkit.mesh.subdivision import split_at_knot_planes
from cpmkit.meshing.boundary_edges import flip_chords, remove_double_boundary_edges
from cpmkit.meshing.untangle_midpoints import untangle_midpoints
from cpmkit.meshing.untangle_vertices import untangle_vertices
from cpmkit.protocols import Bools, Floats, Ints

#: Vertices go along as far as this share of the longest edge of a boundary from it, less and less.
REACH_EDGE_SHARE = 0.5
#: Points of an edge between which the way of its ends is interpolated.
SHARES = np.array([0.0, 0.25, 0.5, 0.75])


def move_neighbours(mesh: Mesh, before: Floats, moved: Floats, free: Bools) -> tuple[Ints, Floats]:
    """Return the ``free`` vertices (v,) of triangles beside edges on boundaries, (k,), and where these carry them.

    Parameters
    ----------
    mesh : SampleMesh
        With edges on boundaries.
    before, moved : (v, d) float64
        Its vertices, and the same with those on boundaries moved onto these.
    free : (v,) bool
        Those that may go along.
    """
    from scipy.spatial import cKDTree

    none = np.zeros(0, dtype=np.int64)
    edges = mesh.cut[~mesh.beyond_tip]
    if mesh.manifold_dim == 1 or not len(edges) or np.array_equal(before, moved):
        return none, before[none]
    shares = SHARES[:, None, None]
    places, ways = (
        ((1 - shares) * one[edges[:, 0]] + shares * one[edges[:, 1]]).reshape(-1, mesh.dim)
        for one in (before, moved - before)
    )
    reach = REACH_EDGE_SHARE * float(norms(before[edges[:, 1]] - before[edges[:, 0]]).max())
    used = np.zeros(len(before), dtype=bool)
    used[mesh.cells] = True
    rows = np.flatnonzero(free & used)
    distance, nearest = cKDTree(places).query(before[rows], distance_upper_bound=reach)
    near = np.isfinite(distance)
    share = 1 - distance[near] / reach
    way = share[:, None] * ways[nearest[near]]
    going = np.flatnonzero(way.any(axis=1))
    rows = rows[near][going]
    return rows, before[rows] + way[going]


#: A midpoint whose foot is farther from it than this share of its edge stays on the chord: there is a crease.
CREASED_EDGE_SHARE = 0.15
#: The rim is looked for beyond that of the mesh: by as much as rounding, then by so much of the edge there.
ON_RIM_EDGE_SHARE, RIM_EDGE_SHARES = 1e-6, (0.5, 1.0, 2.0, 4.0)
#: A vertex moves onto its boundary if that is nearer than this share of the longest edge there.
ONTO_BOUNDARY_EDGE_SHARE = 0.3
#: How often a vertex that has to lie on several things is moved from one to the next.
PROJECTION_ROUNDS = 4


def curve_from_points(
    mesh: Mesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = (), spacing: float | None = None
) -> Mesh:
    """Return quadratic cells on the manifold, with their facets on boundaries and on the rim where those lie.

    Parameters
    ----------
    mesh : SampleMesh
        Flat cells near the manifold, split and cut.
    source : LocalSource
        The manifold.
    boundaries : sequence of LocalSource
        By their number in ``mesh.owner``; None where a boundary stays where the mesh has it.
    spacing : float, optional
        Of the lattice: segments are split where the curve crosses its knot planes.
    """
    mesh = move_vertices_to_manifold(mesh, source, boundaries)
    if mesh.manifold_dim == 1 and spacing is not None:
        mesh = split_at_knot_planes(mesh, spacing, source)
    return add_midpoints(mesh, source, boundaries)


def move_vertices_to_manifold(mesh: Mesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = ()) -> Mesh:
    """Return the mesh with its vertices on the manifold: those of the rim on its rim, those of boundaries on these.

    What extends a boundary past its tip lies on the manifold alone.
    """
    edges = edges_of(mesh)
    rim = rim_of_vertices(mesh, edges)
    points = _to_manifold(source, mesh.vertices, rim)
    for_rim = np.zeros(len(points), dtype=bool)
    for_rim[rim.rows] = True
    on = [boundary_vertices(mesh, owner) for owner in range(len(boundaries))]
    times = np.bincount(np.concatenate([for_rim.nonzero()[0], *on]), minlength=len(points))
    if not times.any():
        return replace(mesh, vertices=points)
    reach = ONTO_BOUNDARY_EDGE_SHARE * longest_edges(mesh, edges, np.flatnonzero(times))
    before = points.copy()
    for turn in range(PROJECTION_ROUNDS):
        for rows, boundary in zip(on, boundaries, strict=True):
            target = rows if turn == 0 else rows[times[rows] > 1]
            if boundary is None or not len(target):
                continue
            onto = boundary.closest_point(points[target]).points
            points[target] = _to_manifold(source, onto, rim.among(target))
    astray = norms(points - before) > reach
    points[astray] = before[astray]
    if mesh.manifold_dim == 2:
        mesh, left = remove_double_boundary_edges(mesh, edges, before, points)
        points[left], times[left] = before[left], 0
    rows, beside = move_neighbours(mesh, before, points, times == 0)
    points[rows] = source.closest_point(beside).points
    mesh = replace(mesh, vertices=untangle_vertices(mesh, before, points))
    return flip_chords(mesh, edges) if mesh.manifold_dim == 2 and len(mesh.cut) else mesh


def add_midpoints(mesh: Mesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = ()) -> Mesh:
    """Return the mesh with a point of the manifold for each edge, the same for all cells that have the edge."""
    edges = edges_of(mesh)
    straight = 0.5 * (mesh.vertices[edges.ends[:, 0]] + mesh.vertices[edges.ends[:, 1]])
    length, target = edges.lengths(mesh.vertices), straight.copy()
    rim = rim_of_edges(mesh, edges)
    if mesh.manifold_dim == 2:
        number = edges_on_cut(mesh, edges)
        for owner, boundary in enumerate(boundaries):
            rows = np.unique(number[(mesh.owner == owner) & ~mesh.beyond_tip])
            if boundary is not None and len(rows):
                target[rows] = boundary.closest_point(straight[rows]).points
    found = _uncreased(_to_manifold(source, target, rim), straight, length)
    if mesh.manifold_dim == 2 and len(mesh.cut):
        own = number[~mesh.beyond_tip]
        found = untangle_midpoints(mesh, edges, own, found, straight, source, lambda x: source.closest_point(x).points)
        found = _uncreased(found, straight, length)
    return replace(mesh, midpoints=found[edges.of_cells])


def _uncreased(found: Floats, straight: Floats, length: Floats) -> Floats:
    """Return the midpoints ``found`` (n, d), or those of the chords where these are too far off."""
    return np.where((norms(found - straight) > CREASED_EDGE_SHARE * length)[:, None], straight, found)


def _to_manifold(source: LocalSource, points: Floats, rim: Rim) -> Floats:
    """Return the feet (n, d) of ``points``; those of the rim from farther and farther out, until they are on a rim."""
    target = np.array(points)
    target[rim.rows] += ON_RIM_EDGE_SHARE * rim.outward
    feet = source.closest_point(target)
    moved = np.array(feet.points)
    left = np.flatnonzero(feet.edge[rim.rows] < 0)
    for share in RIM_EDGE_SHARES:
        if not len(left):
            break
        rows = rim.rows[left]
        beyond = source.closest_point(np.ascontiguousarray(points[rows] + share * rim.outward[left]))
        found = beyond.edge >= 0
        moved[rows[found]] = beyond.points[found]
        left = left[~found]
    return moved


def boundary_vertices(mesh: Mesh, owner: int) -> Ints:
    """Return the vertices on a boundary, but for those that are on its extensions alone."""
    return np.unique(mesh.cut[(mesh.owner == owner) & ~mesh.beyond_tip])


def longest_edges(mesh: Mesh, edges: Edges, rows: Ints) -> Floats:
    """Return (v,) the length of the longest edge at each of the vertices ``rows``, zero at others."""
    return _extreme_edges(mesh, edges, rows, np.maximum, 0.0)


def shortest_edges(mesh: Mesh, edges: Edges, rows: Ints) -> Floats:
    """Return (v,) the length of the shortest edge at each of the vertices ``rows``, infinity at others."""
    return _extreme_edges(mesh, edges, rows, np.minimum, np.inf)


def _extreme_edges(mesh: Mesh, edges: Edges, rows: Ints, extreme: np.ufunc, none: float) -> Floats:
    """Return (v,) the ``extreme`` of the lengths of the edges at each of the vertices ``rows``, ``none`` at others."""
    target = np.zeros(len(mesh.vertices), dtype=bool)
    target[rows] = True
    found = np.full(len(mesh.vertices), none)
    near = np.flatnonzero(target[edges.ends].any(axis=1))
    length = edges.lengths(mesh.vertices)[near]
    for end in edges.ends[near].T:
        extreme.at(found, end, length)
    found[~target] = none
    return found
