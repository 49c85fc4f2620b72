"""Rims that face each other across a gap, and boundaries near rims: places that the spacing may not resolve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.forms.collocation.ghosts.ghost_geometry import ALONGSIDE_COSINE
from cpmkit.forms.collocation.side_view import BoundaryOnLattice
from cpmkit.forms.collocation.unresolved_places import (
    BRIDGED_GAP_SPACINGS,
    SAME_PLACE_SAMPLES,
    SAME_PLACE_SPACINGS,
    STRIP_SPACINGS,
    WIDE_GAP_SPACINGS,
    UnresolvedPlace,
)
from cpmkit.grid.band import Band
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.tangent_space import outward_conormals
from cpmkit.types import Bools, Floats, Ints

#: Half widths of gaps (spacings) that are tested in front of a rim; wider gaps hardly leak, narrower ones are closed.
HALF_GAPS_SPACINGS = 3.0 * 2.0 ** np.arange(-9, 0.5, 0.5)
#: One point of a rim is examined in each cell of this many spacings.
RIM_SAMPLE_SPACINGS = 1.5
#: Least cosine of the conormal with the direction to a foot ahead, and of that foot with the rim that it faces.
FACING_COSINE = 0.8
#: Step, in spacings, of the differences that give a rim's conormal: across a narrower gap they are wrong.
CONORMAL_STEP_SPACINGS = 0.005
#: The closest point on a rim near a boundary is found from a point this many spacings past the rim.
PAST_RIM_SPACINGS = 0.05


# Rims that face each other. Stencils of one rim read nodes whose closest points are on the other. Nodes past a rim
# satisfy its condition only where they are nearer to it than to any other part: in a gap of a spacing or two
# hardly any are, and values leak from one side to the other as if the gap were bridged.


def find_narrowest_gap(surface: LocalSource, band: Band, lattice: Lattice) -> list[UnresolvedPlace]:
    """Return a list with the narrowest gap, of up to 6 spacings, in front of a rim of the manifold, or [] without any.

    The narrowest gap that stencils bridge is preferred, unless it is that of a notch or a small hole of a surface, and
    is of kind "gap"; others are of kind "opening". The number of queries grows with the length of the rims, from none.
    """
    past = np.flatnonzero(band.feet.edge >= 0)
    if not len(past):
        return []
    rim, outward, loop = _rim_samples(surface, band, past)
    rows, across = _find_gaps(surface, rim, outward, band.spacing)
    if not len(rows):
        return []
    gap = np.linalg.norm(across - rim[rows], axis=1)
    bridged = np.flatnonzero(gap <= BRIDGED_GAP_SPACINGS * band.spacing)
    if surface.largest_dim > 1 and len(bridged):
        bridged = bridged[_is_on_long_stretch(rim[rows[bridged]], loop[rows[bridged]], band.spacing)]
    chosen = bridged[gap[bridged].argmin()] if len(bridged) else gap.argmin()
    middle = lattice.to_scene((rim[rows] + 0.5 * gap[:, None] * outward[rows])[[chosen]])[0]
    return [UnresolvedPlace("gap" if len(bridged) else "opening", (), middle, float(gap[chosen]))]


def _rim_samples(surface: LocalSource, band: Band, past: Ints) -> tuple[Floats, Floats, Ints]:
    """Return a rim's point (k, d) in each cell of 1.5 spacings, its outward conormal (k, d) and its loop's number (k,).

    ``past`` are the nodes past an edge, whose closest points are on the rims.
    """
    h, offset = band.spacing, band.positions[past] - band.feet.points[past]
    length = np.linalg.norm(offset, axis=1)
    cells = np.floor(band.feet.points[past] / (RIM_SAMPLE_SPACINGS * h)).astype(np.int64)
    order = np.argsort(-length, kind="stable")  # the farthest node defines the direction best
    labelled = np.column_stack([cells, band.feet.edge[past]])[order]
    chosen = order[np.unique(labelled, axis=0, return_index=True)[1]]
    feet, offset, length = band.feet.take(past[chosen]), offset[chosen], length[chosen]
    outward = offset / np.maximum(length, CONORMAL_STEP_SPACINGS * h)[:, None]
    by_differences = (surface.dimensions_at(feet) < surface.dim) | (length < CONORMAL_STEP_SPACINGS * h)
    rows = np.flatnonzero(by_differences)
    outward[rows] = outward_conormals(surface, feet.take(rows), CONORMAL_STEP_SPACINGS * h)
    return feet.points, outward, feet.edge


def _find_gaps(surface: LocalSource, rim: Floats, outward: Floats, spacing: float) -> tuple[Ints, Floats]:
    """Return the numbers (k,) of rim points that face another part of the manifold, and the points (k, d) across gaps.

    ``rim`` (n, d) are points of rims, ``outward`` (n, d) the conormals there. A query ahead of the rim by more than
    half the gap finds the point across; as steps grow by less than twice, the first such query is in the gap.
    """

    def across_gap(rows: Ints, step: float) -> tuple[Floats, Bools, Bools]:
        """Return closest points (m, d) of ``step`` ahead, whether (m,) each is on another part, and faces the rim."""
        ahead = rim[rows] + step * outward[rows]
        feet = surface.closest_point(ahead).points
        chord, back = feet - rim[rows], feet - ahead
        width = np.linalg.norm(chord, axis=1)
        is_other = np.sum(chord * outward[rows], axis=1) > FACING_COSINE * width
        is_other &= width > CONORMAL_STEP_SPACINGS * spacing
        faces = np.sum(back * chord, axis=1) > FACING_COSINE * np.linalg.norm(back, axis=1) * width
        return feet, is_other, is_other & faces

    steps = HALF_GAPS_SPACINGS * spacing
    across = np.full_like(rim, np.nan)
    rows = np.flatnonzero(across_gap(np.arange(len(rim)), steps[-1])[1])  # most rims face nothing
    for step in steps:
        feet, is_other, is_gap = across_gap(rows, step)
        across[rows[is_gap]] = feet[is_gap]
        rows = rows[~is_other]
    rows = np.flatnonzero(np.isfinite(across[:, 0]))
    return rows, across[rows]


def _is_on_long_stretch(rim: Floats, loop: Ints, spacing: float) -> Bools:
    """Return whether (k,) each point of ``rim`` (k, d) is in a chain of near ones of its ``loop`` 6 spacings across."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    first, second = cKDTree(rim).query_pairs(2 * RIM_SAMPLE_SPACINGS * spacing, output_type="ndarray").T
    same = loop[first] == loop[second]
    graph = csr_array((np.ones(int(same.sum())), (first[same], second[same])), shape=(len(rim), len(rim)))
    count, label = connected_components(graph, directed=False)
    low, high = np.full((count, rim.shape[1]), np.inf), np.full((count, rim.shape[1]), -np.inf)
    np.minimum.at(low, label, rim)
    np.maximum.at(high, label, rim)
    return np.asarray(np.linalg.norm(high - low, axis=1)[label] >= WIDE_GAP_SPACINGS * spacing)


