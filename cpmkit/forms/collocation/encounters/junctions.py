"""Branches of a manifold of curves: points at which three arms or more meet."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.grid.band import Band
from cpmkit.manifold.local_source import LocalSource
from cpmkit.protocols import Floats

#: Members are looked at where feet of neighbouring nodes on them are within this many spacings.
MEMBER_SEARCH_SPACINGS = 3.0
#: Number of alternating projections on the two members; they converge to where these meet.
ALTERNATING_PROJECTIONS = 40
#: Members nearer than this many spacings meet.
MEETING_MEMBERS_SPACINGS = 1e-2
#: Queries so many spacings around a point tell whether a member ends there.
MEMBER_PROBE_SPACINGS = 0.05


@dataclass(frozen=True, eq=False)
class Junction:
    """A point, (d,) relative to the lattice's origin, at which ``arms`` curves meet."""

    point: Floats
    arms: int


def find_junctions(surface: LocalSource, band: Band) -> list[Junction]:
    """Return the branches of a union of curves; nothing is asked for where it is none."""
    members = surface.members
    if len(members) < 2 or surface.manifold_dim != 1 or band.feet.element is None:
        return []
    one, other = band.neighbours()
    element, points = band.feet.element, band.feet.points
    near = np.linalg.norm(points[one] - points[other], axis=1) < MEMBER_SEARCH_SPACINGS * band.spacing
    meetings: list[Floats] = []
    for first, second in combinations(range(len(members)), 2):
        beside = near & (np.minimum(element[one], element[other]) == first)
        beside &= np.maximum(element[one], element[other]) == second
        if beside.any():
            meetings += _common_points(members[first], members[second], points[one[beside]], band.spacing)
    found: list[Junction] = []
    for point in meetings:
        if all(np.linalg.norm(point - known.point) > MEMBER_PROBE_SPACINGS * band.spacing for known in found):
            arms = sum(_arms_at(member, point, band.spacing) for member in members)
            found.append(Junction(point, arms))
    return [one for one in found if one.arms > 2]


def _common_points(first: LocalSource, second: LocalSource, start: Floats, spacing: float) -> list[Floats]:
    """Return points (d,) common to two curves, reached from ``start`` (k, d), a spacing apart or more."""
    start = start[np.unique(np.round(start / spacing).astype(np.int64), axis=0, return_index=True)[1]]
    on_second = start
    for _ in range(ALTERNATING_PROJECTIONS):
        on_first = first.closest_point(on_second).points
        on_second = second.closest_point(on_first).points
    on_first = on_first[np.linalg.norm(on_first - on_second, axis=1) < MEETING_MEMBERS_SPACINGS * spacing]
    return list(on_first[np.unique(np.round(on_first / spacing).astype(np.int64), axis=0, return_index=True)[1]])


def _arms_at(member: LocalSource, point: Floats, spacing: float) -> int:
    """Return how many arms of a curve leave a point: 0 where it is not on it, 1 at its ends, 2 elsewhere."""
    if member.closest_point(point[None]).distance[0] > 2 * MEETING_MEMBERS_SPACINGS * spacing:
        return 0
    shifts = MEMBER_PROBE_SPACINGS * spacing * np.concatenate([np.eye(len(point)), -np.eye(len(point))])
    return 1 if (member.closest_point(point + shifts).edge >= 0).any() else 2
