"""What tilting the normals of a mesh towards the chords between its vertices is worth, and what it costs.

Run ``CPMKIT_DATA=folder python benchmarks/normals.py``; it needs ``pip install . ./plugins/*`` and the meshes
fish.obj, koala.obj, nefertiti-lowres.obj and spot.obj in that folder. It prints the two tables of
tables/normals.md: the error of the normals on meshes inscribed in an ellipsoid, and the difference between the
closest point method and linear finite elements for -Lap u + u = f, over several positions of the grid. Averages are
the normals before they are tilted. Cost is the time to build a mesh beside that without tilting, median of rounds
that take turns.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from time import process_time
from typing import Any
from unittest.mock import patch

import numpy as np

import cpmkit as ck

SCREENED = {
    "fish": (0.0156, 0.0086),
    "koala": (0.0167, 0.0091),
    "nefertiti": (0.0177,),
    "spot": (0.0193, 0.0106, 0.0061),
}
AXES = np.array([1.0, 0.7, 0.45])
ROUNDS = 7


def mesh(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices, in a box of side 1 with its lower corner at the origin, and faces."""
    vertices, faces = ck.read_mesh({"nefertiti": "nefertiti-lowres.obj"}.get(name, f"{name}.obj"))
    return (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max(), faces


def positions(spacing: float, count: int) -> list[np.ndarray | None]:
    """Return origins of the lattice: its own, and random ones."""
    random = np.random.default_rng(5)
    return [None, *(spacing * random.uniform(size=3) for _ in range(count - 1))]


def solution_off(name: str) -> tuple[ck.Scene, dict[str, Any], Callable[[Any], float]]:
    """Return a scene, options, and how far its solution is from finite elements: rms, less the mean, in percent."""
    vertices, faces = mesh(name)
    problem = ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0]) + np.sin(5 * x[:, 1] + 2 * x[:, 2]) + x[:, 2], c=1.0)
    scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), problem)
    u = ck.solve(scene, backend="fem", solver_tolerance=1e-9).evaluate(vertices)
    options = {"form": "collocation", "solver_tolerance": 1e-8, "max_iterations": 6000}
    return scene, options, lambda s: float(200 * np.std(s.evaluate(vertices) - u) / np.ptp(u))


def averaged() -> AbstractContextManager[object]:
    """Return a context in which normals stay as they were averaged."""
    return patch("cpmkit_mesh.corner_normals.fit_normals_to_chords", lambda *given: given[3])


KINDS = {"averages": averaged, "tilted": nullcontext}


def scattered(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return random points of the unit sphere and the triangles between them, wound outwards."""
    from scipy.spatial import ConvexHull

    points = np.random.default_rng(0).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices.copy()
    inwards = np.linalg.det(points[faces]) < 0
    faces[inwards] = faces[inwards, ::-1]
    return points, faces


def even(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Return an icosahedron whose triangles are quartered and put on the unit sphere."""
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=subdivisions)
    return np.array(ball.vertices), np.array(ball.faces)


def degrees_off(points: np.ndarray, faces: np.ndarray) -> float:
    """Return the rms angle between the normals of a mesh inscribed in an ellipsoid and the ellipsoid's own."""
    exact = points / AXES
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    found = np.empty_like(points)
    source = ck.source("mesh.triangles", vertices=points * AXES, faces=faces)
    found[faces.ravel()] = source.normals_at_corners.reshape(-1, 3)
    return float(np.degrees(np.sqrt(((found - exact) ** 2).sum(axis=1).mean())))


def cost_of_building(name: str) -> float:
    """Return how much longer a mesh takes to build than one whose normals are not tilted."""
    vertices, faces = mesh(name)
    spent: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for _ in range(ROUNDS):
        for kind, context in KINDS.items():
            with context():
                start = process_time()
                ck.source("mesh.triangles", vertices=vertices, faces=faces)
                spent[kind].append(process_time() - start)
    return float(np.median(spent["tilted"]) / np.median(spent["averages"]))


def differences(name: str, spacing: float, count: int) -> list[list[float]]:
    """Return the difference from finite elements at each position of the grid, for averages and for tilted normals."""
    found, origins = [], positions(spacing, count)
    for context in KINDS.values():
        with context():
            scene, options, measure = solution_off(name)
        found.append([measure(ck.solve(scene, spacing, origin=origin, **options)) for origin in origins])
    return found


def main(count: int = 5) -> None:
    print("| ellipsoid, vertices | averages off by, degrees | tilted |\n|---|--:|--:|")
    for label, made in [("even", even(level)) for level in (3, 4, 5)] + [
        ("scattered", scattered(size)) for size in (642, 2562, 10242)
    ]:
        off = []
        for context in KINDS.values():
            with context():
                off.append(degrees_off(*made))
        print(f"| {label}, {len(made[0]):,} | {off[0]:.3f} | {off[1]:.3f} |")
    own = "at the grid's own position: averages, % | tilted"
    print(f"\n| mesh | spacing | {own} | rms over {count} positions: averages | tilted |\n|---|--:|--:|--:|--:|--:|")
    for name, spacings in SCREENED.items():
        for spacing in spacings:
            found = np.array(differences(name, spacing, count))
            rms = np.sqrt((found**2).mean(axis=1))
            cells = [f"{value:.2f}" for value in (*found[:, 0], *rms)]
            print(f"| {name} | {spacing} | {' | '.join(cells)} |", flush=True)
    ratios = ", ".join(f"{name} {cost_of_building(name):.1f}" for name in SCREENED)
    print(f"\ntime to build a mesh, beside averages: {ratios}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
