"""Points of a cut: zeros of its function between neighbouring samples of the manifold with opposite signs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cpmkit.plugin import Bools, ClosestPoints, Floats, InputError, Ints, cell_levels, outward_conormals
from cpmkit_combinations.level_cut import CUT_DIFFERENCE_SHARE, LevelCut

#: Side, in samples, of the largest blocks that are discarded where the function is far from zero.
FILTER_BLOCK_SAMPLES = 4
#: Largest distance of neighbours with opposite signs, in spacings.
SIGN_CHANGE_SPACINGS = 2.5
#: Iterations of the search for a zero between two neighbours: for a rough zero, and one to rounding.
ROUGH_ZERO_ROUNDS, FINE_ZERO_ROUNDS = 3, 60
#: Above this share of the values at the neighbours, the value at a supposed zero shows a jump between two sheets.
JUMP_VALUE_SHARE = 0.25
#: Distance beyond the edge, in spacings, of points whose feet are on the edge.
PAST_EDGE_SPACINGS = 0.25


class Crossings(NamedTuple):
    """Points of the cut: ``inside`` lie in the interior, near the cut; ``at_edge`` on the edge, exactly on the cut."""

    inside: ClosestPoints
    at_edge: ClosestPoints


def find_crossings(cut: LevelCut) -> Crossings:
    """Return points of the cut, a few in each spacing, and its ends on the edge.

    On a curve the points are exact, and none counts as an end. Raise InputError if the function is not finite, does
    not change its sign on the manifold, or jumps over zero wherever it does.
    """
    seeds, values = sample_near_zero(cut)
    low, high = _opposite_neighbours(seeds.points, values, SIGN_CHANGE_SPACINGS * cut.spacing)
    if not len(low):
        raise InputError(_no_crossing_message(cut, seeds, values))
    points = cut.surface.manifold_dim == 1
    rounds = FINE_ZERO_ROUNDS if points else ROUGH_ZERO_ROUNDS
    inside = find_zeros(cut, seeds.points[low], seeds.points[high], values[low], values[high], rounds)
    if not len(inside):
        place = (seeds.points[low[0]] + cut.phi.origin).tolist()
        raise InputError(
            f"{cut.phi.label} jumps from {values[low[0]]:.3g} to {values[high[0]]:.3g} near {place} without a zero; it "
            "must be continuous where it cuts."
        )
    edge = np.flatnonzero(seeds.edge >= 0)
    if points or not len(edge):
        return Crossings(inside, inside.take(np.zeros(0, dtype=np.int64)))
    return Crossings(inside, _edge_zeros(cut, seeds.take(edge), values[edge]))


def sample_near_zero(cut: LevelCut) -> tuple[ClosestPoints, Floats]:
    """Return closest points that sample the manifold near the function's zeros, and the function's values (n,) there.

    Samples are a spacing apart. Blocks of space that the manifold does not meet, and blocks where the function's value
    exceeds its estimated variation over the block, are discarded. Raise InputError if none remains.
    """
    dim, spacing = cut.surface.dim, cut.spacing
    children = np.stack(np.meshgrid(*[np.arange(2)] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    side, blocks = next(level for level in cell_levels(cut.surface, spacing, 0.5) if level[0] <= FILTER_BLOCK_SAMPLES)
    while True:
        centres = np.asarray(((blocks + 0.5) * side - 0.5) * spacing, dtype=np.float64)
        diagonal = np.sqrt(dim) * side * spacing
        feet = cut.surface.closest_point(centres)
        values = cut.phi(feet.points)
        meets = feet.distance <= 0.5 * diagonal * (1 + CUT_DIFFERENCE_SHARE)
        meets |= (feet.distance <= diagonal) & ((feet.edge >= 0) | (side > 1))  # one more ring beside the edge
        variation = np.zeros(len(blocks))
        variation[meets] = cut.phi.variation(feet.points[meets], diagonal)
        selected = meets & (np.abs(values) <= variation)
        if not selected.any():
            raise InputError(_no_crossing_message(cut, feet, values))
        if side == 1:
            return feet.take(selected), values[selected]
        side //= 2
        blocks = (2 * blocks[selected][:, None] + children).reshape(-1, dim)


def find_zeros(
    cut: LevelCut, a: Floats, b: Floats, low: Floats, high: Floats, rounds: int, past: Floats | None = None
) -> ClosestPoints:
    """Return zeros on the manifold between points a and b (n, d), with values ``low`` <= 0 < ``high`` there (n,).

    The path from a to b consists of the feet of the straight line, moved by ``past`` (n, d) if it is given; ``rounds``
    is the largest number of iterations. Paths that jump from one sheet to another without a zero have no row.
    """
    offset = np.zeros_like(a) if past is None else past

    def value(share: Floats, rows: Ints) -> Floats:
        line = a[rows] + share[:, None] * (b[rows] - a[rows]) + offset[rows]
        return cut.phi(cut.surface.closest_point(line).points)

    share = find_bracketed_zeros(value, low, high, rounds)
    feet = cut.surface.closest_point(a + share[:, None] * (b - a) + offset)
    return feet.take(
        np.abs(cut.phi(feet.points)) <= JUMP_VALUE_SHARE * np.minimum(-low, high) + CUT_DIFFERENCE_SHARE * (high - low)
    )


def find_bracketed_zeros(function: Callable[[Floats, Ints], Floats], low: Floats, high: Floats, rounds: int) -> Floats:
    """Return zeros (n,) in [0, 1] of n functions with values ``low`` <= 0 at 0 and ``high`` > 0 at 1, both (n,).

    ``function`` takes positions (k,) and the numbers (k,) of the functions, and returns their values (k,). Regula falsi
    with Illinois weights, in ``rounds`` iterations at most; every fourth one bisects the bracket.
    """
    left, right = np.zeros(len(low)), np.ones(len(low))
    at_left, at_right, share = low.copy(), high.copy(), np.zeros(len(low))
    rows = np.arange(len(low))
    for k in range(rounds):
        a, b, fa, fb = left[rows], right[rows], at_left[rows], at_right[rows]
        s = 0.5 * (a + b) if k % 4 == 3 else np.clip((a * fb - b * fa) / (fb - fa), a, b)
        value = function(s, rows)
        below = value <= 0
        left[rows], right[rows] = np.where(below, s, a), np.where(below, b, s)
        at_left[rows], at_right[rows] = np.where(below, value, 0.5 * fa), np.where(below, 0.5 * fb, value)
        share[rows] = s
        rows = rows[(value != 0) & (right[rows] - left[rows] > 1e-15) & (s != a) & (s != b)]
        if not len(rows):
            break
    return share


def _opposite_neighbours(points: Floats, values: Floats, reach: float) -> tuple[Ints, Ints]:
    """Return rows (k,) and (k,) of pairs of ``points`` (n, d) with ``values`` <= 0 and > 0 within ``reach``.

    Each point is paired with the nearest point of opposite sign, if that is within ``reach``; no pair occurs twice.
    """
    from scipy.spatial import cKDTree

    below, above = np.flatnonzero(values <= 0), np.flatnonzero(values > 0)
    if not len(below) or not len(above):
        return below[:0], below[:0]

    def partner(of: Ints, among: Ints) -> tuple[Ints, Ints]:
        distance, number = map(np.asarray, cKDTree(points[among]).query(points[of], distance_upper_bound=reach))
        within_reach = np.isfinite(distance)
        return of[within_reach], among[number[within_reach]]

    (a, b), (d, c) = partner(below, above), partner(above, below)
    pairs = np.unique(np.stack([np.concatenate([a, c]), np.concatenate([b, d])], axis=1), axis=0)
    return pairs[:, 0], pairs[:, 1]


def _edge_zeros(cut: LevelCut, seeds: ClosestPoints, values: Floats) -> ClosestPoints:
    """Return the zeros on the manifold's edge, each once, between ``seeds`` on it with function ``values`` (n,)."""
    low, high = _opposite_neighbours(seeds.points, values, SIGN_CHANGE_SPACINGS * cut.spacing)
    used, place = np.unique(np.concatenate([low, high]), return_inverse=True)
    if not len(used):
        return seeds.take(used)
    outward = outward_conormals(cut.surface, seeds.take(used), CUT_DIFFERENCE_SHARE * cut.size)
    past = 0.5 * PAST_EDGE_SPACINGS * cut.spacing * (outward[place[: len(low)]] + outward[place[len(low) :]])
    zeros = find_zeros(cut, seeds.points[low], seeds.points[high], values[low], values[high], FINE_ZERO_ROUNDS, past)
    zeros = zeros.take(zeros.edge >= 0)
    return zeros.take(select_apart(zeros.points, 0.1 * cut.spacing))


def select_apart(points: Floats, distance: float) -> Bools:
    """Return a mask (n,) of ``points`` (n, d): of each pair nearer than ``distance`` the later point is left out."""
    from scipy.spatial import cKDTree

    selected = np.ones(len(points), dtype=bool)
    if len(points):
        pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
        selected[pairs.max(axis=1)] = False
    return selected


def _no_crossing_message(cut: LevelCut, feet: ClosestPoints, values: Any) -> str:
    """Return the error sentence for a function of one sign, with the one of its ``values`` (n,) nearest to zero."""
    nearest = np.argmin(np.abs(values))
    place = (feet.points[nearest] + cut.phi.origin).tolist()
    label, side = cut.phi.label, "above" if values[nearest] > 0 else "at or below"
    return (
        f"{label} does not change its sign on the manifold, as a cut requires: it stays {side} zero and is nearest to "
        f"it, {values[nearest]:.3g}, near {place}; touching zero is no cut, so change {label}."
    )
