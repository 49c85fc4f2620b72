"""Problems of benchmarks/trade.py: smooth ones, creases, tips, layers, real meshes, time, eigenvalues, each with truth.

Where the solution is known it is that; elsewhere the Galerkin form with about ``REFERENCE_UNKNOWNS`` unknowns, solved
once, and kept in a folder if one is given.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "forms" / "galerkin")]

from model_problems import sphere_points  # noqa: E402
from plane_zones import POINTS, junction, slit  # noqa: E402
from sphere_zones import coupled  # noqa: E402
from sphere_zones import exact as of_zones  # noqa: E402
from test_conditions_on_a_plate import T  # noqa: E402
from test_hard_shapes import TAMARIND, cube, rotation, tamarind_load, xy  # noqa: E402

import cpmkit as ck  # noqa: E402
from cpmkit.errors import CpmkitError  # noqa: E402

#: Of solutions that errors are measured against where none is known.
REFERENCE_UNKNOWNS, QUICK_REFERENCE_UNKNOWNS = 250_000, 100_000
#: Points at which solutions are read.
COUNT = 6000


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene, and ``errors(solution)``: the root mean square and the largest, as shares of the range."""

    name: str
    scene: Any
    errors: Callable[[Any], tuple[float, float]]


def against(at: Any, exact: Any) -> Callable[[Any], tuple[float, float]]:
    """Return what measures errors at points (n, d); ``exact`` is (n,), or a function that returns it."""

    def errors(solution: Any) -> tuple[float, float]:
        u = exact() if callable(exact) else exact
        off = (solution.evaluate(at) - u) / np.ptp(u)
        return float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())

    return errors


@dataclass(frozen=True)
class References:
    """Finer solutions, each solved when it is first asked for, with so many unknowns; kept in a folder, if any."""

    unknowns: int
    folder: Path | None

    def problem(self, name: str, scene: Any, at: Any, area: float) -> Problem:
        """Return a problem whose errors are measured against one, at points (n, d)."""

        @cache
        def exact() -> Any:
            file = None if self.folder is None else self.folder / f"{name}, {self.unknowns}.npy"
            if file is not None and file.exists():
                return np.load(file)
            print(f"{name}: solving with about {self.unknowns:,} unknowns", file=sys.stderr, flush=True)
            found = ck.solve(scene, float(np.sqrt(4.5 * area / self.unknowns))).evaluate(at)
            if file is not None:
                np.save(file, found)
            return found

        return Problem(name, scene, against(at, exact))


def smooth(references: References) -> Iterator[Problem]:
    """Spheres known in several ways, a torus, an open cap, a strip with one side, curves."""
    sphere, at = ck.source("analytic.sphere"), sphere_points(COUNT)
    u = lambda x: x[:, 0] * x[:, 1] + x[:, 2]  # noqa: E731
    f = lambda x: 7 * x[:, 0] * x[:, 1] + 3 * x[:, 2]  # noqa: E731
    wavy = lambda x: np.sin(6 * x[:, 2])  # noqa: E731
    load = lambda x: (1 + 36 * (1 - x[:, 2] ** 2)) * wavy(x) + 12 * x[:, 2] * np.cos(6 * x[:, 2])  # noqa: E731
    cloud = ck.source("pointcloud.points", points=sphere_points(10_000))
    shapes = {
        "sphere": sphere,
        "cloud": cloud,
        "level set": ck.source("levelset.expression", phi="x*x + y*y + z*z - 1", bounds=[[-1.2] * 3, [1.2] * 3]),
    }
    for name, source in shapes.items():
        yield Problem(name, ck.Scene(source, ck.ScreenedPoisson(f)), against(at, u(at)))
    yield Problem("sphere, waves", ck.Scene(sphere, ck.ScreenedPoisson(load)), against(at, wavy(at)))
    cap, upper = ck.source("analytic.cap", height=0.0), at * [1, 1, 0] + np.abs(at) * [0, 0, 1]
    yield Problem("cap", ck.Scene(cap, ck.ScreenedPoisson(f), edge=ck.Dirichlet(u)), against(upper, u(upper)))
    on = tamarind_points()
    yield Problem("tamarind", ck.Scene(TAMARIND, ck.ScreenedPoisson(tamarind_load)), against(on, xy(on)))
    t = np.linspace(0, 4 * np.pi, 2000)
    helix = np.stack([np.cos(t), np.sin(t), t / (2 * np.pi)], axis=1)
    s = lambda x: 2 * np.pi * x[:, 2]  # noqa: E731
    speed = 1 + 1 / (2 * np.pi) ** 2
    bent = lambda x: (1 + 1 / speed) * np.cos(s(x))  # noqa: E731
    yield Problem("helix", ck.Scene(ck.source("parametric.helix"), ck.ScreenedPoisson(bent)), against(helix, np.cos(t)))
    yield from without_solution(references)


