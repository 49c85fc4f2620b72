"""A curve that is known by its closest points alone, as segments that end on knot planes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.errors import ResolutionError
from cpmkit.forms.galerkin.contouring.ends import ends_in_cells
from cpmkit.forms.galerkin.contouring.knot_crossings import KnotCrossings, knot_crossings, merged
from cpmkit.forms.galerkin.contouring.midpoints import CREASE
from cpmkit.forms.galerkin.contouring.strands import follow, neighbours
from cpmkit.forms.galerkin.sample_mesh import SampleMesh
from cpmkit.grid.band import cell_levels
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms
from cpmkit.protocols import Floats, Ints

#: Strands that come to an end so near to each other, in spacings, meet in a cusp.
SAME_TIP = 0.05
#: How far apart, in spacings, two crossings are at most that have no partner in their cells and are joined.
LONE_REACH = 1.5
#: Of the tangent lines through a star's crossings: eigenvalues below this share of the largest say nothing.
TELLING_EIGENVALUE = 0.12
#: Points of the curve farther than so many spacings from all segments are told.
UNMET_REACH = 1.0


@dataclass(frozen=True)
class CurveReport:
    """What a reader should know of a traced curve.

    Attributes
    ----------
    stars : int
        Cells in which three crossings or more hang together: junctions, crossings of a curve with itself.
    ends : int
        Ends of the curve.
    dropped : int
        Crossings that nothing goes on from on one side: gaps in the trace.
    unmet : (k, d) float64
        Points of the curve with no segment near by: pieces that lie in one cell.
    """

    stars: int
    ends: int
    dropped: int
    unmet: Floats


def traced(source: LocalSource, spacing: float, curved: bool = True) -> tuple[SampleMesh, CurveReport]:
    """Return segments on a curve, with vertices on it: its crossings with knot planes, its ends, corners, junctions.

    Parameters
    ----------
    source : LocalSource
        A curve (m = 1) in the plane or in space. No tangents are asked of it.
    spacing : float
        h, of the form's lattice; knot planes lie halfway between its nodes.
    curved : bool
        Whether midpoints of segments are given too, on the curve.

    Raises
    ------
    ResolutionError
        If the curve crosses no knot plane.
    """
    for _, found in cell_levels(source, spacing, 0.5):
        cells = found
    crossings = knot_crossings(source, cells, spacing)
    if not len(crossings.points):
        raise ResolutionError(
            f"spacing={spacing:g} is too coarse for the curve: it lies in one cell of the lattice; use a smaller one."
        )
    pairs = neighbours(source, crossings, spacing)
    degree = np.bincount(pairs.ravel(), minlength=len(crossings.member))
    several = (degree[pairs] > 1).any(axis=1)
    segments = [crossings.member[pairs[~several]]]
    centres, spokes = _stars(source, crossings, pairs[several])
    segments.append(spokes)
    lone = np.flatnonzero(degree == 0)
    of = crossings.member[lone]
    tips, ended, enters = ends_in_cells(
        source, crossings.points[of], crossings.tangents[of], crossings.cells[lone], spacing
    )
    ended &= norms(tips - crossings.points[of]) > 0
    tip, first = merged(tips[ended], SAME_TIP * spacing)
    vertices = np.concatenate([crossings.points, centres, tips[ended][first]])
    segments.append(np.stack([of[ended], len(vertices) - len(first) + tip], axis=1))
    left = of[enters & ~ended]
    joins = _joined_lone(source, crossings, left, spacing)
    segments.append(joins)
    ends = np.unique(np.sort(np.concatenate(segments), axis=1), axis=0)
    vertices, ends = _bent(source, vertices, crossings.tangents, ends)
    report = CurveReport(
        len(centres),
        int((np.bincount(tip) == 1).sum()),
        len(left) - joins.size,
        _unmet(source, cells, vertices, spacing),
    )
    return SampleMesh.of(vertices, ends, _midpoints(source, vertices, ends) if curved else None), report


def _stars(source: LocalSource, found: KnotCrossings, pairs: Ints) -> tuple[Floats, Ints]:
    """Return the centres of stars of entries that hang together by ``pairs``, and their spokes (k, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not len(pairs):
        return np.zeros((0, found.points.shape[1])), np.zeros((0, 2), dtype=np.int64)
    entries, pairs = np.unique(pairs, return_inverse=True)
    pairs = pairs.reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), tuple(pairs.T)), shape=(len(entries),) * 2)
    count, star = connected_components(graph, directed=False)
    of = found.member[entries]
    nearest = nearest_to_lines(found.points[of], found.tangents[of], star, count)
    centres = source.closest_point(nearest).points
    return centres, np.stack([of, len(found.points) + star.astype(np.int64)], axis=1)


