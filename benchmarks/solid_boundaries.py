"""Scenes of solids.py with boundaries inside a solid, and their exact solutions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from solid_shapes import POINTS, SMOOTH, Function

import cpmkit as ck

Scene = tuple[ck.Scene, Function, Any]


@dataclass(frozen=True)
class BoundaryScene:
    """A scene by its position, with u and points at which errors are read; ``norm`` of their differences."""

    name: str
    data: str
    spacings: tuple[float, ...]
    placed: Callable[[int], Scene]
    norm: Callable[[Any], Any] = np.max
    options: Mapping[str, Any] = field(default_factory=dict)  #: Options of the Galerkin form.


def _turn(dim: int, position: int) -> Any:
    """Return a rotation (d, d), random but at position 0."""
    angle = np.random.default_rng(position).normal(size=3) * (position > 0)
    return Rotation.from_rotvec(angle if dim == 3 else [0, 0, angle[0]]).as_matrix()[:dim, :dim]


def _inside(source: Any) -> Any:
    """Return points inside a solid."""
    x = np.random.default_rng(1).uniform(*source.bounds, (4 * POINTS, source.dim))
    return x[source.closest_point(x).edge < 0][:POINTS]


def _ball(dim: int) -> Any:
    return ck.source("solid", of=ck.source("analytic.circle" if dim == 2 else "analytic.sphere"))


def _round(dim: int, center: list[float], radius: float, data: str) -> Callable[[int], Scene]:
    """Return the unit ball with a circle or sphere, inside which u is larger by 1: both values, or the jump, given."""

    def placed(position: int) -> Scene:
        at = _turn(dim, position) @ np.array(center)

        def is_in(x: Any) -> Any:
            return np.linalg.norm(x - at, axis=1) < radius

        def exact(x: Any) -> Any:
            return SMOOTH.u(x) + is_in(x)

        inner, outer = ck.Dirichlet(lambda x: SMOOTH.u(x) + 1), ck.Dirichlet(SMOOTH.u)
        names = ("left", "right") if dim == 2 else ("right", "left")
        jump = ck.Transmission(jump=1.0 if dim == 2 else -1.0)
        given = dict(zip(names, (inner, outer), strict=True)) if data == "Dirichlet" else {"across": jump}
        source = ck.source("analytic.circle" if dim == 2 else "analytic.sphere", radius=radius, center=at)
        problem, solid = ck.ScreenedPoisson(lambda x: SMOOTH.load(x) + is_in(x)), _ball(dim)
        scene = ck.Scene(solid, problem, [ck.Boundary("round", source, **given)], edge=ck.Dirichlet(exact))
        return scene, exact, _inside(solid)

    return placed


def _membrane(dim: int, inner: float, resistance: float) -> Callable[[int], Scene]:
    """Return the unit ball of conductivity 1, and ``inner`` within radius .5 behind a membrane, heated evenly."""

    def placed(_: int) -> Scene:
        def exact(x: Any) -> Any:
            r = np.linalg.norm(x, axis=1)
            centre = 0.75 / (2 * dim) + 0.5 * resistance / dim + 0.25 / (2 * dim * inner)
            return np.where(r < 0.5, centre - r**2 / (2 * dim * inner), (1 - r**2) / (2 * dim))

        def conductivity(x: Any) -> Any:
            return np.where(np.linalg.norm(x, axis=1) < 0.5, inner, 1.0)

        source = ck.source("analytic.circle" if dim == 2 else "analytic.sphere", radius=0.5)
        membrane = ck.Boundary("membrane", source, across=ck.Transmission(resistance=resistance))
        problem, solid = ck.Elliptic(f=1.0, diffusivity=conductivity), _ball(dim)
        return ck.Scene(solid, problem, [membrane], edge=ck.Dirichlet(0.0)), exact, _inside(solid)

    return placed


def _crack(position: int) -> Scene:
    """Return a square with an insulated crack, at whose tip u is sqrt(r) sin(theta / 2)."""
    turn, tip = _turn(2, position), np.array([0.07, 0.03])

    def exact(x: Any) -> Any:
        y = (x - tip) @ turn
        return np.sqrt(np.hypot(*y.T)) * np.sin(np.arctan2(y[:, 1], y[:, 0]) / 2)

    square = ck.source("analytic.box", lower=[-1.0, -1.0], upper=[1.0, 1.0])
    curve = ck.source("mesh.polyline", points=[tip - 3 * turn[:, 0], tip])
    crack = ck.Boundary("crack", curve, both=ck.Neumann(0.0))
    return ck.Scene(square, ck.Laplace(), [crack], edge=ck.Dirichlet(exact)), exact, _inside(square)


def _rms(errors: Any) -> Any:
    return np.sqrt(np.mean(errors**2))


DISK, BALL = (0.2, 0.1, 0.05), (0.4, 0.2, 0.1)
#: Name, dimension, spacings, centre and radius of scenes with a circle or sphere in or across the unit ball.
ROUND = (
    ("circle in a disk", 2, DISK, [0.1, 0.05], 0.5),
    ("arc across a disk", 2, DISK, [1.0, 0.05], 1.0),
    ("sphere in a ball", 3, BALL, [0.1, 0.05, 0.0], 0.5),
    ("sphere across a ball", 3, BALL, [1.0, 0.05, 0.0], 1.0),
)
SCENES = [
    *(
        BoundaryScene(name, data, spacings, _round(dim, center, radius, data))
        for name, dim, spacings, center, radius in ROUND
        for data in ("Dirichlet", "jump")
    ),
    BoundaryScene("membrane in a disk", "resistance", DISK, _membrane(2, 1.0, 1.0)),
    BoundaryScene("membrane in a ball", "resistance", BALL, _membrane(3, 1.0, 1.0)),
    BoundaryScene("two materials in a disk", "1000 to 1", DISK, _membrane(2, 1e3, 0.0)),
    BoundaryScene("crack in a square", "Neumann, rms", DISK, _crack, _rms),
    BoundaryScene('crack, `tips="singular"`', "Neumann, rms", DISK, _crack, _rms, {"tips": "singular"}),
]
