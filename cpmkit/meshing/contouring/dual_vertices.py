"""Dual contouring: a vertex for each connected piece of the surface in a cell, a quadrilateral for each crossing.

Points are connected on the surface if a bisection of their chord closes (:func:`connected_on_surface`).
"""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.meshing.contour_edges import edge_table
from cpmkit.meshing.contouring.contour_nodes import NORMAL_NOISES, LatticeNodes
from cpmkit.meshing.contouring.edge_crossings import Crossings
from cpmkit.meshing.sharp_creases import LEAST_SINGULAR_SHARE, Faces, points_on_creases, shows_slight_creases
from cpmkit.types import Bools, Floats, Ints

#: A chord is flat if the sines of its angles with the tangent planes at its ends are at most this (arcs to 10 degrees),
FLAT_SINE = 0.1
#: and if the cosine of the angle between the normals at its ends is at least this.
FLAT_COSINE = 0.8
#: At a crease, points that should lie on the surface are off it by at most this share of their chord.
CREASE_DISTANCE = 0.1


def chord_is_flat(a: Floats, b: Floats, normal_a: Floats, normal_b: Floats, position_error: float) -> Bools:
    """Return which chords (n,) from ``a`` to ``b`` (n, 3) nearly lie in the tangent planes at both ends.

    The normals (n, 3) must agree up to sign; an unknown normal is zero. Ends have an error up to ``position_error``.
    """
    chord = b - a
    sine = 0.5 * (np.abs(dots(chord, normal_a)) + np.abs(dots(chord, normal_b)))
    unknown = (normal_a == 0).all(axis=1) | (normal_b == 0).all(axis=1)
    same_direction = np.abs(dots(normal_a, normal_b)) > FLAT_COSINE
    return np.asarray((sine <= FLAT_SINE * norms(chord) + position_error) & (same_direction | unknown))


def connected_on_surface(
    source: LocalSource,
    a: Floats,
    b: Floats,
    normal_a: Floats,
    normal_b: Floats,
    position_error: float,
    box: tuple[Floats, Floats],
) -> Bools:
    """Return whether each pair (n,) of points ``a`` and ``b`` (n, 3) of a surface is connected along it inside a box.

    The points are connected if the chord is flat, or if a crease of the surface between them intersects the box; if the
    crease passes outside, they are connected in another box. Otherwise the chord is bisected: the closest point of its
    midpoint replaces one end, so that the half that is not flat, or the longer half, is left. The points are connected
    if the length of the chord shrinks to zero; between two sheets it does not.

    ``normal_a``, ``normal_b`` (n, 3): unit normals at ``a`` and ``b``, of either sign.
    ``position_error``: the length up to which the points are known.
    ``box`` ((n, 3), (n, 3)) float64: the lowest and the highest corner of each box.
    """
    connected = chord_is_flat(a, b, normal_a, normal_b, position_error)
    rows = np.flatnonzero(~connected)
    creased, crease = _connected_over_crease(source, a[rows], b[rows], normal_a[rows], normal_b[rows], position_error)
    connected[rows] = creased & _line_meets_box(
        crease, np.cross(normal_a[rows], normal_b[rows]), box[0][rows], box[1][rows]
    )
    rows = rows[~creased]
    a, b, normal_a, normal_b = (np.array(values[rows]) for values in (a, b, normal_a, normal_b))
    first_gap = gap = norms(b - a)
    for _ in range(40):  # a limit; gaps close or stick before
        if not len(rows):
            break
        middle = 0.5 * (a + b)
        closest = source.closest_point(middle).points
        away = middle - closest
        has_normal = norms(away) > np.maximum(1e-3 * first_gap, NORMAL_NOISES * source.noise)
        normal = np.where(has_normal[:, None], unit(away), 0.0)
        to_a, to_b = norms(closest - a), norms(b - closest)
        flat_a = chord_is_flat(a, closest, normal_a, normal, position_error)
        flat_b = chord_is_flat(closest, b, normal, normal_b, position_error)
        first_half = np.where(flat_a == flat_b, to_a >= to_b, flat_b)
        keep_a = first_half[:, None]
        a, normal_a = np.where(keep_a, a, closest), np.where(keep_a, normal_a, normal)
        b, normal_b = np.where(keep_a, closest, b), np.where(keep_a, normal, normal_b)
        new_gap = np.where(first_half, to_a, to_b)
        closed = (flat_a & flat_b) | (new_gap < np.maximum(0.05 * first_gap, 6.0 * source.noise))
        connected[rows[closed]] = True
        # Where the gap grows, or shrinks by less than 3 percent in a round, the points lie on different sheets.
        go = ~closed & (new_gap <= 1.2 * first_gap) & (new_gap <= 0.97 * gap)
        rows, first_gap, gap = rows[go], first_gap[go], new_gap[go]
        a, b, normal_a, normal_b = a[go], b[go], normal_a[go], normal_b[go]
    return connected


