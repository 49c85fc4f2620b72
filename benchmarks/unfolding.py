"""What unfolding sharp bends is worth on real meshes, and what it costs, over several positions of the grid.

Run ``CPMKIT_DATA=folder python benchmarks/unfolding.py``; it needs ``pip install . ./plugins/*`` and the meshes
fish.obj, koala.obj, nefertiti-lowres.obj and spot.obj in that folder. It prints the two tables of
docs/tables/unfolding.md: the lowest eigenvalues of -Lap beside those of the mesh itself, and the solution of
-Lap u + u = f beside linear finite elements, in boxes of side 1. Work is counted in unknowns and rows of E.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

import cpmkit as ck

METHODS = {"plain": False, "sheets": True, "unfolded": "unfolded"}
COUNT = 6
LEVELS = {"fish": (0.0275, 0.0195, 0.0138), "koala": (0.0292, 0.0208, 0.0146)}
SCREENED = {"fish": 0.0156, "koala": 0.0167, "nefertiti": 0.0177, "spot": 0.0193}
HEAD = "| mesh | spacing | method | unknowns | rows of E |"


def mesh(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices, in a box of side 1 with its lower corner at the origin, and faces."""
    vertices, faces = ck.read_mesh({"nefertiti": "nefertiti-lowres.obj"}.get(name, f"{name}.obj"))
    return (vertices - vertices.min(axis=0)) / np.ptp(vertices, axis=0).max(), faces


def positions(spacing: float, count: int) -> list[np.ndarray | None]:
    """Return origins of the lattice: its own, and random ones."""
    random = np.random.default_rng(5)
    return [None, *(spacing * random.uniform(size=3) for _ in range(count - 1))]


def lowest(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the lowest eigenvalues of the mesh itself, by linear finite elements."""
    from cpmkit_fem.assembly import stiffness_and_mass
    from scipy.sparse.linalg import eigsh

    stiffness, mass = stiffness_and_mass(vertices, faces)
    return np.sort(eigsh(stiffness, k=COUNT, M=mass, sigma=-0.5, v0=np.ones(len(vertices)))[0])


def eigenvalues_off(name: str) -> tuple[ck.Scene, dict[str, Any], Callable[[Any], float]]:
    """Return a scene, options, and by how many percent the lowest eigenvalues of its solution are off at most."""
    vertices, faces = mesh(name)
    reference = lowest(vertices, faces)
    scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), ck.Eigen(count=COUNT))
    return scene, {"degree": 2}, lambda s: float(100 * np.abs(s.eigenvalues[1:] / reference[1:] - 1).max())


def solution_off(name: str) -> tuple[ck.Scene, dict[str, Any], Callable[[Any], float]]:
    """Return a scene, options, and how far its solution is from finite elements: rms, less the mean, in percent."""
    vertices, faces = mesh(name)
    problem = ck.ScreenedPoisson(lambda x: np.cos(6 * x[:, 0]) + np.sin(5 * x[:, 1] + 2 * x[:, 2]) + x[:, 2], c=1.0)
    scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), problem)
    u = ck.solve(scene, backend="fem", solver_tolerance=1e-9).evaluate(vertices)
    options = {"form": "collocation", "solver_tolerance": 1e-8, "max_iterations": 6000}
    return scene, options, lambda s: float(200 * np.std(s.evaluate(vertices) - u) / np.ptp(u))


def rows(name: str, spacing: float, made: tuple[ck.Scene, dict[str, Any], Callable[[Any], float]], count: int) -> None:
    """Print one row a method: its size and error at the lattice's own position, rms and greatest error over several."""
    scene, options, measure = made
    for label, sheets in METHODS.items():
        found, size = [], ("", "")
        for origin in positions(spacing, count):
            solution = ck.solve(scene, spacing, origin=origin, sheets=sheets, **options)
            found.append(measure(solution))
            if origin is None:
                size = f"{solution.work.unknowns:,}", f"{len(solution.discretized.tables.layout.band.nodes):,}"
        rms = np.sqrt(np.mean(np.square(found)))
        print(
            f"| {name} | {spacing} | {label} | {' | '.join(size)} | {found[0]:.1f} | {rms:.1f} | {max(found):.1f} |",
            flush=True,
        )


def main(count: int = 5) -> None:
    for what, study in (
        ("largest of five eigenvalues off by, %", [(n, h, eigenvalues_off) for n, hs in LEVELS.items() for h in hs]),
        ("u off by, %", [(name, h, solution_off) for name, h in SCREENED.items()]),
    ):
        print(f"\n{HEAD} {what} | rms over {count} positions | worst |\n|---|--:|---|--:|--:|--:|--:|--:|")
        for name, spacing, make in study:
            rows(name, spacing, make(name), count)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
