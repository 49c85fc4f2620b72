"""Bodies, real meshes and smooth surfaces, with points and their true solutions there.

The truth on bodies with flat faces is quadratic finite elements on a finer mesh. On real meshes and smooth surfaces it
is the Galerkin form at a smaller spacing. The lens has an exact solution.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from extremes.envelope_scenes import TILT
from extremes.small_geometry import (
    Function,
    SmallScene,
    even_places,
    faceted,
    graded_places,
    rectangle_cells,
    waves_load,
)

import cpmkit as ck

#: Profiles of radii and heights: a cylinder with caps, and a cone without its base.
CYLINDER = np.array([[0, 0], [0.5, 0], [0.5, 1], [0, 1.0]])
CONE = np.array([[0, 1], [0.5, 0.0]])
#: Outlines of a bracket and of a gear wheel of 8 teeth.
BRACKET = np.array([[-0.3, -0.3], [1.0, -0.3], [1.0, 0.3], [0.3, 0.3], [0.3, 1.0], [-0.3, 1.0]])
GEAR = np.repeat([[0.75, 1.0] * 8], 2)[:, None] * [[np.cos(k * np.pi / 16), np.sin(k * np.pi / 16)] for k in range(32)]
#: Half the distance of the centres of the two unit balls of the lens.
HALF = 0.7


def _sampled(vertices: Any, faces: Any, count: int = 1500) -> Any:
    """Return random points (count, d) of a mesh, evenly distributed by area."""
    rng, corners = np.random.default_rng(0), vertices[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = rng.choice(len(faces), count, p=area / area.sum())
    return np.einsum("nkd,nk->nd", corners[chosen], rng.dirichlet([1, 1, 1], count))


def _body(coarse: tuple[Any, Any], fine: Callable[[], tuple[Any, Any]]) -> SmallScene:
    """Return a body with flat faces; its truth is quadratic elements on the mesh ``fine()``."""
    problem, points = ck.ScreenedPoisson(waves_load, c=4.0), TILT.world(_sampled(*coarse))

    def truth() -> tuple[Any, None]:
        return ck.solve(ck.Scene(faceted(*fine()), problem), backend="fem", degree=2).evaluate(points), None

    return SmallScene(ck.Scene(faceted(*coarse), problem), points, truth)


def _merged(patches: Sequence[tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return one mesh of several, whose equal vertices are one."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in patches)])
    faces = np.concatenate([one + start for (_, one), start in zip(patches, starts, strict=False)])
    vertices = np.concatenate([vertices for vertices, _ in patches])
    _, first, number = np.unique(vertices.round(10), axis=0, return_index=True, return_inverse=True)
    faces = number.ravel()[faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return vertices[first], faces[proper]


def cube() -> SmallScene:
    """Return a cube of side 1."""

    def mesh(places: Any) -> tuple[Any, Any]:
        flat, faces = rectangle_cells(places, places, lambda x, y: np.ones(len(x), dtype=bool))
        sides = []
        for axis in range(3):
            for height in (0.0, 1.0):
                is_outward = (height > 0.5) == (axis != 1)
                sides.append((np.insert(flat, axis, height, axis=1), faces if is_outward else faces[:, ::-1]))
        return _merged(sides)

    return _body(mesh(np.linspace(0, 1, 2)), lambda: mesh(graded_places([0, 1], 0.03)))


def _divided(points: Any, parts: int) -> Any:
    """Return ``points`` (n, ...) with each step from one to the next in so many equal parts."""
    share = (np.arange(parts) / parts).reshape(-1, *[1] * (points.ndim - 1))
    return np.concatenate([*(a + share * (b - a) for a, b in pairwise(points)), points[-1:]])


def _grid_mesh(points: Any) -> tuple[Any, Any]:
    """Return the mesh of a grid of points (r, c, 3), of which equal ones are one vertex."""
    rows, columns = map(np.arange, points.shape[:2])
    flat, faces = rectangle_cells(rows, columns, lambda x, y: np.ones(len(x), dtype=bool))
    return _merged([(points[tuple(flat.astype(int).T)], faces)])


def _turned_profile(radii: Any, heights: Any, sides: int, parts: int) -> tuple[Any, Any]:
    """Return the prism-like surface of a profile turned about z, with so many flat sides, each in so many parts."""
    turns = 2 * np.pi * np.arange(sides + 1) / sides
    ring = _divided(np.stack([np.cos(turns), np.sin(turns)], axis=1), parts)
    upright = np.broadcast_to(heights[:, None, None], (len(radii), len(ring), 1))
    return _grid_mesh(np.concatenate([radii[:, None, None] * ring, upright], axis=2))


def _profile(stops: Any, step: float) -> tuple[Any, Any]:
    """Return radii and heights along a polyline (k, 2), at most a step apart."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(stops, axis=0), axis=1))])
    places = even_places(list(lengths), step)
    return np.interp(places, lengths, stops[:, 0]), np.interp(places, lengths, stops[:, 1])


