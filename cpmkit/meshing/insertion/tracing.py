"""Curves that are known by closest points alone, followed step by step."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np

from cpmkit.grid.band import cell_levels
from cpmkit.manifold.local_source import LocalSource
from cpmkit.manifold.vectors import norms, unit
from cpmkit.mesh.mixed_cells import Polyline
from cpmkit.meshing.insertion.feet import Triangles
from cpmkit.meshing.insertion.polylines import followed
from cpmkit.protocols import Floats

#: The step, in L.
STEP_SHARE = 0.15
#: A step ahead is taken if it is of this share of a step at least, and this far along its heading.
LEAST_STEP, LEAST_AHEAD_COSINE = 0.5, 0.7
#: After a corner a curve goes on where it is farther than this share of a step from where it came.
LEAST_TURN = 0.2
#: Nearer than this share of a step to what was traced already, and along it, it is the same curve.
MET_SHARE, ALONG_COSINE = 0.7, 0.8
#: So many points back a curve is not met again: it turned there.
FORGOTTEN = 8
#: How far past the last step an end or a corner is looked for, in steps.
BEYOND = (0.5, 1.0, 2.0)
#: More steps than this a curve has not.
MOST_STEPS = 100_000


def traced(source: LocalSource, triangles: Triangles, spacing: float) -> list[Polyline]:
    """Return the pieces of a curve as polylines on it.

    They are found from the feet of cells of half a spacing that the curve may meet, and followed at steps of ``.15 L``.
    Where no step ahead leads on, the curve is looked for all round, so that it is followed past corners; it ends
    where nothing new is found, or at a curve that was traced already.
    """
    cells = next(blocks for side, blocks in cell_levels(source, 0.5 * spacing, 0.5) if side == 1)
    seeds = source.closest_point(np.asarray(cells * (0.5 * spacing), dtype=np.float64)).points
    space = np.hstack([seeds, np.zeros((len(seeds), 3 - source.dim))])
    size = float(np.median(triangles.nearest_size(space)[0]))
    tracer = Tracer(source, STEP_SHARE * size)
    lines = []
    while len(seeds):
        line = tracer.line_through(seeds[0])
        seeds = seeds[1:]
        if line is not None:
            lines.append(followed(source, line, size))
            seeds = seeds[tracer.distances(seeds) > tracer.step]
    return lines


@dataclass(eq=False)
class Tracer:
    """Follows a curve.

    Attributes
    ----------
    source : LocalSource
    step : float
        Length of a step.
    count : int
        Points that were traced so far.
    """

    source: LocalSource
    step: float
    count: int = 0
    _points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    _ways: Floats = field(default_factory=lambda: np.empty((0, 3)))

    def distances(self, points: Floats) -> Floats:
        """Return the distances of points from the points that were traced."""
        from scipy.spatial import cKDTree

        distance, _ = cKDTree(self._points[: self.count]).query(points)
        return np.asarray(distance)

    def line_through(self, seed: Floats) -> Polyline | None:
        """Return the piece through a point, traced both ways; None where it has no extent."""
        ways = self._all_round(seed)
        ways = ways[norms(ways - seed) > LEAST_STEP * self.step]
        if not len(ways):
            return None
        points, closed = self._onward([seed, ways[0]])
        if not closed:
            back = ways[(unit(ways - seed) @ unit(ways[:1] - seed)[0]) < -LEAST_TURN]
            if len(back):
                rest, _ = self._onward([points[0], back[0]], behind=True)
                points = rest[:0:-1] + points
        line = np.array(points)
        if self.source.has_tangents and len(line) > 1:
            middle = len(line) // 2
            along = self.source.tangents(self.source.closest_point(line[middle : middle + 1]))[0]
            line = line[::-1] if along @ (line[middle] - line[middle - 1]) < 0 else line
        return Polyline(line, closed) if len(line) > 1 else None

    def _onward(self, points: list[Floats], behind: bool = False) -> tuple[list[Floats], bool]:
        """Return the points followed on from two, and whether the line came back to the first."""
        first = self.count
        way = unit((points[1] - points[0])[None])[0]
        for point in points[behind:]:
            self._keep(point, way)
        while len(points) < MOST_STEPS:
            heading = unit((points[-1] - points[-2])[None])[0]
            ahead = self.source.closest_point((points[-1] + self.step * heading)[None]).points[0]
            turned = not self._leads_on(points[-1], ahead, heading)
            if turned:
                corner = self._farthest(points[-1], heading)
                if np.linalg.norm(corner - points[-1]) > 1e-3 * self.step:
                    points.append(corner)
                    self._keep(corner, heading)
                found = self._turn(points)
                if found is None:
                    return points, False
                ahead = found
            way = unit((ahead - points[-1])[None])[0]
            met = self._met(ahead, way, turned)
            if met is not None:
                if 0 <= met - first < FORGOTTEN and not behind:
                    return points[met - first :], True
                points.append(self._points[met])
                return points, False
            points.append(ahead)
            self._keep(ahead, way)
        return points, False

    def _keep(self, point: Floats, way: Floats) -> None:
        if self.count == len(self._points):
            room = np.empty((max(256, self.count), len(point)))
            self._points = np.concatenate([self._points.reshape(-1, len(point)), room])
            self._ways = np.concatenate([self._ways.reshape(-1, len(point)), room])
        self._points[self.count], self._ways[self.count] = point, way
        self.count += 1

    def _leads_on(self, here: Floats, ahead: Floats, heading: Floats) -> bool:
        way = ahead - here
        size = float(np.linalg.norm(way))
        return size > LEAST_STEP * self.step and float(way @ heading) > LEAST_AHEAD_COSINE * size

    def _farthest(self, here: Floats, heading: Floats) -> Floats:
        """Return the end or the corner that the curve has ahead."""
        target = here + np.array(BEYOND)[:, None] * self.step * heading
        feet = self.source.closest_point(target).points
        feet = feet[norms(feet - here) < 1.5 * self.step]
        return feet[np.argmax((feet - here) @ heading)] if len(feet) else here

    def _all_round(self, here: Floats) -> Floats:
        """Return the feet of points all round, the farthest first."""
        grid = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=self.source.dim) if any(d)])
        feet = self.source.closest_point(here + self.step * unit(grid)).points
        feet = feet[norms(feet - here) < 1.5 * self.step]
        return feet[np.argsort(-norms(feet - here), kind="stable")]

    def _turn(self, points: list[Floats]) -> Floats | None:
        """Return where the curve goes on from a corner, as straight as can be; None at its end."""
        here = points[-1]
        feet = self._all_round(here)
        feet = feet[norms(feet - here) > LEAST_STEP * self.step]
        way = points[-2] - here
        behind = np.clip((feet - here) @ way / (way @ way), 0.0, None)
        feet = feet[norms(feet - here - behind[:, None] * way) > LEAST_TURN * self.step]
        return feet[np.argmin(unit(feet - here) @ unit(way[None])[0])] if len(feet) else None

    def _met(self, place: Floats, way: Floats, turned: bool) -> int | None:
        """Return the number of the point at which a step comes upon what was traced already."""
        old = self.count - FORGOTTEN
        if old <= 0:
            return None
        gap = norms(self._points[:old] - place)
        along = np.abs(self._ways[:old] @ way) > ALONG_COSINE
        near = (gap < MET_SHARE * self.step) & (along | turned)
        return int(np.argmin(np.where(near, gap, np.inf))) if near.any() else None
