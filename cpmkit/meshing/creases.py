"""Where a mesh is cut although no boundary lies there: at its creases, and where several of its sheets or arms meet.

A spline whose support contains a crease sees both of its sides at once, so that the solution, which turns there, is of
first order. On a mesh cut there each side has unknowns of its own; a condition of continuity ties them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.manifold.vector_algebra import dots, norms, unit
from cpmkit.mesh.adjacency import facets_of_two_cells
from cpmkit.mesh.mesh import Mesh
from cpmkit.runtime.index_sets import connected_components
from cpmkit.types import Bools, Floats, Ints

#: The owners, in ``mesh.owner``, of facets at creases and junctions, between charts of folds alone, and between charts
#: where there are voids.
CREASE_OWNER, FOLD_OWNER, VOID_OWNER = -1, -2, -3
#: Cells that turn by more than this angle, in degrees, at their common facet meet in a crease. Neighbours on a circle
#: of a radius of one spacing turn by 29 degrees, as edges are half a spacing long.
CREASE_DEGREES = 30.0
#: A part between creases below this area, in squared spacings, stays with a neighbour: it would have more unknowns than
#: it is worth, as many as samples on tubes that are thinner than the cells. With 1 the error on Nefertiti's bust is 20
#: percent larger at 4,400 unknowns; with .1 it is the same, at more unknowns.
LEAST_AREA = 0.25
#: Connected creases that end inside the surface and are shorter than this, in spacings, are not cut: they would cost
#: more unknowns than they gain (Spot has 5 percent more with 1.5). With 3 the fish has a sixth more error at 4,400
#: unknowns, with 4 half as much again at 7,200.
LEAST_CHAIN_SPACINGS = 2.0
#: Triangles at boundaries whose height over an edge is below this, in spacings, are slivers that turn by any angle: the
#: insertion moves points onto edges that are as near.
SLIVER_SPACINGS = 0.02


def crease_facets(mesh: Mesh, spacing: float, creased: Bools | None = None) -> Ints:
    """Return the facets (c, k - 1), by their vertices, of a mesh at creases and junctions that lie on no boundary.

    A junction is a facet of three cells or more. Short open chains and borders of small parts are left out. ``spacing``
    is h; ``creased`` (f,) are the facets at creases, by default those that turn by more than ``CREASE_DEGREES``.
    """
    numbers, count = mesh.connectivity.facet_numbers, mesh.connectivity.facet_count
    junction = np.bincount(numbers.ravel(), minlength=count) > 2
    if creased is None:
        creased = sharp_facets(mesh, CREASE_DEGREES, SLIVER_SPACINGS * spacing)
    crease = creased & ~junction
    if not (junction.any() or crease.any()):
        return np.zeros((0, mesh.manifold_dim), dtype=np.int64)
    if mesh.manifold_dim == 1:
        chosen = junction | crease
        chosen[mesh.cut] = False
        return np.flatnonzero(chosen)[:, None]
    has_length = mesh.edge_lengths**2 > 0
    junction, crease = junction & has_length, crease & has_length
    bounded = mesh.edge_is_cut  # cut in any case
    fixed = junction | bounded
    chosen = fixed | _without_short_chains(mesh, crease & ~fixed, fixed, spacing)
    chosen = _without_small_parts(mesh, chosen & ~bounded, bounded, LEAST_AREA * spacing**2)
    return np.asarray(mesh.edges.ends[chosen])


def sharp_facets(mesh: Mesh, degrees: float, sliver: float = 0.0) -> Bools:
    """Return whether (f,) each facet has two cells that turn by more than ``degrees``, or three cells or more.

    Two cells of which one is a sliver at a boundary, of a height over the facet below ``sliver``, do not count.
    """
    facets, places = facets_of_two_cells(mesh)
    inward = [inward_directions(mesh, of_side) for of_side in places.T]
    heights = [norms(vectors) for vectors in inward]
    turns = -dots(*inward) < np.cos(np.radians(degrees)) * heights[0] * heights[1]
    numbers, count = mesh.connectivity.facet_numbers, mesh.connectivity.facet_count
    turning = np.bincount(numbers.ravel(), minlength=count) > 2
    turning[facets] = turns & ~_are_slivers(mesh, places.T, heights, sliver)
    return turning


def with_ties(mesh: Mesh, facets: Ints, owner: int) -> Mesh:
    """Return a mesh cut at ``facets`` (c, k - 1) too, where u is tied; they follow those of boundaries in ``mesh.cut``.

    Their ``owner`` is negative, such as ``CREASE_OWNER``. Without facets the mesh itself is returned.
    """
    if not len(facets):
        return mesh
    return mesh.with_same_cells(
        cut=np.concatenate([mesh.cut, facets]),
        owner=np.concatenate([mesh.owner, np.full(len(facets), owner)]),
        beyond_tip=np.concatenate([mesh.beyond_tip, np.zeros(len(facets), dtype=bool)]),
    )


def inward_directions(mesh: Mesh, places: Ints) -> Floats:
    """Return vectors (e, d) from the middle of facets into their cells, tangent to the cell and normal to the facet.

    Their length is the height of a flat cell over the facet; curved cells are followed, so that a smooth surface does
    not turn. ``places`` (e,) are positions in the array (m, k) of cells and their facets, flattened.
    """
    k = mesh.cells.shape[1]
    cell, facet = places // k, places % k
    apex, tail, head = (mesh.vertices[mesh.cells[cell, (facet + j) % k]] for j in range(3))
    if mesh.midpoints is None:
        inward = apex - tail
    elif k == 2:  # the derivative of the quadratic curve at its end
        inward = 4 * mesh.midpoints[cell, 0] - 3 * tail - apex
    else:  # of the quadratic triangle at the middle of its edge, by the barycentric coordinate of the apex
        middle, beside_tail, beside_head = (mesh.midpoints[cell, (facet + j) % k] for j in range(3))
        inward = 2 * (beside_tail + beside_head - middle) - apex - tail
    if k == 3:
        along = unit(head - tail)
        inward = inward - dots(inward, along)[:, None] * along
    return np.asarray(inward)


def _are_slivers(mesh: Mesh, places: Ints, heights: Sequence[Floats], least: float) -> Bools:
    """Return whether (e,) one of the two triangles at an edge has a height below ``least`` and a boundary vertex.

    ``places`` (2, e), as in :func:`inward_directions`, are where the cells have the edge, ``heights`` two (e,) heights.
    """
    slivers = np.zeros(len(places[0]), dtype=bool)
    if mesh.manifold_dim == 2 and len(mesh.cut):
        on_boundary = np.zeros(len(mesh.vertices), dtype=bool)
        on_boundary[mesh.cut] = True
        for at, height in zip(places, heights, strict=True):
            slivers |= (height < least) & on_boundary[mesh.cells[at // 3]].any(axis=1)
    return slivers


def _without_short_chains(mesh: Mesh, chosen: Bools, fixed: Bools, spacing: float) -> Bools:
    """Return ``chosen`` edges (e,) without connected sets that are short and end inside the surface.

    Short is below ``LEAST_CHAIN_SPACINGS``. A set ends where a vertex has one edge of the set, lies on no rim, and on
    no edge that is ``fixed`` (e,).
    """
    rows, ends = np.flatnonzero(chosen), mesh.edges.ends
    count, label = connected_components(len(mesh.vertices), ends[rows])
    chain = label[ends[rows, 0]]
    length = np.bincount(chain, mesh.edge_lengths[rows], count)
    is_end = np.bincount(ends[rows].ravel(), minlength=len(mesh.vertices)) == 1
    is_end[ends[fixed | mesh.connectivity.on_rim]] = False
    is_open = np.zeros(count, dtype=bool)
    is_open[label[is_end]] = True
    remaining = chosen.copy()
    remaining[rows] = (~is_open | (length >= LEAST_CHAIN_SPACINGS * spacing))[chain]
    return remaining


def _without_small_parts(mesh: Mesh, chosen: Bools, bounded: Bools, least: float) -> Bools:
    """Return ``chosen`` edges (e,) without those that bound a part of an area below ``least`` towards its neighbour.

    Parts are connected over edges that are neither chosen nor ``bounded`` (e,), cut in any case. Small parts join
    neighbours by :func:`join_small_parts`. Up to four cells at an edge are compared in all pairs.
    """
    corners, of_cells = mesh.vertices[mesh.cells], mesh.edges.of_cells
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.sqrt(np.maximum(dots(a, a) * dots(b, b) - dots(a, b) ** 2, 0.0))  # in the plane too
    cell, order = np.argsort(of_cells, axis=None, kind="stable") // 3, np.sort(of_cells, axis=None)
    same = [(row, row + step) for step in (1, 2, 3) for row in [np.flatnonzero(order[step:] == order[:-step])]]
    rows, others = (np.concatenate(column) for column in zip(*same, strict=True))
    edge, sides = order[rows], np.stack([cell[rows], cell[others]], axis=1)
    part = connected_components(len(area), sides[~(chosen | bounded)[edge]])[1]
    open_edges = ~bounded[edge]
    joined = join_small_parts(part, area, sides[open_edges], mesh.edge_lengths[edge[open_edges]], least)
    remaining = chosen.copy()
    remaining[edge[(part[sides[:, 0]] != part[sides[:, 1]]) & (joined[sides[:, 0]] == joined[sides[:, 1]])]] = False
    return remaining


def join_small_parts(part: Ints, areas: Floats, sides: Ints, lengths: Floats, least: float) -> Ints:
    """Return ``part`` (m,), that of each cell or -1, with parts of an area below ``least`` joined to neighbours.

    A small part joins that with the longest common border; this repeats until no small part has a neighbour. ``areas``
    (m,) are those of cells, ``sides`` (e, 2) pairs of cells, all in parts, at edges with ``lengths`` (e,).
    """
    while True:
        count, rows = int(part.max(initial=-1)) + 1, part >= 0
        small = np.bincount(part[rows], areas[rows], count) < least
        pairs, both = part[sides], np.concatenate([lengths, lengths])
        own, other = np.concatenate([pairs, pairs[:, ::-1]]).T
        border = np.flatnonzero(small[own] & (own != other))
        if not len(border):
            return part
        code, place = np.unique(own[border] * count + other[border], return_inverse=True)
        order = np.lexsort((-np.bincount(place, both[border]), code // count))
        best = code[order[np.unique(code[order] // count, return_index=True)[1]]]
        joined = connected_components(count, np.stack([best // count, best % count], axis=1))[1]
        part = np.where(rows, joined[part], -1)