def find_rim_strips(
    boundaries: Sequence[BoundaryOnLattice], surface: LocalSource, band: Band, lattice: Lattice
) -> list[UnresolvedPlace]:
    """Return a place, "on rim" or "rim strip", for each boundary with sides that runs within a spacing along a rim."""
    from scipy.spatial import cKDTree

    h, past, strips = band.spacing, np.flatnonzero(band.feet.edge >= 0), []
    for number, boundary in enumerate(boundaries if len(past) else ()):
        if not boundary.has_sides:
            continue
        points = surface.closest_point(boundary.samples).points
        distance, nearest = cKDTree(band.feet.points[past]).query(points)
        close = np.flatnonzero(distance < 3 * STRIP_SPACINGS * h)
        if not len(close):
            continue
        points, rim = points[close], band.feet.take(past[nearest[close]])
        outward = outward_conormals(surface, rim, CONORMAL_STEP_SPACINGS * h)
        inside = np.sum((rim.points - points) * outward, axis=1, keepdims=True)
        foot = surface.closest_point(points + (inside + PAST_RIM_SPACINGS * h) * outward)
        width = np.linalg.norm(foot.points - points, axis=1)
        seen = boundary.side_view(points, h, h)
        beside = (width[seen.rows] < STRIP_SPACINGS * h) & (foot.edge[seen.rows] >= 0) & ~seen.end
        beside &= np.abs(np.sum(seen.conormal * outward[seen.rows], axis=1)) > ALONGSIDE_COSINE
        rows = seen.rows[beside]
        rows = rows[np.argsort(width[rows], kind="stable")]
        if len(rows):
            on_rim = width[rows] < SAME_PLACE_SPACINGS * h  # a curve that ends at a rim has one or two samples there
            kind = "on rim" if on_rim.sum() >= min(SAME_PLACE_SAMPLES, len(rows)) else "rim strip"
            point, least = lattice.to_scene(points[rows[:1]])[0], float(width[rows[0]])
            strips.append(UnresolvedPlace(kind, (number,), point, least, loop=int(foot.edge[rows[0]])))
    return strips
