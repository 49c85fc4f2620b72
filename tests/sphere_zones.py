"""A sphere in two zones, each with its own material and polynomial solution, and a circle of it between them."""

from __future__ import annotations

from typing import Any

import numpy as np

import cpmkit as ck

AXIS = np.array([0.3, -0.5, 0.81])
AXIS /= np.linalg.norm(AXIS)
#: The circle's height over the equator of its axis.
HEIGHT = 0.3
SPHERE = ck.source("analytic.sphere")
CIRCLE = ck.source("analytic.circle", center=HEIGHT * AXIS, normal=AXIS, radius=np.sqrt(1 - HEIGHT**2))


def sphere_points(count: int = 2000, seed: int = 0) -> np.ndarray:
    found = np.random.default_rng(seed).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1)[:, None]


class Zone:
    """u = x y + .5 z^2 - .5 x^2 + shift, or u = .7 x z + .4 y + shift; harmonic polynomials of degrees 2 and 1."""

    def __init__(self, which: str, material: float) -> None:
        self.which, self.a = which, material

    def u(self, x: Any) -> Any:
        a, b, c = np.asarray(x).T
        return a * b + 0.5 * (c**2 - a**2) + 0.3 if self.which == "left" else 0.7 * a * c + 0.4 * b - 0.2

    def gradient(self, x: Any) -> Any:
        a, b, c = np.asarray(x).T
        if self.which == "left":
            return np.stack([b - a, a, c], axis=1)
        return np.stack([0.7 * c, np.full_like(a, 0.4), 0.7 * a], axis=1)

    def f(self, x: Any) -> Any:
        a, b, c = np.asarray(x).T
        if self.which == "left":
            return self.a * 6 * (a * b + 0.5 * (c**2 - a**2)) + self.u(x)
        return self.a * (6 * 0.7 * a * c + 2 * 0.4 * b) + self.u(x)

    def leftward(self, x: Any) -> Any:
        """The slope across the circle towards its left, where x . axis is larger."""
        x = np.asarray(x)
        v = (AXIS - (x @ AXIS)[:, None] * x) / np.sqrt(1 - HEIGHT**2)
        return np.einsum("kd,kd->k", self.gradient(x), v)


def on_left(x: Any) -> np.ndarray:
    return np.asarray(np.asarray(x) @ AXIS > HEIGHT)


def by_zone(left: Any, right: Any) -> Any:
    return lambda x: np.where(on_left(x), left(x), right(x))


def condition(kind: str, zone: Zone) -> Any:
    out = -1.0 if zone.which == "left" else 1.0
    if kind == "dirichlet":
        return ck.Dirichlet(zone.u)
    if kind == "neumann":
        return ck.Neumann(lambda x: out * zone.leftward(x))
    return ck.Robin(float(kind), 1.0, lambda x: float(kind) * out * zone.leftward(x) + zone.u(x))


def problem(zones: tuple[Zone, Zone]) -> Any:
    diffusivity = lambda x: np.where(on_left(x), zones[0].a, zones[1].a)  # noqa: E731
    return ck.Elliptic(by_zone(zones[0].f, zones[1].f), diffusivity=diffusivity, c=1.0)


def unlike(left: str, right: str, contrast: float = 1.0) -> Any:
    zones = Zone("left", 1.0), Zone("right", contrast)
    sides = {"left": condition(left, zones[0]), "right": condition(right, zones[1])}
    return ck.Scene(SPHERE, problem(zones), [ck.Boundary("C", CIRCLE, **sides)])


def coupled(contrast: float, resistance: float) -> Any:
    one, two = Zone("left", 1.0), Zone("right", contrast)

    def flux(x: Any) -> Any:  # a du/db of the left less that of the right, b out of the left
        return -one.a * one.leftward(x) + two.a * two.leftward(x)

    def jump(x: Any) -> Any:
        return one.u(x) - two.u(x) - resistance * 0.5 * (one.a * one.leftward(x) + two.a * two.leftward(x))

    across = ck.Transmission(jump, flux, resistance=resistance)
    return ck.Scene(SPHERE, problem((one, two)), [ck.Boundary("C", CIRCLE, across=across)])


exact = by_zone(Zone("left", 1.0).u, Zone("right", 1.0).u)
RANGE = np.ptp(exact(sphere_points(20000)))


def errors(solution: Any, at: Any) -> tuple[float, float]:
    """The largest error and the root mean square, over the solution's range."""
    off = (solution.evaluate(at) - exact(at)) / RANGE
    return float(np.abs(off).max()), float(np.sqrt(np.mean(off**2)))
