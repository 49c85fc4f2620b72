"""Shapes whose curvature is known: projectors on tangents and curvature for exact solutions, in every representation.

All is in local coordinates, where a shape is about 1 large and its axis is z; :class:`extremes.ambient.Place` moves it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from bare import Bare
from extremes.ambient import Place

import cpmkit as ck

TURN = 2 * np.pi


@dataclass(frozen=True)
class Shape:
    """A curve or surface: geometry at local points (n, d), and sources of it in several representations."""

    dim: ClassVar[int] = 3
    manifold_dim: ClassVar[int] = 2
    closed: ClassVar[bool] = True
    #: Representations, by name, that :meth:`source` makes.
    kinds: ClassVar[tuple[str, ...]] = ()

    def points(self, count: int, rng: Any) -> Any:
        """Return local points (count, d), uniform in measure."""
        raise NotImplementedError

    def normal(self, x: Any) -> Any:
        """Return unit normals (n, d) of a hypersurface."""
        raise NotImplementedError

    def bending(self, x: Any) -> Any:
        """Return the derivative of the unit normal along tangents, (n, d, d)."""
        raise NotImplementedError

    def projector(self, x: Any) -> Any:
        """Return projectors on tangents (n, d, d)."""
        n = self.normal(x)
        return np.eye(self.dim) - n[:, :, None] * n[:, None, :]

    def mean_vector(self, x: Any) -> Any:
        """Return k (n, d) with ``Lap_S u = tr(P Hess u) + k . grad u``."""
        return -np.trace(self.bending(x), axis1=1, axis2=2)[:, None] * self.normal(x)

    def rim_normal(self, x: Any) -> Any:
        """Return outward conormals (n, d) at local points of rims, or tangents that point out at ends."""
        raise NotImplementedError

    def analytic(self, place: Place) -> Any:
        """Return the source that answers by formulas."""
        raise NotImplementedError

    def source(self, kind: str, place: Place) -> Any:
        """Return the source of a representation: its name, and after a space what its cells' size is over 1.

        ``"smooth .2"`` and ``"faceted .2"`` are meshes, ``"cloud .1"`` points, ``"bare"`` closest points alone.
        """
        name, _, size = kind.partition(" ")
        if name == "moved":
            return ck.source(
                "moved", of=self.analytic(Place((0.0,) * len(place.turn), (0.0,) * self.dim)), **place.keys
            )
        if name == "bare":
            return Bare(self.analytic(place))
        if name in ("smooth", "faceted"):
            vertices, faces = self.cells(float(size))
            return ck.source("mesh.triangles", vertices=place.world(vertices), faces=faces, closest=name)
        if name == "cloud":
            return ck.source("pointcloud.points", points=place.world(self.cells(float(size))[0]))
        if name == "polyline":
            count = int(np.ceil(TURN / float(size)))
            points = place.world(self.along(np.linspace(0, 1, count + 1)[: -1 if self.closed else None]))
            return ck.source("mesh.polyline", points=points, closed=self.closed)
        if name == "level set":
            return ck.source("moved", of=ck.source("levelset.expression", **self.level_set()), **place.keys)
        return self.analytic(place)

    def cells(self, size: float) -> tuple[Any, Any]:
        """Return vertices and triangles with edges of about ``size``, in local coordinates."""
        flat = Place((0.0,) * 3, (0.0,) * 3)
        return self.analytic(flat).mesh(size)

    def along(self, share: Any) -> Any:
        """Return local points (n, d) of a curve at shares of its parameter."""
        raise NotImplementedError

    def level_set(self) -> dict[str, Any]:
        """Return the keys of a level set."""
        raise NotImplementedError

    def parallel(self, at: float) -> tuple[float, float]:
        """Return height and radius of a circle about the axis that lies in the surface, for ``at`` in [-1, 1]."""
        raise NotImplementedError


@dataclass(frozen=True)
class Spheroid(Shape):
    """Radius 1 about the axis, ``height`` along it; 1 is a sphere."""

    height: float = 1.0
    kinds: ClassVar[tuple[str, ...]] = ("analytic", "level set", "smooth .15", "moved", "bare", "cloud .06")

    @property
    def _squares(self) -> Any:
        return np.array([1.0, 1.0, 1 / self.height**2])

    def points(self, count: int, rng: Any) -> Any:
        z, turn = rng.uniform(-1, 1, 8 * count), rng.uniform(0, TURN, 8 * count)
        area = np.sqrt(self.height**2 * (1 - z**2) + z**2)
        kept = np.flatnonzero(rng.uniform(0, max(1.0, self.height), 8 * count) < area)[:count]
        r = np.sqrt(1 - z[kept] ** 2)
        return np.stack([r * np.cos(turn[kept]), r * np.sin(turn[kept]), self.height * z[kept]], axis=1)

    def normal(self, x: Any) -> Any:
        slope = x * self._squares
        return slope / np.linalg.norm(slope, axis=1)[:, None]

    def bending(self, x: Any) -> Any:
        P = self.projector(x)
        return P @ np.diag(self._squares) @ P / np.linalg.norm(x * self._squares, axis=1)[:, None, None]

    def level_set(self) -> dict[str, Any]:
        top = 1.3 * self.height
        phi = f"x**2 + y**2 + z**2/{self.height**2!r} - 1"
        return {"phi": phi, "bounds": [[-1.3, -1.3, -top], [1.3, 1.3, top]]}

    def analytic(self, place: Place) -> Any:
        if self.height == 1.0:
            return ck.source("analytic.sphere", **place.keys)
        return ck.source("moved", of=ck.source("levelset.expression", **self.level_set()), **place.keys)

    def parallel(self, at: float) -> tuple[float, float]:
        return self.height * at, float(np.sqrt(1 - at**2))


@dataclass(frozen=True)
class Torus(Shape):
    """Radius 1 of the ring and ``minor`` of the tube."""

    minor: float = 0.4
    kinds: ClassVar[tuple[str, ...]] = ("analytic", "level set", "smooth .12", "moved", "bare", "cloud .05")

    def points(self, count: int, rng: Any) -> Any:
        turn, tube = rng.uniform(0, TURN, (2, 8 * count))
        ring = 1 + self.minor * np.cos(tube)
        kept = np.flatnonzero(rng.uniform(0, 1 + self.minor, 8 * count) < ring)[:count]
        turn, tube, ring = turn[kept], tube[kept], ring[kept]
        return np.stack([ring * np.cos(turn), ring * np.sin(turn), self.minor * np.sin(tube)], axis=1)

    def _ring(self, x: Any) -> Any:
        return np.concatenate([x[:, :2] / np.linalg.norm(x[:, :2], axis=1)[:, None], 0 * x[:, :1]], axis=1)

    def normal(self, x: Any) -> Any:
        out = x - self._ring(x)
        return out / np.linalg.norm(out, axis=1)[:, None]

    def bending(self, x: Any) -> Any:
        ring, n = self._ring(x), self.normal(x)
        around = np.stack([-ring[:, 1], ring[:, 0], 0 * ring[:, 0]], axis=1)
        tube = np.cross(n, around)
        curved = np.sum(n * ring, axis=1) / np.linalg.norm(x[:, :2], axis=1)
        return (
            curved[:, None, None] * around[:, :, None] * around[:, None, :]
            + tube[:, :, None] * tube[:, None, :] / self.minor
        )

    def level_set(self) -> dict[str, Any]:
        side, top = 1.2 * (1 + self.minor), 1.4 * self.minor
        phi = f"(sqrt(x**2 + y**2) - 1)**2 + z**2 - {self.minor**2!r}"
        return {"phi": phi, "bounds": [[-side, -side, -top], [side, side, top]]}

    def analytic(self, place: Place) -> Any:
        return ck.source("analytic.torus", major=1.0, minor=self.minor, **place.keys)

    def parallel(self, at: float) -> tuple[float, float]:
        return float(self.minor * np.sin(np.pi * at)), float(1 + self.minor * np.cos(np.pi * at))


@dataclass(frozen=True)
class Cylinder(Shape):
    """Radius 1, ``length`` along the axis, open."""

    length: float = 2.0
    closed: ClassVar[bool] = False
    kinds: ClassVar[tuple[str, ...]] = ("analytic", "smooth .15", "moved", "bare")

    def points(self, count: int, rng: Any) -> Any:
        turn = rng.uniform(0, TURN, count)
        z = self.length * rng.uniform(-0.5, 0.5, count)
        return np.stack([np.cos(turn), np.sin(turn), z], axis=1)

    def normal(self, x: Any) -> Any:
        return x * [1, 1, 0] / np.linalg.norm(x[:, :2], axis=1)[:, None]

    def bending(self, x: Any) -> Any:
        P = self.projector(x)
        return P @ np.diag([1.0, 1.0, 0.0]) @ P / np.linalg.norm(x[:, :2], axis=1)[:, None, None]

    def rim_normal(self, x: Any) -> Any:
        return np.sign(x[:, 2:]) * [0, 0, 1]

    def analytic(self, place: Place) -> Any:
        return ck.source("analytic.cylinder", radius=1.0, length=self.length, **place.keys)

    def parallel(self, at: float) -> tuple[float, float]:
        return 0.5 * self.length * at, 1.0


@dataclass(frozen=True)
class Cap(Shape):
    """The part of the unit sphere above ``bottom``."""

    bottom: float = 0.0
    closed: ClassVar[bool] = False
    kinds: ClassVar[tuple[str, ...]] = ("analytic", "trimmed", "smooth .12", "moved", "bare")

    def points(self, count: int, rng: Any) -> Any:
        z, turn = rng.uniform(self.bottom, 1, count), rng.uniform(0, TURN, count)
        r = np.sqrt(1 - z**2)
        return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)

    def normal(self, x: Any) -> Any:
        return x / np.linalg.norm(x, axis=1)[:, None]

    def bending(self, x: Any) -> Any:
        return self.projector(x) / np.linalg.norm(x, axis=1)[:, None, None]

    def rim_normal(self, x: Any) -> Any:
        n = self.normal(x)
        down = n * n[:, 2:] - [0, 0, 1]
        return down / np.linalg.norm(down, axis=1)[:, None]

    def analytic(self, place: Place) -> Any:
        return ck.source("analytic.cap", height=self.bottom, **place.keys)

    def source(self, kind: str, place: Place) -> Any:
        if kind == "trimmed":
            cut = ck.source("trimmed", of=ck.source("analytic.sphere"), trim=f"{self.bottom!r} - z")
            return ck.source("moved", of=cut, **place.keys)
        return super().source(kind, place)

    def parallel(self, at: float) -> tuple[float, float]:
        z = self.bottom + (1 - self.bottom) * (0.5 + 0.49 * at)
        return float(z), float(np.sqrt(1 - z**2))


@dataclass(frozen=True)
class Plate(Shape):
    """The square [-1, 1]^2 in the plane z = 0."""

    closed: ClassVar[bool] = False
    kinds: ClassVar[tuple[str, ...]] = ("smooth .2", "faceted .2", "faceted 1")

    def points(self, count: int, rng: Any) -> Any:
        return rng.uniform(-1, 1, (count, 3)) * [1, 1, 0]

    def normal(self, x: Any) -> Any:
        return np.tile([0.0, 0.0, 1.0], (len(x), 1))

    def bending(self, x: Any) -> Any:
        return np.zeros((len(x), 3, 3))

    def rim_normal(self, x: Any) -> Any:
        across = np.abs(x[:, 0]) > np.abs(x[:, 1])
        return np.stack([across * np.sign(x[:, 0]), ~across * np.sign(x[:, 1]), 0 * x[:, 0]], axis=1)

    def cells(self, size: float) -> tuple[Any, Any]:
        count = int(np.ceil(2 / size))
        side = np.linspace(-1, 1, count + 1)
        grid = np.stack(np.meshgrid(side, side, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
        i, j = np.divmod(np.arange(count * count), count)
        a, b = i * (count + 1) + j, (i + 1) * (count + 1) + j
        return grid, np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])

    def parallel(self, at: float) -> tuple[float, float]:
        return 0.0, 0.55 + 0.4 * at


@dataclass(frozen=True)
class Box(Plate):
    """The surface of [-1, 1]^3, for :class:`extremes.ambient.BoxModes`."""

    closed: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = ("faceted .5", "faceted 1", "smooth 2")

    def points(self, count: int, rng: Any) -> Any:
        x = rng.uniform(-1, 1, (count, 3))
        x[np.arange(count), rng.integers(0, 3, count)] = rng.choice([-1.0, 1.0], count)
        return x

    def normal(self, x: Any) -> Any:
        axis = np.abs(x).argmax(axis=1)
        return np.eye(3)[axis] * np.sign(x[np.arange(len(x)), axis])[:, None]

    def cells(self, size: float) -> tuple[Any, Any]:
        grid, faces = super().cells(size)
        turns = [np.eye(3), np.diag([1.0, -1, -1])]
        turns += [
            np.array(rows, float) for rows in ([[0, 0, 1], [1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
        ]
        turns += [turns[2] @ turns[1], turns[3] @ turns[1]]
        sides = [(grid + [0, 0, 1]) @ turn.T for turn in turns]
        return np.concatenate(sides), np.concatenate([faces + k * len(grid) for k in range(6)])


@dataclass(frozen=True)
class PlaneCurve(Shape):
    """An ellipse of half axes 1 and ``height``, or its part between two angles."""

    height: float = 1.0
    dim: ClassVar[int] = 2
    manifold_dim: ClassVar[int] = 1
    kinds: ClassVar[tuple[str, ...]] = ("parametric", "level set", "polyline .02", "moved", "bare")

    @property
    def _squares(self) -> Any:
        return np.array([1.0, 1 / self.height**2])

    def along(self, share: Any) -> Any:
        turn = TURN * np.asarray(share)
        return np.stack([np.cos(turn), self.height * np.sin(turn)], axis=1)

    def points(self, count: int, rng: Any) -> Any:
        share = rng.uniform(0, 1, 8 * count)
        speed = np.hypot(np.sin(TURN * share), self.height * np.cos(TURN * share))
        return self.along(share[np.flatnonzero(rng.uniform(0, max(1.0, self.height), 8 * count) < speed)[:count]])

    normal = Spheroid.normal
    bending = Spheroid.bending

    def tangent(self, x: Any) -> Any:
        """Return unit tangents (n, 2) in the direction of travel."""
        n = self.normal(x)
        return np.stack([-n[:, 1], n[:, 0]], axis=1)

    def level_set(self) -> dict[str, Any]:
        top = 1.3 * self.height
        return {"phi": f"x**2 + y**2/{self.height**2!r} - 1", "bounds": [[-1.3, -top], [1.3, top]]}

    def analytic(self, place: Place) -> Any:
        if self.height == 1.0:
            return ck.source("analytic.circle", **place.keys)
        curve = ck.source("parametric.curve", x=["cos(t)", f"{self.height!r}*sin(t)"], range=[0, "2*pi"], periodic=True)
        return ck.source("moved", of=curve, **place.keys)


@dataclass(frozen=True)
class Arc(PlaneCurve):
    """The part of the unit circle from the angle ``start`` to ``end``."""

    start: float = 0.3
    end: float = 4.0
    closed: ClassVar[bool] = False
    kinds: ClassVar[tuple[str, ...]] = ("analytic", "polyline .01", "moved", "bare")

    def along(self, share: Any) -> Any:
        turn = self.start + (self.end - self.start) * np.asarray(share)
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)

    def points(self, count: int, rng: Any) -> Any:
        return self.along(rng.uniform(0, 1, count))

    def rim_normal(self, x: Any) -> Any:
        ends = self.along([0.0, 1.0])
        first = np.linalg.norm(x - ends[0], axis=1) < np.linalg.norm(x - ends[1], axis=1)
        return np.where(first, -1.0, 1.0)[:, None] * self.tangent(x)

    def analytic(self, place: Place) -> Any:
        return ck.source("analytic.arc", start=self.start, end=self.end, **place.keys)


@dataclass(frozen=True)
class Helix(Shape):
    """Radius 1, ``pitch`` a turn, two turns about the axis."""

    pitch: float = 1.0
    manifold_dim: ClassVar[int] = 1
    closed: ClassVar[bool] = False
    kinds: ClassVar[tuple[str, ...]] = ("analytic", "polyline .02", "moved", "bare")

    def along(self, share: Any) -> Any:
        turn = 2 * TURN * np.asarray(share)
        return np.stack([np.cos(turn), np.sin(turn), self.pitch * turn / TURN], axis=1)

    def points(self, count: int, rng: Any) -> Any:
        return self.along(rng.uniform(0, 1, count))

    def tangent(self, x: Any) -> Any:
        """Return unit tangents (n, 3) in the direction of travel."""
        r = np.linalg.norm(x[:, :2], axis=1)
        way = np.stack([-x[:, 1] / r, x[:, 0] / r, np.full(len(x), self.pitch / TURN)], axis=1)
        return way / np.linalg.norm(way, axis=1)[:, None]

    def projector(self, x: Any) -> Any:
        t = self.tangent(x)
        return t[:, :, None] * t[:, None, :]

    def mean_vector(self, x: Any) -> Any:
        return -x * [1, 1, 0] / np.linalg.norm(x[:, :2], axis=1)[:, None] / (1 + (self.pitch / TURN) ** 2)

    rim_normal = Arc.rim_normal

    def analytic(self, place: Place) -> Any:
        curve = ck.source("parametric.helix", radius=1.0, pitch=self.pitch, turns=2)
        return ck.source("moved", of=curve, **place.keys)
