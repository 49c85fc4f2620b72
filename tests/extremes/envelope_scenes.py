"""One family of scenes for each kind of small geometry or data, with its size in spacings and its solution.

Curved sheets are extruded polylines: a function of the length along the polyline and of the height solves there what it
solves on a rectangle. Of plates with holes the truth is quadratic finite elements on a mesh that is finer at corners.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from bare import Bare
from extremes.ambient import Place, Waves
from extremes.cases import Case, Curve
from extremes.shapes import PlaneCurve, Plate, Spheroid, Torus

import cpmkit as ck

TILT = Place((0.4, -0.7, 0.3), (0.13, -0.21, 0.34))
#: The spacing of all scenes but those of curves.
SPACING, CURVE_SPACING = 0.1, 0.05
WAVES = Waves((1.0, 0.5), ((1.5, 0.4, -0.7), (-0.5, 1.3, 1.1)), (0.3, 1.0))


@dataclass(frozen=True, eq=False)
class Known:
    """A scene, points (n, d) of it, and the solution (n,) there."""

    scene: Any
    points: Any
    u: Any
    spacing: float = SPACING


@dataclass(frozen=True)
class Family:
    """Scenes that differ in one size.

    Parameters
    ----------
    name, unit : str
        What is small, and in what the size is.
    sizes : tuple of float
        In ascending order.
    make : callable
        ``make(size)`` returns a :class:`Known`.
    """

    name: str
    unit: str
    sizes: tuple[float, ...]
    make: Callable[[float], Known]


def extruded(arms: list[Any], values: list[Callable[[Any], Any]], load: list[Callable[[Any], Any]]) -> Known:
    """Return a scene on polylines (k, 2) that are extruded by 1; u and f are cos(pi z) times functions of each length.

    ``load`` holds -u'' + (1 + pi^2) u of the functions.
    """
    vertices, faces, offset = [], [], 0
    for arm in arms:
        bottom = np.pad(arm, ((0, 0), (0, 1)))
        vertices += [bottom, bottom + [0, 0, 1]]
        i, k = np.arange(len(arm) - 1), len(arm)
        faces += [np.stack([i, i + 1, i + 1 + k], axis=1) + offset, np.stack([i, i + 1 + k, i + k], axis=1) + offset]
        offset += 2 * k
    source = ck.source(
        "mesh.triangles", vertices=TILT.world(np.concatenate(vertices)), faces=np.concatenate(faces), closest="faceted"
    )

    def at(functions: Any) -> Any:
        def value(x: Any) -> Any:
            y = TILT.local(x)
            found = [along(arm, y[:, :2]) for arm in arms]
            nearest = np.argmin([distance for distance, _ in found], axis=0)
            rows = np.stack([function(length) for function, (_, length) in zip(functions, found, strict=True)])
            return rows[nearest, np.arange(len(y))] * np.cos(np.pi * y[:, 2])

        return value

    rng, points = np.random.default_rng(0), []
    for arm in arms:
        lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(arm, axis=0), axis=1))])
        s = rng.uniform(0, lengths[-1], 1500)
        points.append(
            np.stack([*(np.interp(s, lengths, arm[:, k]) for k in range(2)), rng.uniform(0, 1, 1500)], axis=1)
        )
    x = TILT.world(np.concatenate(points))
    return Known(ck.Scene(source, ck.ScreenedPoisson(at(load), c=1.0)), x, at(values)(x))


def along(arm: Any, y: Any) -> tuple[Any, Any]:
    """Return distances (n,) from a polyline, and lengths along it of the nearest points."""
    starts, ways = arm[:-1], np.diff(arm, axis=0)
    sizes = np.linalg.norm(ways, axis=1)
    share = np.clip(np.einsum("nkd,kd->nk", y[:, None] - starts, ways) / sizes**2, 0, 1)
    distance = np.linalg.norm(y[:, None] - starts - share[:, :, None] * ways, axis=2)
    best = np.argmin(distance, axis=1)
    rows = np.arange(len(y))
    lengths = np.concatenate([[0], np.cumsum(sizes)])
    return distance[rows, best], lengths[best] + share[rows, best] * sizes[best]


def _cosine(length: float) -> tuple[list[Any], list[Any]]:
    k = np.pi / length
    return [lambda s: np.cos(k * s)], [lambda s: (1 + np.pi**2 + k * k) * np.cos(k * s)]


def plate_thickness(size: float) -> Known:
    """Two sheets of one plate, with one wall between them."""
    t = size * SPACING
    return extruded([np.array([[0, 0], [0.9, 0], [0.9, t], [0, t]])], *_cosine(1.8 + t))


def u_turn(size: float) -> Known:
    """Two sheets joined by half a cylinder of a radius."""
    line = u_turn_line(size * SPACING)
    return extruded([line], *_cosine(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()))


def u_turn_line(radius: float) -> Any:
    """Return the polyline (k, 2) of two parallel segments of length .9 and a half circle of 24 chords."""
    turns = np.linspace(-0.5, 0.5, 25) * np.pi
    arc = radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return np.concatenate([[[-0.9, -radius]], arc, [[-0.9, radius]]])


def fold(degrees: float) -> Known:
    """Two sheets that meet at an angle; 180 is flat."""
    turn = np.radians(degrees)
    return extruded([np.array([[0.9, 0], [0, 0], [0.9 * np.cos(turn), 0.9 * np.sin(turn)]])], *_cosine(1.8))


def junction(degrees: float) -> Known:
    """Three sheets that meet: two opposite ones, and one at an angle to the first."""
    turns = np.radians([0, 180, degrees])
    arms = [np.array([[0, 0], [0.9 * np.cos(turn), 0.9 * np.sin(turn)]]) for turn in turns]
    k, parts = np.pi / 1.8, (1.0, -0.4, -0.6)
    values = [lambda s, a=a: a * np.sin(k * s) for a in parts]
    return extruded(arms, values, [lambda s, a=a: a * (1 + np.pi**2 + k * k) * np.sin(k * s) for a in parts])


def _graded(stops: list[float], step: float) -> Any:
    """Return places from the first stop to the last, closer together beside the stops between."""
    out = [np.array([stops[0]])]
    for first, last in pairwise(stops):
        count = max(2, int(np.ceil(2 * (last - first) / step)))
        out.append(first + (last - first) * 0.5 * (1 - np.cos(np.pi * np.arange(1, count + 1) / count)))
    return np.concatenate(out)


def holed(x_stops: list[float], y_stops: list[float], keep: Callable[[Any, Any], Any]) -> Known:
    """Return a plate of rectangles, those whose centres are kept, with the truth by finite elements on them."""
    meshes = []
    for step in (0.25, 0.05):
        xs, ys = _graded(x_stops, step), _graded(y_stops, step)
        grid = np.stack(np.meshgrid(xs, ys, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
        i, j = (one.ravel() for one in np.meshgrid(np.arange(len(xs) - 1), np.arange(len(ys) - 1), indexing="ij"))
        kept = keep(0.5 * (xs[i] + xs[i + 1]), 0.5 * (ys[j] + ys[j + 1]))
        a, b = (i * len(ys) + j)[kept], ((i + 1) * len(ys) + j)[kept]
        cells = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
        used, cells = np.unique(cells, return_inverse=True)
        meshes.append((TILT.world(grid[used]), cells.reshape(-1, 3)))
    coarse, fine = (ck.source("mesh.triangles", vertices=v, faces=f, closest="faceted") for v, f in meshes)
    problem = ck.ScreenedPoisson(lambda x: 4 * np.sin(2 * TILT.local(x)[:, 0] + 1) + TILT.local(x)[:, 1], c=1.0)
    rng = np.random.default_rng(0)
    corners = meshes[1][0][meshes[1][1]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    x = corners[rng.choice(len(area), 2000, p=area / area.sum())].mean(axis=1)
    truth = ck.solve(ck.Scene(fine, problem), backend="fem", degree=2)
    return Known(ck.Scene(coarse, problem), x, truth.evaluate(x))


def slot(size: float) -> Known:
    """A slot from one rim to beyond the middle."""
    t = 0.5 * size * SPACING
    return holed([-0.8, 0.15, 0.8], [-0.7, -t, t, 0.7], lambda x, y: (x > 0.15) | (np.abs(y) > t))


def neck(size: float) -> Known:
    """Two plates that hang together by a neck as long as a spacing."""
    t, half = 0.5 * size * SPACING, 0.5 * SPACING
    return holed([-0.8, -half, half, 0.8], [-0.6, -t, t, 0.6], lambda x, y: (np.abs(x) > half) | (np.abs(y) < t))


def hole(size: float) -> Known:
    """A square hole."""
    t = 0.5 * size * SPACING
    return holed([-0.7, -t, t, 0.7], [-0.7, -t, t, 0.7], lambda x, y: (np.abs(x) > t) | (np.abs(y) > t))


def _known(case: Case) -> Known:
    x = case.shape.points(1500, np.random.default_rng(0))
    return Known(case.scene(), case.place.world(x), case.exact(x), case.spacing)


def _case(shape: Any, kind: str, spacing: float = SPACING, **other: Any) -> Case:
    given: dict[str, Any] = {"equation": "screened", "law": "exact", "u": WAVES, "terms": {"c": 1.0}, **other}
    return Case(shape, kind, TILT, spacing=spacing, **given)


def close_curves(size: float) -> Known:
    """Two circles of a sphere, a gap apart, with values."""
    inside = (Curve(0.2, "dirichlet"), Curve(0.2 + size * 0.15, "dirichlet"))
    return _known(_case(Spheroid(), "analytic", 0.15, inside=inside))


def short_arc(size: float) -> Known:
    """An arc of a length, with a flux on both sides."""
    return _known(_case(Spheroid(), "analytic", 0.15, inside=(Curve(0.2, "neumann", (0.3, 0.3 + size * 0.15)),)))


def radius(size: float) -> Known:
    """A torus whose tube has a radius."""
    return _known(_case(Torus(size * SPACING), "analytic"))


@dataclass(frozen=True, eq=False)
class _Noisy(Bare):
    """Closest points that are off by a length, each in its own way."""

    off: float = 0.0

    def closest_point(self, x: Any, /) -> Any:
        found = self.source.closest_point(x)
        wave = np.sin(1e4 * np.asarray(x) @ np.array([[1.0, 2.3, 3.1], [2.1, -1.7, 1.3], [0.7, 1.9, -2.9]]))
        return ck.ClosestPoints(
            found.points + self.off * wave, found.distance, found.edge, found.element, found.local, found.doubtful
        )


def noise(size: float) -> Known:
    """Closest points of a sphere that are off by a length."""
    case = _case(Spheroid(), "analytic", 0.15)
    scene = ck.Scene(_Noisy(case.scene().surface, size * 0.15), case.problem())
    return Known(scene, _known(case).points, _known(case).u, 0.15)


def coarse_mesh(size: float) -> Known:
    """A mesh of a sphere of radius 1, read as smooth, with edges of a length."""
    return _known(_case(Spheroid(), f"smooth {size!r}", 2 * SPACING))


@dataclass(frozen=True)
class _Layer:
    """The function 2 + 1.5 tanh(x / width)."""

    width: float

    def value(self, x: Any) -> Any:
        return 2 + 1.5 * np.tanh(x[:, 0] / self.width)

    def gradient(self, x: Any) -> Any:
        return (1.5 / self.width / np.cosh(np.clip(x[:, :1] / self.width, -300, 300)) ** 2) * np.eye(x.shape[1])[0]


def layer(size: float) -> Known:
    """A diffusivity that changes from .5 to 3.5 within a width; the flux does not, so that u has a kink there."""
    width = size * SPACING
    terms = {"c": 1.0, "diffusivity": _Layer(width)}
    return _known(_case(Plate(), "faceted 1", equation="elliptic", terms=terms))


def load(size: float) -> Known:
    """A load of integral 1 on a strip of a width, on a flat plate."""
    width, length, middle, m = size * SPACING, 1.8, 0.83, np.sqrt(1 + np.pi**2)
    places, weights = np.polynomial.legendre.leggauss(20)

    def value(s: Any) -> Any:
        at = middle + 0.5 * width * places
        low, high = np.minimum(s[:, None], at), np.maximum(s[:, None], at)
        return np.cosh(m * low) * np.cosh(m * (length - high)) @ (0.5 * weights) / (m * np.sinh(m * length))

    arm = np.array([[0, 0], [length, 0]])
    return extruded([arm], [value], [lambda s: (np.abs(s - middle) < 0.5 * width) / width])


def wavenumber(size: float) -> Known:
    """Standing waves on an ellipse, so many spacings long."""
    k = 2 * np.pi / (size * CURVE_SPACING)
    wave = Waves((1.0,), ((0.6 * k, 0.8 * k),), (0.3,))
    case = _case(PlaneCurve(0.6), "parametric", CURVE_SPACING, equation="helmholtz", u=wave, terms={"wavenumber": k})
    plane = Place((0.4,), (0.13, -0.21))
    return _known(Case(**{**case.__dict__, "place": plane}))


def far_from_zero(size: float) -> Known:
    """Values that lie so many times their range from zero."""
    return _known(
        _case(
            Spheroid(),
            "analytic",
            0.15,
            u=Waves(WAVES.amplitudes, WAVES.waves, WAVES.phases, size),
            inside=(Curve(0.1, "dirichlet"),),
        )
    )


FAMILIES = (
    Family("plate thickness", "spacings", (0.1, 0.4, 1, 2, 4), plate_thickness),
    Family("radius of a U-turn", "spacings", (0.1, 0.25, 0.5, 1, 2), u_turn),
    Family("slot width", "spacings", (0.1, 0.5, 1, 2, 4), slot),
    Family("neck width", "spacings", (0.1, 0.5, 1, 2, 4), neck),
    Family("hole side", "spacings", (0.3, 1, 2, 4), hole),
    Family("fold angle", "degrees", (5, 20, 45, 90, 150), fold),
    Family("junction, smallest angle", "degrees", (5, 20, 45, 90), junction),
    Family("gap of curves", "spacings", (1e-5, 1e-3, 1e-2, 0.1, 1), close_curves),
    Family("length of an arc", "spacings", (0.01, 0.1, 1, 4), short_arc),
    Family("radius of curvature", "spacings", (0.5, 1, 1.5, 3, 5), radius),
    Family("noise of closest points", "spacings", (1e-5, 1e-4, 1e-3, 1e-2, 1e-1), noise),
    Family("edges of a smooth mesh", "radii", (0.05, 0.1, 0.2, 0.4, 0.8), coarse_mesh),
    Family("layer of the diffusivity", "spacings", (0.05, 0.15, 0.5, 1.5), layer),
    Family("width of a load", "spacings", (0.03, 0.1, 0.25, 1, 3), load),
    Family("wave length", "spacings", (3, 5, 8, 12, 20), wavenumber),
    Family("distance from zero", "ranges", (1, 1e3, 1e6, 1e9), far_from_zero),
)
