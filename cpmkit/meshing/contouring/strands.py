"""Which crossings of a curve follow each other inside a cell."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.meshing.contouring.joining import FLAT_SINE, GROWN_GAP, STUCK_GAP
from cpmkit.meshing.contouring.knot_crossings import KnotCrossings, same_share
from cpmkit.protocols import Bools, Floats, Ints

#: Rounds of halving, and the gap that counts as closed, as a share of the first: finer than for surfaces, where strands
#: that cross in the next cell may leave this one side by side.
MOST_ROUNDS, CLOSED_GAP = 30, 5e-3
#: A chord follows the curve if that is at most this share of its length away halfway.
FLAT_SAGITTA = 0.05
#: What feet may be off on account of their noise, and the gap that counts as closed, in units of it.
LOST_NOISES, CLOSED_NOISES = 6.0, 10.0
#: A crossing this near to a chord, as a share of its length, lies between its ends.
BETWEEN = 0.1


def follow(
    source: LocalSource, a: Floats, b: Floats, tangent_a: Floats, tangent_b: Floats, low: Floats, high: Floats
) -> Bools:
    """Return whether points ``a`` and ``b`` (n, d) of a curve hang together near their chord.

    As for surfaces, the chord is bent onto the curve, here inside the boxes from ``low`` to ``high`` (n, d); a tangent
    of zero is not known.
    """
    yes, rows = np.zeros(len(a), dtype=bool), np.arange(len(a))
    a, b, ta, tb = (np.array(values) for values in (a, b, tangent_a, tangent_b))
    first = gap = norms(b - a)
    lost, closed = LOST_NOISES * source.noise, CLOSED_NOISES * source.noise
    for _ in range(MOST_ROUNDS):
        middle = 0.5 * (a + b)
        foot = source.closest_point(middle).points
        chord = b - a
        astray = np.maximum(_astray(a, b, ta), _astray(a, b, tb))
        flat = (astray <= FLAT_SINE * norms(chord) + lost) & (
            norms(foot - middle) <= FLAT_SAGITTA * norms(chord) + lost
        )
        to_a, to_b = norms(foot - a), norms(b - foot)
        flat_a = _astray(a, foot, ta) <= FLAT_SINE * to_a + lost
        flat_b = _astray(foot, b, tb) <= FLAT_SINE * to_b + lost
        first_half = np.where(flat_a == flat_b, to_a >= to_b, flat_b)
        keep_a = first_half[:, None]
        a, ta = np.where(keep_a, a, foot), np.where(keep_a, ta, 0.0)
        b, tb = np.where(keep_a, foot, b), np.where(keep_a, 0.0, tb)
        new = np.where(first_half, to_a, to_b)
        held = ((foot >= low[rows]) & (foot <= high[rows])).all(axis=1)
        done = held & (flat | (new < np.maximum(CLOSED_GAP * first, closed)))
        yes[rows[done]] = True
        go = held & ~done & (new <= GROWN_GAP * first) & (new <= STUCK_GAP * gap)
        rows, first, gap = rows[go], first[go], new[go]
        a, b, ta, tb = a[go], b[go], ta[go], tb[go]
        if not len(rows):
            break
    return yes


def _astray(a: Floats, b: Floats, tangent: Floats) -> Floats:
    """Return how far the chord leaves the line along ``tangent``; nothing is known of one that is zero."""
    chord = b - a
    return np.asarray(norms(chord - dots(chord, tangent)[:, None] * tangent) * (tangent != 0).any(axis=1))


def neighbours(source: LocalSource, found: KnotCrossings, spacing: float) -> Ints:
    """Return the pairs (k, 2) of entries of one cell between which the curve stays in it and crosses nothing."""
    from cpmkit.meshing.contouring.grouping_kernels import nearest_pairs

    alone = np.arange(len(found.member))
    points, tangents = found.points, found.tangents
    pairs = np.empty((0, 2), dtype=np.int64)
    pairs = np.empty((nearest_pairs(found.start, found.member, points, alone, pairs), 2), dtype=np.int64)
    nearest_pairs(found.start, found.member, points, alone, pairs)
    i, j = found.member[pairs].T
    cells, half = found.cells[pairs[:, 0]], 0.5 + same_share(source, spacing)
    low, high = np.asarray((cells - half) * spacing), np.asarray((cells + half) * spacing)
    pairs = pairs[follow(source, points[i], points[j], tangents[i], tangents[j], low, high)]
    return pairs[~_with_others_between(found, pairs)]


def _with_others_between(found: KnotCrossings, pairs: Ints) -> Bools:
    """Return the pairs between which another crossing of the cell lies, on a strand of the same direction."""
    cell = np.searchsorted(found.start, pairs[:, 0], side="right") - 1
    low, high = found.start[cell], found.start[cell + 1]
    a, b = found.points[found.member[pairs]].transpose(1, 0, 2)
    chord, length = unit(b - a), norms(b - a)
    between = np.zeros(len(pairs), dtype=bool)
    for k in range(int((high - low).max(initial=0))):  # the k-th entry of every cell
        entry = np.minimum(low + k, high - 1)
        other = found.points[found.member[entry]] - a
        along = dots(other, chord)
        off = norms(other - along[:, None] * chord)
        alike = np.abs(dots(found.tangents[found.member[entry]], chord)) > 0.8
        new = (entry != pairs[:, 0]) & (entry != pairs[:, 1]) & alike
        between |= new & (along > 0) & (along < length) & (off < BETWEEN * length)
    return between
