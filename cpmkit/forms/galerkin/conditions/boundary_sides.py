"""Which cells beside a boundary are on its left.

Which half facets are on one side of a boundary, the cells tell: those that meet a common corner between two facets of
it, where the mesh is cut. What these sides are called, the scene tells (:class:`cpmkit.scene.oriented
.OrientedBoundary`): once for each connected piece of the boundary, by a vote along it, since a boundary that is drawn
beside the manifold, or turns sharply, may mistake its left here and there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.patch_locator import CellSides
from cpmkit.forms.galerkin.space.dof_map import components
from cpmkit.grid.lattice import Lattice
from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.mesh.adjacency import HalfFacets
from cpmkit.mesh.mesh import Mesh
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.types import Bools, Floats, Ints

if TYPE_CHECKING:
    from cpmkit.forms.galerkin.scene_sampling import SampledScene


#: Step of differences where sources give no directions of their own, in spacings.
DIFFERENCE_SPACINGS = 0.5


def left_of_boundaries(
    mesh: Mesh,
    half: HalfFacets,
    corners: Ints,
    samples: BoundarySamples,
    boundaries: Sequence[OrientedBoundary],
    lattice: Lattice,
) -> Bools:
    """Return which boundary samples (b,) are on the left of their boundary.

    Parameters
    ----------
    mesh : Mesh
        Cut along the boundaries.
    half : HalfFacets
        Its facets on boundaries and rims.
    corners : (m, k) int64
        The vertices of the cells after cutting.
    samples : BoundarySamples
        On these half facets.
    boundaries : sequence of OrientedBoundary
        By the numbers in ``mesh.owner``.
    lattice : Lattice
        That coordinates are relative to.
    """
    n = len(half.cell)
    if not n or not len(samples):
        return np.zeros(len(samples), dtype=bool)
    rows = np.flatnonzero(samples.half >= 0)
    votes = np.bincount(samples.half[rows], _votes(samples, boundaries, lattice)[rows], n)
    group, piece = _groups(mesh, half, corners)
    by_group = np.bincount(group, votes, n)[group]
    opposite = np.bincount(piece, votes, n)[piece] - by_group
    sides = np.bincount(piece[np.unique(group, return_index=True)[1]], minlength=n)[piece]
    left = np.where(sides == 2, by_group > opposite, by_group > 0)
    one_sided = (sides == 1) & _has_other_cell(half)
    left = np.where(one_sided, votes > 0, left)
    on = np.flatnonzero((samples.half >= 0) & (samples.owner >= 0))  # none where boundaries are points of a surface
    found = np.zeros(len(samples), dtype=bool)
    found[on] = left[samples.half[on]]
    return found


def side_moments(samples: BoundarySamples, left: Bools, count: int) -> Floats:
    """Return what tells on which side the left of each boundary lies, (count, d, d + 1).

    Conormals out of the left, times 1 and times position, summed along the boundary: of the other sign where left and
    right are swapped, and otherwise about the same however the boundary is cut into facets.
    """
    dim = samples.points.shape[1]
    moments = np.zeros((count, dim, dim + 1))
    rows = np.flatnonzero(left & (samples.owner >= 0) & ~samples.beyond_tip)
    positions = np.hstack([np.ones((len(rows), 1)), samples.points[rows]])
    weighted = samples.weights[rows, None] * samples.conormals[rows]
    np.add.at(moments, samples.owner[rows], weighted[:, :, None] * positions[:, None])
    return moments


def _votes(samples: BoundarySamples, boundaries: Sequence[OrientedBoundary], lattice: Lattice) -> Floats:
    """Return how surely samples (b,) are on the left: how far out of their cells the conormal to the right points.

    Asked at the middles of facets; continuations of boundaries past their tips have no vote.
    """
    votes = np.zeros(len(samples))
    facets = int(samples.facet.max(initial=-1)) + 1
    count = np.bincount(samples.facet[samples.facet >= 0], minlength=facets)
    for number, oriented in enumerate(boundaries):
        rows = np.flatnonzero((samples.owner == number) & (samples.facet >= 0) & ~samples.beyond_tip)
        if not oriented.has_sides or not len(rows):
            continue
        target, place = np.unique(samples.facet[rows], return_inverse=True)
        middles = np.stack([np.bincount(place, x) for x in samples.points[rows].T], axis=1) / count[target, None]
        feet, on = oriented.feet(lattice.to_scene(middles) - oriented.left.origin)
        leftward = oriented.axis_and_left(feet, on, DIFFERENCE_SPACINGS * lattice.spacing)[1]
        votes[rows] = -samples.weights[rows] * np.sum(samples.conormals[rows] * leftward[place], axis=1)
    return votes


def _groups(mesh: Mesh, half: HalfFacets, corners: Ints) -> tuple[Ints, Ints]:
    """Return which half facets (n,) are on one side of their boundary, and of which connected piece of it they are.

    Facets of one boundary hang together at vertices where exactly two facets of boundaries meet.
    """
    n, k = len(half.cell), mesh.cells.shape[1]
    on = half.cut >= 0
    piece = np.where(on, half.cut, len(mesh.cut) + np.arange(n))
    if k == 2:  # the boundary is a vertex, and a side of it one segment
        return np.arange(n), _renumber(piece)
    places = (half.facet[:, None] + np.arange(1, k)) % k
    vertex, corner = mesh.cells[half.cell[:, None], places], corners[half.cell[:, None], places]
    meeting = np.bincount(mesh.cut.ravel(), minlength=len(mesh.vertices))[vertex]
    rows, places = np.nonzero(on[:, None] & (meeting == 2))
    owner = mesh.owner[half.cut[rows]]
    group = _merge_labels(np.arange(n), rows, np.stack([corner[rows, places], owner], axis=1))
    return group, _merge_labels(_renumber(piece), rows, np.stack([vertex[rows, places], owner], axis=1))


def _merge_labels(labels: Ints, rows: Ints, keys: Ints) -> Ints:
    """Return ``labels`` (n,), all below n, with those of ``rows`` (k,) with common ``keys`` (k, 2) made one."""
    n, node = len(labels), _renumber(keys[:, 0] * (int(keys[:, 1].max(initial=0)) + 1) + keys[:, 1])
    pairs = np.stack([labels[rows], n + node], axis=1)
    return _renumber(components(n + len(rows), pairs)[1][labels])


def _renumber(labels: Ints) -> Ints:
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel(), dtype=np.int64)


def _has_other_cell(half: HalfFacets) -> Bools:
    """Return which half facets (n,) share their facet with another cell."""
    on = half.cut >= 0
    count = np.bincount(half.cut[on], minlength=int(half.cut.max(initial=-1)) + 1)
    twice = np.zeros(len(half.cut), dtype=bool)
    twice[on] = count[half.cut[on]] > 1
    return twice


#: Samples nearer than so many spacings to the chord of an edge on a boundary are looked at: edges bend by less.
NEAR_CHORD_SPACINGS = 0.05
#: So many times as far as a boundary is off the manifold data are surely those of one side.
GAPS = 2.0


def samples_past_boundary(one: SampledScene, sides: CellSides) -> tuple[Ints, Floats]:
    """Return the samples (k,) that are past the boundary beside their cell, and places (k, d) on the cell's side.

    Their mirror images, in the scene's coordinates. Where a boundary lies off the manifold, data may change anywhere
    between it and its feet there: samples as near as that are past it, too. Boundaries that have no left, and those of
    curves, have none.
    """
    rows, places = [np.zeros(0, dtype=np.int64)], [np.zeros((0, one.lattice.dim))]
    for number, oriented in enumerate(one.oriented):
        if one.mesh.manifold_dim == 1 or not oriented.has_left:
            continue
        near, side = _samples_near_chords(one, np.flatnonzero(sides.owner == number), sides.left)
        if not len(near):
            continue
        origin = oriented.left.origin
        x = one.lattice.to_scene(one.samples.points_at(near)) - origin
        feet, on = oriented.feet(x)
        leftward = oriented.axis_and_left(feet, on, DIFFERENCE_SPACINGS * one.lattice.spacing)[1]
        inside, doubt = side * dots(x - on.points, leftward), GAPS * norms(on.points - feet.points)
        past = (inside < doubt) & (feet.edge < 0)
        step = side * np.maximum(doubt, -inside)
        rows.append(near[past])
        places.append((on.points + step[:, None] * leftward)[past] + origin)
    found, first = np.unique(np.concatenate(rows), return_index=True)
    return found, np.concatenate(places)[first]


def _samples_near_chords(one: SampledScene, on: Ints, left: Bools) -> tuple[Ints, Ints]:
    """Return the samples (k,) of cells with one of the half facets ``on`` that lie near its chord, and their side.

    Which is 1 where the half facet is on the ``left`` (n,), and -1 elsewhere.
    """
    half, mesh = one.half, one.mesh
    samples: Any = one.samples  # fixed to their lattice by now
    cells, facet = half.cell[on], half.facet[on]
    starts = samples.cell_starts[cells].astype(np.int64)
    count = samples.cell_starts[cells + 1] - starts
    rows = np.arange(count.sum()) + np.repeat(starts - np.cumsum(count) + count, count)
    start, end = (mesh.vertices[mesh.cells[cells, (facet + k) % 3]] for k in (1, 2))
    along = np.repeat((end - start) / norms(end - start)[:, None], count, axis=0)
    way = samples.points_at(rows) - np.repeat(start, count, axis=0)
    near = norms(way - dots(way, along)[:, None] * along) < NEAR_CHORD_SPACINGS * one.lattice.spacing
    found, first = np.unique(rows[near], return_index=True)
    return found, np.repeat(np.where(left[on], 1, -1), count)[near][first]
