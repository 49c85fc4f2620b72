"""Triangles that turn over beside a curved boundary: their vertices or midpoints are moved back, or with the boundary.

A triangle turns over if a vertex lies between a boundary and its chord when the chord's ends and midpoint are moved
onto the boundary. Its area would count twice; were the boundary left on its chord, samples would lie on its wrong side.

A triangle with two edges on one boundary is special. If the chords pass the triangle on one side and the boundary
itself on the other, the third edge becomes the facet on the boundary. If the triangle is thinner than the height of the
arcs above their chords, it would turn over with curved edges, and with straight edges up to two thirds of that height
times the chord would be area on the wrong side: then the third edge is flipped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import unit_normals
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.mesh import Edges, Mesh
from cpmkit.types import Bools, Floats, Ints

#: A triangle whose area shrinks to less than this share, at one of its corners, counts as turned over.
LEAST_AREA_RATIO = 0.2
#: While vertices are moved onto a boundary, triangles may become as thin as this share: moved back, the vertices would
#: be a hundredth of a spacing off the boundary, where data may jump.
LEAST_MOVED_AREA_RATIO = 0.02
#: Step of differences for normals of a manifold that has no normals of its own, over the longest edge.
NORMAL_EDGE_SHARE = 0.1
#: Number of rounds, since moving vertices or midpoints back may turn over other triangles.
UNTANGLING_ROUNDS = 4


def untangle_vertices(mesh: Mesh, before: Floats, moved: Floats) -> Floats:
    """Return ``moved`` (v, d), with the positions ``before`` (v, d) for vertices of triangles that would turn over.

    A triangle turns over if its area shrinks below ``LEAST_MOVED_AREA_RATIO``. Vertices that are moved back may lie off
    their boundary. There are ``UNTANGLING_ROUNDS`` rounds. For segments ``moved`` itself is returned.
    """
    if mesh.manifold_dim == 1:
        return moved
    moved = moved.copy()
    has_moved = np.any(moved != before, axis=1)
    for _ in range(UNTANGLING_ROUNDS):
        cells = mesh.cells[np.flatnonzero(has_moved[mesh.cells].any(axis=1))]
        turned_over = area_ratios(before[cells], moved[cells]) < LEAST_MOVED_AREA_RATIO
        rows = np.unique(cells[turned_over])
        rows = rows[has_moved[rows]]
        if not len(rows):
            break
        moved[rows], has_moved[rows] = before[rows], False
    return moved


def untangle_midpoints(
    mesh: Mesh,
    on_boundary: Ints,
    midpoints: Floats,
    free: Floats,
    source: LocalSource,
    project: Callable[[Floats], Floats],
) -> Floats:
    """Return the ``midpoints`` (e, d) of edges, changed where quadratic triangles would turn over.

    First the other midpoints of such triangles are displaced with the midpoint on the boundary. Where triangles still
    turn over, the midpoints on boundaries return to ``free``, projected, and the others to ``midpoints``. A few
    triangles may still turn over.

    ``mesh``: triangles. ``on_boundary`` (c,): the edges on boundaries. ``source``: the manifold.
    ``midpoints``, ``free`` (e, d): midpoints on the manifold, the rim and boundaries; and those before any was moved
        onto a boundary, on the chords or the manifold.
    ``project``: projects points (k, d) near the free midpoints onto the manifold.
    """
    folded = _folded_triangles(mesh, midpoints, source)
    if not len(folded):
        return midpoints
    is_on_boundary = np.zeros(len(midpoints), dtype=bool)
    is_on_boundary[on_boundary] = True
    moved = _move_midpoints_with_boundary(mesh, is_on_boundary, folded, midpoints, free, project)
    for _ in range(UNTANGLING_ROUNDS):
        edges = mesh.edges.of_cells[_folded_triangles(mesh, moved, source)].ravel()
        if not len(edges):
            break
        rows = np.unique(edges[is_on_boundary[edges]])
        others = np.unique(edges[~is_on_boundary[edges]])
        moved[others] = midpoints[others]
        moved[rows] = project(free[rows])
    return moved


def area_ratios(before: Floats, moved: Floats) -> Floats:
    """Return the ratios (m,) of the signed areas of triangles after and before a move of their corners (m, 3, d)."""
    return _signed_ratio(*_sides(before), *_sides(moved))


def is_folded(x: Floats, midpoints: Floats) -> Bools:
    """Return which quadratic triangles (m,) turn over, or nearly (``LEAST_AREA_RATIO``), by the Jacobian at a corner.

    ``x``, ``midpoints`` (m, 3, d) are the corners, and the midpoints of the edges opposite to them.
    """
    following, previous = np.array([1, 2, 0]), np.array([2, 0, 1])
    ahead, behind = x[:, following], x[:, previous]
    first = 4 * midpoints[:, previous] - 3 * x - ahead
    second = 4 * midpoints[:, following] - 3 * x - behind
    ratios = _signed_ratio(ahead - x, behind - x, first, second)
    return np.asarray(np.any(ratios < LEAST_AREA_RATIO, axis=1))


def _sides(corners: Floats) -> tuple[Floats, Floats]:
    """Return the two sides (n, d) from the first corner of triangles with ``corners`` (n, 3, d)."""
    return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]


def _signed_ratio(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Return the ratio (n,) of the area spanned by c and d, projected on the plane of a and b, to that of a and b.

    All are (n, d) vectors. The ratio is negative where the orientation changes, and 1 where a and b span no area.
    """
    size = dots(a, a) * dots(b, b) - dots(a, b) ** 2
    projected = dots(c, a) * dots(d, b) - dots(c, b) * dots(d, a)
    return np.asarray(np.divide(projected, size, out=np.ones_like(size), where=size > 0))


