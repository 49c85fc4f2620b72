"""Level sets on which ``cpmkit.testing`` checks the laws, with points on them from parametrisations where there are."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cpmkit.plugin import ConformanceCase, Floats
from cpmkit_levelset import factories
from cpmkit_levelset.levelset import LevelSet

CUBE = [[-1.3, -1.3, -1.3], [1.3, 1.3, 1.3]]
TORUS = "(x**2 + y**2 + z**2 + 0.84)**2 - 4*(x**2 + y**2)"


def conformance_cases() -> list[ConformanceCase]:
    """Return cases of every kind: in the plane and in space, whole and trimmed, tiny, and known in closed form."""
    dome = {"phi": "x**2 + y**2 + z**2 - 1", "bounds": CUBE, "trim": "0.3 - z"}
    micrometre = {"phi": "(x*1e6)**2 + (y*1e6)**2 + (z*1e6)**2 - 1", "bounds": 1e-6 * np.array(CUBE)}
    ellipse = {"phi": "x**2/4 + y**2 - 1", "bounds": [[-2.2, -1.3], [2.2, 1.3]]}
    return [
        _case("expression", "sphere of a micrometre", micrometre, lambda rng, n: 1e-6 * _sphere_points(rng, n)),
        _case("expression", "torus", {"phi": TORUS, "bounds": [[-1.5, -1.5, -0.5], [1.5, 1.5, 0.5]]}, _torus_points),
        _case("expression", "ellipse in the plane", ellipse, _ellipse_points),
        _case("expression", "dome, trimmed", dome, _dome_points),
        _case("expression", "arc of an ellipse", {**ellipse, "trim": "x - y - 1"}, _arc_points),
        _case("callable", "ellipsoid", _ellipsoid_keys(), _ellipsoid_points),
        _case("grid", "ellipsoid", _grid_keys()),
        _case("dziuk", "whole", {}, _dziuk_points),
        _case("decotetrahedron", "whole", {}),
        _case("tooth", "whole", {}),
        _case("goursat", "tangle cube", {}),
    ]


def _case(kind: str, name: str, keys: dict[str, Any], samples: Any = None) -> ConformanceCase:
    """Return the case ``name`` of ``levelset.{kind}`` with ``keys``; ``samples(rng, n)`` draws points (n, d)."""
    factory = getattr(factories, "function" if kind == "callable" else kind)

    @cache  # the laws ask for the source again and again, and it is a value
    def make() -> LevelSet:
        made: LevelSet = factory(**keys)
        return made

    return ConformanceCase(f"levelset.{kind}", name, make, samples)


def _sphere_points(rng: np.random.Generator, n: int) -> Floats:
    z, angle = rng.uniform(-1, 1, n), rng.uniform(0, 2 * np.pi, n)
    around = np.sqrt(1 - z**2)
    return np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1)


def _dome_points(rng: np.random.Generator, n: int) -> Floats:
    points = _sphere_points(rng, 8 * n)
    return points[points[:, 2] >= 0.3][:n]


def _torus_points(rng: np.random.Generator, n: int) -> Floats:
    u, v = rng.uniform(0, 2 * np.pi, (2, n))
    around = 1 + 0.4 * np.cos(v)
    return np.stack([around * np.cos(u), around * np.sin(u), 0.4 * np.sin(v)], axis=1)


def _ellipse_points(rng: np.random.Generator, n: int) -> Floats:
    angle = rng.uniform(0, 2 * np.pi, n)
    return np.stack([2 * np.cos(angle), np.sin(angle)], axis=1)


def _arc_points(rng: np.random.Generator, n: int) -> Floats:
    points = _ellipse_points(rng, 4 * n)
    return points[points[:, 0] - points[:, 1] <= 1][:n]


def _dziuk_points(rng: np.random.Generator, n: int) -> Floats:
    points = _sphere_points(rng, n)
    points[:, 0] += points[:, 2] ** 2
    return points


AXES = np.array([1.0, 0.7, 0.5])


def _ellipsoid_points(rng: np.random.Generator, n: int) -> Floats:
    return AXES * _sphere_points(rng, n)


def _ellipsoid_keys() -> dict[str, Any]:
    """Return the keys of the ellipsoid with half axes ``AXES`` for ``levelset.callable``."""
    return {
        "phi": lambda p: (p**2 / AXES**2).sum(axis=1) - 1,
        "gradient": lambda p: 2 * p / AXES**2,
        "bounds": [[-1.1, -0.8, -0.6], [1.1, 0.8, 0.6]],
    }


def _grid_keys() -> dict[str, Any]:
    """Return the keys of a grid, with values of no polynomial: then those of the cells meet at a slight angle."""
    lower, spacing = np.array([-1.2, -0.9, -0.7]), 0.05
    nodes = lower + spacing * np.indices((49, 37, 29)).transpose(1, 2, 3, 0)
    phi = (nodes**2 / AXES**2).sum(axis=-1) - 1
    return {"values": phi / (1.5 + np.sin(nodes.sum(axis=-1))), "origin": lower, "spacing": spacing}
