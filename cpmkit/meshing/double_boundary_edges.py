"""Boundaries led along the third edge of a triangle that they have two edges of, where it would else turn over.

A boundary that was inserted along chords may pass a triangle on the one side, and itself on the other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cpmkit.mesh.edges import Edges, edges_on_cut
from cpmkit.mesh.mesh import SampleMesh
from cpmkit.meshing.untangle_vertices import KEPT_SHARE, kept_shares
from cpmkit.protocols import Floats, Ints

#: A triangle that is passed on its other side may leave the next one to be passed so; so often it is looked again.
ROUNDS = 4


def shortened(mesh: SampleMesh, edges: Edges, before: Floats, moved: Floats) -> tuple[SampleMesh, Ints]:
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


def _passed(mesh: SampleMesh, edges: Edges, before: Floats, moved: Floats) -> tuple[Ints, Ints]:
    """Return two rows (k, 2) of ``mesh.cut``, and the corners (k, 3) of the triangle they are of, their common first.

    Of triangles that share a row one is returned.
    """
    row = np.full(len(edges.ends) + 1, -1)
    row[edges_on_cut(mesh, edges)] = np.arange(len(mesh.cut))
    row[-1] = -1
    rows = row[edges.of_cells]
    two = np.flatnonzero((rows >= 0).sum(axis=1) == 2)
    two = two[kept_shares(before[mesh.cells[two]], moved[mesh.cells[two]]) < KEPT_SHARE]
    lead = rows[two].argmin(axis=1)
    around = (lead[:, None] + np.arange(3)) % 3
    corners, pairs = (np.take_along_axis(one[two], around, 1) for one in (mesh.cells, rows))
    pairs, ends = pairs[:, 1:], np.bincount(mesh.cut.ravel(), minlength=len(before))
    fits = (mesh.owner[pairs[:, 0]] == mesh.owner[pairs[:, 1]]) & ~mesh.extends[pairs].any(axis=1)
    fits &= (ends[corners[:, 0]] == 2) & (_starts(mesh, pairs, corners).sum(axis=1) == 1)
    pairs, corners = pairs[fits], corners[fits]
    once = np.full(len(mesh.cut), len(pairs))
    np.minimum.at(once, pairs, np.arange(len(pairs))[:, None])
    alone = (once[pairs] == np.arange(len(pairs))[:, None]).all(axis=1)
    return pairs[alone], corners[alone]


def _starts(mesh: SampleMesh, pairs: Ints, corners: Ints) -> Ints:
    """Return (k, 2) whether rows of ``mesh.cut`` start at the common corner: one of two that run one way does."""
    return np.asarray(mesh.cut[pairs][:, :, 0] == corners[:, :1], dtype=np.int64)


def _led_past(mesh: SampleMesh, pairs: Ints, corners: Ints) -> SampleMesh:
    """Return the mesh with the third edge of these triangles on the boundary, in place of its two ``pairs``."""
    second = _starts(mesh, pairs, corners).argmax(axis=1)
    first = np.take_along_axis(pairs, 1 - second[:, None], 1)[:, 0]
    cut = mesh.cut.copy()
    cut[first, 1] = mesh.cut[np.take_along_axis(pairs, second[:, None], 1)[:, 0], 1]
    kept = np.ones(len(cut), dtype=bool)
    kept[np.take_along_axis(pairs, second[:, None], 1)[:, 0]] = False
    return replace(mesh, cut=cut[kept], owner=mesh.owner[kept], extends=mesh.extends[kept])
