"""Warnings about members of different dimension in a union: near misses, and places where no law holds."""

from __future__ import annotations

from cpmkit.errors import place
from cpmkit.manifold.abilities import members_of
from cpmkit.manifold.local_source import largest_dim
from cpmkit.manifold.meetings import approaches, meetings_of, pairs_of_dimensions, touching_distance
from cpmkit.manifold.source import MANIFOLD_WORDS, ClosestPointSource


def near_miss_warnings(surface: ClosestPointSource, spacing: float) -> tuple[str, ...]:
    """Return a warning if members of different dimension come within a ``spacing`` and do not meet, else ()."""
    members, meeting = members_of(surface), {(each.lower, each.higher) for each in meetings_of(surface)}
    for lower, higher in pairs_of_dimensions(members):
        if (lower, higher) not in meeting:
            gap, places = approaches(members[lower], members[higher], spacing, touching_distance(surface))
            if len(places):
                return (
                    f"Members {lower} and {higher} of the union come within {gap:.2g} of each other near "
                    f"{place(places[0])} and do not touch: nothing flows between them; let them touch if it should.",
                )
    return ()


def mixed_joint_warnings(surface: ClosestPointSource, spacing: float = 0.0) -> list[str]:
    """Return a list with a warning if members of a union, of different dimension, are within 4 spacings, else [].

    If ``spacing`` is zero, only members that touch, up to rounding, count. The warning states the places of the nearest
    pair, and the consequence for a solution on a band.
    """
    members, touching = members_of(surface), touching_distance(surface)
    # Near members read each other's nodes: between a sphere and a rod .1 to 3 spacings apart, with values 0 and 1, the
    # error was .04 to .4, and below 1e-3 from 4 spacings on.
    within = max(4 * spacing, touching)
    joints = []
    for lower, higher in pairs_of_dimensions(members):
        gap, places = approaches(members[lower], members[higher], within, touching)
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
