"""Warnings about places where members of different dimension in a union meet, and the equation is not well defined."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np

from cpmkit.errors import place
from cpmkit.manifold.abilities import members_of
from cpmkit.manifold.local_source import largest_dim
from cpmkit.manifold.source import MANIFOLD_WORDS, ClosestPointSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.types import Floats


def mixed_joint_warnings(surface: ClosestPointSource, spacing: float = 0.0) -> list[str]:
    """Return a list with a warning if members of a union, of different dimension, are within 4 spacings, else [].

    With ``spacing`` zero these are members that touch, up to rounding. The warning states the places of the nearest
    pair, and the consequence for a solution on a band.
    """
    members = members_of(surface)
    touching = 1e-6 * float(np.ptp(np.asarray(surface.bounds, dtype=np.float64), axis=0).max())
    # Near members read each other's nodes: between a sphere and a rod .1 to 3 spacings apart, with values 0 and 1, the
    # error was .04 to .4, and below 1e-3 from 4 spacings on.
    within = max(4 * spacing, touching)
    joints = []
    for pair in combinations(range(len(members)), 2):
        lower, higher = sorted(pair, key=lambda number: largest_dim(members[number]))
        if largest_dim(members[lower]) != largest_dim(members[higher]):
            gap, places = _approaches(members[lower], members[higher], within, touching)
            joints += [(gap, lower, higher, places)] if len(places) else []
    if not joints:
        return []
    gap, lower, higher, places = min(joints, key=lambda joint: joint[:3])
    near = " and ".join([*map(place, places[:3]), *([f"{len(places) - 3} more"] if len(places) > 3 else [])])
    meets = "meet" if gap == 0 else f"come within {gap:.2g} of each other"
    more = f", as do {len(joints) - 1} more pairs" if len(joints) > 1 else ""
    dimensions = [largest_dim(members[number]) for number in (lower, higher)]
    words = [MANIFOLD_WORDS[-1 if dimension == surface.dim else dimension] for dimension in dimensions]
    return [
        f"Members {lower} ({words[0]}) and {higher} ({words[1]}) of the union {meets} near {near}{more}: no "
        "law of the equation holds where parts of different dimension meet, and what flows from one to the other is "
        "decided by the spacing; the solution is right only if nothing flows there, and its error has no estimate; "
        "solve the parts separately: a curve with a value at the joint, at its end or at a boundary point, a surface "
        "without, or with it on a small circle."
    ]


def _approaches(
    lower: ClosestPointSource, higher: ClosestPointSource, within: float, touching: float
) -> tuple[float, Floats]:
    """Return the places (k, d) of ``lower`` where two members meet, or else come ``within`` a distance, and how near.

    The places, in a fixed order, at least ``within`` and 2 percent of the bounds apart, are found by alternating
    projections from up to 64 of about 1000 points, which may miss some. A distance up to ``touching`` is 0.
    """
    boxes = np.array([lower.bounds, higher.bounds], dtype=np.float64)
    low, high = boxes[:, 0].max(axis=0) - within, boxes[:, 1].min(axis=0) + within
    if (low > high).any():
        return np.inf, np.zeros((0, lower.dim))
    size = float(np.ptp(boxes, axis=(0, 1)).max())
    axes = np.linspace(low, high, round(1000 ** (1 / lower.dim))).T
    x = lower.closest_point(np.array([*product(*axes)])).points
    y = higher.closest_point(x).points
    starts = _distinct(x, norms(y - x), 0.01 * size)[:64]
    x, y = x[starts], y[starts]
    for _ in range(200):
        if norms(y - x).max() <= touching:
            break
        x = lower.closest_point(y).points
        y = higher.closest_point(x).points
    gap = np.where(norms(y - x) <= touching, 0.0, norms(y - x))
    x, gap = (each[gap <= (within if gap.min() > 0 else 0.0)] for each in (x, gap))
    chosen = _distinct(x, gap, max(within, 0.02 * size))
    x, gap = x[chosen], gap[chosen]
    return float(gap.max(initial=0.0)), x[np.lexsort(np.round(x / size, 6).T[::-1])]


def _distinct(points: Floats, distance: Floats, apart: float) -> list[int]:
    """Return the rows of ``points`` (n, d) by ascending ``distance`` (n,), without those less ``apart`` from others."""
    left, chosen = np.argsort(distance, kind="stable"), []
    while len(left):
        chosen.append(int(left[0]))
        left = left[norms(points[left] - points[left[0]]) > apart]
    return chosen
