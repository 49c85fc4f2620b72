"""The skin of a solid in pieces: segments or polygons inside single lattice cells, with quadrature points.

The skin is a closed oriented mesh, of segments in the plane or flat triangles in space. All lengths are in spacings;
the cell of node r is the cube of side 1 around r, and knot planes are its faces. Coordinates very near a knot plane are
set to it, so that pieces in one cell and the faces of the cell close exactly. A piece in a face belongs to the cell on
the inner side of the skin. A boundary inside the solid is covered by two cells of the mesh, one for each side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cpmkit.manifold.vector_algebra import norms
from cpmkit.mesh.cell_quadrature import TRIANGLE_RULE, quadratic_rule
from cpmkit.mesh.mesh import Mesh
from cpmkit.runtime.compilation import compiled
from cpmkit.types import Bools, Floats, Ints

#: Coordinates nearer to a knot plane than this, in spacings, are set to the plane; for segments, which are split at
#: planes to a millionth of their length, the second number is used.
SNAPPED_SPACINGS, SNAPPED_SEGMENT_SPACINGS = 1e-10, 1e-6
#: Pieces of triangles smaller than this, in squared spacings, are left out: rounding.
LEAST_PIECE = 1e-13
#: Corners that a triangle clipped to a cell has at most, with a spare.
MOST_CORNERS = 12
#: In triangles with a box smaller than this, in spacings, a rule of degree 2 with three points is enough.
SMALL_SPACINGS = 0.05
#: A rule of degree 6 on a triangle (Dunavant 1985): for each group of points two barycentric coordinates, the number of
#: points, which have these coordinates in any order, and the weight of each point.
DEGREE_SIX = (
    (0.249286745170910, 0.249286745170910, 3, 0.116786275726379),
    (0.063089014491502, 0.063089014491502, 3, 0.050844906370207),
    (0.310352451033785, 0.053145049844816, 6, 0.082851075618374),
)


def triangle_rule(exact: bool) -> tuple[Floats, Floats]:
    """Return the barycentric coordinates (r, 3) and the weights (r,), with sum 1, of a rule on triangles.

    If ``exact``, the rule has degree 6 and 12 points, so that linear functions are reproduced to rounding. On the flat
    facets of a curved skin the degree 4, with 6 points, is enough.
    """
    orders = np.array([(0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2), (0, 2, 1), (2, 1, 0)])
    table = DEGREE_SIX if exact else [(a, a, 3, w) for a, w in TRIANGLE_RULE]
    groups = [(np.array([a, b, 1 - a - b])[orders[:count]], np.full(count, w)) for a, b, count, w in table]
    weights = np.concatenate([w for _, w in groups])
    return np.concatenate([points for points, _ in groups]), weights / weights.sum()


@dataclass(frozen=True, eq=False)
class SkinPieces:
    """Pieces of the skin, each in one lattice cell."""

    cell: Ints  #: (m, d): the lattice cell of each piece.
    facet: Ints  #: (m,): the cell of the skin's mesh that contains each piece.
    in_face: Bools  #: (m,): whether the piece lies in a face of its cell.
    corners: Floats  #: (k, d): the corners of all pieces, one after the other.
    corner_starts: Ints  #: (m + 1,): where the corners of each piece start.
    #: (j, 2): pairs of a piece and a facet of the mesh, part of which bounds the piece.
    bounds: Ints
    points: Floats  #: (q, d): quadrature points.
    areas: Floats  #: (q, d): their weights times the outward unit normals.
    piece: Ints  #: (q,): the piece of each quadrature point, ascending.

    @property
    def normals(self) -> Floats:
        """(m, d) the integral of the outward normal over each piece: its area times its mean normal."""
        count = len(self.cell)
        return np.stack([np.bincount(self.piece, column, count) for column in self.areas.T], axis=1)

    @property
    def centres(self) -> Floats:
        """(m, d) the means of the corners of each piece."""
        return np.asarray(np.add.reduceat(self.corners, self.corner_starts[:-1]) / np.diff(self.corner_starts)[:, None])


def snap(points: Floats) -> Floats:
    """Return ``points`` (n, d), in spacings, with coordinates very near a knot plane set to it."""
    planes = np.floor(points) + 0.5
    near = SNAPPED_SEGMENT_SPACINGS if points.shape[1] == 2 else SNAPPED_SPACINGS
    return np.where(np.abs(points - planes) < near, planes, points)


def skin_pieces(mesh: Mesh, spacing: float, exact: bool = True, facets: Ints | None = None) -> SkinPieces:
    """Return the pieces of a closed skin.

    ``mesh``: flat or quadratic segments that end on knot planes, or flat triangles in space, oriented: segments with
    the inside on their left, triangles counterclockwise from outside. Positions are relative to the lattice's origin.
    ``exact``: see :func:`triangle_rule`.
    ``facets`` (c, k): the number of the facet opposite to each corner of the cells, by default an edge of triangles or
    a vertex of segments; see :func:`cpmkit.mesh.sectors.sector_facets`.
    """
    facets = mesh.connectivity.facet_numbers if facets is None else facets
    if mesh.dim == 2:
        return _segment_pieces(mesh, spacing, facets)
    nodes = np.ascontiguousarray(snap(mesh.vertices / spacing)[mesh.cells])
    corners, starts, facet, edges, in_face, cell = clip_triangles(nodes)
    piece, which = np.nonzero((edges[:, None] >> np.arange(3)) & 1)
    bounds = np.stack([piece, facets[facet[piece], which]], axis=1)
    small = np.ptp(nodes, axis=1).max(axis=1) < SMALL_SPACINGS
    points, areas, of = polygon_nodes(corners, starts, small[facet], *triangle_rule(exact))
    return SkinPieces(cell, facet, in_face, corners, starts, bounds, points, areas, of)


def _segment_pieces(mesh: Mesh, spacing: float, facets: Ints) -> SkinPieces:
    """Return the segments of a ``mesh`` as pieces; ``facets`` as in :func:`skin_pieces`."""
    scaled = replace(
        mesh,
        vertices=snap(mesh.vertices / spacing),
        midpoints=None if mesh.midpoints is None else mesh.midpoints / spacing,
    )
    points, tangents, weights, _ = quadratic_rule(scaled)
    along = tangents[:, :, 0]
    shares = weights / np.maximum(norms(along), np.finfo(float).tiny)
    areas = shares[..., None] * np.stack([along[..., 1], -along[..., 0]], axis=-1)
    corners = scaled.vertices[scaled.cells]
    normal, middle = areas.sum(axis=1), corners.mean(axis=1)
    on_plane = (np.ptp(corners, axis=1) == 0) & (middle - np.floor(middle) == 0.5)
    in_face = on_plane.any(axis=1)
    inner = middle - np.where(on_plane, 0.25 * np.sign(normal), 0.0)
    kept = norms(corners[:, 1] - corners[:, 0]) > 0
    rows, g = np.flatnonzero(kept), points.shape[1]
    bounds = np.stack([np.repeat(np.arange(len(rows)), 2), facets[rows].ravel()], axis=1)
    return SkinPieces(
        np.floor(inner[rows] + 0.5).astype(np.int64),
        rows,
        in_face[rows],
        corners[rows].reshape(-1, 2),
        2 * np.arange(len(rows) + 1),
        bounds,
        points[rows].reshape(-1, 2),
        areas[rows].reshape(-1, 2),
        np.repeat(np.arange(len(rows)), g),
    )


@compiled
def splitting_plane(polygon: Floats, count: int) -> tuple[int, float]:
    """Return the axis and coordinate of a knot plane with corners of ``polygon`` (count, 3) on both sides, or -1."""
    for axis in range(3):
        low, high = np.inf, -np.inf
        for k in range(count):
            low, high = min(low, polygon[k, axis]), max(high, polygon[k, axis])
        plane = np.floor(low + 0.5) + 0.5
        if plane < high:
            return axis, plane
    return -1, 0.0


@compiled
def split_polygon(
    polygon: Floats, sides: Ints, count: int, axis: int, plane: float, parts: Floats, labels: Ints
) -> tuple[int, int]:
    """Fill ``parts`` (2, k, 3) with the parts of a convex polygon below and above a plane; return the corner counts.

    ``sides`` (count,) are labels of the sides from each corner on, kept in ``labels`` (2, k), -1 for the new sides.
    """
    used = [0, 0]
    for k in range(count):
        following = k + 1 if k + 1 < count else 0
        here, there = polygon[k, axis] - plane, polygon[following, axis] - plane
        for part in range(2):
            sign = 1.0 if part else -1.0
            if sign * here >= 0:
                at = used[part]
                for i in range(3):
                    parts[part, at, i] = polygon[k, i]
                labels[part, at] = -1 if here == 0 and sign * there < 0 else sides[k]
                used[part] += 1
        if here * there < 0:
            share = here / (here - there)
            for part in range(2):
                at, sign = used[part], 1.0 if part else -1.0
                for i in range(3):
                    value = polygon[k, i] + share * (polygon[following, i] - polygon[k, i])
                    near = np.floor(value) + 0.5
                    parts[part, at, i] = near if abs(value - near) < SNAPPED_SPACINGS else value
                parts[part, at, axis] = plane
                labels[part, at] = -1 if sign * here > 0 else sides[k]
                used[part] += 1
    return used[0], used[1]


@compiled
def area_along(polygon: Floats, count: int, normal: Floats) -> float:
    """Return twice the area of a convex polygon (count, 3) times the length of its ``normal`` (3,)."""
    area = 0.0
    for k in range(1, count - 1):
        a, b, c = polygon[k, 0] - polygon[0, 0], polygon[k, 1] - polygon[0, 1], polygon[k, 2] - polygon[0, 2]
        d, e = polygon[k + 1, 0] - polygon[0, 0], polygon[k + 1, 1] - polygon[0, 1]
        f = polygon[k + 1, 2] - polygon[0, 2]
        area += normal[0] * (b * f - c * e) + normal[1] * (c * d - a * f)
        area += normal[2] * (a * e - b * d)
    return area


@compiled
def find_cell(polygon: Floats, count: int, normal: Floats, cell: Ints) -> bool:
    """Fill ``cell`` (3,) with the lattice cell of a polygon (count, 3); return whether it lies in a face of the cell.

    Of two cells with this face the cell on the inner side is taken, from which the ``normal`` (3,) points away.
    """
    in_face = False
    for i in range(3):
        low, high = np.inf, -np.inf
        for k in range(count):
            low, high = min(low, polygon[k, i]), max(high, polygon[k, i])
        middle = 0.5 * (low + high)
        if low == high and middle - np.floor(middle) == 0.5:
            in_face = True
            middle -= 0.25 * np.sign(normal[i])
        cell[i] = np.int64(np.floor(middle + 0.5))
    return in_face


@compiled
def clip_triangles(nodes: Floats) -> tuple[Floats, Ints, Ints, Ints, Bools, Ints]:
    """Return the convex parts of triangles ``nodes`` (t, 3, 3) in lattice cells.

    Returned for m polygons are the corners (k, 3), the first corner (m + 1,) of each, its triangle (m,), its edges on
    those of the triangle (m,), with bit j for the edge opposite to corner j, whether (m,) it lies in a face of its
    cell, and the cell (m, 3).
    """
    room, most = 16, 64
    corners, starts = np.empty((most, 3)), np.zeros(room + 1, dtype=np.int64)
    facet, edges = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
    in_face = np.empty(room, dtype=np.bool_)
    cells = np.empty((room, 3), dtype=np.int64)
    stack, sizes = np.empty((64, MOST_CORNERS, 3)), np.empty(64, dtype=np.int64)
    a, b, normal = np.empty(3), np.empty(3), np.empty(3)
    labels = np.empty((64, MOST_CORNERS), dtype=np.int64)
    polygon, sides = np.empty((MOST_CORNERS, 3)), np.empty(MOST_CORNERS, dtype=np.int64)
    used = total = 0
    for t in range(len(nodes)):
        for i in range(3):
            a[i], b[i] = nodes[t, 1, i] - nodes[t, 0, i], nodes[t, 2, i] - nodes[t, 0, i]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            normal[i] = a[j] * b[k] - a[k] * b[j]
        size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
        for k in range(3):
            labels[0, k] = (k + 2) % 3
            for i in range(3):
                stack[0, k, i] = nodes[t, k, i]
        sizes[0] = 3
        waiting = 1
        while waiting:
            waiting -= 1
            count = sizes[waiting]
            for k in range(count):
                sides[k] = labels[waiting, k]
                for i in range(3):
                    polygon[k, i] = stack[waiting, k, i]
            axis, plane = splitting_plane(polygon, count)
            if axis >= 0:
                if waiting + 2 > len(sizes):
                    stack, labels = np.concatenate((stack, stack)), np.concatenate((labels, labels))
                    sizes = np.concatenate((sizes, sizes))
                lower, upper = split_polygon(
                    polygon, sides, count, axis, plane, stack[waiting : waiting + 2], labels[waiting : waiting + 2]
                )
                sizes[waiting], sizes[waiting + 1] = lower, upper
                waiting += 2
                continue
            if area_along(polygon, count, normal) <= LEAST_PIECE * size:
                continue
            if used == len(facet):
                facet, edges = np.concatenate((facet, facet)), np.concatenate((edges, edges))
                in_face, cells = np.concatenate((in_face, in_face)), np.concatenate((cells, cells))
                starts = np.concatenate((starts, starts))
            while total + count > len(corners):
                corners = np.concatenate((corners, corners))
            facet[used], edges[used] = t, 0
            for k in range(count):
                for i in range(3):
                    corners[total + k, i] = polygon[k, i]
                if sides[k] >= 0:
                    edges[used] |= 1 << sides[k]
            in_face[used] = find_cell(polygon, count, normal, cells[used])
            used += 1
            total += count
            starts[used] = total
    return corners[:total].copy(), starts[: used + 1].copy(), facet[:used], edges[:used], in_face[:used], cells[:used]


@compiled
def polygon_nodes(
    corners: Floats, starts: Ints, small: Bools, shares: Floats, weights: Floats
) -> tuple[Floats, Floats, Ints]:
    """Return quadrature points (q, 3) on convex polygons, weights times normals (q, 3), and the polygon (q,) of each.

    Polygons, with the ``corners`` (k, 3) from ``starts`` (m + 1,) on, are divided into fans of triangles, each with the
    rule ``shares`` (r, 3), ``weights`` (r,), or where ``small`` (m,) with three points.
    """
    m, rule, total = len(starts) - 1, len(weights), 0
    for p in range(m):
        total += (starts[p + 1] - starts[p] - 2) * (3 if small[p] else rule)
    points, areas, piece = np.empty((total, 3)), np.empty((total, 3)), np.empty(total, dtype=np.int64)
    used = 0
    for p in range(m):
        first = corners[starts[p]]
        for k in range(starts[p] + 1, starts[p + 1] - 1):
            a, b = corners[k] - first, corners[k + 1] - first
            x = 0.5 * (a[1] * b[2] - a[2] * b[1])
            y = 0.5 * (a[2] * b[0] - a[0] * b[2])
            z = 0.5 * (a[0] * b[1] - a[1] * b[0])
            for r in range(3 if small[p] else rule):
                s, t, w = (4 if r == 1 else 1) / 6, (4 if r == 2 else 1) / 6, 1 / 3
                if not small[p]:
                    s, t, w = shares[r, 1], shares[r, 2], weights[r]
                for i in range(3):
                    points[used, i] = first[i] + s * a[i] + t * b[i]
                areas[used, 0], areas[used, 1], areas[used, 2] = w * x, w * y, w * z
                piece[used] = p
                used += 1
    return points, areas, piece
