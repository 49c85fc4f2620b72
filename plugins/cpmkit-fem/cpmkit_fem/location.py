"""The nearest point of cells: exact, by the nearest centroids with a bound that says when to stop."""

from __future__ import annotations

import numpy as np

from cpmkit.plugin import Floats, Ints

#: Centroids that are compared at first; four times as many for the queries that these do not decide.
FIRST_CENTROIDS = 8
#: Pairs of a query and a triangle that are looked at together.
MOST_LOCATION_PAIRS = 1 << 18


def nearest_cells(vertices: Floats, faces: Ints, queries: Floats) -> tuple[Ints, Floats]:
    """Return the cell (n,) that holds the nearest point of each of ``queries`` (n, d), and its coordinates (n, k).

    ``faces`` (m, k) are tetrahedra, triangles or segments between ``vertices`` (v, d); coordinates are barycentric.
    Cells are searched in groups of similar radius, since a large cell would weaken the bound of all small cells.
    """
    corners = vertices[faces]
    radii = np.linalg.norm(corners - corners.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    octave = np.floor(np.log2(radii))
    best, face, local = (
        np.full(len(queries), np.inf),
        np.zeros(len(queries), dtype=np.int64),
        np.zeros((len(queries), faces.shape[1])),
    )
    for size in np.unique(octave):
        group = np.flatnonzero(octave == size)
        member, weights, distance = _nearest_cells_of_one_size(corners[group], radii[group].max(), queries, best)
        nearer = distance < best
        best, face = np.where(nearer, distance, best), np.where(nearer, group[member], face)
        local = np.where(nearer[:, None], weights, local)
    return face, local


def _nearest_cells_of_one_size(
    corners: Floats, radius: float, queries: Floats, bound: Floats
) -> tuple[Ints, Floats, Floats]:
    """Return the nearest (n,) of cells (m, k, d), barycentric coordinates (n, k) and distances (n,).

    ``corners`` (m, k, d) are those of the cells, each within ``radius`` of its centroid. Answers are exact only below
    ``bound`` (n,). None past the c nearest centroids can be nearer once the best distance is below the c-th centroid's
    less the radius.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(corners.mean(axis=1))
    member, weights = np.zeros(len(queries), dtype=np.int64), np.zeros((len(queries), corners.shape[1]))
    distance = np.full(len(queries), np.inf)
    rows, count = np.arange(len(queries)), min(FIRST_CENTROIDS, len(corners))
    while len(rows):
        unsettled = []
        for part in np.array_split(rows, 1 + len(rows) * count // MOST_LOCATION_PAIRS):
            far, near = map(np.asarray, tree.query(queries[part], k=np.arange(1, count + 1)))
            candidates, lengths = _foot_coordinates(corners[near], queries[part])
            pick = np.arange(len(part)), np.argmin(lengths, axis=1)
            member[part], weights[part], distance[part] = near[pick], candidates[pick], lengths[pick]
            open_still = np.minimum(distance[part], bound[part]) > np.maximum(far[:, -1] - radius, 0.0)
            unsettled.append(part[open_still & (count < len(corners))])
        rows, count = np.concatenate(unsettled), min(4 * count, len(corners))
    return member, weights, distance


def _foot_coordinates(corners: Floats, queries: Floats) -> tuple[Floats, Floats]:
    """Return barycentric coordinates (n, c, k) of the points nearest to queries (n, d), and distances (n, c).

    ``corners`` (n, c, k, d) are those of c cells for each query.
    """
    if corners.shape[2] == 4:
        return _solid_foot_coordinates(corners, queries)
    if corners.shape[2] == 2:
        weights = _edge_foot_coordinates(corners, queries, 0)
        return weights, np.linalg.norm(np.einsum("nkc,nkcd->nkd", weights, corners) - queries[:, None, :], axis=2)
    candidates = [
        _plane_foot_coordinates(corners, queries),
        *(_edge_foot_coordinates(corners, queries, k) for k in range(3)),
    ]
    weights = np.stack(candidates)
    points = np.einsum("snkc,nkcd->snkd", weights, corners)
    distance = np.linalg.norm(points - queries[None, :, None, :], axis=3)
    distance[0][(weights[0] < 0).any(axis=2)] = np.inf
    first = np.argmin(distance, axis=0)
    return (
        np.take_along_axis(weights, first[None, ..., None], axis=0)[0],
        np.take_along_axis(distance, first[None], axis=0)[0],
    )


def _solid_foot_coordinates(corners: Floats, queries: Floats) -> tuple[Floats, Floats]:
    """Return barycentric coordinates (n, c, 4) of the points of tetrahedra nearest to queries, and distances (n, c).

    They are exact for the nearest tetrahedron; of queries inside one, other distances are infinite.
    """
    edges = np.moveaxis(corners[..., 1:, :] - corners[..., :1, :], -1, -2)
    local = np.linalg.solve(edges, (queries[:, None, :] - corners[..., 0, :])[..., None])[..., 0]
    weights = np.concatenate([1 - local.sum(axis=-1, keepdims=True), local], axis=-1)
    distance = np.where((weights >= 0).all(axis=-1), 0.0, np.inf)
    outside = np.flatnonzero(distance.min(axis=1) > 0)
    for opposite in range(4):
        facet = np.delete(np.arange(4), opposite)
        of_facet, length = _foot_coordinates(corners[outside][:, :, facet], queries[outside])
        row, cell = np.nonzero(length < distance[outside])
        weights[outside[row], cell] = 0.0
        weights[outside[row][:, None], cell[:, None], facet] = of_facet[row, cell]
        distance[outside[row], cell] = length[row, cell]
    return weights, distance


def _plane_foot_coordinates(corners: Floats, queries: Floats) -> Floats:
    """Return barycentric coordinates (n, c, 3) of queries (n, d) projected on the planes of triangles (n, c, 3, d).

    Those outside a triangle have a negative one; a triangle without area gets -1.
    """
    a, e, f = corners[..., 0, :], corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :]
    d = queries[:, None, :] - a
    ee, ef, ff, ed, fd = (np.sum(p * q, axis=-1) for p, q in ((e, e), (e, f), (f, f), (e, d), (f, d)))
    determinant = ee * ff - ef * ef
    safe = np.where(determinant > 0, determinant, 1.0)
    v, w = (ff * ed - ef * fd) / safe, (ee * fd - ef * ed) / safe
    return np.where((determinant > 0)[..., None], np.stack([1 - v - w, v, w], axis=-1), -1.0)


def _edge_foot_coordinates(corners: Floats, queries: Floats, side: int) -> Floats:
    """Return barycentric coordinates (n, c, k) of the nearest points to queries (n, d) on edges of cells (n, c, k, d).

    The edge is that from corner ``side`` to the next.
    """
    k = corners.shape[2]
    start, end = corners[..., side, :], corners[..., (side + 1) % k, :]
    along = end - start
    t = np.clip(np.sum((queries[:, None, :] - start) * along, axis=-1) / np.sum(along**2, axis=-1), 0.0, 1.0)
    weights = np.zeros((*t.shape, k))
    weights[..., side], weights[..., (side + 1) % k] = 1 - t, t
    return weights
