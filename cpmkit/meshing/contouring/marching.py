"""Where rays first meet a surface, by closest points: Newton's steps where they hold, else empty spheres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import dots, norms, unit
from cpmkit.protocols import Bools, Floats, Ints

#: From this distance on, in lengths of the ray, the plane of the foot tells whether the ray meets the surface near by.
ARRIVED = 0.02
#: Rays that meet the surface at a sine below this graze it: such crossings are dropped.
GRAZING = 0.02
#: A Newton step holds if the normals' cosine is above this and the distance falls to this share.
SAME_SHEET_COSINE, FALLS_TO = 0.7, 0.5
#: Beside a sheet that runs along the ray, steps of this share of its length at least.
SHORTEST_STEP = 0.06
#: That is so far along the ray, as a share; where a ray's end tells it, nothing else does.
TOLD_BY_NODE = 0.05
#: Rounds of queries.
MOST_ROUNDS = 40
#: In units of the noise of feet: how far from its foot a place must be for the direction to be known; how far places
#: are moved off the surface to ask for it, at least this share of the length; the distance of arrival, at least.
KNOWN_NOISES, BESIDE_NOISES, BESIDE_SHARE, ARRIVED_NOISES = 20.0, 30.0, 0.1, 5.0
#: Nearer to the surface than this share of such a step it led along the surface.
WELL_BESIDE = 0.6


def arrival(source: LocalSource, length: float) -> tuple[float, float]:
    """Return ``ARRIVED`` and ``TOLD_BY_NODE`` on rays of this length, larger where feet are noisy."""
    factor = max(1.0, ARRIVED_NOISES * source.noise / (ARRIVED * length))
    return ARRIVED * factor, TOLD_BY_NODE * factor


@dataclass(frozen=True, eq=False)
class Seen:
    """What is known at points: the distance (n,), the direction from the foot (n, 3), and whether that is interior."""

    distance: Floats
    normal: Floats
    inner: Bools

    def take(self, rows: Bools | Ints) -> Seen:
        """Return the records at ``rows``."""
        return Seen(self.distance[rows], self.normal[rows], self.inner[rows])

    def put(self, rows: Bools, new: Seen) -> None:
        """Replace the records at ``rows``."""
        self.distance[rows], self.normal[rows], self.inner[rows] = new.distance, new.normal, new.inner


def look(source: LocalSource, x: Floats, known: Floats, length: float) -> Seen:
    """Return what is seen from ``x`` (n, 3); on the surface itself the normal is the one ``known`` (n, 3) before."""
    answer = source.closest_point(x)
    away = x - answer.points
    distance = norms(away)
    normal = np.where(distance[:, None] > max(1e-7 * length, KNOWN_NOISES * source.noise), unit(away), known)
    return Seen(distance, normal, answer.edge < 0)


def feet_and_normals(source: LocalSource, x: Floats, known: Floats, length: float) -> tuple[Floats, Floats]:
    """Return feet of places ``x`` (n, 3) near the surface and unit normals there, both asked from beside it.

    Along the normals ``known`` (n, 3), which may be wrong; where that leads along the surface, along the axis that
    leads farthest away from it.
    """
    step = max(BESIDE_NOISES * source.noise, BESIDE_SHARE * length)
    beside = x + step * known
    feet = source.closest_point(beside).points
    rows = np.flatnonzero(norms(beside - feet) < WELL_BESIDE * step)
    others = x[rows] + step * np.eye(3)[:, None]
    of_others = source.closest_point(others.reshape(-1, 3)).points.reshape(3, -1, 3)
    farthest = norms(others - of_others).argmax(axis=0), np.arange(len(rows))
    beside[rows], feet[rows] = others[farthest], of_others[farthest]
    return feet, unit(beside - feet)


def first_hits(
    source: LocalSource, start: Floats, along: Floats, length: float, seen: Seen, stop: Floats, steps: bool = True
) -> tuple[Floats, Floats]:
    """Return how far from ``start`` each ray meets the surface, (n,), NaN where it does not, and the normal there.

    The normal points back.

    Parameters
    ----------
    start, along : (n, 3) float64
        Where the rays start, and their unit directions.
    length : float
        That shares of a ray refer to.
    seen : Seen
        What is seen from the starts.
    stop : (n,) float64
        Where the rays end.
    steps : bool
        Whether Newton's steps are tried, which may pass a sheet where two cross.
    """
    hit, normal = np.full(len(start), np.nan), np.zeros_like(start)
    rows = np.arange(len(start))
    low = np.zeros(len(start))  # nothing is met before
    t, base_t, newton = np.zeros(len(start)), np.zeros(len(start)), np.ones(len(start), dtype=bool)
    now, base = seen.take(rows), seen.take(rows)
    arrived_at, reported_at = arrival(source, length)
    told = seen.inner & (seen.distance < arrived_at * length)
    floor = np.zeros(len(start))
    for _ in range(MOST_ROUNDS):
        slope = dots(now.normal, along[rows])
        steep = np.abs(slope) >= GRAZING
        with np.errstate(all="ignore"):
            target = np.where(steep, t - now.distance / slope, np.nan)
        near = now.inner & (now.distance < arrived_at * length) & (np.abs(target - t) <= reported_at * length)
        arrived = near & (target >= np.maximum(low - arrived_at * length, floor[rows])) & (target <= stop[rows])
        hit[rows[arrived]], normal[rows[arrived]] = target[arrived], now.normal[arrived]
        normal[rows[arrived]] *= -np.sign(slope[arrived])[:, None]
        tried = steps & newton & (target > low) & (target <= stop[rows]) & now.inner
        sphere = base_t + np.maximum(base.distance, SHORTEST_STEP * length)
        t_next = np.where(tried, target, sphere)
        go = ~arrived & (t_next <= stop[rows])
        if not go.any():
            break
        floor[told] = reported_at * length  # what is nearer was told at the start
        rows, low, t, base_t, newton = rows[go], low[go], t[go], base_t[go], newton[go]
        now, base, tried, t_next = now.take(go), base.take(go), tried[go], t_next[go]
        new = look(source, start[rows] + t_next[:, None] * along[rows], now.normal, length)
        same = np.abs(dots(new.normal, now.normal)) > SAME_SHEET_COSINE
        held = tried & same & (new.distance <= FALLS_TO * now.distance)
        moved = held | ~tried
        stepped = ~tried
        low = np.where(stepped, np.maximum(low, base_t + base.distance), low)
        t, base_t = np.where(moved, t_next, t), np.where(stepped, t_next, base_t)
        newton = moved
        now.put(moved, new.take(moved))
        base.put(stepped, new.take(stepped))
    return hit, normal
