"""Triangles that turn over as a mesh is moved onto a boundary that bends: what they cover would count twice."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.vectors import dots
from cpmkit.mesh.mesh import Mesh
from cpmkit.protocols import Bools, Floats

#: A triangle that keeps less than this share of its area, at one of its corners, is turned over, or nearly so.
KEPT_SHARE = 0.2
#: As its vertices are moved onto a boundary it may become as thin as this: put back, they would be a hundredth of a
#: spacing off the boundary, where data may jump.
LEFT_SHARE = 0.02
#: Vertices put back turn other triangles over; so often it is looked again.
ROUNDS = 4


def untangle_vertices(mesh: Mesh, before: Floats, moved: Floats) -> Floats:
    """Return the vertices ``moved`` (v, d), those of triangles that would turn over where they were ``before``.

    A vertex beside a boundary may be nearer to it than the boundary is to its chords: the boundary goes beside it then,
    on the side where its chords do.
    """
    if mesh.manifold_dim == 1:
        return moved
    moved = moved.copy()
    astray = np.any(moved != before, axis=1)
    for _ in range(ROUNDS):
        near = np.flatnonzero(astray[mesh.cells].any(axis=1))
        cells = mesh.cells[near]
        turned = area_ratios(before[cells], moved[cells]) < LEFT_SHARE
        back = np.unique(cells[turned])
        back = back[astray[back]]
        if not len(back):
            break
        moved[back], astray[back] = before[back], False
    return moved


def area_ratios(before: Floats, moved: Floats) -> Floats:
    """Return what share of its area each triangle keeps (m,), from its corners (m, 3, d) before and after a move."""
    return _kept(*_sides(before), *_sides(moved))


def is_folded(x: Floats, midpoints: Floats) -> Bools:
    """Tell which triangles (m,) with corners ``x`` and ``midpoints`` (m, 3, d) turn over at a corner, or nearly so.

    A thin one beside a boundary does where that bends by more than its height.
    """
    following, before = np.array([1, 2, 0]), np.array([2, 0, 1])
    ahead, behind = x[:, following], x[:, before]
    first = 4 * midpoints[:, before] - 3 * x - ahead
    second = 4 * midpoints[:, following] - 3 * x - behind
    folded: Bools = np.any(_kept(ahead - x, behind - x, first, second) < KEPT_SHARE, axis=1)
    return folded


def _sides(corners: Floats) -> tuple[Floats, Floats]:
    """Return two sides (n, d) of triangles (n, 3, d)."""
    return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]


def _kept(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Return the area between vectors c and d seen from that between a and b, as a share of it; 1 where it is none."""
    size = dots(a, a) * dots(b, b) - dots(a, b) ** 2
    kept = dots(c, a) * dots(d, b) - dots(c, b) * dots(d, a)
    return np.asarray(np.divide(kept, size, out=np.ones_like(size), where=size > 0))
