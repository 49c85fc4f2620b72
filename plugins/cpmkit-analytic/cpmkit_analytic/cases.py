"""Sources on which ``cpmkit.testing`` checks the laws, with points on them from their parametrisations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.plugin import ConformanceCase, Floats
from cpmkit_analytic import factories
from cpmkit_analytic.placed import Placed

Draw = Callable[[np.random.Generator, int], Floats]

TILTED = {"rotation": [0.3, -1.1, 0.7], "translation": [4.0, -2.0, 7.0], "scale": 3.0}
TURNED = {"rotation": 0.9, "translation": [40.0, -20.0], "scale": 0.01}


def conformance_cases() -> list[ConformanceCase]:
    """Return cases in the plane and in space, in canonical position, moved, tiny and far from zero."""
    everywhere, beyond = (0.0, 2 * np.pi), (0.7, 5.9)
    return [
        _case("point", "in the plane", {"at": [0.3, -2.0]}, _ring_sampler(0.0, everywhere, 2)),
        _case("point", "at the origin of space", {"at": [0, 0, 0]}, _ring_sampler(0.0, everywhere, 3)),
        _case("segment", "in the plane", {"start": [0, 0], "end": [2, 0], **TURNED}, _segment_sampler(2.0, 2)),
        _case("segment", "in space", {"start": [0, 0, 0], "end": [0, 0, 2], **TILTED}, _segment_sampler(2.0, 3)),
        _case("circle", "in the plane", {}, _ring_sampler(1.0, everywhere, 2)),
        _case("circle", "far from zero", {"center": [1e9, 1e9]}, _ring_sampler(1.0, everywhere, 2)),
        _case("circle", "in space", {"normal": [0, 0, 1], "radius": 0.5, **TILTED}, _ring_sampler(0.5, everywhere, 3)),
        _case("arc", "in the plane", {"start": 0.7, "end": 5.9, **TURNED}, _ring_sampler(1.0, beyond, 2)),
        _case(
            "arc", "in space", {"start": 0.7, "end": 5.9, "normal": [0, 0, 1], **TILTED}, _ring_sampler(1.0, beyond, 3)
        ),
        _case("sphere", "unit", {}, _sphere_sampler(1.0, -1.0)),
        _case("sphere", "of a micrometre", {"scale": 1e-6}, _sphere_sampler(1.0, -1.0)),
        _case("sphere", "in the plane", {"center": [0, 0], **TURNED}, _ring_sampler(1.0, everywhere, 2)),
        _case("cap", "small", {"height": 0.8}, _sphere_sampler(1.0, 0.8)),
        _case("cap", "nearly closed", {"height": -0.9, **TILTED}, _sphere_sampler(1.0, -0.9)),
        _case("torus", "upright", {"major": 2.0, "minor": 0.5}, _torus_sampler(2.0, 0.5)),
        _case("torus", "moved", {"minor": 0.9, **TILTED}, _torus_sampler(1.0, 0.9)),
        _case("cylinder", "upright", {"length": 3.0}, _cylinder_sampler(1.0, 3.0)),
        _case("box", "in the plane", {"lower": [-1, -2], "upper": [1, 2], **TURNED}, _box_sampler([1, 2])),
        _case("box", "in space", {"lower": [-1, -2, -3], "upper": [1, 2, 3], **TILTED}, _box_sampler([1, 2, 3])),
        _case("cylinder", "moved", {"radius": 2.0, "length": 0.5, **TILTED}, _cylinder_sampler(2.0, 0.5)),
    ]


def _case(shape: str, name: str, keys: dict[str, Any], draw: Draw) -> ConformanceCase:
    """Return the case ``name`` of ``analytic.{shape}`` with ``keys``; ``draw`` gives points in canonical position."""
    factory: Callable[..., Placed] = getattr(factories, shape)

    def make() -> Placed:
        return factory(**keys)

    def samples(rng: np.random.Generator, n: int) -> Floats:
        move, scale = make(), keys.get("scale", 1.0)
        points: Floats = move.center + scale * draw(rng, n) @ move.axes.T
        return points

    return ConformanceCase(f"analytic.{shape}", name, make, samples)


def _segment_sampler(length: float, dim: int) -> Draw:
    return lambda rng, n: rng.uniform(0, length, (n, 1)) * np.eye(dim)[0]


def _box_sampler(half: list[float]) -> Draw:
    return lambda rng, n: rng.uniform(-1, 1, (n, len(half))) * half


def _ring_sampler(radius: float, angles: tuple[float, float], dim: int) -> Draw:
    """Return a function that draws points (n, dim) of a circle between two angles, uniformly."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        angle = rng.uniform(*angles, n)
        return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(n)][:dim], axis=1)

    return draw


def _sphere_sampler(radius: float, lowest: float) -> Draw:
    """Return a function that draws points (n, 3) of a sphere above the height ``lowest``, uniformly (Archimedes)."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        z, angle = rng.uniform(lowest, radius, n), rng.uniform(0, 2 * np.pi, n)
        around = np.sqrt(radius**2 - z**2)
        return np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1)

    return draw


def _torus_sampler(major: float, minor: float) -> Draw:
    """Return a function that draws points (n, 3) of a torus around z, by uniform angles."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        u, v = rng.uniform(0, 2 * np.pi, (2, n))
        around = major + minor * np.cos(v)
        return np.stack([around * np.cos(u), around * np.sin(u), minor * np.sin(v)], axis=1)

    return draw


def _cylinder_sampler(radius: float, length: float) -> Draw:
    """Return a function that draws points (n, 3) of a cylinder around z, uniformly."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        angle, z = rng.uniform(0, 2 * np.pi, n), rng.uniform(-0.5 * length, 0.5 * length, n)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)

    return draw
