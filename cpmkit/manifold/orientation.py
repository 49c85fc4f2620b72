"""Signs of directions propagated between the samples of a boundary, and points linked in their order along curves.

Differs from King et al. (2024), section 4.7, where vectors get their signs stencil by stencil.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cpmkit.manifold.vector_algebra import dots, norms
from cpmkit.types import Floats, Ints

#: Samples within this many of their spacings may be neighbours.
NEIGHBOUR_SPACINGS = 2.5
#: Two points nearer than this share of the spacing have no reliable chord.
SHORT_CHORD_SPACINGS = 0.02
#: Least cosine between a direction and that of a neighbour, transported along the chord, for certain signs.
SURE_COSINE = 0.7


@dataclass(frozen=True, eq=False)
class Orientation:
    """A consistent choice of sign for the conormals of a boundary, or for normals along it, stored at samples of it."""

    points: Floats | None = None  #: (s, d): samples of the boundary; None where the source's own signs are used.
    directions: Floats | None = None  #: (s, d): unit vectors at the samples; the signs of neighbours agree.
    spacing: float = 0.0  #: Distance of the samples.

    def orient_directions(self, points: Floats, directions: Floats) -> Floats:
        """Return ``directions`` (n, d) at ``points`` (n, d) with the signs of the nearest samples, if there are any.

        The directions of the six (or all) nearest samples are transported along the chords to the point; the one that
        is most nearly parallel decides the sign.
        """
        if self.points is None or self.directions is None or not len(points):
            return directions
        nearest, short = self._nearest_samples(points), SHORT_CHORD_SPACINGS * self.spacing
        chords = points[:, None] - self.points[nearest]
        agreement = transported_cosines(self.directions[nearest], directions[:, None], chords, short)
        best = np.take_along_axis(agreement, np.abs(agreement).argmax(axis=1)[:, None], 1)
        return np.asarray(np.where(best >= 0, directions, -directions))

    def mean_directions(self, points: Floats) -> Floats:
        """Return unit vectors (n, d), the means of the directions of the six (or all) samples nearest to ``points``."""
        assert self.directions is not None
        mean = self.directions[self._nearest_samples(points)].sum(axis=1)
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))

    @cached_property
    def _tree(self) -> Any:
        """The k-d tree of the samples."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points)

    def _nearest_samples(self, points: Floats) -> Ints:
        """Return the numbers (n, k) of the samples nearest to ``points`` (n, d): six, or all if there are fewer."""
        count = min(6, self._tree.n)
        return np.reshape(self._tree.query(points, count)[1], (len(points), count))


#: The source's own signs.
AS_GIVEN = Orientation()


def transported_cosines(first: Floats, second: Floats, chords: Floats, short: float) -> Floats:
    """Return the cosines (...) between unit vectors ``second`` and ``first``, moved along ``chords``, all (..., d).

    The first vector, a normal or conormal, is rotated as along a circular arc with this chord, to its mirror image in
    the plane across the chord. This is right to third order on a smooth curve or surface, and also across a corner at
    the midpoint of the chord, where directions may be far apart. Chords up to the length ``short`` rotate nothing.
    """
    length = np.linalg.norm(chords, axis=-1, keepdims=True)
    unit_chords = chords / np.where(length > 0, length, 1.0)
    plain = dots(first, second)
    mirrored = plain - 2 * dots(first, unit_chords) * dots(second, unit_chords)
    return np.asarray(np.where(length[..., 0] <= short, plain, mirrored))


