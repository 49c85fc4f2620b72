"""Combinations on which ``cpmkit.testing`` checks the laws; they need the plugin cpmkit-analytic."""

from __future__ import annotations

from typing import Any

from cpmkit.combinations.motion import moved
from cpmkit.combinations.solid import solid
from cpmkit.combinations.union import union
from cpmkit.plugins import source
from cpmkit.testing import ConformanceCase


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
    ]


def mixed_union() -> Any:
    """Return the object of mixed codimension of King et al. (2024), section 7.1, at a fifth of its size."""
    torus = source("analytic.torus", major=0.6, minor=0.2)
    segments = [source("analytic.segment", start=[sign * 0.25, 0, 0], end=[sign * 0.4, 0, 0]) for sign in (-1.0, 1.0)]
    return union(members=[torus, source("analytic.sphere", radius=0.25), *segments])


def _circle(radius: float) -> Any:
    return source("analytic.circle", radius=radius)


def _tilted(of: Any) -> Any:
    return moved(of=of, rotation=[0.3, -1.1, 0.7], translation=[4.0, -2.0, 7.0], scale=3.0)
