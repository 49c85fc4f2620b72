"""Bent sheets, curves and plates with geometry below the spacing, with points and their true solutions there.

Extruded polylines and curves have exact solutions. The truth on plates is quadratic finite elements on a mesh that is
finer at corners.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from extremes.ambient import Place
from extremes.envelope_scenes import TILT, along, extruded

import cpmkit as ck

PLANE_TILT = Place((0.4,), (0.13, -0.21))
Function = Callable[[Any], Any]


@dataclass(frozen=True, eq=False)
class SmallScene:
    """A scene, points (n, d) of it, and ``truth()``: u (n,) there and the first eigenvalue above zero of plates."""

    scene: ck.Scene
    points: Any
    truth: Callable[[], tuple[Any, float | None]]

    @property
    def eigen_scene(self) -> ck.Scene:
        """The scene of the eigenvalues of its surface."""
        return ck.Scene(self.scene.surface, ck.Eigen(count=3))


def polyline_of(degrees: Sequence[float], length: float) -> Any:
    """Return the polyline (k + 1, 2) of segments in the directions ``degrees`` (k,), each of a length."""
    turns = np.radians(degrees)
    steps = length * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])


def plate_line(thickness: float) -> Any:
    """Return the polyline (4, 2) of two parallel segments of length .9 and one wall."""
    return np.array([[0, 0], [0.9, 0], [0.9, thickness], [0, thickness]])


def _length(line: Any) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def bent_sheet(line: Any) -> SmallScene:
    """Return an extruded polyline; u is a cosine of the length along it times one of the height."""
    k = np.pi / _length(line)
    known = extruded([line], [lambda s: np.cos(k * s)], [lambda s: (1 + np.pi**2 + k * k) * np.cos(k * s)])
    return SmallScene(known.scene, known.points, lambda: (known.u, None))


def _arm_functions(count: int, length: float, c: float) -> tuple[list[Function], list[Function]]:
    """Return u of the distance on arms that meet, with slopes that sum to zero, and the loads -u'' + c u."""
    k = np.pi / (2 * length)
    parts = np.cos(2 * np.pi * np.arange(count) / count + 0.4)
    values = [lambda s, a=a: a * np.sin(k * s) + 0.5 * np.cos(2 * k * s) for a in parts]
    loads = [lambda s, a=a: a * (c + k * k) * np.sin(k * s) + 0.5 * (c + 4 * k * k) * np.cos(2 * k * s) for a in parts]
    return values, loads


def meeting_sheets(degrees: Sequence[float]) -> SmallScene:
    """Return sheets of length .9 that meet along one edge."""
    arms = [polyline_of([turn], 0.9) for turn in degrees]
    known = extruded(arms, *_arm_functions(len(arms), 0.9, 1 + np.pi**2))
    return SmallScene(known.scene, known.points, lambda: (known.u, None))


def plane_line(line: Any) -> SmallScene:
    """Return a polyline in the plane; u is a cosine of the length along it."""
    length = _length(line)
    k = np.pi / length
    source = ck.source("mesh.polyline", points=PLANE_TILT.world(line))
    stops = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    s = np.random.default_rng(0).uniform(0, length, 1000)
    points = np.stack([np.interp(s, stops, column) for column in line.T], axis=1)

    def load(x: Any) -> Any:
        return (1 + k * k) * np.cos(k * along(line, PLANE_TILT.local(x))[1])

    scene = ck.Scene(source, ck.ScreenedPoisson(load, c=1.0))
    return SmallScene(scene, PLANE_TILT.world(points), lambda: (np.cos(k * s), None))


def plane_arms(degrees: Sequence[float]) -> SmallScene:
    """Return segments of length .9 in the plane that meet at a point."""
    directions = PLANE_TILT.direction(np.concatenate([polyline_of([turn], 1.0)[1:] for turn in degrees]))
    start = np.array(PLANE_TILT.translation)
    members = [
        ck.source("analytic.segment", start=start.tolist(), end=(start + 0.9 * way).tolist()) for way in directions
    ]
    values, loads = _arm_functions(len(directions), 0.9, 1.0)
    s = np.random.default_rng(0).uniform(0, 0.9, 600)

    def load(x: Any) -> Any:
        along = np.clip((x - start) @ directions.T, 0.0, None)
        off = np.linalg.norm((x - start)[:, None] - along[:, :, None] * directions, axis=2)
        arm = off.argmin(axis=1)
        rows = np.arange(len(x))
        return np.stack([one(along[rows, arm]) for one in loads])[arm, rows]

    points = np.concatenate([start + s[:, None] * way for way in directions])
    u = np.concatenate([value(s) for value in values])
    return SmallScene(
        ck.Scene(ck.source("union", members=members), ck.ScreenedPoisson(load, c=1.0)), points, lambda: (u, None)
    )


@dataclass(frozen=True, eq=False)
class PlateShape:
    """A part of the unit square: rectangles between the stops of x and y whose centres are kept."""

    x_stops: Sequence[float]
    y_stops: Sequence[float]
    keep: Callable[[Any, Any], Any]


def slot(width: float) -> PlateShape:
    """Return a square with a slot from one rim to the middle."""
    return PlateShape(
        [0, 0.5, 1], [0, 0.5 - width / 2, 0.5 + width / 2, 1], lambda x, y: (x < 0.5) | (abs(y - 0.5) > width / 2)
    )


def neck(width: float) -> PlateShape:
    """Return two plates that hang together by a neck of length .1."""
    return PlateShape(
        [0, 0.45, 0.55, 1],
        [0, 0.5 - width / 2, 0.5 + width / 2, 1],
        lambda x, y: (abs(x - 0.5) > 0.05) | (abs(y - 0.5) < width / 2),
    )


def comb(width: float) -> PlateShape:
    """Return a square with five slots of length .6."""
    middles = np.arange(1, 6) / 6
    stops = np.sort(np.concatenate([[0, 1], middles - width / 2, middles + width / 2]))
    return PlateShape(
        [0, 0.4, 1], list(stops), lambda x, y: (x < 0.4) | (np.abs(y[:, None] - middles) > width / 2).all(axis=1)
    )


def square_hole(width: float) -> PlateShape:
    """Return a square with a square hole in the middle."""
    stops = [0, 0.5 - width / 2, 0.5 + width / 2, 1]
    return PlateShape(stops, stops, lambda x, y: np.maximum(abs(x - 0.5), abs(y - 0.5)) > width / 2)


def ell() -> PlateShape:
    """Return three quarters of a square."""
    return PlateShape([0, 0.5, 1], [0, 0.5, 1], lambda x, y: (x < 0.5) | (y < 0.5))


def even_places(stops: Sequence[float], step: float) -> Any:
    """Return the stops and places between them at most a step apart."""
    parts = [np.linspace(a, b, int(np.ceil((b - a) / step - 1e-9)) + 1)[:-1] for a, b in pairwise(stops)]
    return np.concatenate([*parts, [stops[-1]]])


def graded_places(stops: Sequence[float], step: float) -> Any:
    """Return the stops and places between them, at most a step apart and geometrically closer beside the stops."""
    halves = np.concatenate([[0.0], 0.5 ** np.arange(9, 0, -1)])
    marks = np.concatenate([halves, 1 - halves[-2::-1]])
    inner = [a + (b - a) * marks[:-1] for a, b in pairwise(stops)]
    return even_places([*np.concatenate(inner), stops[-1]], step)


def rectangle_cells(xs: Any, ys: Any, keep: Callable[[Any, Any], Any]) -> tuple[Any, Any]:
    """Return vertices (v, 2) and triangles (m, 3) of the rectangles of a grid that are kept."""
    grid = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
    i, j = (index.ravel() for index in np.indices((len(xs) - 1, len(ys) - 1)))
    kept = keep(0.5 * (xs[i] + xs[i + 1]), 0.5 * (ys[j] + ys[j + 1]))
    a, b = (i * len(ys) + j)[kept], ((i + 1) * len(ys) + j)[kept]
    cells = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    used, cells = np.unique(cells, return_inverse=True)
    return grid[used], cells.reshape(-1, 3)


def faceted(vertices: Any, faces: Any) -> Any:
    """Return the source of a mesh with flat triangles, tilted."""
    return ck.source("mesh.triangles", vertices=TILT.world(vertices), faces=faces, closest="faceted")


def waves_load(x: Any) -> Any:
    """Return smooth data (n,) of all three coordinates."""
    y = TILT.local(x)
    return np.cos(3 * y[:, 0]) + 2 * y[:, 1] * (0.5 + y[:, 2]) + np.cos(2 * y[:, 2] + 1)


def plate(shape: PlateShape) -> SmallScene:
    """Return a plate with natural rims."""
    rng, problem = np.random.default_rng(0), ck.ScreenedPoisson(waves_load, c=4.0)
    points = rng.uniform(0.01, 0.99, (1000, 2))
    points = TILT.world(np.pad(points[shape.keep(*points.T)], ((0, 0), (0, 1))))

    def source(places: Callable[..., Any], step: float) -> Any:
        flat, faces = rectangle_cells(places(shape.x_stops, step), places(shape.y_stops, step), shape.keep)
        return faceted(np.pad(flat, ((0, 0), (0, 1))), faces)

    def truth() -> tuple[Any, float]:
        fine = source(graded_places, 0.04)
        u = ck.solve(ck.Scene(fine, problem), backend="fem", degree=2).evaluate(points)
        values = ck.solve(ck.Scene(fine, ck.Eigen(count=3)), backend="fem", degree=2).eigenvalues
        return u, float(values[1])

    return SmallScene(ck.Scene(source(even_places, 0.25), problem), points, truth)