def _folded_triangles(mesh: Mesh, midpoints: Floats, source: LocalSource) -> Ints:
    """Return the numbers (k,) of the triangles that turn over both in their own plane and along the manifold's normal.

    ``midpoints`` (e, d) are those of the edges. The plane of a triangle alone is no measure where the triangle is
    thinner than the heights of its curved edges.
    """
    corners, of_cells = mesh.vertices[mesh.cells], mesh.edges.of_cells
    rows = np.flatnonzero(is_folded(corners, midpoints[of_cells]))
    if not len(rows):
        return rows
    x, middles = corners[rows], midpoints[of_cells[rows]]
    step = NORMAL_EDGE_SHARE * float(norms(x - np.roll(x, 1, axis=1)).max())
    normal = unit_normals(source, source.closest_point(x.mean(axis=1)), step)[:, None]
    x, middles = (points - dots(points, normal)[..., None] * normal for points in (x, middles))
    return rows[is_folded(x, middles)]


def _move_midpoints_with_boundary(
    mesh: Mesh,
    is_on_boundary: Bools,
    folded: Ints,
    midpoints: Floats,
    free: Floats,
    project: Callable[[Floats], Floats],
) -> Floats:
    """Return the ``midpoints`` (e, d) of edges, displaced in ``folded`` triangles (k,) along with the boundary.

    Only triangles with exactly one edge on a boundary are treated. The midpoint of this edge is displaced from its
    position without boundaries, ``free`` (e, d). The two other midpoints get a share of that displacement, and
    ``project`` returns them to the manifold. The share is 1 at the midpoint of the edge's chord, and falls to 0 towards
    the ends of the chord and at a distance of its length.
    """
    edges = mesh.edges.of_cells[folded]
    edges = edges[is_on_boundary[edges].sum(axis=1) == 1]
    moved = midpoints.copy()
    if not len(edges):
        return moved
    on_boundary = edges[is_on_boundary[edges]]
    start, end = (mesh.vertices[mesh.edges.ends[on_boundary, k]] for k in range(2))
    chord, displacement = end - start, midpoints[on_boundary] - free[on_boundary]
    for rows in edges[~is_on_boundary[edges]].reshape(-1, 2).T:
        along = dots(free[rows] - start, chord) / dots(chord, chord)
        gap = norms(free[rows] - start - along[:, None] * chord) / norms(chord)
        share = np.maximum(4 * along * (1 - along), 0.0) * np.maximum(1 - gap, 0.0)
        moved[rows] = project(free[rows] + share[:, None] * displacement)
    return moved


