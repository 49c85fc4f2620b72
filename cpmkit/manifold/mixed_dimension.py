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

    With ``spacing`` zero these are members that touch, up to rounding. The warning states the place of the nearest
    joint, and the consequence for a solution on a band.
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
            gap, point = _nearest_approach(members[lower], members[higher], within, touching)
            joints += [(gap, lower, higher, point)] if gap <= within else []
    if not joints:
        return []
    gap, lower, higher, point = min(joints, key=lambda joint: joint[:3])
    meets = "meet" if gap == 0 else f"come within {gap:.2g} of each other"
    more = f", as do {len(joints) - 1} more pairs" if len(joints) > 1 else ""
    dimensions = [largest_dim(members[number]) for number in (lower, higher)]
    words = [MANIFOLD_WORDS[-1 if dimension == surface.dim else dimension] for dimension in dimensions]
    return [
        f"Members {lower} ({words[0]}) and {higher} ({words[1]}) of the union {meets} near {place(point)}{more}: no "
        "law of the equation holds where parts of different dimension meet, and what flows from one to the other is "
        "decided by the spacing; the solution is right only if nothing flows there, and its error has no estimate; "
        "solve the parts separately: a curve with a value at its end, a surface without, or with it on a small circle."
    ]


def _nearest_approach(
    lower: ClosestPointSource, higher: ClosestPointSource, within: float, touching: float
) -> tuple[float, Floats]:
    """Return the distance between two members and the point (d,) of ``lower`` nearest to ``higher``.

    They are found by alternating projections from 64 of about 1000 starting points, which may miss a nearer place. A
    distance up to ``touching`` is 0. It is infinite, the point arbitrary, if boxes are 2 ``within`` apart on an axis.
    """
    boxes = np.array([lower.bounds, higher.bounds], dtype=np.float64)
    low, high = boxes[:, 0].max(axis=0) - within, boxes[:, 1].min(axis=0) + within
    if (low > high).any():
        return np.inf, low
    axes = np.linspace(low, high, round(1000 ** (1 / lower.dim))).T
    x = lower.closest_point(np.array([*product(*axes)])).points
    y = higher.closest_point(x).points
    nearest = np.argsort(norms(y - x))[:64]
    x, y = x[nearest], y[nearest]
    for _ in range(50):
        if norms(y - x).min() <= touching:
            return 0.0, x[norms(y - x).argmin()]
        x = lower.closest_point(y).points
        y = higher.closest_point(x).points
    gap = norms(y - x)
    return float(gap.min()), x[gap.argmin()]
