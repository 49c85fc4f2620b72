"""Closest points of a mesh of 70 000 triangles: cpmkit's tree against libigl's AABB, in alternation.

Run ``python benchmarks/closest_point_mesh.py``; it needs ``pip install libigl``. The mesh is
nefertiti-lowres.obj in the folder that CPMKIT_DATA names, else a sphere. Queries are the nodes of a
lattice within five spacings of the mesh, in lattice order. Rates are queries per second of
processor time of the whole process, the median of the rounds; ratios are those of each round, so that what else
runs on the machine touches both sides alike.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from cpmkit_mesh import read_mesh, triangles

ROUNDS, BAND = 7, 5.0


def mesh() -> tuple[str, np.ndarray, np.ndarray]:
    """Return a name, vertices and faces of about 70 000 triangles."""
    file = Path(os.environ.get("CPMKIT_DATA", "")) / "nefertiti-lowres.obj"
    if file.is_file():
        return file.name, *read_mesh(file)
    columns, rows = 265, 132
    polar, around = np.divmod(np.arange(columns * rows), columns)
    polar, around = np.pi * (polar + 0.5) / rows, 2 * np.pi * around / columns
    points = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=1)
    a = np.arange(columns * (rows - 1))
    b = a // columns * columns + (a + 1) % columns
    faces = np.concatenate([np.stack([a, a + columns, b], axis=1), np.stack([b, a + columns, b + columns], axis=1)])
    return "a sphere without its poles", points, faces


def band(points: np.ndarray, faces: np.ndarray, count: int) -> np.ndarray:
    """Return about ``count`` lattice nodes within five spacings of the mesh, in lattice order."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    spacing = np.sqrt(2 * BAND * area / count)
    low, high = points.min(axis=0) - BAND * spacing, points.max(axis=0) + BAND * spacing
    axes = [np.arange(start, stop, spacing) for start, stop in zip(low, high, strict=True)]
    source = triangles(vertices=points, faces=faces, closest="faceted")
    kept = []
    for x in axes[0]:
        plane = np.stack(np.meshgrid([x], axes[1], axes[2], indexing="ij"), axis=-1).reshape(-1, 3)
        kept.append(plane[source.closest_point(plane).distance <= BAND * spacing])
    return np.concatenate(kept)


def rate(answer: Callable[[np.ndarray], object], queries: np.ndarray) -> float:
    """Return millions of queries per second of processor time."""
    start = time.process_time()
    answer(queries)
    return len(queries) / (time.process_time() - start) / 1e6


def main(count: int = 300_000) -> dict[str, float]:
    import igl

    name, points, faces = mesh()
    tree = igl.AABB()
    tree.init(points, faces)
    faceted, smooth = (triangles(vertices=points, faces=faces, closest=closest) for closest in ("faceted", "smooth"))
    answers = {
        "libigl": lambda x: tree.squared_distance(points, faces, x),
        "faceted": faceted.closest_point,
        "smooth": smooth.closest_point,
    }
    queries = band(points, faces, count)
    for answer in answers.values():
        answer(queries[:10])
    rates = np.array([[rate(answer, queries) for answer in answers.values()] for _ in range(ROUNDS)])
    ratio = np.median(rates / rates[:, :1], axis=0)
    print(f"{name}: {len(faces)} triangles, {len(queries)} queries, {ROUNDS} rounds")
    for label, value, times in zip(answers, np.median(rates, axis=0), ratio, strict=True):
        print(f"{label:8s} {value:6.3f} million queries per second of processor time, {times:5.2f} times libigl")
    return dict(zip(answers, ratio.tolist(), strict=True))


if __name__ == "__main__":
    main()