def without_solution(references: References) -> Iterator[Problem]:
    """Smooth shapes whose solution is not known: a torus, a Moebius strip, a flat ellipsoid."""
    wave = lambda x: np.sin(3 * x[:, 0]) * np.cos(2 * x[:, 1]) + x[:, 2]  # noqa: E731
    shapes = {
        "torus": (ck.source("analytic.torus", major=1.0, minor=0.4), 4 * np.pi**2 * 0.4),
        "moebius": (ck.source("parametric.moebius"), 5.0),
        "flat ellipsoid": (
            ck.source(
                "levelset.expression", phi="x*x + y*y + 100*z*z - 1", bounds=[[-1.2] * 2 + [-0.3], [1.2] * 2 + [0.3]]
            ),
            6.5,
        ),
    }
    for name, (source, area) in shapes.items():
        scene = ck.Scene(source, ck.ScreenedPoisson(wave))
        at = np.random.default_rng(0).permutation(source.mesh(0.05)[0])[:COUNT]
        yield references.problem(name, scene, at, area)


def tamarind_points() -> Any:
    """Points of the tamarind, spread evenly over angles."""
    rng = np.random.default_rng(0)
    x, turn = rng.uniform(-2, 2, COUNT), rng.uniform(0, 2 * np.pi, COUNT)
    near = np.stack([x, np.sqrt(1 - x**2 / 4) * np.cos(turn), np.sqrt(1 - x**2 / 4) * np.sin(turn) * 0.5], axis=1)
    return TAMARIND.closest_point(near).points


def hard(references: References) -> Iterator[Problem]:
    """A cube, unlike data on a plate, slits, materials, a layer, a spike."""
    half, turned, rng = 0.6, rotation(), np.random.default_rng(0)
    u = lambda x: np.cos(np.pi * (x @ turned) / half).sum(axis=1)  # noqa: E731

    def f(x: Any) -> Any:
        flat = np.cos(np.pi * (x @ turned) / half)
        own = flat[np.arange(len(x)), np.abs(x @ turned).argmax(axis=1)]
        return (1 + (np.pi / half) ** 2) * (flat.sum(axis=1) - own) + own

    at = rng.uniform(-half, half, (COUNT, 3))
    at[np.arange(COUNT), rng.integers(0, 3, COUNT)] = half * rng.choice([-1, 1], COUNT)
    at = at @ turned.T
    yield Problem("cube", ck.Scene(cube(half, turned), ck.ScreenedPoisson(f)), against(at, u(at)))
    for kind in ("flux", "value"):
        scene, value = slit(kind)
        yield Problem(f"slit, {kind}", scene, against(POINTS, value(POINTS)))
    scene, value = junction(T, (1, 10, 100))
    yield Problem("materials that meet", scene, against(POINTS, value(POINTS)))
    at = sphere_points(COUNT)
    yield Problem("transmission", coupled(1000.0, 0.3), against(at, of_zones(at)))
    sphere = ck.source("analytic.sphere")
    ring = ck.source("analytic.circle", normal=[0, 0, 1])
    two = ck.Boundary("ring", ring, left=ck.Dirichlet(1.0), right=ck.Dirichlet(lambda x: x[:, 0]))
    for name, scene in {
        "layer": ck.Scene(sphere, ck.ScreenedPoisson(0.0, c=400.0), [two]),
        "unlike data": ck.Scene(sphere, ck.ScreenedPoisson(lambda x: x[:, 2]), [two]),
        "spike": ck.Scene(
            sphere, ck.ScreenedPoisson(lambda x: np.exp(-200 * np.sum((x - [0.6, 0.0, 0.8]) ** 2, axis=1)), c=1.0)
        ),
    }.items():
        away = at[np.abs(at[:, 2]) > 1e-3]
        yield references.problem(name, scene, away, 4 * np.pi)


def meshes(references: References) -> Iterator[Problem]:
    """Real meshes of unit size, read as smooth; those that are missing are left out."""
    for name in ("spot", "fish", "koala", "nefertiti-lowres"):
        try:
            vertices, faces = ck.read_mesh(f"{name}.obj")
        except CpmkitError as error:
            print(f"{name} is left out: {error}", file=sys.stderr)
            continue
        vertices = (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max()
        corners = vertices[faces]
        area = (
            0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
        )
        source = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="smooth")
        scene = ck.Scene(source, ck.ScreenedPoisson(lambda x: 40 * np.cos(6 * x[:, 0]) * np.sin(5 * x[:, 1]), c=1.0))
        at = np.random.default_rng(0).permutation(vertices)[:COUNT]
        yield references.problem(name, scene, at, area)


def others(_: References) -> Iterator[Problem]:
    """Heat, and eigenvalues, whose errors are relative."""
    sphere, at = ck.source("analytic.sphere"), sphere_points(COUNT)
    u = lambda x, t=0.0: np.exp(-2 * t) * x[:, 2] + np.exp(-6 * t) * x[:, 0] * x[:, 1]  # noqa: E731
    heat = ck.Heat(u, until=0.2, step=0.02)
    yield Problem("heat", ck.Scene(sphere, heat), against(at, u(at, 0.2)))
    exact = np.repeat([degree * (degree + 1) for degree in range(5)], [2 * degree + 1 for degree in range(5)])[:16]

    def errors(solution: Any) -> tuple[float, float]:
        off = float(np.abs(solution.eigenvalues[1:] / exact[1:] - 1).max())
        return off, off

    yield Problem("eigenvalues", ck.Scene(sphere, ck.Eigen(16)), errors)


def problems(unknowns: int = REFERENCE_UNKNOWNS, folder: Path | None = None) -> Iterator[Problem]:
    """Yield all; solutions that errors are measured against have so many unknowns, and are kept in a folder, if any."""
    for part in (smooth, hard, meshes, others):
        yield from part(References(unknowns, folder))
