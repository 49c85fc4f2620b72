"""Values that applications hold at points and along curves, and how large and small they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import cpmkit as ck
from cpmkit.applications.curve_colours import Ramp
from cpmkit.protocols import ClosestPointSource, Floats, HasMesh


def hold_at(name: str, points: Floats, values: Floats) -> list[ck.Boundary]:
    """Return a boundary for each of the ``points`` (k, d) that holds its row of ``values`` (k, channels)."""
    return [
        ck.Boundary(f"{name}.{k}", ck.source("analytic.point", at=at), both=ck.Dirichlet(one.tolist()))
        for k, (at, one) in enumerate(zip(points, values, strict=True))
    ]


def hold_along(name: str, curve: ClosestPointSource, values: Callable[[Floats], Floats]) -> ck.Boundary:
    """Return a boundary that holds a function of points on both sides of a curve."""
    return ck.Boundary(name, curve, both=ck.Dirichlet(values))


def held_ends(scene: ck.Scene, spacing: float) -> Floats:
    """Return the least and the largest of three channels that conditions hold, (2, 3), within 0 and 1.

    Functions are read ``spacing`` apart. By the maximum principle a harmonic function is nowhere beyond, where other
    conditions let nothing pass; 0 and 1 where one does otherwise, or holds what is not read at points of a mesh.
    """
    found = [np.clip(one, 0.0, 1.0) for one in _held(scene, spacing)]
    if not found:
        return np.array([[0.0] * 3, [1.0] * 3])
    values = np.concatenate(found)
    return np.stack([values.min(axis=0), values.max(axis=0)])


def _held(scene: ck.Scene, spacing: float) -> Iterator[Floats]:
    """Yield the values (k, 3) of each condition, 0 and 1 where they are not known."""
    for boundary in scene.boundaries:
        for side in ("left", "right"):
            yield _values_of(boundary.condition(side), boundary.source, spacing)
    for condition in scene.edge_conditions:
        yield _values_of(condition, None, spacing)


def _values_of(condition: Any, curve: ClosestPointSource | None, spacing: float) -> Floats:
    unknown = np.array([[0.0] * 3, [1.0] * 3])
    datum = condition.data()[0][1] if len(condition.data()) == 1 else None
    if condition.kind == "neumann":
        return unknown[:0] if np.isscalar(datum) and datum == 0 else unknown
    if condition.kind != "dirichlet":
        return unknown
    if isinstance(datum, Ramp):
        return datum.stops.colours
    if callable(datum):
        if not isinstance(curve, HasMesh):
            return unknown
        datum = datum(curve.mesh(spacing)[0])
    else:
        datum = [datum]
    try:
        values = np.asarray(datum, dtype=np.float64)
    except (TypeError, ValueError):  # a formula, or a list of them
        return unknown
    return np.broadcast_to(values.reshape(len(values), -1), (len(values), 3))
