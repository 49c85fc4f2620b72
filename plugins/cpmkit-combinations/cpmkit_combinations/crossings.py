"""Where a function changes its sign on a manifold: samples, and zeros between neighbours of opposite sign."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cpmkit.plugin import Bools, ClosestPoints, Floats, InputError, Ints, cell_levels, outward_conormals
from cpmkit_combinations.level_cut import CUT_DIFFERENCE_SHARE, LevelCut

#: Side, in samples, of the coarsest blocks that are skipped where the function is far from zero.
FILTER_BLOCK_SAMPLES = 4
#: Neighbours of opposite sign lie within so many spacings.
SIGN_CHANGE_SPACINGS = 2.5
#: Rounds of the search for a zero between two neighbours: to a share of their distance, and to rounding.
ROUGH_ZERO_ROUNDS, FINE_ZERO_ROUNDS = 3, 60
#: A zero at which the function is not below this share of its values at the neighbours is a jump between two sheets.
JUMP_VALUE_SHARE = 0.25
#: How far past the edge, in spacings, the points lie whose feet are on it.
PAST_EDGE_SPACINGS = 0.25


class Crossings(NamedTuple):
    """Points of the cut: inside the manifold, nearly on the cut, and on the manifold's edge, exactly."""

    inside: ClosestPoints
    at_edge: ClosestPoints


def crossings(cut: LevelCut) -> Crossings:
    """Return points of the cut, a few a spacing, and those where it ends on the edge.

    Raises
    ------
    InputError
        If the function does not change its sign on the manifold.
    """
    seeds, values = samples_near_zero(cut)
    low, high = _neighbours(seeds.points, values, SIGN_CHANGE_SPACINGS * cut.spacing)
    if not len(low):
        raise InputError(_no_crossing(cut, seeds, values))
    points = cut.surface.manifold_dim == 1
    rounds = FINE_ZERO_ROUNDS if points else ROUGH_ZERO_ROUNDS
    inside = zeros_between(cut, seeds.points[low], seeds.points[high], values[low], values[high], rounds)
    if not len(inside):
        place = (seeds.points[low[0]] + cut.phi.origin).tolist()
        raise InputError(
            f"{cut.phi.what} jumps from {values[low[0]]:.3g} to {values[high[0]]:.3g} near {place} without a zero; it "
            "must be continuous where it cuts."
        )
    edge = np.flatnonzero(seeds.edge >= 0)
    if points or not len(edge):
        return Crossings(inside, inside.take(np.zeros(0, dtype=np.int64)))
    return Crossings(inside, _edge_zeros(cut, seeds.take(edge), values[edge]))


