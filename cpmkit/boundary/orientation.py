"""A sign for normals and tangents that come from closest points alone, carried along the boundary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cpmkit.protocols import Bools, Floats, Ints

#: Samples within so many times their spacing may be neighbours.
REACH = 2.5
#: Neighbours on a curve lie ahead or behind: the least cosine between the chord and the tangents at both.
AHEAD = 0.25
#: The chord of two points nearer than this share of the spacing tells nothing.
SHORT = 0.02
#: Neighbours whose directions agree by less than this (cosine, after the turn on the way) are not sure of each other.
SURE = 0.7


@dataclass(frozen=True, eq=False)
class Orientation:
    """Signs of directions along a boundary, known at samples of it.

    Attributes
    ----------
    points : (s, d) float64 or None
        Samples of the boundary; None where the source's own signs are used as they are.
    directions : (s, d) float64 or None
        Directions at the samples, neighbours agreeing.
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
        """Return ``directions`` (n, d) at ``points`` (n, d) with the sign of the nearest sample."""
        if self.points is None or self.directions is None:
            return directions
        nearest = self._tree.query(points)[1]
        chord = points - self.points[nearest]
        carried = transported(self.directions[nearest], chord, SHORT * self.spacing, self.travel)
        agree = np.sum(directions * carried, axis=1) >= 0
        return np.where(agree[:, None], directions, -directions)

    def moved(self, offset: Floats) -> Orientation:
        """Return the same signs along the boundary moved by ``offset`` (d,)."""
        return self if self.points is None else replace(self, points=self.points + offset)

    @classmethod
    def joined(cls, parts: Sequence[Orientation]) -> Orientation:
        """Return the signs along several parts of a boundary as one; all parts are sampled."""
        points, directions = ([getattr(part, name) for part in parts] for name in ("points", "directions"))
        spacing = min(part.spacing for part in parts)
        return cls(np.concatenate(points), np.concatenate(directions), spacing, parts[0].travel)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self.points)


#: The signs that the source gives.
AS_GIVEN = Orientation()


def transported(directions: Floats, chords: Floats, short: float, travel: bool) -> Floats:
    """Return ``directions`` (n, d) carried over ``chords`` (n, d), turned as a circular arc with that chord turns them.

    That is their mirror image in the plane across the chord; of a tangent the opposite. It is right to third order
    on a smooth curve or surface, and right to the sign at a corner or crease of up to 150 degrees, where the two
    directions themselves may point apart.
    """
    length = np.linalg.norm(chords, axis=1, keepdims=True)
    unit = chords / np.where(length > 0, length, 1.0)
    mirrored = directions - 2 * np.sum(directions * unit, axis=1, keepdims=True) * unit
    return np.where(length <= short, directions, -mirrored if travel else mirrored)


def neighbours(points: Floats, spacing: float, tangents: Floats | None) -> Ints:
    """Return the pairs (k, 2) of samples that follow each other; on a curve, with ``tangents`` of any sign."""
    from scipy.spatial import cKDTree

    pairs: Ints = cKDTree(points).query_pairs(REACH * spacing, output_type="ndarray").astype(np.int64)
    if tangents is None or not len(pairs):
        return pairs
    chord = points[pairs[:, 1]] - points[pairs[:, 0]]
    length = np.linalg.norm(chord, axis=1)
    ahead = [np.abs(np.sum(chord * tangents[pairs[:, end]], axis=1)) >= AHEAD * length for end in (0, 1)]
    return np.asarray(pairs[ahead[0] & ahead[1]])


@dataclass(frozen=True, eq=False)
class Carried:
    """Directions whose signs were carried from sample to sample.

    Attributes
    ----------
    directions : (s, d) float64
    piece : (s,) int64
        The connected piece of each sample; between pieces nothing is carried.
    sure : bool
        True where all neighbours that signs were carried between agree well: denser samples would change nothing.
    consistent : bool
        False where the direction comes back reversed on some way round.
    """

    directions: Floats
    piece: Ints
    sure: bool
    consistent: bool


def carry(points: Floats, directions: Floats, pairs: Ints, spacing: float, travel: bool) -> Carried:
    """Give ``directions`` (s, d) at samples ``points`` signs that agree, over the surest of the ``pairs`` first."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

    count = len(points)
    first, second = pairs.T
    moved = transported(directions[first], points[second] - points[first], SHORT * spacing, travel)
    agreement = np.sum(moved * directions[second], axis=1)
    weight = 1.001 - np.minimum(np.abs(agreement), 1.0)  # zero would be no link
    tree = minimum_spanning_tree(csr_array((weight, (first, second)), shape=(count, count)))
    pieces, piece = connected_components(tree, directed=False)
    sign = np.ones(count)
    for number in range(pieces):
        members = np.flatnonzero(piece == number)
        _, parent = breadth_first_order(tree, members[0], directed=False)
        above = np.where(parent[members] < 0, members, parent[members]).astype(np.int64)
        over = transported(directions[above], points[members] - points[above], SHORT * spacing, travel)
        agrees = (np.sum(over * directions[members], axis=1) >= 0) | (above == members)
        sign[members] = _signs_from_root(agrees, members, above)
    clear = np.abs(agreement) >= SURE
    consistent = not np.any((sign[first] * sign[second] * agreement < 0) & clear)
    sure = bool(1.001 - tree.data.max(initial=0.0) >= SURE)
    return Carried(directions * sign[:, None], np.asarray(piece, dtype=np.int64), sure, consistent)


def _signs_from_root(agrees: Bools, members: Ints, above: Ints) -> Floats:
    """Return each member's sign relative to the root of a spanning tree, by doubling steps towards the root.

    ``agrees`` (m,) tells which of the ``members`` (m,) have the sign of those ``above`` them, the root of itself.
    """
    place = np.empty(int(members.max()) + 1, dtype=np.int64)
    place[members] = np.arange(len(members))
    sign, up = np.where(agrees, 1.0, -1.0), place[above]
    while True:
        further = up[up]
        if np.array_equal(further, up):
            return sign
        sign, up = sign * sign[up], further


def by_rule(points: Floats, directions: Floats, centre: Floats, travel: bool) -> float:
    """Return the sign that a rule gives to ``directions`` (s, d) of one piece, whatever the lattice.

    Normals point away from ``centre`` (d,), tangents run counter-clockwise about the axis that has the largest share;
    where that is undecided, the largest component of their mean, or else of the first, is positive.
    """
    away = points - centre
    moments = [directions.mean(axis=0), directions[np.lexsort(points.T)[0]]]
    if travel:
        turning = np.cross(away, directions) if points.shape[1] == 3 else away[:, :1] * directions[:, 1:]
        if points.shape[1] == 2:
            turning = turning - away[:, 1:] * directions[:, :1]
        moments.insert(1, turning.mean(axis=0) / _size(away))
    else:
        moments.insert(0, np.array([np.sum(away * directions, axis=1).mean() / _size(away)]))
    decided = next((moment for moment in moments if np.abs(moment).max() > 0.05), moments[-1])
    return -1.0 if decided[np.argmax(np.abs(decided))] < 0 else 1.0


def _size(away: Floats) -> float:
    return float(np.linalg.norm(away, axis=1).max()) or 1.0


def piece_masks(piece: Ints) -> list[Bools]:
    """Return which samples belong to each piece."""
    return [piece == number for number in range(int(piece.max(initial=-1)) + 1)]
