"""Values that applications hold at points and along curves."""

from __future__ import annotations

from collections.abc import Callable

import cpmkit as ck
from cpmkit.protocols import ClosestPointSource, Floats


def hold_at(name: str, points: Floats, values: Floats) -> list[ck.Boundary]:
    """Return a boundary for each of the ``points`` (k, d) that holds its row of ``values`` (k, channels)."""
    return [
        ck.Boundary(f"{name}.{k}", ck.source("analytic.point", at=at), both=ck.Dirichlet(one.tolist()))
        for k, (at, one) in enumerate(zip(points, values, strict=True))
    ]


def hold_along(name: str, curve: ClosestPointSource, values: Callable[[Floats], Floats]) -> ck.Boundary:
    """Return a boundary that holds a function of points on both sides of a curve."""
    return ck.Boundary(name, curve, both=ck.Dirichlet(values))
