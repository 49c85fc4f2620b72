"""A tilted square plate in space, and curves on it that bound zones with a solution each."""

from __future__ import annotations

from typing import Any

import numpy as np

import cpmkit as ck

#: Rows: the plate's two axes and its normal.
FRAME = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
FRAME[2] = np.cross(FRAME[0], FRAME[1])
_CORNERS = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
PLATE = ck.source(
    "mesh.triangles", vertices=_CORNERS @ FRAME, faces=np.array([[0, 1, 2], [0, 2, 3]]), closest="faceted"
)
POINTS = np.pad(np.random.default_rng(0).uniform(-1, 1, (4000, 2)), ((0, 0), (0, 1))) @ FRAME


def flat(x: Any) -> np.ndarray:
    """The two coordinates (n, 2) of points (n, 3) on the plate."""
    return np.asarray(x) @ FRAME[:2].T


def segment(start: Any, end: Any) -> Any:
    return ck.source("analytic.segment", start=np.asarray(start) @ FRAME[:2], end=np.asarray(end) @ FRAME[:2])


def in_zone(zone: int, x: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Value, gradient (n, 2) and Laplacian of sin(2 u + zone) + .3 zone v^2 + .4 zone."""
    u, v = flat(x).T
    value = np.sin(2 * u + zone) + 0.3 * zone * v**2 + 0.4 * zone
    slope = np.stack([2 * np.cos(2 * u + zone), 0.6 * zone * v], axis=1)
    return value, slope, -4 * np.sin(2 * u + zone) + 0.6 * zone


def zoned(zone_of: Any, count: int, which: int) -> Any:
    """A function of points: value or Laplacian by zone."""

    def at(x: Any) -> Any:
        zone = zone_of(x)
        return np.select([zone == k for k in range(count)], [in_zone(k, x)[which] for k in range(count)])

    return at


def junction(angles: Any, materials: Any) -> tuple[Any, Any]:
    """Curves from the middle to the rim at these angles, a zone after each; the scene, and its solution."""
    angles, materials = np.asarray(angles), np.asarray(materials, dtype=float)
    count = len(angles)

    def zone_of(x: Any) -> Any:
        turned = np.mod(np.arctan2(*flat(x).T[::-1]) - angles[0], 2 * np.pi)
        return np.searchsorted(angles - angles[0], turned, side="right") - 1

    def arm(left: int) -> Any:
        right, along = (left - 1) % count, np.array([np.cos(angles[left]), np.sin(angles[left])])
        out = np.array([along[1], -along[0]])

        def jump(x: Any) -> Any:
            return in_zone(left, x)[0] - in_zone(right, x)[0]

        def flux(x: Any) -> Any:
            return materials[left] * (in_zone(left, x)[1] @ out) - materials[right] * (in_zone(right, x)[1] @ out)

        line = segment(np.zeros(2), along / np.abs(along).max())
        return ck.Boundary(f"arm {left}", line, across=ck.Transmission(jump, flux))

    value, laplacian = zoned(zone_of, count, 0), zoned(zone_of, count, 2)
    problem = ck.Elliptic(
        lambda x: value(x) - materials[zone_of(x)] * laplacian(x), diffusivity=lambda x: materials[zone_of(x)], c=1.0
    )
    return ck.Scene(PLATE, problem, [arm(k) for k in range(count)], edge=ck.Dirichlet(value)), value


def strips(*places: float) -> tuple[Any, Any]:
    """Lines u = place, upwards, with the values of their zones on their sides; the scene, and its solution."""

    def zone_of(x: Any) -> Any:
        return np.searchsorted(places, flat(x)[:, 0])

    def line(k: int) -> Any:
        sides = [ck.Dirichlet(lambda x, zone=zone: in_zone(zone, x)[0]) for zone in (k, k + 1)]
        return ck.Boundary(f"line {k}", segment([places[k], -1], [places[k], 1]), left=sides[0], right=sides[1])

    value, laplacian = (zoned(zone_of, len(places) + 1, which) for which in (0, 2))
    problem = ck.ScreenedPoisson(lambda x: value(x) - laplacian(x))
    return ck.Scene(PLATE, problem, [line(k) for k in range(len(places))], edge=ck.Dirichlet(value)), value


def slit(kind: str) -> tuple[Any, Any]:
    """A slit from the rim to the middle, -Lap u = 0: sqrt(r) sin(t/2) with zero flux, sqrt(r) cos(t/2) with zero u."""
    wave, condition = {"flux": (np.sin, ck.Neumann(0.0)), "value": (np.cos, ck.Dirichlet(0.0))}[kind]

    def value(x: Any) -> Any:
        u, v = flat(x).T
        return np.sqrt(np.hypot(u, v)) * wave(0.5 * np.arctan2(v, u))

    slits = [ck.Boundary("slit", segment([-1, 0], [0, 0]), both=condition)]
    return ck.Scene(PLATE, ck.Laplace(), slits, edge=ck.Dirichlet(value)), value


def solved(scene: Any, spacing: float, shift: int = 0, **options: Any) -> Any:
    origin = np.random.default_rng(shift).uniform(0, spacing, 3)
    return ck.solve(scene, spacing, **{"form": "galerkin", "solver": "direct", "origin": origin, **options})


def off(solution: Any, value: Any, at: Any = POINTS) -> tuple[float, float]:
    """The largest error and the root mean square, over the solution's range."""
    exact = value(at)
    error = (solution.evaluate(at) - exact) / np.ptp(exact)
    return float(np.abs(error).max()), float(np.sqrt(np.mean(error**2)))
