"""Cutting a mesh along a curve on which a signed distance vanishes, and parting its two sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.protocols import Bools, ClosestPointSource, Floats, Ints

#: A vertex nearer to a boundary than this share of the spacing lies on it.
ON_CURVE = 1e-6

#: An edge crosses a boundary if the zero on it lies nearer to the boundary than this share of its length.
CROSSES = 0.5


@dataclass(frozen=True, eq=False)
class Pieces:
    """A mesh between two cuts; ``attributes`` are points and normals, which a cut interpolates alike."""

    attributes: Floats  # (v, d) or (v, 2 d)
    sides: Ints  # (v, boundaries): 1 left, -1 right, 0 not on that boundary
    cells: Ints  # (m, k)


def cut(pieces: Pieces, boundary: int, distance: Floats, dim: int, curve: ClosestPointSource, spacing: float) -> Pieces:
    """Split every cell that a boundary crosses, and part the two sides.

    Parameters
    ----------
    pieces : Pieces
        The mesh before.
    boundary : int
        The boundary's column in ``pieces.sides``.
    distance : (v,) float64
        Signed distance of the vertices from it, positive on the left, NaN where a vertex has no side.
    dim : int
        2 or 3.
    curve : ClosestPointSource
        Where the boundary lies.
    spacing : float
        Of the solution, the unit of :data:`ON_CURVE`.
    """
    count = len(distance)
    sign = _signs(pieces.attributes[:, :dim], distance, curve, spacing)
    edges, cell_edges = edges_of(pieces.cells, count)
    crossed = _crossed(pieces.attributes[:, :dim], edges, distance, sign, curve)
    split = _split_segments if pieces.cells.shape[1] == 2 else _split_triangles
    cells, side = split(pieces.cells, cell_edges, sign, crossed)
    # A split names the crossing of edge e as vertex count + e; only those that were used are made.
    used = np.unique(cells[cells >= count]) - count
    number = np.zeros(count + len(edges), dtype=np.int64)
    number[:count] = np.arange(count)
    number[count + used] = count + np.arange(len(used))
    on = np.concatenate([sign == 0, np.ones(len(used), dtype=bool)])
    with_crossings = _append_crossings(pieces, edges[used], distance, number[cells])
    return _part(with_crossings, boundary, on, side)


def _signs(points: Floats, distance: Floats, curve: ClosestPointSource, spacing: float) -> Floats:
    """Return 1 left, -1 right, 0 on the boundary and NaN where there is no side.

    The distance is measured along the surface's tangent, so it also vanishes beside the boundary on
    another sheet, such as the other leg of an animal; that is no place on the boundary.
    """
    sign: Floats = np.sign(distance)
    zero = np.flatnonzero(np.abs(distance) < ON_CURVE * spacing)
    sign[zero] = np.where(_apart(points[zero], curve) < CROSSES * spacing, 0.0, np.nan)
    return sign


def edges_of(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the (e, 2) edges and, for each cell, its edges' numbers; edge k joins corners k and k + 1."""
    corners = cells.shape[1]
    ends = np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1)[:, : corners if corners > 2 else 1]
    low, high = ends.min(axis=-1), ends.max(axis=-1)
    keys, cell_edges = np.unique(low * count + high, return_inverse=True)
    return np.stack([keys // count, keys % count], axis=1), cell_edges.reshape(low.shape)


def _crossed(points: Floats, edges: Ints, distance: Floats, sign: Floats, curve: ClosestPointSource) -> Bools:
    """Whether the boundary crosses each edge.

    Opposite signs alone do not say so: they also differ across the tangent plane on another sheet,
    and half way between two arms of a curve, where the nearest arm changes. There the zero is not
    near the curve.
    """
    a, b = edges.T
    crossed: Bools = sign[a] * sign[b] < 0
    candidates = edges[crossed]
    length = np.linalg.norm(points[candidates[:, 1]] - points[candidates[:, 0]], axis=1)
    crossed[crossed] = _apart(_zero(points, candidates, distance), curve) < CROSSES * length
    return crossed


def _zero(attributes: Floats, edges: Ints, distance: Floats) -> Floats:
    """Return the attributes where the distance vanishes on each of ``edges``."""
    a, b = edges.T
    share = (distance[a] / (distance[a] - distance[b]))[:, None]
    interpolated: Floats = (1 - share) * attributes[a] + share * attributes[b]
    return interpolated


def _apart(points: Floats, curve: ClosestPointSource) -> Floats:
    """Return how far ``points`` are from ``curve``."""
    apart: Floats = np.linalg.norm(curve.closest_point(np.ascontiguousarray(points)).points - points, axis=1)
    return apart


def _split_segments(cells: Ints, cell_edges: Ints, sign: Floats, crossed: Bools) -> tuple[Ints, Floats]:
    """Return the cells after the cut and the side of each: 1 left, -1 right, 0 neither."""
    cut = crossed[cell_edges[:, 0]]
    a, b = cells[cut].T
    p = len(sign) + cell_edges[cut, 0]
    kept = cells[~cut]
    return (
        np.concatenate([kept, np.stack([a, p], axis=1), np.stack([p, b], axis=1)]),
        np.concatenate([_side(kept, sign), sign[a], sign[b]]),
    )


def _split_triangles(cells: Ints, cell_edges: Ints, sign: Floats, crossed: Bools) -> tuple[Ints, Floats]:
    """Return the cells after the cut and the side of each: 1 left, -1 right, 0 neither.

    A triangle is cut from edge to edge, or from a corner on the curve to the edge across. One
    that the curve enters and does not leave holds the curve's end and stays whole.
    """
    crossing = crossed[cell_edges]
    count = crossing.sum(axis=1)
    two = count == 2
    across = (count == 1) & (sign[np.take_along_axis(cells, (crossing.argmax(axis=1)[:, None] + 2) % 3, 1)[:, 0]] == 0)
    kept = cells[~(two | across)]

    # The lone corner a comes first: it faces the one edge that is not crossed.
    (a, b, c), (ab, _, ca) = rotated(cells[two], cell_edges[two], crossing[two].argmin(axis=1) + 2)
    p, q = len(sign) + ab, len(sign) + ca
    parts = [(kept, _side(kept, sign))]
    parts += [
        (np.stack(corners, axis=1), s)
        for corners, s in [((a, p, q), sign[a]), ((p, b, c), sign[b]), ((p, c, q), sign[b])]
    ]

    # The corner a on the curve comes first: it faces the one edge that is crossed.
    (a, b, c), (_, bc, _) = rotated(cells[across], cell_edges[across], crossing[across].argmax(axis=1) + 2)
    p = len(sign) + bc
    parts += [(np.stack(corners, axis=1), s) for corners, s in [((a, b, p), sign[b]), ((a, p, c), sign[c])]]
    return np.concatenate([part for part, _ in parts]), np.concatenate([side for _, side in parts])


def rotated(cells: Ints, cell_edges: Ints, first: Ints) -> tuple[Ints, Ints]:
    """Return the corners and edges, each (3, m), of triangles turned so that corner ``first`` leads."""
    order = (first[:, None] + np.arange(3)) % 3
    return np.take_along_axis(cells, order, 1).T, np.take_along_axis(cell_edges, order, 1).T


def _side(cells: Ints, sign: Floats) -> Floats:
    """Return the one side on which all corners of a cell lie, 0 where there is none."""
    signs = np.nan_to_num(sign[cells])
    left, right = (signs > 0).any(axis=1), (signs < 0).any(axis=1)
    return np.where(left == right, 0.0, np.where(left, 1.0, -1.0))


def _append_crossings(pieces: Pieces, edges: Ints, distance: Floats, cells: Ints) -> Pieces:
    """Append the zero of the distance on each of ``edges`` as a vertex."""
    a, b = edges.T
    attributes = _zero(pieces.attributes, edges, distance)
    # An edge that runs along an earlier boundary hands its side on.
    sides = np.where(pieces.sides[a] == pieces.sides[b], pieces.sides[a], 0)
    return Pieces(
        np.concatenate([pieces.attributes, attributes]),
        np.concatenate([pieces.sides, sides]),
        cells,
    )


def _part(pieces: Pieces, boundary: int, on: Bools, side: Floats) -> Pieces:
    """Give the right side copies of the vertices ``on`` the boundary; the vertices themselves become the left's."""
    copied = np.flatnonzero(on)
    copy = np.arange(len(on))
    copy[copied] = len(on) + np.arange(len(copied))
    left, right = pieces.sides.copy(), pieces.sides[copied].copy()
    left[copied, boundary], right[:, boundary] = 1, -1
    return Pieces(
        np.concatenate([pieces.attributes, pieces.attributes[copied]]),
        np.concatenate([left, right]),
        np.where((side < 0)[:, None], copy[pieces.cells], pieces.cells),
    )
