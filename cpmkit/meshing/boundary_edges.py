"""Triangles between a boundary and a chord of it: the chord is flipped, so that no triangle has two edges there.

Such a triangle is thinner than the boundary bends. With its edges there on the boundary and the chord on the manifold
it turns over, and with its edges straight there is area on the wrong side, as much as two thirds of the chord's height
times its length.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.manifold.vectors import dots, norms
from cpmkit.mesh.mesh import Edges, Mesh, edges_on_cut
from cpmkit.meshing.untangle_vertices import KEPT_SHARE, area_ratios
from cpmkit.protocols import Bools, Floats, Ints

#: A boundary runs on through a vertex where the cosine of the angle between its edges there is below this.
RUNS_ON_COSINE = -0.8


def flip_chords(mesh: Mesh, edges: Edges) -> Mesh:
    """Return a mesh of triangles with the chords of its boundaries flipped; ``edges`` are its own.

    A chord stays where it is on a boundary or a rim, where the two triangles at it are not wound alike, where they make
    no convex quadrilateral, or where the vertices that it would join have an edge already.
    """
    number = edges_on_cut(mesh, edges)
    on_cut = np.zeros(len(edges.ends) + 1, dtype=bool)
    on_cut[number] = True
    on_cut[-1] = False
    own = on_cut[edges.of_cells]
    thin = np.flatnonzero(own.sum(axis=1) == 2)
    if not len(thin):
        return mesh
    cells, chords = _turned(mesh.cells, edges, thin, own[thin].argmin(axis=1))
    ways = mesh.vertices[cells[:, 1:]] - mesh.vertices[cells[:, :1]]
    straight = dots(ways[:, 0], ways[:, 1]) < RUNS_ON_COSINE * norms(ways[:, 0]) * norms(ways[:, 1])
    thin, cells, chords = thin[straight], cells[straight], chords[straight]
    beside, corner = _beside(edges, thin, chords)
    thin, cells, beside, corner = (one[beside >= 0] for one in (thin, cells, beside, corner))
    across, _ = _turned(mesh.cells, edges, beside, corner)
    first = np.stack([cells[:, 0], cells[:, 1], across[:, 0]], axis=1)
    second = np.stack([cells[:, 0], across[:, 0], cells[:, 2]], axis=1)
    fits = (across[:, 1] == cells[:, 2]) & (across[:, 2] == cells[:, 1])
    fits &= _convex(mesh.vertices, cells, across, first, second) & _apart(mesh, edges, cells[:, 0], across[:, 0])
    fits &= _alone(np.concatenate([thin, beside]), np.tile(fits, 2)).reshape(2, -1).all(axis=0)
    flipped = mesh.cells.copy()
    flipped[thin[fits]], flipped[beside[fits]] = first[fits], second[fits]
    return replace(mesh, cells=flipped)


def _turned(cells: Ints, edges: Edges, rows: Ints, lead: Ints) -> tuple[Ints, Ints]:
    """Return the corners (k, 3) of the triangles ``rows``, the ``lead`` first, and the edges (k,) opposite to these."""
    around = (lead[:, None] + np.arange(3)) % 3
    return np.take_along_axis(cells[rows], around, 1), edges.of_cells[rows, lead]


def _beside(edges: Edges, rows: Ints, shared: Ints) -> tuple[Ints, Ints]:
    """Return the one other triangle (k,) at edges of triangles, -1 if it is not one, and its corner off the edge."""
    near = np.zeros(len(edges.ends), dtype=bool)
    near[shared] = True
    cell, corner = np.nonzero(near[edges.of_cells])
    edge = edges.of_cells[cell, corner]
    count = np.bincount(edge, minlength=len(edges.ends))
    cells, corners = np.zeros((2, len(edges.ends)), dtype=np.int64)
    np.add.at(cells, edge, cell)
    np.add.at(corners, edge, corner)
    own = edges.of_cells[rows] == shared[:, None]
    other, at = cells[shared] - rows, corners[shared] - own.argmax(axis=1)
    return np.where(count[shared] == 2, other, -1), at


def _convex(vertices: Floats, cells: Ints, across: Ints, first: Ints, second: Ints) -> Bools:
    """Whether both new triangles are wound as the quadrilateral of the old ones."""
    around = _area(vertices, cells) + _area(vertices, across)
    fine: Bools = (dots(_area(vertices, first), around) > 0) & (dots(_area(vertices, second), around) > 0)
    return fine


def _area(vertices: Floats, cells: Ints) -> Floats:
    x = vertices[cells]
    if x.shape[2] == 2:
        x = np.concatenate([x, np.zeros((*x.shape[:2], 1))], axis=2)
    return np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])


def _apart(mesh: Mesh, edges: Edges, one: Ints, other: Ints) -> Bools:
    """Whether pairs of vertices (k,) have no edge."""
    count = len(mesh.vertices)
    low, high = np.minimum(one, other), np.maximum(one, other)
    ends = np.sort(edges.ends, axis=1)
    return ~np.isin(low * count + high, ends[:, 0] * count + ends[:, 1])


def _alone(cells: Ints, target: Bools) -> Bools:
    """Whether each of ``cells`` that is asked for is so once."""
    found, where, count = np.unique(cells[target], return_inverse=True, return_counts=True)
    del found
    alone = np.zeros(len(cells), dtype=bool)
    alone[np.flatnonzero(target)] = count[where] == 1
    return alone


#: A triangle that is passed on its other side may leave the next one to be passed so; so often it is looked again.
ROUNDS = 4


def remove_double_boundary_edges(mesh: Mesh, edges: Edges, before: Floats, moved: Floats) -> tuple[Mesh, Ints]:
    """Return the mesh with its boundaries led past such triangles, and the vertices (k,) that are on them no more.

    Parameters
    ----------
    mesh : SampleMesh
        Of triangles.
    edges : Edges
        Its edges.
    before, moved : (v, d) float64
        Its vertices, and the same with those on boundaries moved onto these.
    """
    left = []
    for _ in range(ROUNDS):
        rows, corners = _passed(mesh, edges, before, moved)
        if not len(rows):
            break
        mesh = _led_past(mesh, rows, corners)
        left.append(corners[:, 0])
    return mesh, np.concatenate([np.zeros(0, dtype=np.int64), *left])


def _passed(mesh: Mesh, edges: Edges, before: Floats, moved: Floats) -> tuple[Ints, Ints]:
    """Return two rows (k, 2) of ``mesh.cut``, and the corners (k, 3) of the triangle they are of, their common first.

    Of triangles that share a row one is returned.
    """
    row = np.full(len(edges.ends) + 1, -1)
    row[edges_on_cut(mesh, edges)] = np.arange(len(mesh.cut))
    row[-1] = -1
    rows = row[edges.of_cells]
    two = np.flatnonzero((rows >= 0).sum(axis=1) == 2)
    two = two[area_ratios(before[mesh.cells[two]], moved[mesh.cells[two]]) < KEPT_SHARE]
    lead = rows[two].argmin(axis=1)
    around = (lead[:, None] + np.arange(3)) % 3
    corners, pairs = (np.take_along_axis(one[two], around, 1) for one in (mesh.cells, rows))
    pairs, ends = pairs[:, 1:], np.bincount(mesh.cut.ravel(), minlength=len(before))
    fits = (mesh.owner[pairs[:, 0]] == mesh.owner[pairs[:, 1]]) & ~mesh.beyond_tip[pairs].any(axis=1)
    fits &= (ends[corners[:, 0]] == 2) & (_starts(mesh, pairs, corners).sum(axis=1) == 1)
    pairs, corners = pairs[fits], corners[fits]
    once = np.full(len(mesh.cut), len(pairs))
    np.minimum.at(once, pairs, np.arange(len(pairs))[:, None])
    alone = (once[pairs] == np.arange(len(pairs))[:, None]).all(axis=1)
    return pairs[alone], corners[alone]


def _starts(mesh: Mesh, pairs: Ints, corners: Ints) -> Ints:
    """Return (k, 2) whether rows of ``mesh.cut`` start at the common corner: one of two that run one way does."""
    return np.asarray(mesh.cut[pairs][:, :, 0] == corners[:, :1], dtype=np.int64)


def _led_past(mesh: Mesh, pairs: Ints, corners: Ints) -> Mesh:
    """Return the mesh with the third edge of these triangles on the boundary, in place of its two ``pairs``."""
    second = _starts(mesh, pairs, corners).argmax(axis=1)
    first = np.take_along_axis(pairs, 1 - second[:, None], 1)[:, 0]
    cut = mesh.cut.copy()
    cut[first, 1] = mesh.cut[np.take_along_axis(pairs, second[:, None], 1)[:, 0], 1]
    kept = np.ones(len(cut), dtype=bool)
    kept[np.take_along_axis(pairs, second[:, None], 1)[:, 0]] = False
    return replace(mesh, cut=cut[kept], owner=mesh.owner[kept], beyond_tip=mesh.beyond_tip[kept])