def samples_near_zero(cut: LevelCut) -> tuple[ClosestPoints, Floats]:
    """Return samples of the manifold near the zeros of the function, and its values (n,).

    Blocks that the manifold misses, or in which the function seems too far from zero, are passed over; those are
    judged by how much it changes over the block.
    """
    dim, spacing = cut.surface.dim, cut.spacing
    children = np.stack(np.meshgrid(*[np.arange(2)] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    side, blocks = next(level for level in cell_levels(cut.surface, spacing, 0.5) if level[0] <= FILTER_BLOCK_SAMPLES)
    while True:
        centres = np.asarray(((blocks + 0.5) * side - 0.5) * spacing, dtype=np.float64)
        diagonal = np.sqrt(dim) * side * spacing
        feet = cut.surface.closest_point(centres)
        values = cut.phi(feet.points)
        near = feet.distance <= 0.5 * diagonal * (1 + CUT_DIFFERENCE_SHARE)
        near |= (feet.distance <= diagonal) & ((feet.edge >= 0) | (side > 1))  # beside the edge a ring more
        variation = np.zeros(len(blocks))
        variation[near] = cut.phi.variation(feet.points[near], diagonal)
        kept = near & (np.abs(values) <= variation)
        if not kept.any():
            raise InputError(_no_crossing(cut, feet, values))
        if side == 1:
            return feet.take(kept), values[kept]
        side //= 2
        blocks = (2 * blocks[kept][:, None] + children).reshape(-1, dim)


def zeros_between(
    cut: LevelCut, a: Floats, b: Floats, low: Floats, high: Floats, rounds: int, past: Floats | None = None
) -> ClosestPoints:
    """Return zeros on the manifold between points a and b (n, d), with values ``low`` <= 0 < ``high`` there (n,).

    The path from a to b is the feet of the straight line, or of that line moved by ``past`` (n, d). Where the path
    jumps from one sheet to another without a zero, none is returned.
    """
    beside = np.zeros_like(a) if past is None else past

    def ask(share: Floats, rows: Ints) -> Floats:
        line = a[rows] + share[:, None] * (b[rows] - a[rows]) + beside[rows]
        return cut.phi(cut.surface.closest_point(line).points)

    share = bracketed_zeros(ask, low, high, rounds)
    feet = cut.surface.closest_point(a + share[:, None] * (b - a) + beside)
    return feet.take(
        np.abs(cut.phi(feet.points)) <= JUMP_VALUE_SHARE * np.minimum(-low, high) + CUT_DIFFERENCE_SHARE * (high - low)
    )


def bracketed_zeros(ask: Callable[[Floats, Ints], Floats], low: Floats, high: Floats, rounds: int) -> Floats:
    """Return where, from 0 to 1, functions with values ``low`` <= 0 at 0 and ``high`` > 0 at 1 vanish (n,).

    Regula falsi with Illinois weights; every fourth round halves the bracket, whatever the function.
    """
    left, right = np.zeros(len(low)), np.ones(len(low))
    at_left, at_right, share = low.copy(), high.copy(), np.zeros(len(low))
    rows = np.arange(len(low))
    for k in range(rounds):
        a, b, fa, fb = left[rows], right[rows], at_left[rows], at_right[rows]
        s = 0.5 * (a + b) if k % 4 == 3 else np.clip((a * fb - b * fa) / (fb - fa), a, b)
        value = ask(s, rows)
        below = value <= 0
        left[rows], right[rows] = np.where(below, s, a), np.where(below, b, s)
        at_left[rows], at_right[rows] = np.where(below, value, 0.5 * fa), np.where(below, 0.5 * fb, value)
        share[rows] = s
        rows = rows[(value != 0) & (right[rows] - left[rows] > 1e-15) & (s != a) & (s != b)]
        if not len(rows):
            break
    return share


def _neighbours(points: Floats, values: Floats, reach: float) -> tuple[Ints, Ints]:
    """Return pairs of samples: each has the nearest of the other sign as partner, below zero first."""
    from scipy.spatial import cKDTree

    below, above = np.flatnonzero(values <= 0), np.flatnonzero(values > 0)
    if not len(below) or not len(above):
        return below[:0], below[:0]

    def partner(of: Ints, among: Ints) -> tuple[Ints, Ints]:
        distance, number = map(np.asarray, cKDTree(points[among]).query(points[of], distance_upper_bound=reach))
        found = np.isfinite(distance)
        return of[found], among[number[found]]

    (a, b), (d, c) = partner(below, above), partner(above, below)
    pairs = np.unique(np.stack([np.concatenate([a, c]), np.concatenate([b, d])], axis=1), axis=0)
    return pairs[:, 0], pairs[:, 1]


def _edge_zeros(cut: LevelCut, seeds: ClosestPoints, values: Floats) -> ClosestPoints:
    """Return the zeros on the edge, each once: along feet of lines that run past the edge."""
    low, high = _neighbours(seeds.points, values, SIGN_CHANGE_SPACINGS * cut.spacing)
    used, place = np.unique(np.concatenate([low, high]), return_inverse=True)
    if not len(used):
        return seeds.take(used)
    outward = outward_conormals(cut.surface, seeds.take(used), CUT_DIFFERENCE_SHARE * cut.size)
    past = 0.5 * PAST_EDGE_SPACINGS * cut.spacing * (outward[place[: len(low)]] + outward[place[len(low) :]])
    found = zeros_between(cut, seeds.points[low], seeds.points[high], values[low], values[high], FINE_ZERO_ROUNDS, past)
    found = found.take(found.edge >= 0)
    return found.take(spaced_apart(found.points, 0.1 * cut.spacing))


def spaced_apart(points: Floats, distance: float) -> Bools:
    """Return which points (n, d) to keep so that no two of them are nearer than ``distance``."""
    from scipy.spatial import cKDTree

    kept = np.ones(len(points), dtype=bool)
    if len(points):
        pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
        kept[pairs.max(axis=1)] = False
    return kept


def _no_crossing(cut: LevelCut, feet: ClosestPoints, values: Any) -> str:
    nearest = np.argmin(np.abs(values))
    place = (feet.points[nearest] + cut.phi.origin).tolist()
    what, kept = cut.phi.what, "above" if values[nearest] > 0 else "at or below"
    return (
        f"{what} does not change its sign on the manifold, which it has to cut: it stays {kept} zero and is nearest to "
        f"it, {values[nearest]:.3g}, near {place}; a cut that only touches is none, so change {what}."
    )
