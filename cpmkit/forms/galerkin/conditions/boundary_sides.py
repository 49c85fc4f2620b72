"""Which cells beside a boundary are on its left.

In the mesh, which is cut along boundaries, half facets (facets seen from one cell) are on the same side of a boundary
if they share a corner of the cut mesh between two facets of the boundary. The scene defines which side is left
(:class:`cpmkit.scene.oriented.OrientedBoundary`). Its directions are summed along each connected piece of the
boundary, since they may be wrong at single samples where the boundary is not on the manifold or turns sharply.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpmkit.forms.galerkin.conditions.boundary_samples import BoundarySamples
from cpmkit.forms.galerkin.dof_map import components
from cpmkit.grid.lattice import Lattice
from cpmkit.mesh.adjacency import HalfFacets
from cpmkit.mesh.mesh import Mesh
from cpmkit.scene.oriented import OrientedBoundary
from cpmkit.types import Bools, Floats, Ints

#: Step of finite differences, in spacings, for normals and tangents of sources that do not provide them.
DIFFERENCE_SPACINGS = 0.5


def left_of_boundaries(
    mesh: Mesh,
    half: HalfFacets,
    corners: Ints,
    samples: BoundarySamples,
    boundaries: Sequence[OrientedBoundary],
    lattice: Lattice,
) -> Bools:
    """Return whether each boundary sample (b,) is on the left of its boundary.

    Parameters
    ----------
    mesh : Mesh
        The mesh, cut along the boundaries.
    half : HalfFacets
        Facets of the mesh on boundaries and rims, once for each cell beside them.
    corners : (m, k) int64
        The vertices of the cells after cutting.
    samples : BoundarySamples
        Samples on these half facets.
    boundaries : sequence of OrientedBoundary
        The boundaries, numbered as in ``mesh.owner``.
    lattice : Lattice
        The coordinates of samples are relative to its origin.
    """
    n = len(half.cell)
    if not n or not len(samples):
        return np.zeros(len(samples), dtype=bool)
    rows = np.flatnonzero(samples.half >= 0)
    votes = np.bincount(samples.half[rows], _votes(samples, boundaries, lattice)[rows], n)
    group, piece = _side_and_piece_labels(mesh, half, corners)
    by_group = np.bincount(group, votes, n)[group]
    opposite = np.bincount(piece, votes, n)[piece] - by_group
    sides = np.bincount(piece[np.unique(group, return_index=True)[1]], minlength=n)[piece]
    left = np.where(sides == 2, by_group > opposite, by_group > 0)
    one_sided = (sides == 1) & _has_cell_beyond(half)
    left = np.where(one_sided, votes > 0, left)
    on = np.flatnonzero((samples.half >= 0) & (samples.owner >= 0))  # empty if boundaries are points of a surface
    is_left = np.zeros(len(samples), dtype=bool)
    is_left[on] = left[samples.half[on]]
    return is_left


def side_moments(samples: BoundarySamples, left: Bools, count: int) -> Floats:
    """Return moments (count, d, d + 1) of the conormals out of the left side of each of ``count`` boundaries.

    They are the integrals of the conormal times 1 and times each coordinate. They change sign if left and right are
    swapped, and hardly depend on the facets into which the boundary is divided. ``left`` (b,) is whether each sample is
    on the left.
    """
    dim = samples.points.shape[1]
    moments = np.zeros((count, dim, dim + 1))
    rows = np.flatnonzero(left & (samples.owner >= 0) & ~samples.beyond_tip)
    positions = np.hstack([np.ones((len(rows), 1)), samples.points[rows]])
    weighted = samples.weights[rows, None] * samples.conormals[rows]
    np.add.at(moments, samples.owner[rows], weighted[:, :, None] * positions[:, None])
    return moments


def _votes(samples: BoundarySamples, boundaries: Sequence[OrientedBoundary], lattice: Lattice) -> Floats:
    """Return the votes (b,) of samples for their cell being on the left: positive for left, negative for right.

    A vote is the weight of the sample times the inner product of its conormal with the boundary's direction to the
    right. Directions are computed at the middles of facets; samples on continuations past tips have the vote zero.
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
        leftward = oriented.leftward(feet, on, DIFFERENCE_SPACINGS * lattice.spacing)
        votes[rows] = -samples.weights[rows] * np.sum(samples.conormals[rows] * leftward[place], axis=1)
    return votes


def _side_and_piece_labels(mesh: Mesh, half: HalfFacets, corners: Ints) -> tuple[Ints, Ints]:
    """Return two labels (n,) of half facets: of one side of a connected piece of a boundary, and of this piece.

    Facets of one boundary are connected at vertices where exactly two facets of boundaries meet.
    """
    n, k = len(half.cell), mesh.cells.shape[1]
    on = half.cut >= 0
    piece = np.where(on, half.cut, len(mesh.cut) + np.arange(n))
    if k == 2:  # a boundary is a vertex, and each side of it one segment
        return np.arange(n), _renumber(piece)
    places = (half.facet[:, None] + np.arange(1, k)) % k
    vertex, corner = mesh.cells[half.cell[:, None], places], corners[half.cell[:, None], places]
    meeting = np.bincount(mesh.cut.ravel(), minlength=len(mesh.vertices))[vertex]
    rows, places = np.nonzero(on[:, None] & (meeting == 2))
    owner = mesh.owner[half.cut[rows]]
    group = _merge_labels(np.arange(n), rows, np.stack([corner[rows, places], owner], axis=1))
    return group, _merge_labels(_renumber(piece), rows, np.stack([vertex[rows, places], owner], axis=1))


def _merge_labels(labels: Ints, rows: Ints, keys: Ints) -> Ints:
    """Return ``labels`` (n,), all below n, after merging the labels of ``rows`` (k,) with equal ``keys`` (k, 2)."""
    n, node = len(labels), _renumber(keys[:, 0] * (int(keys[:, 1].max(initial=0)) + 1) + keys[:, 1])
    pairs = np.stack([labels[rows], n + node], axis=1)
    return _renumber(components(n + len(rows), pairs)[1][labels])


def _renumber(labels: Ints) -> Ints:
    """Return ``labels`` (n,) renumbered from 0 on without gaps."""
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel(), dtype=np.int64)


def _has_cell_beyond(half: HalfFacets) -> Bools:
    """Return for each half facet (n,), a facet of one cell, whether it is on a boundary with another cell beyond it."""
    on = half.cut >= 0
    count = np.bincount(half.cut[on], minlength=int(half.cut.max(initial=-1)) + 1)
    twice = np.zeros(len(half.cut), dtype=bool)
    twice[on] = count[half.cut[on]] > 1
    return twice
