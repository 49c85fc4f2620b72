"""Surfaces in space that meet: quadratic triangles split where they meet another surface, with common edges there.

A triangle is split at points of its own quadratic geometry, so that its parts are the same surface. Vertices beside the
curve where surfaces meet are first moved along an edge onto it, so that no part is thin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.mesh import Mesh
from cpmkit.meshing.common_edges import first_of_each
from cpmkit.meshing.quadratic_surface import (
    QuadraticSurface,
    arc_nodes,
    arc_points,
    edge_midpoints,
    edge_numbers,
    extremes_at_edges,
    points_of_arcs,
    split_cells,
    split_edges,
    with_edge_midpoints,
)
from cpmkit.types import Bools, Floats, Ints

#: A vertex nearer to a crossing of an edge than this share of the edge is moved there.
SNAP_SHARE = 0.3
#: A vertex nearer to the other surface than this share of its shortest edge lies on it.
ON_SHARE = 1e-6
#: An edge is split where it meets a surface, or its continuation up to so many lengths of the edge beyond its rim.
BEYOND_RIM = 1.5
#: An edge is a crease if the normals of its two triangles differ by more than this at its midpoint.
CREASE_DEGREES = 3.0
#: A point nearer to an edge or a vertex than this share of its triangle's height becomes a vertex of it.
NEAR_EDGE_SHARE = 0.2
#: A vertex is moved only if the areas of its triangles do not fall below this share.
LEAST_MOVED_SHARE = 0.1
#: Rounds of the search for a crossing of an edge: every third one halves the interval.
ROUNDS = 60

#: A function that returns the signed distances (n,) of points (n, 3) from a surface, and how far (n,) they are beyond
#: its rim.
SignedDistance = Callable[[Floats], tuple[Floats, Floats]]


@dataclass(frozen=True, eq=False)
class SplitMesh:
    """Triangles that were split where they meet another surface."""

    mesh: Mesh  #: Quadratic triangles.
    parent: Ints  #: (m,): the original triangle that contains each triangle.
    is_on: Bools  #: (v,): whether a vertex lies on the other surface.
    sides: Ints  #: (m,): 1 or -1 for triangles on one side of the other surface, 0 for those on both sides.

    @property
    def chain(self) -> Ints:
        """(k, 2) the edges on the other surface: between triangles on both of its sides."""
        ends, (least, most) = self.mesh.edges.ends, extremes_at_edges(self.mesh, self.sides)
        return ends[self.is_on[ends].all(axis=1) & (least * most < 0)]


def split_at_surface(
    mesh: Mesh,
    side: SignedDistance,
    on: Floats | float = 0.0,
    exact: float = 1e-12,
    beyond_rim: float = BEYOND_RIM,
    thin: float = 0.0,
) -> SplitMesh:
    """Return quadratic triangles split where they cross another surface, given by its signed distance ``side``.

    Vertices nearer to the surface than ``on`` (v,) count as on it. Edges are split where they cross the surface, up to
    ``beyond_rim`` edge lengths beyond its rim; the crossing has an error of ``exact`` edge lengths. Triangles with all
    corners on the surface have no side if their centres are nearer than ``thin`` times their size.
    """
    sides = side(mesh.vertices)[0]
    mesh_edges, lengths = mesh.edges.ends, mesh.edge_lengths
    shortest = np.full(len(mesh.vertices), np.inf)
    np.minimum.at(shortest, mesh_edges, lengths[:, None])
    sides[np.abs(sides) <= np.maximum(ON_SHARE * shortest, on)] = 0.0
    crossing, share = _crossings(mesh, sides, side, np.arange(len(mesh_edges)), exact, beyond_rim)
    mesh, sides = _snapped(mesh, sides, crossing, share)
    crossing, share = _crossings(mesh, sides, side, crossing, exact, beyond_rim)
    split, parent = split_edges(mesh, mesh.edges.ends[crossing], share)
    sides = np.concatenate([sides, np.zeros(len(crossing))])
    signs = np.sign(sides)[split.cells]
    least, most = signs.min(axis=1), signs.max(axis=1)
    of_cells = np.where(least * most < 0, 0, np.sign(least + most))
    inner = np.flatnonzero((signs == 0).all(axis=1))
    if len(inner):
        height = side(QuadraticSurface(split).frames(inner, np.full((len(inner), 3), 1 / 3))[0])[0]
        of_cells[inner] = np.where(
            np.abs(height) < thin * split.lengths_of_cells[inner].max(axis=1), 0, np.sign(height)
        )
    return SplitMesh(split, parent, sides == 0, of_cells.astype(np.int64))


def _crossings(
    mesh: Mesh, sides: Floats, side: SignedDistance, edges: Ints, exact: float, beyond_rim: float
) -> tuple[Ints, Floats]:
    """Return the ``edges`` (n,) of (k,) that cross the other surface, and the shares (n,) of their lengths to there.

    ``sides`` (v,) are the signed distances of vertices; the other arguments are those of :func:`split_at_surface`.
    """
    ends = mesh.edges.ends[edges]
    edges = edges[np.prod(np.sign(sides[ends]), axis=1) < 0]
    start, end = sides[mesh.edges.ends[edges]].T
    nodes, length = arc_nodes(mesh, edges), mesh.edge_lengths[edges]
    low, high, share = np.zeros(len(edges)), np.ones(len(edges)), np.full(len(edges), 0.5)
    before, after = start.copy(), end.copy()
    active = np.arange(len(edges))
    for turn in range(ROUNDS):
        if not len(active):
            break
        with np.errstate(all="ignore"):
            secant = low[active] + (high - low)[active] * before[active] / (before - after)[active]
        bisect = (turn % 3 == 2) | ~((secant > low[active]) & (secant < high[active]))
        share[active] = np.where(bisect, 0.5 * (low + high)[active], secant)
        value = side(points_of_arcs(nodes[active], share[active]))[0]
        on_first = value * start[active] > 0
        low[active], before[active] = np.where(on_first, [share[active], value], [low[active], before[active]])
        high[active], after[active] = np.where(on_first, [high[active], after[active]], [share[active], value])
        ready = (np.abs(value) <= exact * length[active]) | ((high - low)[active] < exact)
        active = active[~ready]
    height, beyond = side(points_of_arcs(nodes, share)) if len(edges) else (start, start)
    valid = (np.abs(height) <= 0.1 * length) & (beyond <= beyond_rim * length)
    return edges[valid], share[valid]


def _snapped(mesh: Mesh, sides: Floats, crossing: Ints, share: Floats) -> tuple[Mesh, Floats]:
    """Return the mesh with vertices near crossings moved along edges to the crossings, and the vertices' new ``sides``.

    Vertices on creases and rims move along these alone; corners stay.
    """
    creased = sharp_edges(mesh)
    creases = np.bincount(mesh.edges.ends[creased].ravel(), minlength=len(mesh.vertices))
    near_end = share > 0.5
    vertex = mesh.edges.ends[crossing, near_end.astype(int)]
    away = np.where(near_end, 1 - share, share)
    fits = (away < SNAP_SHARE) & ((creases[vertex] == 0) | ((creases[vertex] == 2) & creased[crossing]))
    order = np.flatnonzero(fits)[np.argsort(away[fits], kind="stable")]
    order = order[np.sort(np.unique(vertex[order], return_index=True)[1])]  # the nearest crossing of each vertex
    order = order[~_completes(mesh, sides, vertex[order], away[order])]
    mesh, moved = _with_moved(mesh, vertex[order], arc_points(mesh, crossing[order], share[order]), creased)
    return mesh, np.where(moved, 0.0, sides)


def _completes(mesh: Mesh, sides: Floats, vertices: Ints, away: Floats) -> Bools:
    """Return whether each of ``vertices`` (k,), if moved, would be the third corner of a triangle on the other surface.

    Of several vertices of a triangle only the one with the longest way ``away`` (k,) counts. A triangle between three
    points of the common curve would be too thin: it would have the height of the curve above its chord.
    """
    distance = np.where(sides == 0, 0.0, np.inf)
    distance[vertices] = 1 + away
    while True:
        last = distance[mesh.cells].max(axis=1)
        corners = mesh.cells[np.isfinite(last) & (last > 0)]
        if not len(corners):
            return np.asarray(np.isinf(distance[vertices]))
        distance[corners[np.arange(len(corners)), distance[corners].argmax(axis=1)]] = np.inf


def _with_moved(mesh: Mesh, rows: Ints, points: Floats, creased: Bools) -> tuple[Mesh, Bools]:
    """Return the mesh with the vertices ``rows`` (k,) moved to its ``points`` (k, 3), and whether (v,) each was moved.

    Midpoints follow; those of ``creased`` edges (e,) stay on the arcs of these edges. In a triangle that would become
    thin or turn over, the vertex that moves farthest stays.
    """
    moved, at = np.zeros(len(mesh.vertices), dtype=bool), mesh.vertices.copy()
    moved[rows], at[rows] = True, points
    areas, away = _areas(mesh.vertices[mesh.cells]), norms(at - mesh.vertices)
    while True:
        vertices = np.where(moved[:, None], at, mesh.vertices)
        share = dots(_areas(vertices[mesh.cells]), areas) / np.maximum(dots(areas, areas), 1e-300)
        turned = (share < LEAST_MOVED_SHARE) & moved[mesh.cells].any(axis=1)
        if not turned.any():
            break
        corners = mesh.cells[turned]
        moved[corners[np.arange(len(corners)), np.where(moved, away, -1.0)[corners].argmax(axis=1)]] = False
    if not moved.any():
        return mesh, moved
    changed, midpoints = np.flatnonzero(moved[mesh.edges.ends].any(axis=1)), edge_midpoints(mesh)
    shift = (vertices - mesh.vertices)[mesh.edges.ends[changed]].sum(axis=1) / 2
    midpoints[changed] = QuadraticSurface(mesh).nearest(midpoints[changed] + shift)
    rows = changed[creased[changed]]
    old, new = mesh.vertices[mesh.edges.ends[rows]], vertices[mesh.edges.ends[rows]]
    chord = old[:, 1] - old[:, 0]
    midpoints[rows] = arc_points(mesh, rows, dots(new.mean(axis=1) - old[:, 0], chord) / dots(chord, chord))
    return with_edge_midpoints(mesh.with_same_cells(vertices=vertices), midpoints), moved


def _areas(corners: Floats) -> Floats:
    """Return normals (m, 3) of flat triangles with these ``corners`` (m, 3, 3), as long as twice their areas."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def with_points(mesh: Mesh, points: Floats) -> tuple[Mesh, Ints]:
    """Return the mesh with vertices at its ``points`` (n, 3), and the original triangle (m,) that contains each one.

    Points near a crease, or near a vertex on a crease, are left out.
    """
    parent = np.arange(len(mesh.cells))
    for _ in range(len(points)):
        creased = sharp_edges(mesh)
        cell, shares = QuadraticSurface(mesh).feet(points)
        rows = first_of_each(cell, shares.max(axis=1))
        later = np.setdiff1d(np.arange(len(points)), rows)
        cell, shares, at = cell[rows], shares[rows], points[rows]
        is_inner = shares.min(axis=1) >= NEAR_EDGE_SHARE
        edge = mesh.edges.of_cells[cell, shares.argmin(axis=1)]
        on_edge = ~is_inner & (shares.max(axis=1) <= 1 - NEAR_EDGE_SHARE) & ~creased[edge]
        on_edge[on_edge] = _is_first(edge[on_edge])
        ends = mesh.edges.ends[edge[on_edge]]
        first = norms(at[on_edge] - mesh.vertices[ends[:, 0]])
        share = first / (first + norms(at[on_edge] - mesh.vertices[ends[:, 1]]))
        on_corner = np.bincount(mesh.edges.ends[creased].ravel(), minlength=len(mesh.vertices)) > 0
        corner = mesh.cells[cell, shares.argmax(axis=1)]
        at_vertex = (shares.max(axis=1) > 1 - NEAR_EDGE_SHARE) & ~on_corner[corner]
        at_vertex[at_vertex] = _is_first(corner[at_vertex])
        mesh, parts = split_cells(mesh, cell[is_inner], shares[is_inner])
        count = len(mesh.vertices)
        mesh, more = split_edges(mesh, ends, share)
        parent = parent[parts[more]]
        target = np.concatenate([corner[at_vertex], count + np.arange(len(ends))])
        mesh, _ = _with_moved(mesh, target, np.concatenate([at[at_vertex], at[on_edge]]), sharp_edges(mesh))
        points = points[later]
        if not len(points):
            break
    return mesh, parent


