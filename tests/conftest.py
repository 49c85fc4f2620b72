"""Solutions in closed form, with the interface of the real ones: what draws and writes needs no solver."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cpmkit.errors import InputError
from cpmkit.plugin import DisplayMesh
from cpmkit.solution.display_mesh import display_mesh


@dataclass(frozen=True, eq=False)
class MeshedSource:
    """A source of which only the mesh is asked."""

    points: np.ndarray
    cells: np.ndarray

    @property
    def dim(self) -> int:
        return self.points.shape[1]

    @property
    def manifold_dim(self) -> int:
        return self.cells.shape[1] - 1

    def mesh(self, spacing: float) -> tuple[np.ndarray, np.ndarray]:
        return self.points, self.cells

    def closest_point(self, x: np.ndarray) -> Any:
        nearest = np.argmin(((x[:, None] - self.points) ** 2).sum(axis=-1), axis=1)
        return SimpleNamespace(points=self.points[nearest])


class MixedSource(MeshedSource):
    """A source of triangles, segments and points: a cell with fewer corners ends in -1."""

    @property
    def manifold_dim(self) -> None:
        return None


@dataclass(frozen=True, eq=False)
class Line:
    """Where ``normal . x = offset`` in the plane; left is where it is above."""

    normal: Any
    offset: float

    @property
    def unit(self) -> np.ndarray:
        return np.asarray(self.normal) / np.linalg.norm(self.normal)

    def distance(self, x: np.ndarray) -> np.ndarray:
        return x @ self.unit - self.offset / np.linalg.norm(self.normal)

    def closest_point(self, x: np.ndarray) -> Any:
        return SimpleNamespace(points=x - self.distance(x)[:, None] * self.unit)


@dataclass(frozen=True, eq=False)
class ClosedFormSolution:
    """Piecewise values: ``value(points, signs)`` where column b of ``signs`` is the side of boundary b."""

    surface: Any
    boundaries: Mapping[str, tuple[Any, Callable[[np.ndarray], np.ndarray]]]
    value: Callable[[np.ndarray, np.ndarray], np.ndarray]
    spacing: float = 0.1
    channels: int = 1
    warnings: tuple[str, ...] = ()
    estimated: Any = None
    solve_history: Any = None
    batches: list[int] = field(default_factory=list)

    @property
    def error(self) -> Any:
        raise InputError("what has a closed form has no coarser lattice.")

    @property
    def scene(self) -> Any:
        boundaries = [SimpleNamespace(name=name, source=source) for name, (source, _) in self.boundaries.items()]
        problem = SimpleNamespace(kind="laplace")
        return SimpleNamespace(surface=self.surface, boundaries=boundaries, problem=problem, channels=self.channels)

    def signed_distance(self, name: str, points: np.ndarray) -> np.ndarray:
        return self.boundaries[name][1](points)

    def evaluate(self, points: np.ndarray, side: Mapping[str, str] | None = None) -> np.ndarray:
        self.batches.append(len(points))
        signs = np.ones((len(points), len(self.boundaries)))
        for column, (name, (_, distance)) in enumerate(self.boundaries.items()):
            signed = distance(points)
            signs[:, column] = np.where(signed < 0, -1.0, 1.0)
            if side and name in side:  # like a real solution, it has sides on the boundary alone
                signs[np.abs(signed) < 1e-3 * self.spacing, column] = 1.0 if side[name] == "left" else -1.0
        values = self.value(points, signs)
        return values if self.channels > 1 else values.reshape(len(points))

    def display_mesh(self) -> DisplayMesh:
        return display_mesh(self)

    @property
    def seconds(self) -> dict[str, float]:
        return {"build": 1.25, "solve": 2.5}

    @property
    def work(self) -> Any:
        return SimpleNamespace(unknowns=12345, ghosts=67)

    @property
    def report(self) -> Any:
        return SimpleNamespace(solver="direct", reason="relative residual 1e-12")

    def summary(self) -> dict[str, Any]:
        return {"spacing": self.spacing, "warnings": list(self.warnings)}

    def arrays(self) -> dict[str, np.ndarray]:
        return {"origin": np.zeros(3), "unknowns": np.arange(5.0)}


def torus_mesh(spacing: float, ring: float = 1.0, tube: float = 0.4) -> MeshedSource:
    m, n = (int(np.ceil(2 * np.pi * radius / spacing)) for radius in (ring, tube))
    u, v = (2 * np.pi * i / k for i, k in zip(np.divmod(np.arange(m * n), n), (m, n), strict=True))
    points = np.stack(
        [(ring + tube * np.cos(v)) * np.cos(u), (ring + tube * np.cos(v)) * np.sin(u), tube * np.sin(v)], 1
    )
    i, j = np.divmod(np.arange(m * n), n)
    a, b, c, d = (((i + di) % m) * n + (j + dj) % n for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)))
    return MeshedSource(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def square_mesh(cells: int) -> MeshedSource:
    """Return [0, 1]^2 in the plane."""
    side = np.linspace(0, 1, cells + 1)
    points = np.stack(np.meshgrid(side, side, indexing="ij"), -1).reshape(-1, 2)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    a, b, c, d = corner, corner + cells + 1, corner + cells + 2, corner + 1
    return MeshedSource(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


@pytest.fixture
def torus() -> Callable[..., ClosedFormSolution]:
    """Return a maker of colours on a torus that jump across a wave around the tube and an arc on it."""

    def make(spacing: float = 0.1, channels: int = 3) -> ClosedFormSolution:
        def turn(x: np.ndarray) -> np.ndarray:
            """Return the angle around the tube from the wave, between -pi and pi."""
            u, v = np.arctan2(x[:, 1], x[:, 0]), np.arctan2(x[:, 2], np.hypot(x[:, 0], x[:, 1]) - 1)
            return np.mod(v - 0.6 - 0.35 * np.sin(3 * u) + np.pi, 2 * np.pi) - np.pi

        def wave(x: np.ndarray) -> np.ndarray:
            slope = 0.4 * 1.05 * np.cos(3 * np.arctan2(x[:, 1], x[:, 0])) / np.hypot(x[:, 0], x[:, 1])
            return 0.4 * np.where(np.abs(turn(x)) < 1, turn(x), np.nan) / np.hypot(1, slope)

        def colour(x: np.ndarray, signs: np.ndarray) -> np.ndarray:
            angle = turn(x)
            angle += 2 * np.pi * np.where(np.abs(angle) < 1, signs[:, 0] < 0, angle < 0)
            share = angle[:, None] / (2 * np.pi)  # 0 on the left of the wave, 1 on its right
            rgb = (1 - share) * [0.95, 0.35, 0.1] + share * [0.1, 0.4, 0.9]
            return rgb if channels == 3 else np.repeat(rgb[:, :1], channels, 1)

        s = np.linspace(0, 2 * np.pi, 301)
        v = 0.6 + 0.35 * np.sin(3 * s)
        curve = np.stack([(1 + 0.4 * np.cos(v)) * np.cos(s), (1 + 0.4 * np.cos(v)) * np.sin(s), 0.4 * np.sin(v)], 1)[
            :-1
        ]
        steps = np.stack([np.arange(300), (np.arange(300) + 1) % 300], 1)
        boundaries = {"wave": (MeshedSource(curve, steps), wave)}
        return ClosedFormSolution(torus_mesh(spacing), boundaries, colour, spacing, channels)

    return make


@pytest.fixture
def square() -> Callable[..., ClosedFormSolution]:
    """Return a maker of solutions on the unit square whose values are the sides of straight boundaries."""

    def make(cells: int, distance: Any = None, **lines: tuple[Any, float]) -> ClosedFormSolution:
        made = {name: Line(*line) for name, line in lines.items()}
        boundaries = {name: (line, distance or line.distance) for name, line in made.items()}
        powers = 10.0 ** np.arange(len(lines))
        return ClosedFormSolution(square_mesh(cells), boundaries, lambda _, signs: signs @ powers, 1 / cells)

    return make


@pytest.fixture
def mixture() -> Callable[..., ClosedFormSolution]:
    """Return a maker of solutions on triangles, segments and points in space, whose value is the side of x = 0.37."""

    def make(channels: int = 1) -> ClosedFormSolution:
        plane = square_mesh(6)
        t = np.linspace(0.0, 1.0, 7)
        line = np.stack([t, np.full(7, 0.5), np.full(7, 0.4)], axis=1)
        cloud = np.random.default_rng(3).uniform(size=(200, 3)) * [1, 1, 0] + [0, 0, 0.8]
        first = len(plane.points)
        cells = [
            plane.cells,
            np.stack([np.arange(6), np.arange(1, 7), np.full(6, -1 - first)], axis=1) + first,
            np.stack([np.arange(200) + first + 7, np.full(200, -1), np.full(200, -1)], axis=1),
        ]
        points = np.concatenate([np.pad(plane.points, ((0, 0), (0, 1))), line, cloud])
        wall = Line([1, 0, 0], 0.37)
        return ClosedFormSolution(
            MixedSource(points, np.concatenate(cells)),
            {"wall": (wall, wall.distance)},
            lambda _, signs: np.repeat(signs, channels, axis=1),
            1 / 6,
            channels,
        )

    return make


EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture
def example(real_mesh: Callable[[str], Path]) -> Callable[..., Path]:
    """Return a finder of scene files in examples/, for scenes that need the named real meshes."""

    def find(name: str, *meshes: str) -> Path:
        for mesh in meshes:
            real_mesh(mesh)
        return EXAMPLES / name

    return find
