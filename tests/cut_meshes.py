"""Meshes with boundaries in them, and what topology says of them: zones, tips, area."""

from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import cpmkit as ck
from cpmkit.meshing.insertion.boundary_insertion import Insertion, insert_boundaries
from cpmkit.plugin import Mesh, localize

ICOSAHEDRON = (
    "0 11 5 0 5 1 0 1 7 0 7 10 0 10 11 1 5 9 5 11 4 11 10 2 10 7 6 7 1 8 "
    "3 9 4 3 4 2 3 2 6 3 6 8 3 8 9 4 9 5 2 4 11 6 2 10 8 6 7 9 8 1"
)


def icosphere(levels: int) -> Mesh:
    """Return the unit sphere: an icosahedron of which every triangle is split in four, ``levels`` times."""
    g = 0.5 * (1 + 5**0.5)
    corners = [[(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0)], [(0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g)]]
    vertices = np.array([*corners[0], *corners[1], (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)], dtype=float)
    cells = np.array(ICOSAHEDRON.split(), dtype=np.int64).reshape(-1, 3)
    for _ in range(levels):
        edges = np.sort(cells[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
        ends, number = np.unique(edges, axis=0, return_inverse=True)
        (a, b, c), (x, y, z) = cells.T, number.reshape(-1, 3).T + len(vertices)
        vertices = np.concatenate([vertices, vertices[ends].mean(axis=1)])
        cells = np.concatenate([np.stack(three, axis=1) for three in ((a, z, y), (z, b, x), (y, x, c), (x, y, z))])
    return Mesh.of(vertices / np.linalg.norm(vertices, axis=1)[:, None], cells)


def plate(count: int, sides: tuple[float, float] = (1.0, 1.0)) -> Mesh:
    """Return a rectangle in space at z = 0, of ``count`` cells a side, its diagonals in turn."""
    x = np.linspace(0.0, 1.0, count + 1)
    vertices = np.stack([*np.meshgrid(sides[0] * x, sides[1] * x, indexing="ij"), np.zeros((count + 1,) * 2)], axis=-1)
    a = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    b, c, d = a + count + 1, a + count + 2, a + 1
    turned = (a % 2 == 0)[:, None]
    first = np.where(turned, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    second = np.where(turned, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return Mesh.of(vertices.reshape(-1, 3), np.concatenate([first, second]))


def polyline(points: Any, closed: bool = False) -> Any:
    return ck.source("mesh.polyline", points=np.asarray(points, dtype=float), closed=closed)


def cut(mesh: Mesh, *sources: Any, spacing: float | None = None) -> Insertion:
    """Return the mesh with ``sources`` in it; the spacing is 1.5 mean edges unless given, as in a form."""
    spacing = 1.5 * mean_edge(mesh) if spacing is None else spacing
    return insert_boundaries(mesh, [localize(source, np.zeros(mesh.dim)) for source in sources], spacing)


def mean_edge(mesh: Mesh) -> float:
    corners = mesh.vertices[mesh.cells]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.cells[:, k]] for k in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def edge_codes(mesh: Mesh, edges: Any) -> np.ndarray:
    ends = np.sort(np.asarray(edges).reshape(-1, 2), axis=1)
    return ends[:, 0] * len(mesh.vertices) + ends[:, 1]


def zones_and_tips(mesh: Mesh) -> tuple[int, int]:
    """Return the parts that hang together over edges not cut, and the vertices off the rim where one cut edge ends.

    Extensions past tips cut nothing here.
    """
    lines = mesh.cut[~mesh.beyond_tip]
    codes, marked = edge_codes(mesh, mesh.facets), edge_codes(mesh, lines)
    assert len(np.unique(marked)) == len(marked)
    assert np.isin(marked, codes).all()
    cell, joining = np.repeat(np.arange(len(mesh.cells)), 3), ~np.isin(codes, marked)
    number = len(mesh.cells) + np.unique(codes[joining], return_inverse=True)[1]
    size = (int(number.max()) + 1,) * 2
    parts = connected_components(coo_array((np.ones(len(number)), (cell[joining], number)), size), directed=False)[1]
    code, times = np.unique(codes, return_counts=True)
    rim = np.stack(np.divmod(code[times == 1], len(mesh.vertices)))
    vertex, degree = np.unique(lines, return_counts=True)
    return len(np.unique(parts[: len(mesh.cells)])), len(np.setdiff1d(vertex[degree == 1], rim))


def check_sound(before: Mesh, after: Mesh) -> None:
    """Assert that the mesh covers what it covered, and that each edge has as many cells as the one it is part of."""
    assert area(after) == pytest.approx(area(before), rel=1e-12)
    rims = []
    for mesh in (before, after):
        code, times = np.unique(edge_codes(mesh, mesh.facets), return_counts=True)
        assert times.max() <= 2
        ends = np.stack(np.divmod(code[times == 1], len(mesh.vertices)))
        rims.append(np.linalg.norm(mesh.vertices[ends[0]] - mesh.vertices[ends[1]], axis=1).sum())
    assert rims[0] == pytest.approx(rims[1], rel=1e-12, abs=1e-12)
    assert len(after.owner) == len(after.beyond_tip) == len(after.cut)


def great_circles(corners: np.ndarray, closed: bool, steps: int = 60) -> np.ndarray:
    """Return points (n, 3) along the great circles between ``corners`` (k, 3) on the unit sphere."""
    points = []
    for a, b in pairwise([*corners, corners[0]] if closed else [*corners]):
        angle = np.arccos(np.clip(a @ b, -1, 1))
        t = np.linspace(0.0, 1.0, max(2, int(angle * steps)) + 1)[:-1, None]
        points.append((np.sin((1 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle))
    return np.concatenate(points if closed else [*points, corners[-1:]])


def data_mesh(name: str) -> Mesh:
    """Return a mesh of the data folder; its test is skipped where there is none."""
    folder = os.environ.get("CPMKIT_DATA")
    if not folder or not (Path(folder) / name).exists():
        pytest.skip(f"{name} is in the folder that CPMKIT_DATA names, which is not set or lacks it.")
    lines = (Path(folder) / name).read_text().splitlines()
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], dtype=float)
    corners = [[part.split("/")[0] for part in line.split()[1:]] for line in lines if line.startswith("f ")]
    return Mesh.of(vertices, np.array(corners, dtype=np.int64) - 1)


def grid_mesh(points: np.ndarray, twisted: bool = False, round_too: bool = False) -> Mesh:
    """Return the triangles of a grid of points (n, k, 3), closed along its first axis.

    It is closed ``twisted`` as a Moebius band is, or closed along the second axis as well.
    """
    n, k = points.shape[:2]
    i, j = np.meshgrid(np.arange(n), np.arange(k if round_too else k - 1), indexing="ij")

    def number(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return (i % n) * k + (np.where(i < n, j, k - 1 - j) if twisted else j) % k

    corners = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)]
    cells = [np.stack([corners[0], corners[a], corners[a + 1]], axis=-1).reshape(-1, 3) for a in (1, 2)]
    return Mesh.of(points.reshape(-1, 3), np.concatenate(cells).astype(np.int64))


def tube(radius: float, around: int = 24, length: float = 1.0, along: int = 80) -> Mesh:
    """Return a limb, open at both ends, along z."""
    angle, z = np.meshgrid(2 * np.pi * np.arange(around) / around, np.linspace(0, length, along + 1), indexing="ij")
    return grid_mesh(np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1))


def torus() -> Mesh:
    """Return the torus of radii 1 and 0.4 about z."""
    a, b = np.meshgrid(2 * np.pi * np.arange(60) / 60, 2 * np.pi * np.arange(30) / 30, indexing="ij")
    away = 1 + 0.4 * np.cos(b)
    return grid_mesh(np.stack([away * np.cos(a), away * np.sin(a), 0.4 * np.sin(b)], axis=-1), round_too=True)


def moebius_band() -> Mesh:
    """Return a band of half width 0.35 about the unit circle, its core, that is twisted once."""
    a, s = np.meshgrid(2 * np.pi * np.arange(80) / 80, np.linspace(-0.35, 0.35, 11), indexing="ij")
    away = 1 + s * np.cos(a / 2)
    return grid_mesh(np.stack([away * np.cos(a), away * np.sin(a), s * np.sin(a / 2)], axis=-1), twisted=True)
