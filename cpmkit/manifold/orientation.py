"""Signs of normals and tangents of sources that have no orientation of their own, propagated along a boundary.

Differs from King et al. (2024), section 4.7, where vectors get their signs stencil by stencil.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.types import Bools, Floats, Ints

#: Samples within this many of their spacings may be neighbours.
NEIGHBOUR_SPACINGS = 2.5
#: Neighbours on a curve lie ahead or behind: the least cosine between the chord and the tangents at both.
NEIGHBOUR_CHORD_COSINE = 0.25
#: Two points nearer than this share of the spacing have no reliable chord.
SHORT_CHORD_SPACINGS = 0.02
#: Least cosine between a direction and that of a neighbour, transported along the chord, for certain signs.
SURE_COSINE = 0.7
#: Largest difference between the cosines of the chord with the two directions, for their signs to be certain: a larger
#: one shows a corner between them.
UNEVEN_COSINE = 0.2
#: A point gets the sign of the sample with the best agreement among this many nearest samples.
SIGN_SAMPLES = 6


@dataclass(frozen=True, eq=False)
class Orientation:
    """A consistent choice of sign for normals or tangents of a boundary, stored at samples of it.

    Attributes
    ----------
    points : (s, d) float64 or None
        Samples of the boundary; None where the source's own signs are used.
    directions : (s, d) float64 or None
        Unit normals or tangents at the samples; the signs of neighbours agree.
    spacing : float
        Distance of the samples.
    travel : bool
        True where the directions are tangents of a curve, False where they are normals.
    """

    points: Floats | None = None
    directions: Floats | None = None
    spacing: float = 0.0
    travel: bool = False

    def apply(self, points: Floats, directions: Floats) -> Floats:
        """Return ``directions`` (n, d) at ``points`` (n, d), with signs changed where the samples near by require it.

        Of the nearest samples, the sample whose direction is most nearly parallel decides.
        """
        if self.points is None or self.directions is None or not len(points):
            return directions
        nearest, short = self._nearest_samples(points), SHORT_CHORD_SPACINGS * self.spacing
        chords = points[:, None] - self.points[nearest]
        agreement = agreements(self.directions[nearest], directions[:, None], chords, short, self.travel)
        best = np.take_along_axis(agreement, np.abs(agreement).argmax(axis=1)[:, None], 1)
        return np.asarray(np.where(best >= 0, directions, -directions))

    def mean(self, points: Floats) -> Floats:
        """Return unit vectors (n, d): the mean directions of the samples nearest to ``points`` (n, d)."""
        assert self.directions is not None
        mean = self.directions[self._nearest_samples(points)].sum(axis=1)
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))

    def translate(self, offset: Floats) -> Orientation:
        """Return the orientation of the boundary moved by ``offset`` (d,)."""
        return self if self.points is None else replace(self, points=self.points + offset)

    @classmethod
    def join(cls, parts: Sequence[Orientation]) -> Orientation:
        """Return one orientation of several parts of a boundary, all of which have samples."""
        points, directions = ([getattr(part, name) for part in parts] for name in ("points", "directions"))
        spacing = min(part.spacing for part in parts)
        return cls(np.concatenate(points), np.concatenate(directions), spacing, parts[0].travel)

    @cached_property
    def _tree(self) -> Any:
        """The k-d tree of the samples."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points)

    def _nearest_samples(self, points: Floats) -> Ints:
        """Return the numbers (n, k) of the samples nearest to ``points`` (n, d)."""
        count = min(SIGN_SAMPLES, self._tree.n)
        return np.reshape(self._tree.query(points, count)[1], (len(points), count))


#: The source's own signs.
AS_GIVEN = Orientation()


def agreements(first: Floats, second: Floats, chords: Floats, short: float, travel: bool) -> Floats:
    """Return the cosines (...,) between ``second`` and ``first`` after transport along the chords, all (..., d).

    A direction is rotated as along a circular arc with this chord: a normal to its mirror image in the plane across the
    chord, a tangent to the opposite of its mirror image. This is right to third order on a smooth curve or surface, and
    also across a corner in the middle of the chord, where the two directions themselves may be far apart.

    Parameters
    ----------
    first, second : (..., d) float64
        Unit directions at the start and the end of each chord.
    chords : (..., d) float64
    short : float
        Chords up to this length rotate nothing.
    travel : bool
        True for tangents, False for normals.
    """
    length = np.linalg.norm(chords, axis=-1, keepdims=True)
    unit_chords = chords / np.where(length > 0, length, 1.0)
    plain = np.sum(first * second, axis=-1)
    mirrored = plain - 2 * np.sum(first * unit_chords, axis=-1) * np.sum(second * unit_chords, axis=-1)
    return np.asarray(np.where(length[..., 0] <= short, plain, -mirrored if travel else mirrored))


def neighbours(points: Floats, spacing: float, tangents: Floats | None) -> Ints:
    """Return the pairs (k, 2) of neighbouring samples among ``points`` (s, d), which are ``spacing`` apart.

    With ``tangents`` (s, d) the samples lie on a curve, and only samples ahead or behind along it are neighbours.
    """
    from scipy.spatial import cKDTree

    pairs: Ints = cKDTree(points).query_pairs(NEIGHBOUR_SPACINGS * spacing, output_type="ndarray").astype(np.int64)
    if tangents is None or not len(pairs):
        return pairs
    chord = points[pairs[:, 1]] - points[pairs[:, 0]]
    length = np.linalg.norm(chord, axis=1)
    along = np.abs(np.einsum("kd,ked->ke", chord, tangents[pairs])).min(axis=1)
    return np.asarray(pairs[along >= NEIGHBOUR_CHORD_COSINE * length])


