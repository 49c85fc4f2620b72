"""Polylines that follow curves closely: from the mesh that a curve has of itself, or traced by closest points."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np

from cpmkit.grid.blocks import cell_levels
from cpmkit.manifold.abilities import HasMesh
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vector_algebra import norms, unit
from cpmkit.mesh.mixed_cells import Polyline, chain_segments
from cpmkit.meshing.insertion.surface_matching import TriangleSearch
from cpmkit.types import Floats, Ints

#: A step of a trace that moves by less than this share of a full step does not count.
LEAST_STEP = 0.5
#: After a corner a curve continues where it is farther than this share of a step from its part before the corner.
LEAST_TURN = 0.2
#: Number of last points of a trace that do not count as met again: the trace turned there.
RECENT_POINTS = 8
#: Largest number of steps of one trace.
MAX_STEPS = 100_000


def in_three_dimensions(points: Floats) -> Floats:
    """Return ``points`` (n, 2 or 3) as (n, 3), with a third coordinate of zero for points of the plane."""
    return points if points.shape[1] == 3 else np.hstack([points, np.zeros((len(points), 1))])


def polylines_of_source(source: LocalSource, length: float) -> list[Polyline] | None:
    """Return polylines from the curve's own mesh at the resolution ``length``, refined; None without such a mesh."""
    if not isinstance(source.source, HasMesh):
        return None
    vertices, cells = source.source.mesh(length)
    if cells.shape[1] != 2:
        return None
    vertices = np.asarray(vertices, dtype=np.float64) - source.shift
    return [refine_polyline(source, line, length) for line in chain_segments(vertices, cells)]


def refine_polyline(source: LocalSource, line: Polyline, length: float) -> Polyline:
    """Return a polyline with chords halved at points of the curve until their middles are within .002 ``length`` of it.

    A closest point farther than .3 chords from the middle lies on another branch, and does not count.
    """
    points = np.concatenate([line.points, line.points[:1]]) if line.closed else line.points
    fresh = np.ones(len(points) - 1, dtype=bool)
    for _ in range(12):  # a limit: chords are halved so often
        rows = np.flatnonzero(fresh)
        if not len(rows):
            break
        chord = norms(points[rows + 1] - points[rows])
        middle = 0.5 * (points[rows] + points[rows + 1])
        closest = source.closest_point(middle).points
        off = norms(closest - middle)
        split = (off > 2e-3 * length) & (off < 0.3 * chord)
        points = np.insert(points, rows[split] + 1, closest[split], axis=0)
        halved = np.zeros(len(fresh), dtype=bool)
        halved[rows[split]] = True
        fresh = np.repeat(halved, np.where(halved, 2, 1))
    return Polyline(points[:-1] if line.closed else points, line.closed)


