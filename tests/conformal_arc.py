"""A slit in the plane, mapped to an arc of a small circle on the sphere: Laplace's equation goes with it.

With the inverse w of Joukowski's map, w + 1/w = 2 z, for z the slit's own coordinate: Re w is z on the slit, and Im w
has slope 1 across it, on both sides; both have square roots at its ends.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from model_problems import rotation

import cpmkit as ck

HALF, HEIGHT = 0.5, 0.3
_TURN = rotation()


def on_sphere(generator: np.random.Generator, count: int) -> np.ndarray:
    points = generator.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1)[:, None]


def _plane(x: Any) -> np.ndarray:
    """Stereographic coordinates."""
    p = np.asarray(x) @ _TURN
    return (p[:, 0] + 1j * p[:, 1]) / np.maximum(1 - p[:, 2], 1e-300)


def _sphere(z: np.ndarray) -> np.ndarray:
    squared = np.abs(z) ** 2
    return np.stack([2 * z.real, 2 * z.imag, squared - 1], axis=1) / (squared + 1)[:, None] @ _TURN.T


def _inverse(x: Any) -> np.ndarray:
    z = (_plane(x) - 1j * HEIGHT) / HALF
    return 1 / (z + np.sqrt(z - 1) * np.sqrt(z + 1))


def arc_scene(kind: str) -> tuple[Any, Any]:
    """The scene, and its solution: "value" is Re w, held on both sides, "flux" Im w, up to a constant."""
    arc = ck.source("mesh.polyline", points=_sphere(np.linspace(-HALF, HALF, 3001) + 1j * HEIGHT))
    if kind == "value":
        sides = {"both": ck.Dirichlet(lambda x: _inverse(x).real)}
        solution = lambda x: _inverse(x).real  # noqa: E731
    else:

        def slope(x: Any) -> np.ndarray:
            return (1 + np.abs(_plane(x)) ** 2) / (2 * HALF)

        sides = {"left": ck.Neumann(slope), "right": ck.Neumann(lambda x: -slope(x))}
        solution = lambda x: _inverse(x).imag  # noqa: E731
    scene = ck.Scene(ck.source("analytic.sphere"), ck.Poisson(0.0), [ck.Boundary("arc", arc, **sides)])
    return scene, solution
