"""Sources on which ``cpmkit.testing`` checks the laws, with points on them from formulas written anew in NumPy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cpmkit.plugin import ConformanceCase, Floats
from cpmkit_parametric import factories, shapes
from cpmkit_parametric.sources import Parametric

ANGLES = (0.0, 2 * np.pi)
FIGURE_EIGHT = {"x": ["sin(t)", "sin(2*t)/2"], "range": ANGLES, "periodic": True}
SHARP_CURVE = {"x": ["t", "sqrt(t**2 + 0.0004)"], "range": [-1.0, 1.0]}
SADDLE_SHEET = {"x": ["u", "v", "(u**2 - v**2)/2"], "u": [-1, 1], "v": [-0.5, 0.5]}


def conformance_cases() -> list[ConformanceCase]:
    """Return cases of all kinds: bounded, periodic, twisted, self-intersecting, tiny and far from zero."""
    return [
        _case(
            "curve", "circle", {"x": ["cos(t)", "sin(t)"], "range": ANGLES, "periodic": True}, _circle_points, ANGLES
        ),
        _case("curve", "figure eight", FIGURE_EIGHT, lambda t: [np.sin(t), 0.5 * np.sin(2 * t)], ANGLES),
        _case("curve", "sharply curved", SHARP_CURVE, lambda t: [t, np.hypot(t, 0.02)], (-1.0, 1.0)),
        _case("curve", "callable", {"x": _twisted_cubic, "range": [-1, 1]}, lambda t: [t, t**2, t**3], (-1.0, 1.0)),
        _case("torus_knot", "of the paper", {}, _knot_points, ANGLES),
        _case("helix", "two turns", {}, _helix_points, (0.0, 4 * np.pi)),
        _case("helix", "far from zero", {"translation": [1e9, -1e9, 5e8]}, _helix_points, (0.0, 4 * np.pi)),
        _case("planar_curve", "of the paper", {}, _planar_points, ANGLES),
        _case(
            "surface",
            "saddle with four sides",
            SADDLE_SHEET,
            lambda u, v: [u, v, (u * u - v * v) / 2],
            (-1, 1),
            (-0.5, 0.5),
        ),
        _case("surface", "torus of a micrometre", {**_torus_keys(), "periodic_v": True}, _torus_points, ANGLES, ANGLES),
        _case("surface", "cylinder from a callable", _cylinder_keys(), _cylinder_points, ANGLES, (0.0, 1.0)),
        _case("revolution", "sphere", _meridian_keys(-0.5), _sphere_points, ANGLES, (-0.5 * np.pi, 0.5 * np.pi)),
        _case("revolution", "cap", _meridian_keys(0.1), _sphere_points, ANGLES, (0.1 * np.pi, 0.5 * np.pi)),
        _case("moebius", "of half width 0.35", {}, _moebius_points, ANGLES, (-0.35, 0.35)),
        _case("klein", "figure eight", {}, _klein_points, ANGLES, ANGLES),
    ]


def _case(
    shape: str, name: str, keys: dict[str, Any], points: Callable[..., list[Floats]], *ranges: tuple[float, float]
) -> ConformanceCase:
    """Return the case ``name`` of ``parametric.{shape}``; samples are ``points`` at parameters drawn in ``ranges``."""
    factory: Callable[..., Parametric] = getattr(shapes, shape, None) or getattr(factories, shape)

    def samples(rng: np.random.Generator, n: int) -> Floats:
        drawn = np.stack(points(*[rng.uniform(*ends, n) for ends in ranges]), axis=1)
        moved: Floats = drawn + np.asarray(keys.get("translation", 0.0))
        return moved

    return ConformanceCase(f"parametric.{shape}", name, lambda: factory(**keys), samples)


def _circle_points(t: Floats) -> list[Floats]:
    return [np.cos(t), np.sin(t)]


def _twisted_cubic(t: Floats) -> Floats:
    return np.stack([t, t**2, t**3], axis=1)


def _knot_points(t: Floats) -> list[Floats]:
    v = 3 + np.cos(7 * t)
    return [v * np.cos(3 * t), v * np.sin(3 * t), np.sin(7 * t)]


def _helix_points(t: Floats) -> list[Floats]:
    return [np.cos(t), np.sin(t), t / (2 * np.pi)]


def _planar_points(t: Floats) -> list[Floats]:
    v = (np.cos(t) * (3.5 + np.sin(3 * t) + np.sin(4 * t)) + 3.5) / 7
    return [v * np.cos(t) - 0.5, v * np.sin(t) - 0.5]


def _torus_keys() -> dict[str, Any]:
    around = "(1e-6 + 4e-7*cos(v))"
    x = [f"{around}*cos(u)", f"{around}*sin(u)", "4e-7*sin(v)"]
    return {"x": x, "u": [0, "2*pi"], "v": [0, "2*pi"], "periodic_u": True}


def _torus_points(u: Floats, v: Floats) -> list[Floats]:
    around = 1 + 0.4 * np.cos(v)
    return [1e-6 * around * np.cos(u), 1e-6 * around * np.sin(u), 4e-7 * np.sin(v)]


def _cylinder_keys() -> dict[str, Any]:
    return {"x": lambda u, v: np.stack(_cylinder_points(u, v), axis=1), "u": ANGLES, "v": [0, 1], "periodic_u": True}


def _cylinder_points(u: Floats, v: Floats) -> list[Floats]:
    return [np.cos(u), np.sin(u), v]


def _meridian_keys(lowest_latitude: float) -> dict[str, Any]:
    """Return the keys of the part of the unit sphere above ``lowest_latitude``, in units of pi, for ``revolution``."""
    return {"profile": ["cos(t)", "sin(t)"], "range": [f"{lowest_latitude}*pi", "0.5*pi"]}


def _sphere_points(u: Floats, v: Floats) -> list[Floats]:
    return [np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)]


def _moebius_points(u: Floats, v: Floats) -> list[Floats]:
    around = 1 + v * np.cos(u / 2)
    return [around * np.cos(u), around * np.sin(u), v * np.sin(u / 2)]


def _klein_points(u: Floats, v: Floats) -> list[Floats]:
    around = 2 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    height = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    return [around * np.cos(u), around * np.sin(u), height]
