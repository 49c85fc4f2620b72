"""The solids of solids.py with their outward normals, and solutions that are known in all of space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import solid_problems
from scipy.spatial.transform import Rotation

import cpmkit as ck

Function = Callable[[Any], Any]
CONDITIONS = ("Dirichlet", "Neumann", "Robin")
#: Points at which errors are read.
POINTS = 3000
#: The gradient of the linear solution.
SLOPE = np.array([1.0, -2.0, 0.7])


@dataclass(frozen=True)
class Known:
    """A function u, its gradient, and the load -Lap u + u."""

    u: Function
    gradient: Function
    load: Function

    def condition(self, kind: str, normal: Function) -> Any:
        """Return what holds on a boundary with these normals."""

        def flux(x: Any) -> Any:
            return np.sum(self.gradient(x) * normal(x), axis=1)

        if kind == "Dirichlet":
            return ck.Dirichlet(self.u)
        return ck.Neumann(flux) if kind == "Neumann" else ck.Robin(1.0, 2.0, lambda x: flux(x) + 2 * self.u(x))


def linear(x: Any) -> Any:
    return 0.3 + x @ SLOPE[: x.shape[1]]


SMOOTH = Known(solid_problems.u, solid_problems.gradient, solid_problems.f)
LINEAR = Known(linear, lambda x: np.tile(SLOPE[: x.shape[1]], (len(x), 1)), linear)


@dataclass(frozen=True)
class Solid:
    """A solid and the normals (n, d) at points of its boundary."""

    name: str
    source: Any
    normal: Function

    def placed(self, position: int) -> tuple[Any, Function, Any]:
        """Return the solid turned at random, its normals and points inside."""
        dim, rng = self.source.dim, np.random.default_rng(position)
        vector = Rotation.random(random_state=rng).as_rotvec() * ([0, 0, 1] if dim == 2 else 1)
        turn = Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
        source = ck.source("moved", of=self.source, rotation=float(vector[2]) if dim == 2 else vector)
        points = rng.uniform(*np.asarray(self.source.bounds), (POINTS, dim))
        points = points[self.source.closest_point(points).edge < 0]
        return source, lambda x: self.normal(x @ turn) @ turn.T, points @ turn.T

    def origin(self, spacing: float, position: int) -> Any:
        """Return an origin of the lattice."""
        return spacing * np.random.default_rng([position, 1]).uniform(size=self.source.dim)


def polygon(name: str, corners: Any) -> Solid:
    """Return what a polygon with corners (n, 2) to the left of its sides encloses."""
    start, side = np.asarray(corners, dtype=float), np.roll(corners, -1, axis=0) - np.asarray(corners)

    def normal(x: Any) -> Any:
        away = x[:, None] - start
        share = np.clip((away * side).sum(axis=2) / (side**2).sum(axis=1), 0, 1)
        nearest = np.linalg.norm(away - share[..., None] * side, axis=2).argmin(axis=1)
        return (side[:, ::-1] * [1, -1] / np.linalg.norm(side, axis=1)[:, None])[nearest]

    return Solid(name, ck.source("solid", of=ck.source("mesh.polyline", points=start, closed=True)), normal)


def box(name: str, *sides: float) -> Solid:
    """Return a box with its middle at the origin."""
    half = np.array(sides) / 2

    def normal(x: Any) -> Any:
        off = np.abs(x) - half
        return np.sign(x) * (off == off.max(axis=1, keepdims=True))

    return Solid(name, ck.source("analytic.box", lower=-half, upper=half), normal)


def enclosed(name: str, surface: Any) -> Solid:
    """Return what a circle or sphere around the origin encloses."""
    return Solid(name, ck.source("solid", of=surface), lambda x: x / np.linalg.norm(x, axis=1)[:, None])


DISK, BALL = (enclosed(name, ck.source(f"analytic.{kind}")) for name, kind in (("disk", "circle"), ("ball", "sphere")))
SQUARE, CUBE = box("square", 1.0, 1.0), box("cube", 1.0, 1.0, 1.0)
ELL = polygon("L", [[0, 0], [1, 0], [1, 0.5], [0.5, 0.5], [0.5, 1], [0, 1]])


def balls() -> list[Solid]:
    """Return the ball as a level set and as a closed mesh."""
    phi, bounds = "x**2 + y**2 + z**2 - 1", [[-1.3] * 3, [1.3] * 3]
    vertices, faces = ck.source("analytic.sphere").mesh(0.1)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    level_set = ck.source("levelset.expression", phi=phi, bounds=bounds)
    return [enclosed("ball as a level set", level_set), enclosed("ball as a closed mesh", mesh)]
