"""Combinations on which ``cpmkit.testing`` checks the laws; they need the plugin cpmkit-analytic."""

from __future__ import annotations

from typing import Any

import numpy as np

from cpmkit.plugin import ConformanceCase, Floats, source
from cpmkit_combinations.motion import moved
from cpmkit_combinations.solid import solid
from cpmkit_combinations.tube import tube
from cpmkit_combinations.union import union


def conformance_cases() -> list[ConformanceCase]:
    """Return cases of every kind of the core."""
    return [
        ConformanceCase("union", "a torus, a sphere and the segments that join them", mixed_union),
        ConformanceCase("union", "two circles", lambda: union(members=[_circle(1.0), _circle(3.0)])),
        ConformanceCase("moved", "torus", lambda: _tilted(source("analytic.torus", minor=0.3))),
        ConformanceCase("moved", "union", lambda: _tilted(mixed_union())),
        ConformanceCase("moved", "arc", lambda: moved(of=source("analytic.arc", start=0, end=2), translation=[7, 7])),
        ConformanceCase("solid", "disc", lambda: solid(of=_circle(2.0))),
        ConformanceCase("solid", "annulus", lambda: solid(of=union(members=[_circle(1.0), _circle(3.0)]))),
        ConformanceCase("solid", "full torus", lambda: solid(of=source("analytic.torus", minor=0.3))),
        ConformanceCase("tube", "round a circle, a torus", lambda: tube(around=_ring(), radius=0.3), _on_torus),
        ConformanceCase("tube", "round a segment", lambda: tube(around=_rod(3), radius=0.5)),
        ConformanceCase("tube", "both offsets of a circle", lambda: tube(around=_circle(2.0), radius=0.5)),
        ConformanceCase("tube", "offset of a segment, closed", lambda: tube(around=_rod(2), radius=0.5)),
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


def _on_torus(rng: np.random.Generator, n: int) -> Floats:
    u, v = rng.uniform(0, 2 * np.pi, (2, n))
    around = 1 + 0.3 * np.cos(v)
    return np.stack([around * np.cos(u), around * np.sin(u), 0.3 * np.sin(v)], axis=1)


def _circle(radius: float) -> Any:
    return source("analytic.circle", radius=radius)


def _tilted(of: Any) -> Any:
    return moved(of=of, rotation=[0.3, -1.1, 0.7], translation=[4.0, -2.0, 7.0], scale=3.0)