def _connected_over_crease(
    source: LocalSource, a: Floats, b: Floats, normal_a: Floats, normal_b: Floats, position_error: float
) -> tuple[Bools, Floats]:
    """Return whether (n,) the tangent planes at ``a`` and ``b`` (n, 3) meet in a crease, and points (n, 3) of creases.

    The point of the planes' common line nearest to the chord's midpoint must lie on the surface, and so must the
    midpoints of the two chords from it to ``a`` and ``b``. Where there is no crease the points have no meaning.
    """
    connected = np.zeros(len(a), dtype=bool)
    middle, length, cosine = 0.5 * (a + b), norms(b - a), dots(normal_a, normal_b)
    height_a, height_b = dots(normal_a, a - middle), dots(normal_b, b - middle)
    with np.errstate(all="ignore"):
        share = 1 / (1 - cosine**2)
        along_a, along_b = share * (height_a - cosine * height_b), share * (height_b - cosine * height_a)
        crease = middle + along_a[:, None] * normal_a + along_b[:, None] * normal_b
        crease_is_close = norms(crease - middle) < 1.5 * length
    known = (normal_a != 0).any(axis=1) & (normal_b != 0).any(axis=1)
    rows = np.flatnonzero(known & crease_is_close & (1 - cosine**2 > 0.3**2))
    a, b, normal_a, normal_b, length = a[rows], b[rows], normal_a[rows], normal_b[rows], length[rows]
    closest = source.closest_point(crease[rows]).points
    meets = norms(closest - crease[rows]) <= CREASE_DISTANCE * length + position_error
    for end, normal in ((a, normal_a), (b, normal_b)):
        rise = np.abs(dots(closest - end, normal))
        meets &= rise <= FLAT_SINE * norms(closest - end) + position_error
    crease[rows] = closest
    rows, a, b, closest = rows[meets], a[meets], b[meets], closest[meets]
    midpoints = [0.5 * (end + closest) for end in (a, b)]
    on_surface = source.closest_point(np.concatenate(midpoints)).points.reshape(2, -1, 3)
    connected[rows] = True
    for end, half, projected in zip((a, b), midpoints, on_surface, strict=True):
        connected[rows] &= norms(projected - half) <= CREASE_DISTANCE * norms(closest - end) + position_error
    return connected, crease


