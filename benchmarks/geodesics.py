"""Geodesic distances against exact ones, and against the heat method on meshes.

Run ``python benchmarks/geodesics.py``; it needs ``pip install . ./plugins/* potpourri3d pygeodesic`` and, for the
meshes, ``CPMKIT_DATA`` set to a folder with spot.obj, koala.obj and nefertiti-lowres.obj. It prints the rows of
tables/geodesics.md: root mean square over the origins of the mean error, as a share of the mean distance, in
percent, the largest error and the least distance less the straight line, as the same share; seconds of processor time
of the first origin, with the tables, and of one more. Names of rows as arguments print those alone.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from time import process_time
from typing import Any, NamedTuple

import numpy as np

import cpmkit as ck
from cpmkit.applications import geodesic_distance
from cpmkit.studies.tables import table_row, table_rule

HEADER = [
    "distance",
    "method",
    "spacing",
    "unknowns",
    "origins",
    "mean error, %",
    "largest, %",
    "least less straight, %",
]
HEADER += ["first, s", "one more, s"]
MAJOR, MINOR = 1.0, 0.4
SPHERE = ck.source("analytic.sphere")
TORUS = ck.source("analytic.torus", major=MAJOR, minor=MINOR)
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])
OUTER = ck.source("analytic.circle", radius=MAJOR + MINOR, normal=[0, 0, 1])
#: Points at which smooth surfaces are measured.
COUNT = 4000


class Case(NamedTuple):
    """A surface, where distances from each origin are measured, and what they are."""

    surface: Any
    origins: list[Any]
    points: np.ndarray
    exact: Callable[[Any], np.ndarray]


def _sphere(count: int) -> Case:
    points = np.random.default_rng(0).normal(size=(COUNT, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return Case(SPHERE, list(points[:count]), points, lambda one: np.arccos(np.clip(points @ one, -1, 1)))


def _circle() -> Case:
    case = _sphere(1)
    return Case(SPHERE, [EQUATOR], case.points, lambda _: np.abs(np.arcsin(np.clip(case.points[:, 2], -1, 1))))


def _torus(surface: Any = TORUS) -> Case:
    around, along = np.random.default_rng(0).uniform(-np.pi, np.pi, (2, COUNT))
    return Case(surface, [OUTER], torus_points(around, along), lambda _: MINOR * np.abs(around))


def torus_points(around: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return points (n, 3) of the torus at two angles (n,)."""
    ring = MAJOR + MINOR * np.cos(around)
    return np.stack([ring * np.cos(along), ring * np.sin(along), MINOR * np.sin(around)], axis=1)


@cache
def _mesh(name: str, count: int) -> Case:
    from pygeodesic.geodesic import PyGeodesicAlgorithmExact

    vertices, faces = ck.read_mesh(name)
    surface = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    chosen = np.random.default_rng(1).choice(len(vertices), count, replace=False)
    exact = PyGeodesicAlgorithmExact(vertices, faces)
    known = {int(one): exact.geodesicDistances([int(one)])[0] for one in chosen}
    number = {tuple(vertices[one]): int(one) for one in chosen}
    return Case(surface, [vertices[one] for one in chosen], vertices, lambda at: known[number[tuple(at)]])


def rows(case: Case, spacing: float) -> Iterator[list[str]]:
    """Yield the numbers of one row a method, each on one prepared scene of its own: the first origin makes factors."""
    for method in ("heat", "transport"):
        began = process_time()
        prepared = ck.prepare(ck.Scene(case.surface, ck.Poisson(0.0)), spacing, form="galerkin")
        tables = process_time() - began
        found, seconds = [], []
        for origin in case.origins:
            began = process_time()
            distance = geodesic_distance(prepared, origin, method=method)
            seconds.append(process_time() - began)
            found.append(distance.evaluate(case.points))
        more = _number(float(np.mean(seconds[1:]))) if len(seconds) > 1 else ""
        errors = _errors(case, found)
        yield [method, f"{spacing:g}", f"{prepared.discretized.size:,}", *errors, f"{tables + seconds[0]:.1f}", more]