def remove_double_boundary_edges(mesh: Mesh, before: Floats, moved: Floats) -> tuple[Mesh, Ints]:
    """Return the triangles with fewer facets on boundaries, and the vertices (k,) that lie on no boundary any more.

    Where a triangle with two facets of one boundary would turn over, its third edge becomes a facet in their place.
    ``before``, ``moved`` (v, d): the vertices, and the same with those on boundaries moved onto the true boundaries.
    """
    released = [np.zeros(0, dtype=np.int64)]
    for _ in range(4):  # the third edge of a triangle may give the next triangle two edges on the boundary
        pairs, corners = _double_edges(mesh, before, moved)
        if not len(pairs):
            break
        mesh = _replace_facet_pairs(mesh, pairs, corners)
        released.append(corners[:, 0])
    return mesh, np.concatenate(released)


def _double_edges(mesh: Mesh, before: Floats, moved: Floats) -> tuple[Ints, Ints]:
    """Return pairs (k, 2) of rows of ``mesh.cut``, and the corners (k, 3) of the triangles with both facets as edges.

    The triangles would turn over, and their facets are consecutive on one boundary. The common corner, where no other
    facet ends, comes first. Of triangles that share a row only the first is returned.
    """
    edges = mesh.edges
    row = np.full(len(edges.ends) + 1, -1)
    row[mesh.cut_edges] = np.arange(len(mesh.cut))
    row[-1] = -1
    rows = row[edges.of_cells]
    triangles = np.flatnonzero((rows >= 0).sum(axis=1) == 2)
    corners = mesh.cells[triangles]
    triangles = triangles[area_ratios(before[corners], moved[corners]) < LEAST_AREA_RATIO]
    around = (rows[triangles].argmin(axis=1)[:, None] + np.arange(3)) % 3
    corners, pairs = (np.take_along_axis(table[triangles], around, 1) for table in (mesh.cells, rows))
    pairs, ends = pairs[:, 1:], np.bincount(mesh.cut.ravel(), minlength=len(before))
    fits = (mesh.owner[pairs[:, 0]] == mesh.owner[pairs[:, 1]]) & ~mesh.beyond_tip[pairs].any(axis=1)
    fits &= (ends[corners[:, 0]] == 2) & (_starts_at_common_corner(mesh, pairs, corners).sum(axis=1) == 1)
    pairs, corners = pairs[fits], corners[fits]
    first = np.full(len(mesh.cut), len(pairs))
    np.minimum.at(first, pairs, np.arange(len(pairs))[:, None])
    unique = (first[pairs] == np.arange(len(pairs))[:, None]).all(axis=1)
    return pairs[unique], corners[unique]


def _starts_at_common_corner(mesh: Mesh, pairs: Ints, corners: Ints) -> Ints:
    """Return an array (k, 2): 1 where a row of ``mesh.cut`` in ``pairs`` (k, 2) starts at the common corner, else 0.

    The common corner is the first of ``corners`` (k, 3). Of two consecutive edges of a boundary just one starts there.
    """
    return np.asarray(mesh.cut[pairs][:, :, 0] == corners[:, :1], dtype=np.int64)


def _replace_facet_pairs(mesh: Mesh, pairs: Ints, corners: Ints) -> Mesh:
    """Return the mesh with the third edge of triangles as facet in place of two others, ``pairs`` (k, 2) of its cut.

    ``corners`` (k, 3) are the triangles' corners, the common corner of both facets first.
    """
    later = _starts_at_common_corner(mesh, pairs, corners).argmax(axis=1)
    first = np.take_along_axis(pairs, 1 - later[:, None], 1)[:, 0]
    second = np.take_along_axis(pairs, later[:, None], 1)[:, 0]
    cut = mesh.cut.copy()
    cut[first, 1] = mesh.cut[second, 1]
    remaining = np.ones(len(cut), dtype=bool)
    remaining[second] = False
    parts = {"owner": mesh.owner[remaining], "beyond_tip": mesh.beyond_tip[remaining]}
    return mesh.with_same_cells(cut=cut[remaining], **parts)


def flip_chords(mesh: Mesh) -> Mesh:
    """Return the mesh after flips of the third edge of triangles with two edges in line on boundaries."""
    of_cells = mesh.edge_is_cut[mesh.edges.of_cells]
    thin = np.flatnonzero(of_cells.sum(axis=1) == 2)
    if not len(thin):
        return mesh
    return flip_third_edges(mesh, thin, of_cells[thin].argmin(axis=1))


