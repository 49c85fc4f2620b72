"""Moving a mesh onto the manifold: vertices to their feet, and a midpoint for each edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms
from cpmkit.mesh.edges import Edges, edges_of, edges_on_cut
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.mesh.rim import Rim, rim_of_edges, rim_of_vertices
from cpmkit.mesh.segments import split_at_knots
from cpmkit.meshing.double_boundary_edges import shortened
from cpmkit.meshing.edge_flips import without_chords
from cpmkit.meshing.move_neighbours import carried_along
from cpmkit.meshing.untangle_midpoints import unfolded
from cpmkit.meshing.untangle_vertices import unturned
from cpmkit.protocols import Floats, Ints

#: A midpoint whose foot is farther from it than this share of its edge stays on the chord: there is a crease.
CREASED_EDGE_SHARE = 0.15
#: The rim is looked for beyond that of the mesh: by as much as rounding, then by so much of the edge there.
ON_RIM_EDGE_SHARE, RIM_EDGE_SHARES = 1e-6, (0.5, 1.0, 2.0, 4.0)
#: A vertex moves onto its boundary if that is nearer than this share of the longest edge there.
ONTO_BOUNDARY_EDGE_SHARE = 0.3
#: How often a vertex that has to lie on several things is moved from one to the next.
PROJECTION_ROUNDS = 4


def curved(
    mesh: SampleMesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = (), spacing: float | None = None
) -> SampleMesh:
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
    mesh = moved_to_feet(mesh, source, boundaries)
    if mesh.manifold_dim == 1 and spacing is not None:
        mesh = split_at_knots(mesh, spacing, source)
    return with_midpoints(mesh, source, boundaries)


def moved_to_feet(mesh: SampleMesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = ()) -> SampleMesh:
    """Return the mesh with its vertices on the manifold: those of the rim on its rim, those of boundaries on these.

    What extends a boundary past its tip lies on the manifold alone.
    """
    edges = edges_of(mesh)
    rim = rim_of_vertices(mesh, edges)
    points = _to_manifold(source, mesh.vertices, rim)
    for_rim = np.zeros(len(points), dtype=bool)
    for_rim[rim.rows] = True
    on = [vertices_on(mesh, owner) for owner in range(len(boundaries))]
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
        mesh, left = shortened(mesh, edges, before, points)
        points[left], times[left] = before[left], 0
    rows, beside = carried_along(mesh, before, points, times == 0)
    points[rows] = source.closest_point(beside).points
    mesh = replace(mesh, vertices=unturned(mesh, before, points))
    return without_chords(mesh, edges) if mesh.manifold_dim == 2 and len(mesh.cut) else mesh


def with_midpoints(mesh: SampleMesh, source: LocalSource, boundaries: Sequence[LocalSource | None] = ()) -> SampleMesh:
    """Return the mesh with a point of the manifold for each edge, the same for all cells that have the edge."""
    edges = edges_of(mesh)
    straight = 0.5 * (mesh.vertices[edges.ends[:, 0]] + mesh.vertices[edges.ends[:, 1]])
    length, target = edges.lengths(mesh.vertices), straight.copy()
    rim = rim_of_edges(mesh, edges)
    if mesh.manifold_dim == 2:
        number = edges_on_cut(mesh, edges)
        for owner, boundary in enumerate(boundaries):
            rows = np.unique(number[(mesh.owner == owner) & ~mesh.extends])
            if boundary is not None and len(rows):
                target[rows] = boundary.closest_point(straight[rows]).points
    found = _uncreased(_to_manifold(source, target, rim), straight, length)
    if mesh.manifold_dim == 2 and len(mesh.cut):
        own = number[~mesh.extends]
        found = unfolded(mesh, edges, own, found, straight, source, lambda x: source.closest_point(x).points)
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


def vertices_on(mesh: SampleMesh, owner: int) -> Ints:
    """Return the vertices on a boundary, but for those that are on its extensions alone."""
    return np.unique(mesh.cut[(mesh.owner == owner) & ~mesh.extends])


def longest_edges(mesh: SampleMesh, edges: Edges, rows: Ints) -> Floats:
    """Return (v,) the length of the longest edge at each of the vertices ``rows``, zero at others."""
    return _extreme_edges(mesh, edges, rows, np.maximum, 0.0)


def shortest_edges(mesh: SampleMesh, edges: Edges, rows: Ints) -> Floats:
    """Return (v,) the length of the shortest edge at each of the vertices ``rows``, infinity at others."""
    return _extreme_edges(mesh, edges, rows, np.minimum, np.inf)


def _extreme_edges(mesh: SampleMesh, edges: Edges, rows: Ints, extreme: np.ufunc, none: float) -> Floats:
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
