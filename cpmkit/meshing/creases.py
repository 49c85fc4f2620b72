"""Where a mesh is cut although no boundary lies there: at creases, and at junctions of several sheets or arms.

A spline whose support contains a crease is smooth across it, while the gradient of the solution turns there, so that
errors are of first order. On a mesh cut at the crease each side has its own unknowns, tied by a continuity condition.
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
#: A part between creases below this area, in squared spacings, is not cut off, as it would add too many unknowns: as
#: many as samples on tubes that are thinner than the cells. With 1 the error on Nefertiti's bust is 20 percent larger
#: at 4,400 unknowns; with .1 it is the same, at more unknowns.
LEAST_AREA = 0.25
#: Connected creases that end inside the surface and are shorter than this, in spacings, are not cut: they would cost
#: more unknowns than they gain (Spot has 5 percent more with 1.5). With 3 the fish has a sixth more error at 4,400
#: unknowns, with 4 half as much again at 7,200.
LEAST_CHAIN_SPACINGS = 2.0
#: Triangles at boundaries whose height over an edge is below this, in spacings, are slivers with arbitrary normals: the
#: insertion moves points onto edges that are nearer than that.
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

    Facets of a sliver, a triangle at a boundary with a height over the facet below ``sliver``, do not count.
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
    """Return the mesh cut also at ``facets`` (c, k - 1), the ties, which follow the boundaries' facets in ``mesh.cut``.

    ``owner``, a negative number such as ``CREASE_OWNER``, is that of the new facets in ``mesh.owner``.
    """
    if not len(facets):
        return mesh
    return mesh.with_same_cells(
        cut=np.concatenate([mesh.cut, facets]),
        owner=np.concatenate([mesh.owner, np.full(len(facets), owner)]),
        beyond_tip=np.concatenate([mesh.beyond_tip, np.zeros(len(facets), dtype=bool)]),
    )


def inward_directions(mesh: Mesh, places: Ints) -> Floats:
    """Return vectors (e, d) from the midpoints of facets into their cells, tangent to the cell and normal to the facet.

    Their length is the height of a flat cell over the facet. Vectors are tangent to curved cells, so that those of two
    cells of a smooth surface are opposite. ``places`` (e,) are positions in the flattened array (m, k) of facets of
    cells.
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
    """Return ``chosen`` edges (e,) without connected sets that end inside the surface and are short.

    A set is short below ``LEAST_CHAIN_SPACINGS``. A set ends at a vertex with one edge of the set that lies neither on
    a rim nor on a ``fixed`` edge (e,).
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
    """Return ``chosen`` edges (e,) without those between a part of an area below ``least`` and the part that it joins.

    Parts are connected over edges that are neither chosen nor ``bounded`` (e,), which are cut in any case. Small parts
    join neighbours by :func:`join_small_parts`. Up to four cells at an edge are compared in all pairs.
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
    """Return the ``part`` (m,) of each cell, -1 for none, with parts of an area below ``least`` joined to neighbours.

    A small part joins the neighbour with the longest common border, until no small part has a neighbour. ``areas`` (m,)
    are those of cells, ``sides`` (e, 2) the two cells, in parts, at edges with ``lengths`` (e,).
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
