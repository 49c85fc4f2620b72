"""Whether two points of a manifold hang together near by: the one topological test."""

from __future__ import annotations

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.protocols import Bools, Floats

#: A chord is flat if its mean sine with the tangent spaces is at most this, and the normals' cosine above that.
FLAT_SINE, FLAT_COSINE = 0.1, 0.8
#: Crossings are known to this share of the lattice's spacing: so far a chord may leave the tangent planes in any case.
LOST_SHARE = 2e-3
#: Rounds of halving; ends of them: a gap this share of the first, grown to this, or kept to that share in a round.
MOST_ROUNDS, CLOSED_GAP, GROWN_GAP, STUCK_GAP = 10, 0.05, 1.2, 0.97


def flat(a: Floats, b: Floats, normal_a: Floats, normal_b: Floats, lost: float) -> Bools:
    """Return whether the chord from a to b lies in both tangent planes, up to ``lost``; a normal of zero is unknown."""
    chord = b - a
    sine = 0.5 * (np.abs(dots(chord, normal_a)) + np.abs(dots(chord, normal_b)))
    unknown = (normal_a == 0).all(axis=1) | (normal_b == 0).all(axis=1)
    alike = np.abs(dots(normal_a, normal_b)) > FLAT_COSINE
    return np.asarray((sine <= FLAT_SINE * norms(chord) + lost) & (alike | unknown))


def joined(source: LocalSource, a: Floats, b: Floats, normal_a: Floats, normal_b: Floats, lost: float) -> Bools:
    """Return whether points ``a`` and ``b`` (n, 3) of a surface hang together near their chord.

    The chord is bent onto the surface where it is farthest: its midpoint's closest point takes the place of one of its
    ends, so that what is not flat or longer is left. At a crease the gap shrinks, between sheets it stays.
    """
    yes = flat(a, b, normal_a, normal_b, lost)
    rows = np.flatnonzero(~yes)
    a, b, na, nb = (np.array(values[rows]) for values in (a, b, normal_a, normal_b))
    first = gap = norms(b - a)
    for _ in range(MOST_ROUNDS):
        middle = 0.5 * (a + b)
        foot = source.closest_point(middle).points
        away = middle - foot
        known = norms(away) > 1e-3 * first
        nf = np.where(known[:, None], unit(away), 0.0)
        to_a, to_b = norms(foot - a), norms(b - foot)
        flat_a, flat_b = flat(a, foot, na, nf, lost), flat(foot, b, nf, nb, lost)
        first_half = np.where(flat_a == flat_b, to_a >= to_b, flat_b)
        keep_a = first_half[:, None]
        a, na = np.where(keep_a, a, foot), np.where(keep_a, na, nf)
        b, nb = np.where(keep_a, foot, b), np.where(keep_a, nf, nb)
        new = np.where(first_half, to_a, to_b)
        done = (flat_a & flat_b) | (new < CLOSED_GAP * first)
        yes[rows[done]] = True
        go = ~done & (new <= GROWN_GAP * first) & (new <= STUCK_GAP * gap)
        rows, first, gap = rows[go], first[go], new[go]
        a, b, na, nb = a[go], b[go], na[go], nb[go]
        if not len(rows):
            break
    return yes