def _line_meets_box(point: Floats, along: Floats, low: Floats, high: Floats) -> Bools:
    """Return which lines (n,), through ``point`` along ``along`` (n, 3), meet the boxes ``low`` to ``high`` (n, 3)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - point) / along, (high - point) / along
    enters = np.where(along == 0, np.where(low <= point, -np.inf, np.inf), np.minimum(first, second)).max(axis=1)
    leaves = np.where(along == 0, np.where(point <= high, np.inf, -np.inf), np.maximum(first, second)).min(axis=1)
    return np.asarray(enters <= leaves)


#: Eigenvalues of a sum of projections below this share of the largest one are noise: their directions are not used.
LEAST_EIGENVALUE = 0.12
#: A slight crease is sought if the common point of planes is nearer to the surface than this share of its height above
#: the crossings.
PLANES_SHARE = 0.4


def dual_vertices(source: LocalSource, nodes: LatticeNodes, crossings: Crossings) -> tuple[Floats, Floats, Ints, bool]:
    """Return vertices (v, 3) on the surface, unit normals (v, 3) there of either sign, and quadrilaterals (c, 4).

    The last result is whether there are slight creases (:attr:`LocalSource.slight_creases`). Each group of crossings of
    one cell's edges that are connected on the surface in the cell has one vertex. Each crossing has a quadrilateral:
    the vertices, in cyclic order, in the four cells around its lattice edge.
    """
    strides = nodes.codes.strides
    u, v = strides[(crossings.axis + 1) % 3], strides[(crossings.axis + 2) % 3]
    cells = np.asarray(nodes.codes.encode(crossings.node)[:, None] - np.stack([0 * u, u, u + v, v], axis=1))
    order = np.argsort(cells.ravel(), kind="stable")
    member, sorted_cells = order // 4, cells.ravel()[order]
    start = np.append(np.flatnonzero(np.diff(sorted_cells, prepend=-1)), len(order)).astype(np.int64)
    group = _connected_groups(source, nodes, crossings, start, member, sorted_cells)
    roots, piece = np.unique(group, return_inverse=True)
    around = np.empty(len(order), dtype=np.int64)
    around[order] = piece
    vertex, normals, slight = _least_squares_vertices(source, nodes, sorted_cells[roots], crossings, member, piece)
    return source.closest_point(vertex).points, normals, around.reshape(-1, 4), slight


def _connected_groups(
    source: LocalSource, nodes: LatticeNodes, crossings: Crossings, start: Ints, member: Ints, cells: Ints
) -> Ints:
    """Return the group (k,) of each entry, the same for entries of one cell whose crossings are connected in the cell.

    An entry is a pair of a cell and a crossing of one of its edges; a group is named by one of its entries.
    ``start`` (cells + 1,): the first entry of each cell, and the number of entries.
    ``member``, ``cells`` (k,): the crossing of each entry, and the code of its cell.
    """
    from cpmkit.meshing.contouring.contouring_kernels import nearest_pairs, unite, unite_flat

    points, normals = crossings.points, crossings.normals
    # Crossings are known to this share of the spacing, and to so many times the noise of closest points.
    position_error = max(2e-3 * nodes.spacing, 4.0 * source.noise)
    group = np.arange(len(member))
    unite_flat(start, member, points, normals, FLAT_SINE, FLAT_COSINE, position_error, group)
    pairs = np.empty((0, 2), dtype=np.int64)
    pairs = np.empty((nearest_pairs(start, member, points, group, pairs), 2), dtype=np.int64)
    nearest_pairs(start, member, points, group, pairs)
    i, j = member[pairs].T
    margin = 0.02 * nodes.spacing  # creases on a cell's faces connect crossings of the cell
    low = (nodes.position_of(nodes.codes.decode(cells)) - margin)[pairs[:, 0]]
    box = low, low + (nodes.spacing + 2 * margin)
    connected = connected_on_surface(source, points[i], points[j], normals[i], normals[j], position_error, box)
    unite(np.ascontiguousarray(pairs[connected, 0]), np.ascontiguousarray(pairs[connected, 1]), group)
    return group


def _least_squares_vertices(
    source: LocalSource, nodes: LatticeNodes, cells: Ints, crossings: Crossings, member: Ints, piece: Ints
) -> tuple[Floats, Floats, bool]:
    """Return points (v, 3) nearest to the tangent planes of the crossings of each group, and unit normals (v, 3).

    Least squares are relative to the mean of the crossings; along eigenvectors of small eigenvalues points stay at the
    mean. Points that leave their cell by more than a tenth of its side are clipped. In cells with a slight crease
    points are moved onto the crease; the last result is whether there are any. Normals have either sign.
    ``cells`` (v,): the code of the cell of each group.
    ``member``, ``piece`` (k,): pairs of a crossing and its group; a crossing has four, one for each cell around it.
    """
    count = len(cells)
    share = 1.0 / np.bincount(piece, minlength=count)
    points, n = crossings.points[member], crossings.normals[member]

    def mean(values: Floats) -> Floats:
        """Return the mean (v,) of ``values`` (k,) over the entries of each group."""
        return np.asarray(np.bincount(piece, values, minlength=count) * share)

    centre = np.stack([mean(points[:, k]) for k in range(3)], axis=1)
    height = ((points - centre[piece]) * n).sum(axis=1)
    matrix = np.stack([np.stack([mean(n[:, i] * n[:, j]) for j in range(3)], axis=1) for i in range(3)], axis=1)
    side = np.stack([mean(n[:, k] * height) for k in range(3)], axis=1)
    values, axes = np.linalg.eigh(matrix)
    used = values >= LEAST_EIGENVALUE * values[:, -1:]
    part = np.einsum("vki,vk->vi", axes, side)
    step = np.einsum("vki,vi->vk", axes, part * np.where(used, 1.0 / np.where(used, values, 1.0), 0.0))
    low = nodes.position_of(nodes.codes.decode(cells))
    margin = 0.1 * nodes.spacing
    vertex, normals = np.clip(centre + step, low - margin, low + nodes.spacing + margin), axes[:, :, -1]
    slight = np.flatnonzero(~used[:, 1] & (values[:, 1] >= LEAST_SINGULAR_SHARE**2 * values[:, 2]))
    on_crease = np.zeros(len(vertex), dtype=bool)
    if len(slight) and shows_slight_creases(source, np.array([nodes.spacing])):
        # planes at a smooth surface meet at twice its height above the crossings; planes at a crease meet on the crease
        common = (centre + step)[slight] + axes[slight, :, 1] * (part[slight, 1] / values[slight, 1])[:, None]
        height = np.abs(dots(common - centre[slight], normals[slight]))
        slight = slight[source.closest_point(common).distance < PLANES_SHARE * height]
        faces = Faces.of_sides(slight, axes[slight, :, 1], normals[slight], np.full(len(slight), nodes.spacing))
        moved, on_crease = points_on_creases(source, vertex, faces)
        on_crease &= ((moved >= low) & (moved < low + nodes.spacing)).all(axis=1)  # or two vertices might coincide
        vertex = np.where(on_crease[:, None], moved, vertex)
    return vertex, np.ascontiguousarray(normals), bool(on_crease.any())


def dual_triangles(source: LocalSource, points: Floats, normals: Floats, around: Ints) -> Ints:
    """Return the triangles (m, 3), of any orientation, into which the quadrilaterals ``around`` (c, 4) are split.

    ``points``, ``normals`` (v, 3) are those of the vertices. A quadrilateral is split along the diagonal whose midpoint
    is nearer to the surface, if planar along the shorter. Doubled ones are left out (:func:`_without_doubles`).
    """
    quads = _without_doubles(around)
    corners, normals = points[quads], normals[quads]
    first, second = 0.5 * (corners[:, 0] + corners[:, 2]), 0.5 * (corners[:, 1] + corners[:, 3])
    excess = norms(corners[:, 0] - corners[:, 2]) - norms(corners[:, 1] - corners[:, 3])
    edges = np.roll(corners, -1, axis=1) - corners
    rise = np.maximum(np.abs(dots(edges, normals)), np.abs(dots(edges, np.roll(normals, -1, axis=1))))
    curved = np.flatnonzero((rise > 0.1 * norms(edges)).any(axis=1))
    if len(curved):
        misses = [norms(x - source.closest_point(x).points) for x in (first[curved], second[curved])]
        excess[curved] = misses[0] - misses[1]
    turned = np.where((excess > 0)[:, None], np.roll(quads, -1, axis=1), quads)
    return np.ascontiguousarray(turned[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3))


def _without_doubles(quads: Ints) -> Ints:
    """Return the quadrilaterals (q, 4), with at most one of several on the same four vertices.

    Two quadrilaterals on the same vertices enclose a part thinner than a cell, and are left out. One is kept if their
    number is odd, or if another sheet ends at their edges, which would be cut off otherwise.
    """
    ordered = np.sort(quads, axis=1)
    _, first, same, count = np.unique(ordered, axis=0, return_index=True, return_inverse=True, return_counts=True)
    several, single = quads[first[count > 1]], quads[count[same.ravel()] == 1]
    single_edges = edge_table(single)
    ends = np.sort(np.stack([several, np.roll(several, -1, axis=1)], axis=-1), axis=-1)
    odd = single_edges.ends[single_edges.count % 2 == 1]
    size = int(quads.max(initial=0)) + 1
    needed = np.isin(ends @ [size, 1], odd @ [size, 1]).any(axis=1) | (count[count > 1] % 2 == 1)
    return np.concatenate([single, several[needed]])
