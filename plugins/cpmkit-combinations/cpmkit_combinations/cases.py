"""Combinations on which ``cpmkit.testing`` checks the laws; they need the plugin cpmkit-analytic."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from cpmkit.plugin import ConformanceCase, Floats, source
from cpmkit_combinations.cut import function_cut, plane_cut
from cpmkit_combinations.moved import moved_source
from cpmkit_combinations.points import points
from cpmkit_combinations.solid import solid
from cpmkit_combinations.trimmed import trimmed_source
from cpmkit_combinations.tube import tube
from cpmkit_combinations.union import union

Draw = Callable[[np.random.Generator, int], Floats]

SPOT_POINTS = np.array([[0.3, -1.0, 2.0], [0.0, 0.0, 0.5], [1.0, 1.0, 1.0], [-2.0, 0.4, 0.1]])


def conformance_cases() -> list[ConformanceCase]:
    """Return cases of every kind of this distribution."""
    return [
        ConformanceCase("union", "a torus, a sphere and the segments that join them", mixed_union),
        ConformanceCase("union", "two circles", lambda: union(members=[_circle(1.0), _circle(3.0)])),
        ConformanceCase("moved", "torus", lambda: _tilt(source("analytic.torus", minor=0.3))),
        ConformanceCase("moved", "union", lambda: _tilt(mixed_union())),
        ConformanceCase(
            "moved", "arc", lambda: moved_source(of=source("analytic.arc", start=0, end=2), translation=[7, 7])
        ),
        ConformanceCase("solid", "disc", lambda: solid(of=_circle(2.0))),
        ConformanceCase("solid", "annulus", lambda: solid(of=union(members=[_circle(1.0), _circle(3.0)]))),
        ConformanceCase("solid", "full torus", lambda: solid(of=source("analytic.torus", minor=0.3))),
        ConformanceCase("tube", "round a circle, a torus", lambda: tube(around=_ring(), radius=0.3), _tube_points),
        ConformanceCase("tube", "round a segment", lambda: tube(around=_rod(3), radius=0.5)),
        ConformanceCase("tube", "both offsets of a circle", lambda: tube(around=_circle(2.0), radius=0.5)),
        ConformanceCase("tube", "offset of a segment, closed", lambda: tube(around=_rod(2), radius=0.5)),
        _case("points", "in the plane", lambda: points(at=SPOT_POINTS[:, :2]), _spots),
        _case("points", "in space, far from zero", lambda: points(at=1e9 + SPOT_POINTS)),
        _case("cut.plane", "sphere, one loop", lambda: plane_cut(surface=_sphere(), **_SLICE), _sphere_cut),
        _case("cut.plane", "torus, two loops", lambda: plane_cut(surface=_torus(), point=[0, 0, 0], normal=[0, 0, 1])),
        _case("cut.plane", "cylinder, two open pieces", _open_pieces),
        _case(
            "cut.plane",
            "circle, two points",
            lambda: plane_cut(surface=_unit_circle(), point=[0.2, 0], normal=[1, 0.3]),
        ),
        _case("cut.function", "torus", lambda: function_cut(surface=_torus(), phi="z - 0.2 * sin(3 * x)")),
        _case("cut.function", "curve in space", _points_of_curve),
        _case("trimmed", "sphere to a cap", lambda: trimmed_source(of=_sphere(), trim="0.3 - z"), _cap(0.3)),
        _case("trimmed", "torus with two edges", lambda: trimmed_source(of=_torus(), trim="x - 0.3"), _torus_part),
        _case("trimmed", "cylinder across its rims", _across_rims, _cylinder_part),
        _case("trimmed", "circle to an arc", lambda: trimmed_source(of=_unit_circle(), trim="0.2 - x - y"), _arc),
        _case("trimmed", "arc with an end of its own", _shorter_arc),
    ]


def mixed_union() -> Any:
    """Return the object of mixed codimension of King et al. (2024), section 7.1, at a fifth of its size."""
    torus = source("analytic.torus", major=0.6, minor=0.2)
    segments = [source("analytic.segment", start=[sign * 0.25, 0, 0], end=[sign * 0.4, 0, 0]) for sign in (-1.0, 1.0)]
    return union(members=[torus, source("analytic.sphere", radius=0.25), *segments])


def _ring() -> Any:
    return source("analytic.circle", normal=[0, 0, 1])


def _rod(dim: int) -> Any:
    return source("analytic.segment", start=[0.0] * dim, end=[2.0, 1.0, 0.5][:dim])


def _tube_points(rng: np.random.Generator, n: int) -> Floats:
    """Return ``n`` random points (n, 3) of the torus of radii 1 and 0.3 about the z axis."""
    u, v = rng.uniform(0, 2 * np.pi, (2, n))
    around = 1 + 0.3 * np.cos(v)
    return np.stack([around * np.cos(u), around * np.sin(u), 0.3 * np.sin(v)], axis=1)


def _circle(radius: float) -> Any:
    return source("analytic.circle", radius=radius)


def _tilt(of: Any) -> Any:
    return moved_source(of=of, rotation=[0.3, -1.1, 0.7], translation=[4.0, -2.0, 7.0], scale=3.0)


def _case(kind: str, name: str, make: Callable[[], Any], samples: Draw | None = None) -> ConformanceCase:
    """Return a conformance case whose source ``make`` creates once, with ``samples`` that draw points of it."""
    return ConformanceCase(kind, name, cache(make), samples)


_SLICE: dict[str, Any] = {"point": [0.0, 0.0, 0.6], "normal": [0.0, 0.0, 2.0]}


def _sphere() -> Any:
    return source("analytic.sphere")


def _torus() -> Any:
    return source("analytic.torus")


def _unit_circle() -> Any:
    return source("analytic.circle", center=[0.0, 0.0])


def _open_pieces() -> Any:
    return plane_cut(surface=source("analytic.cylinder"), point=[0.1, 0, 0], normal=[1, 0.4, 0.2])


def _points_of_curve() -> Any:
    return function_cut(surface=source("analytic.circle", normal=[1, 2, 3]), phi="x * y - 0.1")


def _across_rims() -> Any:
    return trimmed_source(of=source("analytic.cylinder"), trim="x + 0.2 * z - 0.3")


def _shorter_arc() -> Any:
    return trimmed_source(of=source("analytic.arc", start=0.3, end=5.0), trim="-0.5 - y")


def _spots(rng: np.random.Generator, n: int) -> Floats:
    return SPOT_POINTS[rng.integers(0, len(SPOT_POINTS), n), :2]


def _sphere_cut(rng: np.random.Generator, n: int) -> Floats:
    """Return ``n`` random points (n, 3) of the circle in which the plane z = 0.6 cuts the unit sphere."""
    angle = rng.uniform(0, 2 * np.pi, n)
    return np.stack([0.8 * np.cos(angle), 0.8 * np.sin(angle), np.full(n, 0.6)], axis=1)


def _cap(lowest: float) -> Draw:
    """Return a draw of random points of the unit sphere with z above ``lowest``."""

    def draw(rng: np.random.Generator, n: int) -> Floats:
        z, angle = rng.uniform(lowest, 1.0, n), rng.uniform(0, 2 * np.pi, n)
        around = np.sqrt(1 - z**2)
        return np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1)

    return draw


def _filter_draw(draw: Draw, keep: Callable[[Floats], Any]) -> Draw:
    """Return a draw of those points of ``draw`` that ``keep`` accepts, which must be one in eight or more."""

    def some(rng: np.random.Generator, n: int) -> Floats:
        drawn = draw(rng, 64 + 8 * n)
        return np.asarray(drawn[keep(drawn)][:n])

    return some


def _whole_torus(rng: np.random.Generator, n: int) -> Floats:
    """Return ``n`` random points (n, 3) of the torus of radii 1 and 0.4 about the z axis."""
    u, v = rng.uniform(0, 2 * np.pi, (2, n))
    around = 1.0 + 0.4 * np.cos(v)
    return np.stack([around * np.cos(u), around * np.sin(u), 0.4 * np.sin(v)], axis=1)


def _whole_cylinder(rng: np.random.Generator, n: int) -> Floats:
    angle, z = rng.uniform(0, 2 * np.pi, n), rng.uniform(-1.0, 1.0, n)
    return np.stack([np.cos(angle), np.sin(angle), z], axis=1)


def _whole_circle(rng: np.random.Generator, n: int) -> Floats:
    angle = rng.uniform(0, 2 * np.pi, n)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


_torus_part = _filter_draw(_whole_torus, lambda p: p[:, 0] <= 0.3)
_cylinder_part = _filter_draw(_whole_cylinder, lambda p: p[:, 0] + 0.2 * p[:, 2] <= 0.3)
_arc = _filter_draw(_whole_circle, lambda p: p[:, 0] + p[:, 1] >= 0.2)
