"""Branches of a manifold of curves: points at which three arms or more meet."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cpmkit.grid.band import Band
from cpmkit.manifold.localized import Localized
from cpmkit.protocols import Floats

#: Members are looked at where feet of neighbouring nodes on them are within this many spacings.
NEAR = 3.0
#: So often points go to the nearest of the one member and of the other in turn; they end where these meet.
TURNS = 40
#: Members nearer than this many spacings meet.
MEETING = 1e-2
#: Queries so many spacings around a point tell whether a member ends there.
AROUND = 0.05


@dataclass(frozen=True, eq=False)
class Junction:
    """A point, (d,) relative to the lattice's origin, at which ``arms`` curves meet."""

    point: Floats
    arms: int


def junctions(surface: Localized, band: Band) -> list[Junction]:
    """Return the branches of a union of curves; nothing is asked for where it is none."""
    members = surface.members
    if len(members) < 2 or surface.manifold_dim != 1 or band.feet.element is None:
        return []
    one, other = band.neighbours()
    element, points = band.feet.element, band.feet.points
    near = np.linalg.norm(points[one] - points[other], axis=1) < NEAR * band.spacing
    meetings: list[Floats] = []
    for first, second in combinations(range(len(members)), 2):
        beside = near & (np.minimum(element[one], element[other]) == first)
        beside &= np.maximum(element[one], element[other]) == second
        if beside.any():
            meetings += _meetings(members[first], members[second], points[one[beside]], band.spacing)
    found: list[Junction] = []
    for point in meetings:
        if all(np.linalg.norm(point - known.point) > AROUND * band.spacing for known in found):
            arms = sum(_arms(member, point, band.spacing) for member in members)
            found.append(Junction(point, arms))
    return [one for one in found if one.arms > 2]


def _meetings(first: Localized, second: Localized, start: Floats, spacing: float) -> list[Floats]:
    """Return points (d,) common to two curves, reached from ``start`` (k, d), a spacing apart or more."""
    start = start[np.unique(np.round(start / spacing).astype(np.int64), axis=0, return_index=True)[1]]
    there = start
    for _ in range(TURNS):
        here = first.closest_point(there).points
        there = second.closest_point(here).points
    here = here[np.linalg.norm(here - there, axis=1) < MEETING * spacing]
    return list(here[np.unique(np.round(here / spacing).astype(np.int64), axis=0, return_index=True)[1]])


def _arms(member: Localized, point: Floats, spacing: float) -> int:
    """Return how many arms of a curve leave a point: 0 where it is not on it, 1 at its ends, 2 elsewhere."""
    if member.closest_point(point[None]).distance[0] > 2 * MEETING * spacing:
        return 0
    shifts = AROUND * spacing * np.concatenate([np.eye(len(point)), -np.eye(len(point))])
    return 1 if (member.closest_point(point + shifts).edge >= 0).any() else 2