def nearest_to_lines(points: Floats, tangents: Floats, group: Ints, count: int) -> Floats:
    """Return the points (count, d) nearest to the lines of each group, about the mean of the lines' points."""
    dim, share = points.shape[1], 1.0 / np.bincount(group, minlength=count)

    def mean(values: Floats) -> Floats:
        return np.asarray(np.bincount(group, values, minlength=count) * share)

    centre = np.stack([mean(points[:, k]) for k in range(dim)], axis=1)
    off = points - centre[group]
    off = off - dots(off, tangents)[:, None] * tangents
    matrix = np.empty((count, dim, dim))
    for i in range(dim):
        for j in range(dim):
            matrix[:, i, j] = (i == j) - mean(tangents[:, i] * tangents[:, j])
    side = np.stack([mean(off[:, k]) for k in range(dim)], axis=1)
    values, axes = np.linalg.eigh(matrix)
    telling = values >= TELLING_EIGENVALUE * values[:, -1:]
    part = np.einsum("vki,vk->vi", axes, side) * np.where(telling, 1.0 / np.where(telling, values, 1.0), 0.0)
    return np.asarray(centre + np.einsum("vki,vi->vk", axes, part))


def _joined_lone(source: LocalSource, found: KnotCrossings, left: Ints, spacing: float) -> Ints:
    """Return pairs of crossings that lack a neighbour on one side, each the other's nearest, that hang together."""
    from scipy.spatial import KDTree

    if len(left) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    points = found.points[left]
    distance, nearest = KDTree(points).query(points, k=2)
    partner = nearest[:, 1]
    mutual = (partner[partner] == np.arange(len(left))) & (distance[:, 1] < LONE_REACH * spacing)
    i = np.flatnonzero(mutual & (np.arange(len(left)) < partner))
    a, b = left[i], left[partner[i]]
    box = (np.full_like(found.points[a], side * np.inf) for side in (-1.0, 1.0))
    together = follow(source, found.points[a], found.points[b], found.tangents[a], found.tangents[b], *box)
    return np.stack([a[together], b[together]], axis=1)


def _bent(source: LocalSource, vertices: Floats, tangents: Floats, ends: Ints) -> tuple[Floats, Ints]:
    """Return vertices and segments, those between crossings that bend too much halved where the tangents meet."""
    a, b = vertices[ends].transpose(1, 0, 2)
    middle = 0.5 * (a + b)
    away = norms(source.closest_point(middle).points - middle)
    bent = np.flatnonzero((away > CREASE * norms(b - a)) & (ends < len(tangents)).all(axis=1))
    corners = ends[bent]
    group = np.repeat(np.arange(len(bent)), 2)
    meeting = nearest_to_lines(vertices[corners.ravel()], tangents[corners.ravel()], group, len(bent))
    reach = norms(b - a)[bent]
    meeting = np.where((norms(meeting - middle[bent]) < reach)[:, None], meeting, middle[bent])
    new = len(vertices) + np.arange(len(bent))
    vertices = np.concatenate([vertices, source.closest_point(meeting).points])
    halves = [np.stack([corners[:, end], new], axis=1) for end in range(2)]
    return vertices, np.concatenate([np.delete(ends, bent, axis=0), *halves])


def _midpoints(source: LocalSource, vertices: Floats, ends: Ints) -> Floats:
    """Return the points (m, 1, d) of the curve halfway along segments, straight where a corner lies between."""
    a, b = vertices[ends].transpose(1, 0, 2)
    middle = 0.5 * (a + b)
    feet = source.closest_point(middle).points
    crease = norms(feet - middle) > CREASE * norms(b - a)
    return np.asarray(np.where(crease[:, None], middle, feet)[:, None])


def _unmet(source: LocalSource, cells: Ints, vertices: Floats, spacing: float) -> Floats:
    from scipy.spatial import KDTree

    feet = source.closest_point(np.asarray(cells * spacing)).points
    return np.asarray(feet[KDTree(vertices).query(feet)[0] > UNMET_REACH * spacing])