def _errors(case: Case, found: list[np.ndarray]) -> list[str]:
    means, largest, least = [], [], []
    for origin, ours in zip(case.origins, found, strict=True):
        exact = case.exact(origin)
        if ours.min() < 0:
            raise ValueError(f"a distance from {origin} is negative: {ours.min()}")
        means.append(np.abs(ours - exact).mean() / exact.mean())
        largest.append(np.abs(ours - exact).max() / exact.mean())
        straight = _straight(origin, case.points)
        least.append((ours - straight).min() / exact.mean())
    rms = np.sqrt(np.mean(np.square(means)))
    return [str(len(found)), _number(100 * rms), _number(100 * max(largest)), _number(100 * min(least))]


def _straight(origin: Any, points: np.ndarray) -> np.ndarray:
    if isinstance(origin, np.ndarray):
        return np.linalg.norm(points - origin, axis=1)
    return np.asarray(origin.closest_point(points).distance)


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.2g}" if abs(value) < 100 else f"{value:.0f}"


def mesh_heat_method(name: str, count: int) -> Iterator[list[str]]:
    """Yield the row of the heat method on a mesh's own vertices."""
    from potpourri3d import MeshHeatMethodDistanceSolver

    vertices, faces = ck.read_mesh(name)
    case = _mesh(name, count)
    began = process_time()
    solver = MeshHeatMethodDistanceSolver(vertices, faces)
    found, seconds = [], []
    for origin in case.origins:
        found.append(solver.compute_distance(int(np.abs(vertices - origin).sum(axis=1).argmin())))
        seconds.append(process_time() - began)
        began = process_time()
    found = [np.maximum(one, 0) for one in found]
    more = _number(float(np.mean(seconds[1:]))) if count > 1 else ""
    yield ["mesh heat method", "", f"{len(vertices):,}", *_errors(case, found), f"{seconds[0]:.2g}", more]


def _torus_sources() -> dict[str, Any]:
    around, along = (
        one.ravel() for one in np.meshgrid(*(2 * np.pi * np.arange(n) / n for n in (60, 150)), indexing="ij")
    )
    points = torus_points(around, along)
    at = np.arange(60 * 150).reshape(60, 150)
    a, b, c, d = (
        one.ravel() for one in (at, np.roll(at, -1, 1), np.roll(np.roll(at, -1, 0), -1, 1), np.roll(at, -1, 0))
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    phi = f"(sqrt(x*x + y*y) - {MAJOR})**2 + z*z - {MINOR**2}"
    box = [[-1.6, -1.6, -0.6], [1.6, 1.6, 0.6]]
    return {
        "torus as a mesh": ck.source("mesh.triangles", vertices=points, faces=faces, closest="smooth"),
        "torus as a cloud": ck.source("pointcloud.points", points=points),
        "torus as a level set": ck.source("levelset.expression", phi=phi, bounds=box),
    }


def jobs() -> Iterator[tuple[str, Callable[[], Iterator[list[str]]]]]:
    """Yield the name of each row, and what yields its numbers."""
    for name, count, spacings in (
        ("spot.obj", 16, (0.0635, 0.0355)),
        ("koala.obj", 16, (0.33, 0.155)),
        ("nefertiti-lowres.obj", 16, (17.7, 8.5)),
    ):
        yield name, partial(mesh_heat_method, name, count)
        for spacing in spacings:
            yield name, partial(lambda f, n, h: rows(_mesh(f, n), h), name, count, spacing)
    for name in ("torus as a mesh", "torus as a cloud", "torus as a level set"):
        yield name, partial(lambda one: rows(_torus(_torus_sources()[one]), 0.13), name)
    yield "torus, outer equator", lambda: rows(_torus(), 0.07)
    for spacing in (0.1, 0.05):
        yield "sphere, circle", partial(lambda h: rows(_circle(), h), spacing)
    for spacing, count in ((0.1, 16), (0.05, 2)):
        yield "sphere, point", partial(lambda h, n: rows(_sphere(n), h), spacing, count)


def main() -> None:
    """Print the table."""
    wanted = sys.argv[1:]
    for surface in (SPHERE, *_torus_sources().values()):  # nothing of what follows pays for imports
        for method in ("heat", "transport"):
            geodesic_distance(surface, [1.0, 0, 0], spacing=0.2, method=method)
    print(table_row(HEADER))
    print(table_rule(2, len(HEADER) - 2))
    for name, measure in jobs():
        if not wanted or name in wanted:
            for row in measure():
                print(table_row([name, *row]), flush=True)


if __name__ == "__main__":
    main()
