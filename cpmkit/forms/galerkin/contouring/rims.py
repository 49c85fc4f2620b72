"""Borders of a triangulation: small holes are closed, and what borders on a rim is moved onto it."""

from __future__ import annotations

import numpy as np

from cpmkit.forms.galerkin.contouring.edges import Border, border_of, edges_of
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.protocols import Bools, Floats, Ints

#: A hole of at most so many edges is filled, where the surface passes this near to its centre, in mean radii.
MOST_HOLE_EDGES, NEAR_HOLE = 10, 0.5
#: The border of a hole faces its centre at this mean cosine at least.
FACING_COSINE = 0.3
#: How far beyond a border its rim is looked for, in spacings, one round after another.
RIM_REACHES = (1.2, 1.2, 2.0)
#: A query beyond a rim misses the surface mostly along the conormal, at this cosine.
MISSED_COSINE = 0.7


def without_holes(source: LocalSource, vertices: Floats, cells: Ints) -> tuple[Floats, Ints, int]:
    """Return vertices and triangles with small holes filled by fans, and how many holes those were."""
    border = border_of(vertices, cells, edges_of(cells))
    loop, count = _loops(border.ends, len(vertices))
    if not count:
        return vertices, cells, 0
    inside = loop >= 0
    of, size = loop[inside], np.bincount(loop[inside], minlength=count)
    middles, conormals, ends = border.middles[inside], border.conormals[inside], border.ends[inside]

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(of, values, minlength=count) / size)

    centre = np.stack([mean(middles[:, k]) for k in range(3)], axis=1)
    inward = centre[of] - middles
    facing = mean(dots(unit(inward), conormals)) > FACING_COSINE
    small = np.flatnonzero(facing & (size <= MOST_HOLE_EDGES))
    feet = source.closest_point(centre[small]).points
    cracks = norms(feet - centre[small]) < NEAR_HOLE * mean(norms(inward))[small]
    tip = np.full(count, -1)
    tip[small[cracks]] = len(vertices) + np.arange(int(cracks.sum()))
    closing = tip[of] >= 0
    fans = np.concatenate([ends[closing], tip[of[closing], None]], axis=1)
    return np.concatenate([vertices, feet[cracks]]), np.concatenate([cells, fans]), int(cracks.sum())


def _loops(ends: Ints, count: int) -> tuple[Ints, int]:
    """Return the loop of each border edge, -1 where three or more meet, and how many loops there are."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(ends), dtype=np.int8), tuple(ends.T)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    plain = np.ones(count, dtype=bool)
    plain[label[np.bincount(ends.ravel(), minlength=count) > 2]] = False
    label = label[ends[:, 0]]
    loop = np.full(len(ends), -1)
    kept = plain[label]
    names, loop[kept] = np.unique(label[kept], return_inverse=True)
    return loop, len(names)


def onto_rims(source: LocalSource, vertices: Floats, cells: Ints, spacing: float) -> tuple[Floats, Bools]:
    """Return the vertices, those beside rims moved onto them, and which (v,) lie on a rim now."""
    edges, moved, on_rim = edges_of(cells), vertices.copy(), np.zeros(len(vertices), dtype=bool)
    for reach in RIM_REACHES:
        border = border_of(moved, cells, edges)  # anew: what was moved points the others better
        outward = np.zeros_like(vertices)
        for end in range(2):
            np.add.at(outward, border.ends[:, end], border.conormals)
        outward = unit(outward)
        left = np.flatnonzero((outward != 0).any(axis=1) & ~on_rim)
        feet, missed = beyond(source, moved[left], outward[left], np.full(len(left), reach * spacing))
        moved[left[missed]], on_rim[left[missed]] = feet[missed], True
    return moved, on_rim


def beyond(source: LocalSource, points: Floats, outward: Floats, reach: Floats) -> tuple[Floats, Bools]:
    """Return the feet of points pushed ``outward`` by ``reach`` (n,), and whether those went beyond a rim."""
    pushed = points + reach[:, None] * outward
    answer = source.closest_point(pushed)
    away = pushed - answer.points
    missed = dots(away, outward) > MISSED_COSINE * norms(away) + 1e-3 * reach
    return answer.points, np.asarray(missed | (answer.edge >= 0))


def rim_edges(border: Border, on_rim: Bools) -> Ints:
    """Return which border edges lie on a rim: those with both ends there."""
    return np.flatnonzero(on_rim[border.ends].all(axis=1))
