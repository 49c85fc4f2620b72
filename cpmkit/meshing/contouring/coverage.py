"""Feet of lattice nodes that triangles do not cover: sharp edges and corners of rims that they cut, pulled out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.vectors import dots, norms
from cpmkit.meshing.contouring.contour_edges import edges_of
from cpmkit.meshing.contouring.nodes import Nodes
from cpmkit.protocols import Bools, Floats, Ints

#: A foot farther from all triangles than this share of the lattice's spacing is not covered; one farther than that
#: share is pulled to.
UNCOVERED, PULLED = 0.3, 0.1
#: So many triangles with the nearest centres are looked at for each foot.
NEAREST = 12
#: An edge is halved at a foot whose projection is at least this share of the edge from its ends.
INNER = 0.15
#: Rounds of pulling: each looks at what the one before has left.
MOST_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class CreaseFeet:
    """Feet (n, 3) of the nodes round which the surface is no single plane, and whether (n,) they lie on rims."""

    points: Floats
    rim: Bools

    @classmethod
    def of(cls, nodes: Nodes) -> CreaseFeet:
        """Return those of the nodes within a spacing of the surface; they cost no query."""
        rows = nodes.unlike.any(axis=1) & (nodes.distance < nodes.spacing)
        return cls(nodes.feet[rows], nodes.rim[rows])


def uncovered(feet: Floats, vertices: Floats, cells: Ints, spacing: float) -> Floats:
    """Return those of ``feet`` (n, 3) that lie on no triangle."""
    return np.asarray(feet[_nearest(feet, vertices, cells)[0] > UNCOVERED * spacing])


def pulled_out(
    feet: CreaseFeet, vertices: Floats, cells: Ints, on_rim: Bools, spacing: float
) -> tuple[Floats, Ints, Bools]:
    """Return vertices, triangles, and which vertices are on rims, with edges halved at feet that they cut off."""
    for _ in range(MOST_ROUNDS):
        distance, slot, share = _nearest(feet.points, vertices, cells)
        edges = edges_of(cells)
        rows = np.flatnonzero((distance > PULLED * spacing) & (share > INNER) & (share < 1 - INNER))
        edge = edges.of.ravel()[slot[rows]]
        wanted = (edges.count[edge] > 1) | feet.rim[rows]  # open edges go to rims alone
        order = np.argsort(-distance[rows[wanted]])
        rows, edge = _one_a_triangle(rows[wanted][order], edge[wanted][order], edges.of)
        if not len(rows):
            break
        vertices, cells = _halved(vertices, cells, edges.of, edge, feet.points[rows])
        on_rim = np.append(on_rim, feet.rim[rows] & (edges.count[edge] == 1))
    return vertices, cells, on_rim


def _one_a_triangle(rows: Ints, edge: Ints, of: Ints) -> tuple[Ints, Ints]:
    """Return feet and edges, in their order, so that no triangle has two of the edges."""
    rank = np.full(int(of.max(initial=-1)) + 1, len(edge))
    np.minimum.at(rank, edge, np.arange(len(edge)))
    first = rank[of].min(axis=1)
    lost = np.zeros(len(rank), dtype=bool)
    lost[of[rank[of] > first[:, None]]] = True
    chosen = np.flatnonzero((rank[edge] == np.arange(len(edge))) & ~lost[edge])
    return rows[chosen], edge[chosen]


def _halved(vertices: Floats, cells: Ints, of: Ints, edge: Ints, points: Floats) -> tuple[Floats, Ints]:
    """Return vertices and triangles with each ``edge`` (k,) halved at its point; no triangle has two of them."""
    new = np.full(int(of.max()) + 1, -1)
    new[edge] = len(vertices) + np.arange(len(edge))
    cell, corner = np.nonzero(new[of] >= 0)
    apex, a, b = (cells[cell, (corner + k) % 3] for k in range(3))
    tip = new[of[cell, corner]]
    halves = [np.stack([apex, a, tip], axis=1), np.stack([apex, tip, b], axis=1)]
    return np.concatenate([vertices, points]), np.concatenate([np.delete(cells, cell, axis=0), *halves])


def _nearest(feet: Floats, vertices: Floats, cells: Ints) -> tuple[Floats, Ints, Floats]:
    """Return for each foot its distance to the triangles, the nearest one's nearest edge's slot, and where on it.

    A slot is three times the number of a triangle and that of the corner opposite to the edge.
    """
    from scipy.spatial import KDTree

    n = len(feet)
    least, slot, where = np.full(n, np.inf), np.zeros(n, dtype=np.int64), np.zeros(n)
    if not n:
        return least, slot, where
    corners = vertices[cells]
    count = min(NEAREST, len(cells))
    near = KDTree(corners.mean(axis=1)).query(feet, k=count)[1].reshape(n, count)
    for column in near.T:
        distance, corner, share = _distances(feet, corners[column])
        nearer = distance < least
        least = np.where(nearer, distance, least)
        slot, where = np.where(nearer, 3 * column + corner, slot), np.where(nearer, share, where)
    return least, slot, where


def _distances(points: Floats, corners: Floats) -> tuple[Floats, Ints, Floats]:
    """Return the distance of each of ``points`` (n, 3) to its triangle (n, 3, 3), the nearest edge, and where on it."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = norms(normal)
    inside = size > 0
    away, shares = np.empty((3, len(points))), np.empty((3, len(points)))
    for k in range(3):
        tail = corners[:, (k + 1) % 3]
        along, out = corners[:, (k + 2) % 3] - tail, points - tail
        inside &= dots(np.cross(along, out), normal) >= 0
        with np.errstate(all="ignore"):
            shares[k] = np.clip(np.nan_to_num(dots(out, along) / dots(along, along)), 0.0, 1.0)
        away[k] = norms(out - shares[k][:, None] * along)
    edge, rows = away.argmin(axis=0), np.arange(len(points))
    with np.errstate(all="ignore"):
        height = np.abs(dots(points - corners[:, 0], normal) / size)
    return np.where(inside, height, away[edge, rows]), edge, shares[edge, rows]