@dataclass(frozen=True, eq=False)
class PropagatedSigns:
    """Directions whose signs were propagated from sample to sample.

    Attributes
    ----------
    directions : (s, d) float64
    piece : (s,) int64
        The connected piece of each sample; signs of different pieces are independent.
    sure : bool
        True where all neighbours along which signs were propagated agree well: denser samples would change nothing.
    consistent : bool
        False where a direction comes back reversed along some closed path.
    """

    directions: Floats
    piece: Ints
    sure: bool
    consistent: bool


def propagate_signs(points: Floats, directions: Floats, pairs: Ints, spacing: float, travel: bool) -> PropagatedSigns:
    """Return ``directions`` (s, d) at ``points`` (s, d) with signs that agree between neighbours.

    Signs follow a minimum spanning tree of the ``pairs`` (k, 2) of neighbours, whose weights are small where directions
    agree well.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

    count, (first, second) = len(points), pairs.T
    chord = points[second] - points[first]
    agreement = agreements(directions[first], directions[second], chord, SHORT_CHORD_SPACINGS * spacing, travel)
    leaning = [np.abs(np.sum(chord * directions[end], axis=1)) for end in (first, second)]
    length = np.maximum(np.linalg.norm(chord, axis=1), SHORT_CHORD_SPACINGS * spacing)
    uneven = np.abs(leaning[0] - leaning[1]) / length
    weight = 1.001 - np.minimum(np.abs(agreement), 1.0) + uneven  # zero would be no link
    tree = minimum_spanning_tree(csr_array((weight, (first, second)), shape=(count, count)))
    pieces, piece = connected_components(tree, directed=False)
    sign = np.ones(count)
    for number in range(pieces):
        members = np.flatnonzero(piece == number)
        _, parent = breadth_first_order(tree, members[0], directed=False)
        above = np.where(parent[members] < 0, members, parent[members]).astype(np.int64)
        step = points[members] - points[above]
        over = agreements(directions[above], directions[members], step, SHORT_CHORD_SPACINGS * spacing, travel)
        sign[members] = _signs_from_root((over >= 0) | (above == members), members, above)
    clear = (np.abs(agreement) >= SURE_COSINE) & (uneven <= UNEVEN_COSINE)
    consistent = not np.any((sign[first] * sign[second] * agreement < 0) & clear)
    sure = bool(tree.data.max(initial=0.0) <= 1.001 - SURE_COSINE)
    return PropagatedSigns(directions * sign[:, None], np.asarray(piece, dtype=np.int64), sure, consistent)


def _signs_from_root(agrees: Bools, members: Ints, above: Ints) -> Floats:
    """Return the sign (m,), 1 or -1, of each member relative to the root of its spanning tree, by pointer doubling.

    Parameters
    ----------
    agrees : (m,) bool
        Whether each member has the sign of its parent.
    members, above : (m,) int64
        Numbers of the members, and of their parents in the tree; the root is its own parent.
    """
    place = np.empty(int(members.max()) + 1, dtype=np.int64)
    place[members] = np.arange(len(members))
    sign, up = np.where(agrees, 1.0, -1.0), place[above]
    while True:
        further = up[up]
        if np.array_equal(further, up):
            return sign
        sign, up = sign * sign[up], further


def sign_by_rule(points: Floats, directions: Floats, centre: Floats, travel: bool) -> float:
    """Return 1 or -1, the factor that gives ``directions`` (s, d) of a connected piece their conventional orientation.

    The rule does not depend on the lattice. Normals point away from ``centre`` (d,), tangents (``travel``) run
    counter-clockwise about the axis with the largest angular moment. Where this is undecided, the largest component of
    the mean direction, or else of the direction at the first sample in lexicographic order, is positive.
    """
    away = points - centre
    moments = [directions.mean(axis=0), directions[np.lexsort(points.T)[0]]]
    if travel:
        turning = np.cross(away, directions) if points.shape[1] == 3 else away[:, :1] * directions[:, 1:]
        if points.shape[1] == 2:
            turning = turning - away[:, 1:] * directions[:, :1]
        moments.insert(1, turning.mean(axis=0) / _largest_length(away))
    else:
        moments.insert(0, np.array([np.sum(away * directions, axis=1).mean() / _largest_length(away)]))
    decided = next((moment for moment in moments if np.abs(moment).max() > 0.05), moments[-1])
    return -1.0 if decided[np.argmax(np.abs(decided))] < 0 else 1.0


def _largest_length(away: Floats) -> float:
    """Return the largest length of the vectors ``away`` (s, d), 1 if all are zero."""
    return float(np.linalg.norm(away, axis=1).max()) or 1.0


def piece_masks(piece: Ints) -> list[Bools]:
    """Return for each connected piece a mask (s,) of its samples, from the ``piece`` (s,) of each sample."""
    return [piece == number for number in range(int(piece.max(initial=-1)) + 1)]
