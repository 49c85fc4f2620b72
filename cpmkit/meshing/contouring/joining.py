"""Whether two points of a manifold hang together near by: the one topological test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.protocols import Bools, Floats

#: A chord is flat if its mean sine with the tangent spaces is at most this, and the normals' cosine above that.
FLAT_SINE, FLAT_COSINE = 0.1, 0.8
#: Crossings are known to this share of the lattice's spacing: so far a chord may leave the tangent planes in any case.
LOST_SHARE = 2e-3
#: Rounds of halving; ends of them: a gap this share of the first, grown to this, or kept to that share in a round.
MOST_ROUNDS, CLOSED_GAP, GROWN_GAP, STUCK_GAP = 40, 0.05, 1.2, 0.97
#: In units of the noise of feet: what a chord may leave the tangent planes by, how far from its foot a place must be
#: for the direction to be known, the gap that counts as closed.
LOST_NOISES, KNOWN_NOISES, CLOSED_NOISES = 4.0, 20.0, 6.0
#: Tangent planes meet in a crease if the sine of their normals is above this, so near to the chord's middle, in chords.
CREASE_SINE, CREASE_REACH = 0.3, 1.5


@dataclass(frozen=True)
class JoinTolerances:
    """How exactly points must lie in planes and on the manifold to count as joined.

    Attributes
    ----------
    lost : float
        The length to which the points are known: a chord may leave the tangent planes by so much in any case.
    sine : float
        A chord is flat if its mean sine with the tangent planes of its ends is at most this.
    cosine : float
        And if the cosine of the normals at its ends is above this.
    off_manifold : float
        Points between two sheets that meet in a crease lie on the manifold up to this share of their chord.
    """

    lost: float
    sine: float = FLAT_SINE
    cosine: float = FLAT_COSINE
    off_manifold: float = 0.1

    @classmethod
    def of_lattice(cls, spacing: float, noise: float = 0.0) -> JoinTolerances:
        """Return those for crossings found on a lattice by closest points with that noise."""
        return cls(max(LOST_SHARE * spacing, LOST_NOISES * noise))


def flat(a: Floats, b: Floats, normal_a: Floats, normal_b: Floats, tolerances: JoinTolerances) -> Bools:
    """Return whether the chord from a to b lies in both tangent planes; a normal of zero is unknown."""
    chord = b - a
    sine = 0.5 * (np.abs(dots(chord, normal_a)) + np.abs(dots(chord, normal_b)))
    unknown = (normal_a == 0).all(axis=1) | (normal_b == 0).all(axis=1)
    alike = np.abs(dots(normal_a, normal_b)) > tolerances.cosine
    return np.asarray((sine <= tolerances.sine * norms(chord) + tolerances.lost) & (alike | unknown))


def joined(
    source: LocalSource,
    a: Floats,
    b: Floats,
    normal_a: Floats,
    normal_b: Floats,
    tolerances: JoinTolerances,
    box: tuple[Floats, Floats],
) -> Bools:
    """Return whether points ``a`` and ``b`` (n, 3) of a surface hang together in boxes with corners ``box`` (2, n, 3).

    They do where the chord is flat, and where a crease between them lies on the surface in the box; where it lies
    outside they hang together in another box. Else the chord is bent onto
    the surface where it is farthest: its midpoint's closest point takes the place of one of its ends, so that what is
    not flat or longer is left. At a crease the gap shrinks, between sheets it stays.
    """
    yes = flat(a, b, normal_a, normal_b, tolerances)
    rows = np.flatnonzero(~yes)
    over, crease = _joined_over_crease(source, a[rows], b[rows], normal_a[rows], normal_b[rows], tolerances)
    yes[rows] = over & _meets_box(crease, np.cross(normal_a[rows], normal_b[rows]), box[0][rows], box[1][rows])
    rows = rows[~over]
    a, b, na, nb = (np.array(values[rows]) for values in (a, b, normal_a, normal_b))
    first = gap = norms(b - a)
    for _ in range(MOST_ROUNDS):
        if not len(rows):
            break
        middle = 0.5 * (a + b)
        foot = source.closest_point(middle).points
        away = middle - foot
        known = norms(away) > np.maximum(1e-3 * first, KNOWN_NOISES * source.noise)
        nf = np.where(known[:, None], unit(away), 0.0)
        to_a, to_b = norms(foot - a), norms(b - foot)
        flat_a, flat_b = flat(a, foot, na, nf, tolerances), flat(foot, b, nf, nb, tolerances)
        first_half = np.where(flat_a == flat_b, to_a >= to_b, flat_b)
        keep_a = first_half[:, None]
        a, na = np.where(keep_a, a, foot), np.where(keep_a, na, nf)
        b, nb = np.where(keep_a, foot, b), np.where(keep_a, nf, nb)
        new = np.where(first_half, to_a, to_b)
        done = (flat_a & flat_b) | (new < np.maximum(CLOSED_GAP * first, CLOSED_NOISES * source.noise))
        yes[rows[done]] = True
        go = ~done & (new <= GROWN_GAP * first) & (new <= STUCK_GAP * gap)
        rows, first, gap = rows[go], first[go], new[go]
        a, b, na, nb = a[go], b[go], na[go], nb[go]
    return yes


def _joined_over_crease(
    source: LocalSource, a: Floats, b: Floats, normal_a: Floats, normal_b: Floats, tolerances: JoinTolerances
) -> tuple[Bools, Floats]:
    """Return whether tangent planes of ``a`` and ``b`` (n, 3) meet in a crease of the surface near, and where (n, 3).

    The point of the meeting line nearest to the chord's middle is looked for on the surface, then the two halves.
    """
    yes = np.zeros(len(a), dtype=bool)
    middle, length, cosine = 0.5 * (a + b), norms(b - a), dots(normal_a, normal_b)
    high_a, high_b = dots(normal_a, a - middle), dots(normal_b, b - middle)
    with np.errstate(all="ignore"):
        share = 1 / (1 - cosine**2)
        along_a, along_b = share * (high_a - cosine * high_b), share * (high_b - cosine * high_a)
        crease = middle + along_a[:, None] * normal_a + along_b[:, None] * normal_b
        near = norms(crease - middle) < CREASE_REACH * length
    known = (normal_a != 0).any(axis=1) & (normal_b != 0).any(axis=1)
    rows = np.flatnonzero(known & near & (1 - cosine**2 > CREASE_SINE**2))
    a, b, na, nb, length = a[rows], b[rows], normal_a[rows], normal_b[rows], length[rows]
    foot = source.closest_point(crease[rows]).points
    meets = norms(foot - crease[rows]) <= tolerances.off_manifold * length + tolerances.lost
    for end, normal in ((a, na), (b, nb)):
        rise = np.abs(dots(foot - end, normal))
        meets &= rise <= tolerances.sine * norms(foot - end) + tolerances.lost
    crease[rows] = foot
    rows, a, b, foot = rows[meets], a[meets], b[meets], foot[meets]
    halves = [0.5 * (end + foot) for end in (a, b)]
    feet = source.closest_point(np.concatenate(halves)).points.reshape(2, -1, 3)
    yes[rows] = True
    for end, half, of_half in zip((a, b), halves, feet, strict=True):
        yes[rows] &= norms(of_half - half) <= tolerances.off_manifold * norms(foot - end) + tolerances.lost
    return yes, crease


def _meets_box(point: Floats, along: Floats, low: Floats, high: Floats) -> Bools:
    """Return whether lines through ``point`` (n, 3) meet their boxes."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - point) / along, (high - point) / along
    enters = np.where(along == 0, np.where(low <= point, -np.inf, np.inf), np.minimum(first, second)).max(axis=1)
    leaves = np.where(along == 0, np.where(point <= high, np.inf, -np.inf), np.maximum(first, second)).min(axis=1)
    return np.asarray(enters <= leaves)