def simplify_polyline(points: Floats, tolerance: Floats) -> Ints:
    """Return the rows (k,) of ``points`` (n, d) whose polyline is within the ``tolerance`` (n,) of every point.

    Douglas and Peucker (1973).
    """
    used = np.zeros(len(points), dtype=bool)
    used[[0, -1]] = True
    waiting = [(0, len(points) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        inner = points[first + 1 : last] - points[first]
        chord = points[last] - points[first]
        square = float(chord @ chord)
        share = np.minimum(np.maximum(inner @ chord / square, 0.0), 1.0) if square > 0 else np.zeros(len(inner))
        excess = norms(inner - share[:, None] * chord) / tolerance[first + 1 : last]
        worst = first + 1 + int(excess.argmax())
        if excess[worst - first - 1] > 1:
            used[worst] = True
            waiting += [(first, worst), (worst, last)]
    return np.flatnonzero(used)


def trace_polylines(source: LocalSource, search: TriangleSearch, spacing: float) -> list[Polyline]:
    """Return polylines on all pieces of a curve that is known by closest points alone.

    Traces start at the closest points of cells of half a spacing that the curve may meet, and continue in steps of .15
    L, where L is the local edge length of the triangles of ``search``. Where no step ahead leads on, the curve is
    searched in all directions, so that traces go around corners. They end where no new point is found, or at a curve
    that was traced already.
    """
    cells = next(blocks for side, blocks in cell_levels(source, 0.5 * spacing, 0.5) if side == 1)
    seeds = source.closest_point(np.asarray(cells * (0.5 * spacing), dtype=np.float64)).points
    size = float(np.median(search.local_size(in_three_dimensions(seeds))))
    tracer = CurveTracer(source, 0.15 * size)
    lines = []
    while len(seeds):
        line = tracer.trace_through(seeds[0])
        seeds = seeds[1:]
        if line is not None:
            lines.append(refine_polyline(source, line, size))
            seeds = seeds[tracer.distances(seeds) > tracer.step]
    return lines


@dataclass(eq=False)
class CurveTracer:
    """Traces the pieces of a curve by closest points.

    Attributes
    ----------
    source : LocalSource
    step : float
        The length of a step.
    count : int
        The number of points traced so far.
    """

    source: LocalSource
    step: float
    count: int = 0
    _points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    _directions: Floats = field(default_factory=lambda: np.empty((0, 3)))

    def distances(self, points: Floats) -> Floats:
        """Return the distances (n,) of ``points`` (n, d) from the nearest point traced so far."""
        from scipy.spatial import cKDTree

        distance, _ = cKDTree(self._points[: self.count]).query(points)
        return np.asarray(distance)

    def trace_through(self, seed: Floats) -> Polyline | None:
        """Return the piece of the curve through ``seed`` (d,), traced in both directions; None if it has no extent."""
        ahead = self._points_around(seed)
        ahead = ahead[norms(ahead - seed) > LEAST_STEP * self.step]
        if not len(ahead):
            return None
        points, closed = self._trace_on([seed, ahead[0]])
        if not closed:
            back = ahead[(unit(ahead - seed) @ unit(ahead[:1] - seed)[0]) < -LEAST_TURN]
            if len(back):
                rest, _ = self._trace_on([points[0], back[0]], backward=True)
                points = rest[:0:-1] + points
        line = np.array(points)
        if self.source.has_tangents and len(line) > 1:
            middle = len(line) // 2
            tangent = self.source.tangents(self.source.closest_point(line[middle : middle + 1]))[0]
            line = line[::-1] if tangent @ (line[middle] - line[middle - 1]) < 0 else line
        return Polyline(line, closed) if len(line) > 1 else None

    def _trace_on(self, points: list[Floats], backward: bool = False) -> tuple[list[Floats], bool]:
        """Return the points of the trace continued from two ``points``, and whether it came back to the first.

        A ``backward`` trace starts at a point traced already.
        """
        first = self.count
        direction = unit((points[1] - points[0])[None])[0]
        for point in points[backward:]:
            self._record(point, direction)
        while len(points) < MAX_STEPS:
            heading = unit((points[-1] - points[-2])[None])[0]
            ahead = self.source.closest_point((points[-1] + self.step * heading)[None]).points[0]
            turned = not self._leads_on(points[-1], ahead, heading)
            if turned:
                corner = self._end_ahead(points[-1], heading)
                if np.linalg.norm(corner - points[-1]) > 1e-3 * self.step:
                    points.append(corner)
                    self._record(corner, heading)
                after_corner = self._turn(points)
                if after_corner is None:
                    return points, False
                ahead = after_corner
            direction = unit((ahead - points[-1])[None])[0]
            met = self._met_point(ahead, direction, turned)
            if met is not None:
                if 0 <= met - first < RECENT_POINTS and not backward:
                    return points[met - first :], True
                points.append(self._points[met])
                return points, False
            points.append(ahead)
            self._record(ahead, direction)
        return points, False

    def _record(self, point: Floats, direction: Floats) -> None:
        """Append a point (d,) of the trace and its direction (d,)."""
        if self.count == len(self._points):
            room = np.empty((max(256, self.count), len(point)))
            self._points = np.concatenate([self._points.reshape(-1, len(point)), room])
            self._directions = np.concatenate([self._directions.reshape(-1, len(point)), room])
        self._points[self.count], self._directions[self.count] = point, direction
        self.count += 1

    def _leads_on(self, here: Floats, ahead: Floats, heading: Floats) -> bool:
        """Return whether the step from ``here`` to the closest point ``ahead`` is long and follows ``heading``."""
        way = ahead - here
        length = float(np.linalg.norm(way))
        return length > LEAST_STEP * self.step and float(way @ heading) > 0.7 * length

    def _end_ahead(self, here: Floats, heading: Floats) -> Floats:
        """Return the end or corner (d,) of the curve ahead of ``here`` along ``heading``; ``here`` if there is none."""
        target = here + np.array([0.5, 1.0, 2.0])[:, None] * self.step * heading
        closest = self._closest_near(here, target)
        return closest[np.argmax((closest - here) @ heading)] if len(closest) else here

    def _points_around(self, here: Floats) -> Floats:
        """Return points (k, d) of the curve about a step away from ``here``, in all directions, the farthest first."""
        directions = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=self.source.dim) if any(d)])
        closest = self._closest_near(here, here + self.step * unit(directions))
        return closest[np.argsort(-norms(closest - here), kind="stable")]

    def _closest_near(self, here: Floats, targets: Floats) -> Floats:
        """Return the closest points (n, d) of ``targets`` (k, d) that are within one and a half steps of ``here``."""
        closest = self.source.closest_point(targets).points
        return closest[norms(closest - here) < 1.5 * self.step]

    def _turn(self, points: list[Floats]) -> Floats | None:
        """Return the point (d,) where the curve continues from a corner, as straight as possible; None at its end."""
        here = points[-1]
        ahead = self._points_around(here)
        ahead = ahead[norms(ahead - here) > LEAST_STEP * self.step]
        way = points[-2] - here
        behind = np.clip((ahead - here) @ way / (way @ way), 0.0, None)
        ahead = ahead[norms(ahead - here - behind[:, None] * way) > LEAST_TURN * self.step]
        return ahead[np.argmin(unit(ahead - here) @ unit(way[None])[0])] if len(ahead) else None

    def _met_point(self, place: Floats, direction: Floats, turned: bool) -> int | None:
        """Return the number of the traced point that a step to ``place`` meets, None if there is none.

        The trace must have the step's ``direction`` there, unless the step follows a corner (``turned``).
        """
        old = self.count - RECENT_POINTS
        if old <= 0:
            return None
        gap = norms(self._points[:old] - place)
        is_along = np.abs(self._directions[:old] @ direction) > 0.8
        is_met = (gap < 0.7 * self.step) & (is_along | turned)
        return int(np.argmin(np.where(is_met, gap, np.inf))) if is_met.any() else None