def flip_third_edges(mesh: Mesh, thin: Ints, lead: Ints) -> Mesh:
    """Return the triangles; if two edges of one of ``thin`` (k,) lie nearly in line, its third edge is flipped.

    The two edges meet at corner ``lead`` (k,). The third stays if it lies on a boundary, if it does not have two
    triangles that form a convex quadrilateral and take part in no other flip, or if the flipped edge exists already.
    """
    edges = mesh.edges
    cells, chords = _rotate_corners(mesh.cells, edges, thin, lead)
    sides = mesh.vertices[cells[:, 1:]] - mesh.vertices[cells[:, :1]]
    # A line continues through a vertex where the cosine of the angle between its edges there is below -.8.
    straight = dots(sides[:, 0], sides[:, 1]) < -0.8 * norms(sides[:, 0]) * norms(sides[:, 1])
    straight &= ~mesh.edge_is_cut[chords]
    thin, cells, chords = thin[straight], cells[straight], chords[straight]
    neighbour, corner = _opposite_triangles(edges, thin, chords)
    thin, cells, neighbour, corner = (array[neighbour >= 0] for array in (thin, cells, neighbour, corner))
    across, _ = _rotate_corners(mesh.cells, edges, neighbour, corner)
    differ = across[:, 1] == cells[:, 1]  # the new triangles are oriented like the second one
    cells[differ] = cells[differ][:, [0, 2, 1]]
    first = np.stack([cells[:, 0], cells[:, 1], across[:, 0]], axis=1)
    second = np.stack([cells[:, 0], across[:, 0], cells[:, 2]], axis=1)
    fits = np.ones(len(cells), dtype=bool)
    around = _area_vectors(mesh.vertices, cells) + _area_vectors(mesh.vertices, across)
    for triangles in (first, second):  # the quadrilateral is convex
        fits &= dots(_area_vectors(mesh.vertices, triangles), around) > 0
    ends = np.sort(np.concatenate([mesh.edges.ends, first[:, [0, 2]]]), axis=1) @ [len(mesh.vertices), 1]
    fits &= ~np.isin(ends[len(mesh.edges.ends) :], ends[: len(mesh.edges.ends)])
    times = np.bincount(np.concatenate([thin[fits], neighbour[fits]]), minlength=len(mesh.cells))
    fits &= (times[thin] == 1) & (times[neighbour] == 1)
    flipped = mesh.cells.copy()
    flipped[thin[fits]], flipped[neighbour[fits]] = first[fits], second[fits]
    return replace(mesh, cells=flipped)


def _rotate_corners(cells: Ints, edges: Edges, rows: Ints, lead: Ints) -> tuple[Ints, Ints]:
    """Return the corners (k, 3) of triangles ``rows`` (k,), ``lead`` (k,) first, and the edges (k,) opposite to it."""
    around = (lead[:, None] + np.arange(3)) % 3
    return np.take_along_axis(cells[rows], around, 1), edges.of_cells[rows, lead]


def _opposite_triangles(edges: Edges, rows: Ints, shared: Ints) -> tuple[Ints, Ints]:
    """Return the second triangle (k,) at each edge ``shared`` (k,) of triangles ``rows`` (k,), and its corner (k,).

    The corner, 0 to 2, is opposite to the edge. Where the edge has not two triangles, the triangle is -1.
    """
    chosen = np.zeros(len(edges.ends), dtype=bool)
    chosen[shared] = True
    cell, corner = np.nonzero(chosen[edges.of_cells])
    edge = edges.of_cells[cell, corner]
    count = np.bincount(edge, minlength=len(edges.ends))
    cells, corners = np.zeros((2, len(edges.ends)), dtype=np.int64)
    np.add.at(cells, edge, cell)
    np.add.at(corners, edge, corner)
    is_shared = edges.of_cells[rows] == shared[:, None]
    other, at = cells[shared] - rows, corners[shared] - is_shared.argmax(axis=1)
    return np.where(count[shared] == 2, other, -1), at


def _area_vectors(vertices: Floats, cells: Ints) -> Floats:
    """Return normals (m, 3), as long as twice the area, of triangles ``cells`` (m, 3) with ``vertices`` (v, 2 or 3)."""
    x = vertices[cells]
    if x.shape[2] == 2:
        x = np.concatenate([x, np.zeros((*x.shape[:2], 1))], axis=2)
    return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