def turned_body(stops: Any) -> SmallScene:
    """Return the surface of 64 flat sides of a profile (k, 2) of radii and heights."""
    return _body(_turned_profile(*_profile(stops, 0.1), 64, 1), lambda: _turned_profile(*_profile(stops, 0.02), 64, 3))


def bored_prism(outline: Any, radius: float, height: float) -> SmallScene:
    """Return a prism with a bore around the z axis, from which all of its ``outline`` (k, 2) is seen.

    The bore has flat sides: one for each step of .1 along the outline.
    """
    flat = np.stack(_profile(outline[[*range(len(outline)), 0]], 0.1), axis=1)
    bore = radius * flat / np.linalg.norm(flat, axis=1)[:, None]
    loops = (bore, height), (flat, height), (flat, 0.0), (bore, 0.0), (bore, height)
    rings = np.stack([np.insert(loop, 2, z, axis=1) for loop, z in loops])

    def mesh(parts: int) -> tuple[Any, Any]:
        return _grid_mesh(_divided(_divided(rings, 8 * parts).swapaxes(0, 1), parts).swapaxes(0, 1))

    return _body(mesh(1), lambda: mesh(3))


def _by_galerkin(source: Any, points: Any, load: Function, spacing: float) -> SmallScene:
    """Return a scene whose truth is the Galerkin form at a smaller spacing."""
    scene = ck.Scene(source, ck.ScreenedPoisson(load, c=4.0))
    return SmallScene(scene, points, lambda: (ck.solve(scene, spacing).evaluate(points), None))


def lens(level_set: bool) -> SmallScene:
    """Return the lens common to two unit balls, as two caps or as a level set; u is odd in z, so no flux is lost."""
    rng = np.random.default_rng(0)
    height, turn = rng.uniform(HALF, 1, 1500), rng.uniform(0, 2 * np.pi, 1500)
    wide, side = np.sqrt(1 - height**2), np.where(rng.uniform(size=1500) < 0.5, -1.0, 1.0)
    points = np.stack([wide * np.cos(turn), wide * np.sin(turn), side * (height - HALF)], axis=1)
    ways = TILT.direction([[0, 0, 1.0], [0, 0, -1.0]])
    centres = np.array(TILT.translation) - HALF * ways
    source = _level_set_of(centres) if level_set else _caps(centres, ways)
    problem = ck.ScreenedPoisson(lambda x: _lens_load(TILT.local(x)), c=4.0)
    return SmallScene(ck.Scene(source, problem), TILT.world(points), lambda: (_lens_value(points), None))


def _lens_value(y: Any) -> Any:
    return y[:, 2] * (1 + 0.8 * y[:, 0] + y[:, 0] * y[:, 1])


def _lens_load(points: Any) -> Any:
    """Return -Lap u + 4 u (n,), where Lap u = Lap F - n.(H n) - 2 n.grad F on a unit sphere, and Lap F = 0."""
    x, y, z = points.T
    normal = points + HALF * np.sign(z)[:, None] * [0, 0, 1]
    nx, ny, nz = normal.T
    bend = 2 * (nx * ny * z + nx * nz * (0.8 + y) + ny * nz * x)
    slope = nx * z * (0.8 + y) + ny * z * x + nz * (1 + 0.8 * x + x * y)
    return bend + 2 * slope + 4 * _lens_value(points)


def _caps(centres: Any, ways: Any) -> Any:
    """Return the union of caps of unit spheres around two centres (2, 3), each in its direction."""
    pairs = zip(centres.tolist(), ways.tolist(), strict=True)
    caps = [ck.source("analytic.cap", center=centre, axis=way, height=HALF) for centre, way in pairs]
    return ck.source("union", members=caps)


def _level_set_of(centres: Any) -> Any:
    """Return the level set of the points common to balls of radius 1 around two centres (2, 3)."""
    a, b = ["+".join(f"({axis}-({at!r}))**2" for axis, at in zip("xyz", row, strict=True)) for row in centres.tolist()]
    middle = centres.mean(axis=0)
    bounds = [(middle - 1).tolist(), (middle + 1).tolist()]
    return ck.source("levelset.expression", phi=f"{a} + {b} + abs({a} - ({b})) - 2", bounds=bounds)  # twice the maximum


def real_mesh(name: str, spacing: float) -> SmallScene:
    """Return a mesh of the folder ``CPMKIT_DATA``, its longest side 2, read as flat triangles."""
    vertices, faces = ck.read_mesh(Path(os.environ["CPMKIT_DATA"]) / f"{name}.obj")
    vertices = 2 * (vertices - vertices.mean(axis=0)) / np.ptp(vertices, axis=0).max()
    return _by_galerkin(faceted(vertices, faces), TILT.world(_sampled(vertices, faces)), waves_load, spacing)


def smooth_control(kind: str, spacing: float, **keys: Any) -> SmallScene:
    """Return a smooth surface of a kind, where nothing is to be cut."""
    source = ck.source(kind, **keys)
    points = source.closest_point(np.random.default_rng(0).normal(size=(1500, 3))).points
    return _by_galerkin(source, points, waves_load, spacing)