def propagate_signs(
    points: Floats, directions: Floats, tangents: Floats | None, spacing: float
) -> tuple[Floats, Ints, bool, bool]:
    """Return ``directions`` (s, d), unit normals or conormals at ``points`` (s, d), with signs that neighbours share.

    Points are about ``spacing`` apart; neighbours are points within :data:`NEIGHBOUR_SPACINGS`; with the unit
    ``tangents`` (s, d) of a curve, only points ahead or behind. Signs follow a minimum spanning tree of pairs of
    neighbours, with small weights where directions agree well, from the first point of each piece, whose sign stays.

    Returned ``directions`` (s, d).
    Returned ``piece`` (s,): number of the connected piece of each sample; signs of different pieces are independent.
    Returned ``consistent``: False if neighbours that agree well up to sign have opposite signs, as on a Moebius strip.
    Returned ``sure``: True if all neighbours along which signs were propagated agree well, so that denser samples would
        change nothing.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
    from scipy.spatial import cKDTree

    pairs = cKDTree(points).query_pairs(NEIGHBOUR_SPACINGS * spacing, output_type="ndarray").astype(np.int64)
    if tangents is not None:
        chord = points[pairs[:, 1]] - points[pairs[:, 0]]
        along = np.abs(np.einsum("kd,ked->ke", chord, tangents[pairs])).min(axis=1)
        pairs = pairs[along >= 0.25 * norms(chord)]  # neighbours on a curve lie ahead or behind
    count, (first, second) = len(points), pairs.T
    chord = points[second] - points[first]
    agreement = transported_cosines(directions[first], directions[second], chord, SHORT_CHORD_SPACINGS * spacing)
    weight = 1.001 - np.minimum(np.abs(agreement), 1.0)  # zero would be no link
    tree = minimum_spanning_tree(csr_array((weight, (first, second)), shape=(count, count)))
    _, piece = connected_components(tree, directed=False)
    sign = np.ones(count)
    for root in np.unique(piece, return_index=True)[1]:
        order, parent = breadth_first_order(tree, root, directed=False)
        members, above = order[1:], parent[order[1:]]
        step = points[members] - points[above]
        over = transported_cosines(directions[above], directions[members], step, SHORT_CHORD_SPACINGS * spacing)
        for member, up, cosine in zip(members, above, over, strict=True):
            sign[member] = sign[up] if cosine >= 0 else -sign[up]
    clear = np.abs(agreement) >= SURE_COSINE
    consistent = not np.any((sign[first] * sign[second] * agreement < 0) & clear)
    sure = bool(tree.data.max(initial=0.0) <= 1.001 - SURE_COSINE)
    return directions * sign[:, None], np.asarray(piece, dtype=np.int64), consistent, sure


class Chain(NamedTuple):
    """Numbers of points (k,) in their order along a curve; in a closed chain the first point follows the last."""

    order: Ints
    closed: bool


def link_chains(points: Floats, tangents: Floats, conormals: Floats, reach: float) -> list[Chain]:
    """Return the chains of ``points`` (n, d), n > 0, in either direction along each curve that passes through them.

    Two points are linked if each is the other's next point: the nearest within ``reach`` that lies ahead or behind,
    with sideways distance weighted more, and with its conormal to the same side. Branches that cross, parallel arms and
    neighbouring sheets of a surface therefore stay separate. A point without links is an open chain.

    The ``points`` are a few times denser than ``reach``, the largest distance of linked points. ``tangents`` (n, d) are
    unit tangents of any sign, ``conormals`` (n, d) unit vectors across the curve, of one sign along each curve.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    pairs = _links(points, tangents, conormals, reach)
    n = len(points)
    ends = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = coo_array((np.ones(2 * len(pairs)), (ends[0], ends[1])), (n, n)).tocsr()
    degree, chains = np.diff(graph.indptr), []
    count, label = connected_components(graph, directed=False)
    for piece in range(count):
        members = np.flatnonzero(label == piece)
        ends_of_piece = members[degree[members] < 2]
        closed = not len(ends_of_piece)
        start = members[0] if closed else ends_of_piece[0]
        order = np.asarray(breadth_first_order(graph, start, directed=False, return_predecessors=False), np.int64)
        # breadth first search visits a closed chain in both directions by turns
        chains.append(Chain(np.concatenate([order[:1], order[1::2], order[2::2][::-1]]) if closed else order, closed))
    return chains


def _links(points: Floats, tangents: Floats, conormals: Floats, reach: float) -> Ints:
    """Return the pairs (m, 2) of points that are linked (see :func:`link_chains`), the smaller number first.

    Each point chooses a neighbour ahead and one behind among the 23 nearest. Squared sideways distance counts 5 times.
    """
    from scipy.spatial import cKDTree

    n = len(points)
    distance, other = cKDTree(points).query(points, min(24, n), distance_upper_bound=reach)
    distance, other = (np.reshape(columns, (n, -1))[:, 1:] for columns in (distance, other))
    within_reach = np.isfinite(distance)
    other = np.where(within_reach, other, 0)
    chord = points[other] - points[:, None]
    ahead = dots(chord, tangents[:, None])
    fits = within_reach & (dots(conormals[other], conormals[:, None]) >= 0.25)
    fits &= np.minimum(np.abs(ahead), np.abs(dots(chord, tangents[other]))) >= 0.5 * distance
    cost = np.where(fits, 5 * distance**2 - 4 * ahead**2, np.inf)
    forward, backward = (_cheapest_entries(other, np.where(side, cost, np.inf)) for side in (ahead > 0, ahead <= 0))
    choices = np.concatenate([np.stack([np.arange(n), number], axis=1)[number >= 0] for number in (forward, backward)])
    pairs, times = np.unique(np.sort(choices, axis=1), axis=0, return_counts=True)
    return np.asarray(pairs[times == 2], dtype=np.int64)


def _cheapest_entries(other: Ints, cost: Floats) -> Ints:
    """Return the entry (n,) of ``other`` (n, k) of least ``cost`` in each row, -1 where all costs are infinite."""
    if not cost.shape[1]:
        return np.full(len(cost), -1)
    best = cost.argmin(axis=1)[:, None]
    finite = np.isfinite(np.take_along_axis(cost, best, 1)[:, 0])
    return np.where(finite, np.take_along_axis(other, best, 1)[:, 0], -1)
