"""Triangles that fill closed polygons: Delaunay's, of the polygons' vertices and a lattice of triangles inside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cpmkit.plugin import Bools, Floats, Ints, SceneError, place

#: Sides longer than this many spacings are divided.
LONGEST_SIDE = 1.25
#: Points of the lattice keep this distance from the sides, in spacings.
LEAST_DISTANCE = 0.6
#: Distances from sides are those from so many samples a spacing.
SAMPLES = 6
#: Rounds in which sides that are no edges of Delaunay's triangles are halved.
ROUNDS = 12
#: Triangles with a doubled area below this share of the spacing squared lie on a straight side.
NO_AREA_SHARE = 1e-9

#: Points (n, 2) near the boundary moved onto it.
Project = Callable[[Floats], Floats]
#: Whether points (n, 2) lie inside.
Inside = Callable[[Floats], Bools]


def fill_polygons(
    vertices: Floats, sides: Ints, spacing: float, project: Project, inside: Inside
) -> tuple[Floats, Ints, Ints, Ints]:
    """Return vertices (v, 2), triangles (m, 3) with edges of about ``spacing``, the region (m,) of each, and sides.

    The triangles fill the hull of closed polygons, whose ``sides`` (s, 2) between ``vertices`` (n, 2) divide it into
    regions; the sides that are returned are parts of them. Raise SceneError if that takes more than :data:`ROUNDS`
    rounds of halving.
    """
    from scipy.spatial import Delaunay

    vertices, sides = _divide(vertices, sides, spacing, project)
    lattice = _lattice_inside(vertices, sides, spacing, inside)
    for attempt in range(ROUNDS):
        points = np.concatenate([vertices, lattice])
        triangles = Delaunay(points).simplices.astype(np.int64)
        first, second = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
        turn = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        triangles = triangles[np.abs(turn) > NO_AREA_SHARE * spacing**2]
        edges = _keys(triangles[:, [[0, 1], [1, 2], [2, 0]]], len(points))
        kept = _keys(sides, len(points))
        missing = ~np.isin(kept, edges)
        if not missing.any():
            break
        if attempt == ROUNDS - 1:
            at = place(vertices[sides[missing][0]].mean(axis=0))
            raise SceneError(f"the edge of the solid meets itself near {at}; separate it there, or use backend='cpm'.")
        vertices, sides = _halve(vertices, sides, missing, project)
    return points, triangles, _regions(edges, kept), sides


def _regions(edges: Ints, sides: Ints) -> Ints:
    """Return a number (m,) of the region of each triangle, by the keys (3 m,) of its edges and those of ``sides``."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    count, open_ = len(edges) // 3, np.flatnonzero(~np.isin(edges, sides))
    number = np.unique(edges[open_], return_inverse=True)[1].ravel()
    size = count + int(number.max(initial=-1)) + 1
    graph = csr_array((np.ones(len(open_)), (open_ // 3, count + number)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1][:count], dtype=np.int64)


def _keys(pairs: Ints, size: int) -> Ints:
    """Return a number (e,) for each pair of vertices of ``pairs`` (..., 2), the same in either order."""
    low, high = np.sort(pairs.reshape(-1, 2), axis=1).T
    return np.asarray(low * size + high)


def _divide(vertices: Floats, sides: Ints, spacing: float, project: Project) -> tuple[Floats, Ints]:
    """Return the polygons with sides longer than :data:`LONGEST_SIDE` spacings divided into equal parts."""
    start, end = vertices[sides[:, 0]], vertices[sides[:, 1]]
    lengths = np.linalg.norm(end - start, axis=1)
    parts = np.where(lengths > LONGEST_SIDE * spacing, np.ceil(lengths / spacing), 1).astype(np.int64)
    side = np.repeat(np.arange(len(sides)), parts - 1)
    number = np.arange(len(side)) - np.repeat(np.cumsum(parts - 1) - (parts - 1), parts - 1) + 1
    share = (number / parts[side])[:, None]
    added = start[side] + share * (end - start)[side]
    added = project(added) if len(added) else added
    chains, first = [], len(vertices)
    for (a, b), count in zip(sides, parts - 1, strict=True):
        chain = np.array([a, *range(first, first + count), b])
        chains.append(np.stack([chain[:-1], chain[1:]], axis=1))
        first += count
    return np.concatenate([vertices, added]), np.concatenate(chains)


def _halve(vertices: Floats, sides: Ints, chosen: Bools, project: Project) -> tuple[Floats, Ints]:
    """Return the polygons with the ``chosen`` sides (s,) halved."""
    a, b = sides[chosen].T
    middle = len(vertices) + np.arange(len(a))
    halves = np.concatenate([np.stack([a, middle], axis=1), np.stack([middle, b], axis=1)])
    added = project(0.5 * (vertices[a] + vertices[b]))
    return np.concatenate([vertices, added]), np.concatenate([sides[~chosen], halves])


def _lattice_inside(vertices: Floats, sides: Ints, spacing: float, inside: Inside) -> Floats:
    """Return the points (n, 2) of a lattice of equal triangles that are ``inside`` and not near the sides."""
    from scipy.spatial import cKDTree

    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    columns, rows = (int(count) for count in np.ceil((upper - lower) / (spacing * np.array([1.0, np.sqrt(0.75)]))))
    j, i = np.divmod(np.arange((columns + 1) * (rows + 1)), columns + 1)
    points = lower + spacing * np.stack([i + 0.5 * (j % 2), np.sqrt(0.75) * j], axis=1)
    share = (np.arange(2 * SAMPLES) / (2 * SAMPLES))[:, None]
    start, end = vertices[sides[:, 0]], vertices[sides[:, 1]]
    samples = (start[:, None] + share * (end - start)[:, None]).reshape(-1, 2)
    far = cKDTree(samples).query(points, distance_upper_bound=LEAST_DISTANCE * spacing)[0]
    points = points[far >= LEAST_DISTANCE * spacing]
    return points[inside(points)] if len(points) else points