def _is_first(values: Ints) -> Bools:
    """Return whether each of ``values`` (n,) differs from all before it."""
    first = np.zeros(len(values), dtype=bool)
    first[np.unique(values, return_index=True)[1]] = True
    return first


def sharp_edges(mesh: Mesh) -> Bools:
    """Return whether (e,) each edge of quadratic triangles is on a rim, has three triangles or more, or is a crease.

    An edge is a crease if the normals of its two triangles differ by more than `CREASE_DEGREES` at its midpoint.
    """
    count = np.bincount(mesh.edges.of_cells.ravel(), minlength=len(mesh.edges.ends))
    shares = 0.5 * (1 - np.eye(3))
    surface = QuadraticSurface(mesh)
    across = np.empty((len(mesh.cells), 3, 3))
    for corner in range(3):
        _, first, second = surface.frames(np.arange(len(mesh.cells)), np.tile(shares[corner], (len(mesh.cells), 1)))
        across[:, corner] = unit(np.cross(first, second)) * mesh.winding[:, None]
    total = np.zeros((len(count), 3))
    np.add.at(total, mesh.edges.of_cells, across)
    return np.asarray((count != 2) | (norms(total) < 2 * np.cos(np.radians(CREASE_DEGREES) / 2)))


def moved_onto(base: Mesh, chain: Ints, other: QuadraticSurface) -> Mesh:
    """Return the ``base`` with midpoints of edges ``chain`` (k, 2) moved along the base onto the ``other`` surface."""
    surface, edges = QuadraticSurface(base), edge_numbers(base, chain)
    midpoints = edge_midpoints(base)
    points = midpoints[edges]
    for _ in range(4):
        cell, shares = surface.feet(points)
        normals, (foot, at) = surface.normals(cell, shares), other.feet(points)
        across = other.normals(foot, at)
        height = dots(points - other.frames(foot, at)[0], across)
        along = across - dots(across, normals)[:, None] * normals
        slope = dots(along, along)
        step = np.where(slope > 1e-4, height / np.maximum(slope, 1e-4), 0.0)
        points = surface.nearest(points - step[:, None] * along)
    near = norms(points - midpoints[edges]) <= 0.25 * base.edge_lengths[edges]
    midpoints[edges[near]] = points[near]
    return with_edge_midpoints(base, midpoints)


