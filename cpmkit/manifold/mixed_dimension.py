"""Joints: places where members of different dimension in a union meet, and the equation is not well defined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.errors import place
from cpmkit.manifold.abilities import HasMembers
from cpmkit.manifold.source import MANIFOLD_WORDS, ClosestPointSource
from cpmkit.manifold.vector_algebra import norms
from cpmkit.types import Floats

#: Members nearer than this many spacings read each other's nodes: between a sphere and a rod .1 to 3 spacings apart,
#: with values 0 and 1, the error was .04 to .4, and below 1e-3 from 4 spacings on.
JOINED_SPACINGS = 4.0
#: Members nearer than this share of the union's size touch, whatever the spacing.
TOUCHING_SIZE_SHARE = 1e-6
#: Alternating projections: number of starting points on one member, of the nearest of them that are iterated, and of
#: iterations.
START_POINTS, ITERATED_POINTS, PROJECTION_ROUNDS = 1000, 64, 50


@dataclass(frozen=True, eq=False)
class MixedJoint:
    """The place where two members of different dimension are nearest to each other.

    Attributes
    ----------
    first, second : int
        Numbers of the members, the member of lower dimension first.
    dimensions : (int, int)
        Dimensions of the members; that of a solid is the space's.
    gap : float
        Distance between them; 0 where one lies in or on the other.
    point : (d,) float64
        The nearest point of the first member.
    """

    first: int
    second: int
    dimensions: tuple[int, int]
    gap: float
    point: Floats


def mixed_joints(surface: ClosestPointSource, within: float) -> list[MixedJoint]:
    """Return the joints of all pairs of members of different dimension that are at most ``within`` apart."""
    if not isinstance(surface, HasMembers):
        return []
    members, touching = _single_members(surface), _touching_distance(surface)
    joints = []
    for pair in combinations(range(len(members)), 2):
        lower, higher = sorted(pair, key=lambda number: _dimension(members[number]))
        if _dimension(members[lower]) == _dimension(members[higher]):
            continue
        gap, point = _nearest_approach(members[lower], members[higher], within, touching)
        if gap <= within:
            dimensions = _dimension(members[lower]), _dimension(members[higher])
            joints.append(MixedJoint(lower, higher, dimensions, gap, point))
    return joints


def touching_joints(surface: ClosestPointSource) -> list[MixedJoint]:
    """Return the joints of all pairs of members of different dimension that touch, up to rounding."""
    return mixed_joints(surface, _touching_distance(surface))


def mixed_joint_warnings(surface: ClosestPointSource, spacing: float) -> list[str]:
    """Return a warning, in a list, if members of different dimension are too near for this spacing; else []."""
    joints = mixed_joints(surface, JOINED_SPACINGS * spacing)
    return [joints_warning(surface, joints)] if joints else []


def joints_warning(surface: ClosestPointSource, joints: Sequence[MixedJoint]) -> str:
    """Return the warning about ``joints``: the place of the nearest joint, and the consequence for a solution."""
    joint = min(joints, key=lambda joint: (joint.gap, joint.first, joint.second))
    meets = "meet" if joint.gap == 0 else f"come within {joint.gap:.2g} of each other"
    more = f", as do {len(joints) - 1} more pairs" if len(joints) > 1 else ""
    words = [MANIFOLD_WORDS[-1 if dimension == surface.dim else dimension] for dimension in joint.dimensions]
    return (
        f"Members {joint.first} ({words[0]}) and {joint.second} ({words[1]}) of the union {meets} near "
        f"{place(joint.point)}{more}: no law of the equation holds where parts of different dimension meet, and what "
        "flows from one to the other is decided by the spacing; the solution is right only if nothing flows there, and "
        "its error has no estimate; solve the parts apart, each with a condition at the joint."
    )


def _touching_distance(surface: ClosestPointSource) -> float:
    """Return the distance below which members count as touching: a share of the union's size."""
    return TOUCHING_SIZE_SHARE * float(np.ptp(np.asarray(surface.bounds, dtype=np.float64), axis=0).max())


def _single_members(surface: ClosestPointSource) -> list[ClosestPointSource]:
    """Return the members of a union, with those of nested unions, or the source alone."""
    if not isinstance(surface, HasMembers):
        return [surface]
    return [single for member in surface.members for single in _single_members(member)]


def _dimension(member: ClosestPointSource) -> int:
    """Return the dimension of a member, that of the space where the member has none."""
    return member.dim if member.manifold_dim is None else member.manifold_dim


def _nearest_approach(
    lower: ClosestPointSource, higher: ClosestPointSource, within: float, touching: float
) -> tuple[float, Floats]:
    """Return the distance between two members and the point (d,) of ``lower`` nearest to ``higher``.

    They are found by alternating projections. The distance is 0 where it is at most ``touching``, infinite where the
    bounding boxes are farther apart than ``within``.
    """
    boxes = np.array([lower.bounds, higher.bounds], dtype=np.float64)
    low, high = boxes[:, 0].max(axis=0) - within, boxes[:, 1].min(axis=0) + within
    if (low > high).any():
        return np.inf, low
    count = round(START_POINTS ** (1 / lower.dim))
    axes = np.linspace(low, high, count).T
    x = lower.closest_point(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, lower.dim)).points
    y = higher.closest_point(x).points
    nearest = np.argsort(norms(y - x))[:ITERATED_POINTS]
    x, y = x[nearest], y[nearest]
    for _ in range(PROJECTION_ROUNDS):
        if norms(y - x).min() <= touching:
            return 0.0, x[norms(y - x).argmin()]
        x = lower.closest_point(y).points
        y = higher.closest_point(x).points
    gap = norms(y - x)
    return float(gap.min()), x[gap.argmin()]
