"""Triangles with two edges on one boundary: the boundary is moved to the third edge, or the third edge is flipped.

The chords of an inserted boundary may pass a triangle on one side while the boundary itself passes it on the other:
then the third edge becomes the facet on the boundary. Elsewhere the triangle is thinner than the boundary bends. With
its edges on the boundary and the third edge on the manifold it would turn over, and with straight edges there would be
area on the wrong side of the boundary, up to two thirds of the chord's height times its length: then the third edge is
flipped.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.mesh import Edges, Mesh
from cpmkit.meshing.untangling import LEAST_AREA_RATIO, area_ratios
from cpmkit.types import Bools, Floats, Ints

#: A boundary continues through a vertex where the cosine of the angle between its edges there is below this.
STRAIGHT_COSINE = -0.8
#: Number of rounds: moving the boundary to the third edge of a triangle may give the next triangle two such edges.
REMOVAL_ROUNDS = 4


def remove_double_boundary_edges(mesh: Mesh, before: Floats, moved: Floats) -> tuple[Mesh, Ints]:
    """Return triangles in which two edges on a boundary are replaced by the third where the triangle would turn over.

    Parameters
    ----------
    mesh : Mesh
        Triangles.
    before, moved : (v, d) float64
        The vertices of the mesh, and the same with the boundary vertices moved onto the boundaries.

    Returns
    -------
    mesh : Mesh
        With the same cells and fewer facets on boundaries.
    released : (k,) int64
        Vertices that no longer lie on a boundary.
    """
    released = [np.zeros(0, dtype=np.int64)]
    for _ in range(REMOVAL_ROUNDS):
        pairs, corners = _double_edges(mesh, before, moved)
        if not len(pairs):
            break
        mesh = _replace_pairs(mesh, pairs, corners)
        released.append(corners[:, 0])
    return mesh, np.concatenate(released)


def _double_edges(mesh: Mesh, before: Floats, moved: Floats) -> tuple[Ints, Ints]:
    """Return pairs (k, 2) of rows of ``mesh.cut`` that are edges of one triangle which would turn over.

    The corners (k, 3) of these triangles are returned too, the common corner of both edges first. Of triangles that
    share a row only the first is returned.
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
    """Return an array (k, 2): 1 where a row of ``mesh.cut`` in ``pairs`` starts at the common corner, else 0.

    The common corner is the first of ``corners`` (k, 3). Of two consecutive edges of a boundary exactly one starts
    there.
    """
    return np.asarray(mesh.cut[pairs][:, :, 0] == corners[:, :1], dtype=np.int64)


def _replace_pairs(mesh: Mesh, pairs: Ints, corners: Ints) -> Mesh:
    """Return the mesh with the third edge of triangles on the boundary in place of the edges ``pairs`` (k, 2).

    ``corners`` (k, 3) are the triangles' corners, the common corner of both edges first.
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
    """Return triangles in which chords of boundaries are flipped, so that no triangle has two edges on one boundary.

    A chord, the third edge of such a triangle, stays where it lies on a boundary or the rim, where its two triangles
    are oriented differently or form no convex quadrilateral, or where the flipped edge exists already.
    """
    edges = mesh.edges
    on_cut = np.zeros(len(edges.ends) + 1, dtype=bool)
    on_cut[mesh.cut_edges] = True
    on_cut[-1] = False
    of_cells = on_cut[edges.of_cells]
    thin = np.flatnonzero(of_cells.sum(axis=1) == 2)
    if not len(thin):
        return mesh
    cells, chords = _rotate(mesh.cells, edges, thin, of_cells[thin].argmin(axis=1))
    sides = mesh.vertices[cells[:, 1:]] - mesh.vertices[cells[:, :1]]
    straight = dots(sides[:, 0], sides[:, 1]) < STRAIGHT_COSINE * norms(sides[:, 0]) * norms(sides[:, 1])
    thin, cells, chords = thin[straight], cells[straight], chords[straight]
    neighbour, corner = _triangles_across(edges, thin, chords)
    thin, cells, neighbour, corner = (array[neighbour >= 0] for array in (thin, cells, neighbour, corner))
    across, _ = _rotate(mesh.cells, edges, neighbour, corner)
    first = np.stack([cells[:, 0], cells[:, 1], across[:, 0]], axis=1)
    second = np.stack([cells[:, 0], across[:, 0], cells[:, 2]], axis=1)
    fits = (across[:, 1] == cells[:, 2]) & (across[:, 2] == cells[:, 1])
    fits &= _are_convex(mesh.vertices, cells, across, first, second) & _have_no_edge(mesh, cells[:, 0], across[:, 0])
    fits &= _are_unique(np.concatenate([thin, neighbour]), np.tile(fits, 2)).reshape(2, -1).all(axis=0)
    flipped = mesh.cells.copy()
    flipped[thin[fits]], flipped[neighbour[fits]] = first[fits], second[fits]
    return replace(mesh, cells=flipped)


def _rotate(cells: Ints, edges: Edges, rows: Ints, lead: Ints) -> tuple[Ints, Ints]:
    """Return the corners (k, 3) of triangles ``rows`` with corner ``lead`` first, and the opposite edges (k,)."""
    around = (lead[:, None] + np.arange(3)) % 3
    return np.take_along_axis(cells[rows], around, 1), edges.of_cells[rows, lead]


def _triangles_across(edges: Edges, rows: Ints, shared: Ints) -> tuple[Ints, Ints]:
    """Return the second triangle (k,) at each edge ``shared`` (k,) of triangles ``rows`` (k,), and its opposite corner.

    The triangle is -1 where the edge has not exactly two triangles.
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


def _are_convex(vertices: Floats, cells: Ints, across: Ints, first: Ints, second: Ints) -> Bools:
    """Return which quadrilaterals (k,) are convex: both new triangles are oriented like the old triangles together."""
    around = _area_vectors(vertices, cells) + _area_vectors(vertices, across)
    alike = [dots(_area_vectors(vertices, triangles), around) > 0 for triangles in (first, second)]
    return np.asarray(alike[0] & alike[1])


def _area_vectors(vertices: Floats, cells: Ints) -> Floats:
    """Return the normals (m, 3) of triangles ``cells`` (m, 3), as long as twice their areas."""
    x = vertices[cells]
    if x.shape[2] == 2:
        x = np.concatenate([x, np.zeros((*x.shape[:2], 1))], axis=2)
    return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])


def _have_no_edge(mesh: Mesh, first: Ints, second: Ints) -> Bools:
    """Return which pairs of the vertices ``first`` and ``second`` (k,) are not connected by an edge."""
    count = len(mesh.vertices)
    low, high = np.minimum(first, second), np.maximum(first, second)
    ends = np.sort(mesh.edges.ends, axis=1)
    return ~np.isin(low * count + high, ends[:, 0] * count + ends[:, 1])


def _are_unique(cells: Ints, chosen: Bools) -> Bools:
    """Return which of ``cells`` (k,) are ``chosen`` (k,) and occur only once among the chosen."""
    _, place, count = np.unique(cells[chosen], return_inverse=True, return_counts=True)
    unique = np.zeros(len(cells), dtype=bool)
    unique[np.flatnonzero(chosen)] = count[place] == 1
    return unique