def turned_cells(mesh: Mesh, chain: Ints, least: float) -> Ints:
    """Return the triangles (k,) beside edges ``chain`` (n, 2) that turn over, or nearly, at a corner.

    There the area element is less than ``least`` times that of the flat triangle.
    """
    on_chain = np.zeros(len(mesh.edges.ends), dtype=bool)
    on_chain[edge_numbers(mesh, chain)] = True
    cells = np.flatnonzero(on_chain[mesh.edges.of_cells].any(axis=1))
    areas, surface = _areas(mesh.vertices[mesh.cells[cells]]), QuadraticSurface(mesh)
    share = np.full(len(cells), np.inf)
    for corner in np.eye(3):
        _, first, second = surface.frames(cells, np.tile(corner, (len(cells), 1)))
        share = np.minimum(share, dots(np.cross(first, second), areas) / np.maximum(dots(areas, areas), 1e-300))
    return cells[share < least]


def piercing_points(mesh: Mesh, side: SignedDistance, gap: float) -> Floats:
    """Return the points (k, 3) where creases, junctions and rims of a mesh meet another surface, given by ``side``.

    Rim edges are left out if one of their ends is nearer to the surface than ``gap``: the rim may end on the surface.
    """
    creases = np.flatnonzero(sharp_edges(mesh))
    if not len(creases):
        return np.zeros((0, 3))
    sides = np.full(len(mesh.vertices), np.inf)
    ends = np.unique(mesh.edges.ends[creases])
    sides[ends] = side(mesh.vertices[ends])[0]
    ends_on = mesh.connectivity.on_rim[creases] & (np.abs(sides[mesh.edges.ends[creases]]).min(axis=1) < gap)
    crossing, share = _crossings(mesh, sides, side, creases[~ends_on], 1e-12, 1e-6)
    return arc_points(mesh, crossing, share)
