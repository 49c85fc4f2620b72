"""Surfaces made of rectangles, of profiles that revolve, or of formulas: exact feet, rims, areas and fine meshes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import ceil, cos, hypot, inf, pi, sin

import numpy as np

import cpmkit as ck
from cpmkit import ClosestPoints

#: Points nearer than this, in sizes of about one, are the same.
SAME = 1e-7


def merged(vertices, cells):
    """Return vertices and triangles with equal vertices merged, and without triangles of fewer than three of them."""
    _, first, number = np.unique(np.round(vertices / SAME + 0.2345), axis=0, return_index=True, return_inverse=True)
    cells = number.ravel()[cells]
    sound = (cells != np.roll(cells, 1, axis=1)).all(axis=1)
    return vertices[first], cells[sound]


def grid(points, rows, columns):
    """Return triangles on a grid of points, row by row."""
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    return points, np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def together(parts):
    """Return one mesh of several."""
    shifts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    return merged(vertices, np.concatenate([cells + shift for (_, cells), shift in zip(parts, shifts, strict=False)]))


@dataclass(frozen=True, eq=False)
class Rectangles:
    """Rectangles (corner, first side, second side) that meet along whole sides."""

    rectangles: tuple
    thickness: float = inf

    @cached_property
    def area(self):
        return sum(np.linalg.norm(a) * np.linalg.norm(b) for _, a, b in self.rectangles)

    def mesh(self, spacing):
        parts = []
        for corner, a, b in self.rectangles:
            m, n = (ceil(np.linalg.norm(side) / spacing - SAME) for side in (a, b))
            s, t = np.meshgrid(np.linspace(0, 1, m + 1), np.linspace(0, 1, n + 1), indexing="ij")
            parts.append(grid(corner + s.reshape(-1, 1) * a + t.reshape(-1, 1) * b, m, n))
        return together(parts)

    @cached_property
    def rims(self):
        """(2, e, 3) the sides that one rectangle has alone."""
        sides = []
        for corner, a, b in self.rectangles:
            p = np.stack([corner, corner + a, corner + a + b, corner + b])
            sides.append(np.stack([p, np.roll(p, -1, axis=0)], axis=1))
        sides = np.concatenate(sides)
        keys = [tuple(sorted(map(tuple, np.round(side / SAME + 0.2345).astype(int).tolist()))) for side in sides]
        alone = [keys.count(key) == 1 for key in keys]
        return sides[alone].transpose(1, 0, 2)

    def feet(self, x):
        best, feet = np.full(len(x), inf), np.zeros_like(x)
        for corner, a, b in self.rectangles:
            s, t = (np.clip((x - corner) @ side / (side @ side), 0, 1)[:, None] for side in (a, b))
            foot = corner + s * a + t * b
            square = ((x - foot) ** 2).sum(axis=1)
            nearer = square < best
            best[nearer], feet[nearer] = square[nearer], foot[nearer]
        return feet, self._on_rim(feet)

    def _on_rim(self, feet):
        on = np.zeros(len(feet), dtype=bool)
        for a, b in self.rims.transpose(1, 0, 2):
            t = np.clip((feet - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)[:, None]
            on |= np.linalg.norm(feet - a - t * (b - a), axis=1) < SAME
        return on


@dataclass(frozen=True)
class Arc:
    """Part of a circle in the half plane (r, z), from one angle to another."""

    centre: tuple
    radius: float
    start: float
    stop: float

    @property
    def length(self):
        return self.radius * abs(self.stop - self.start)

    @property
    def area(self):
        slope = self.centre[0] * (self.stop - self.start) + self.radius * (sin(self.stop) - sin(self.start))
        return 2 * pi * self.radius * abs(slope)

    def at(self, t):
        angle = self.start + t * (self.stop - self.start)
        return np.stack(
            [self.centre[0] + self.radius * np.cos(angle), self.centre[1] + self.radius * np.sin(angle)], -1
        )

    def feet(self, p):
        away = p - np.array(self.centre)
        low, high = sorted([self.start, self.stop])
        angle = low + (np.arctan2(away[:, 1], away[:, 0]) - low) % (2 * pi)
        before = angle - high > 0.5 * (2 * pi - (high - low))  # nearer to the start, round the circle
        angle = np.where(angle > high, np.where(before, low, high), angle)
        return np.array(self.centre) + self.radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@dataclass(frozen=True)
class Line:
    """A segment in the half plane (r, z)."""

    a: tuple
    b: tuple

    @property
    def length(self):
        return hypot(self.b[0] - self.a[0], self.b[1] - self.a[1])

    @property
    def area(self):
        return pi * (self.a[0] + self.b[0]) * self.length

    def at(self, t):
        return np.array(self.a) + np.asarray(t)[..., None] * (np.array(self.b) - np.array(self.a))

    def feet(self, p):
        along = np.array(self.b) - np.array(self.a)
        return self.at(np.clip((p - np.array(self.a)) @ along / (along @ along), 0, 1))


@dataclass(frozen=True, eq=False)
class Revolved:
    """A profile of lines and arcs that revolves about the z axis."""

    profile: tuple
    thickness: float = inf

    @cached_property
    def area(self):
        return sum(piece.area for piece in self.profile)

    @cached_property
    def rims(self):
        """(k, 2) the ends that one piece has alone, off the axis."""
        ends = np.concatenate([piece.at(np.array([0.0, 1.0])) for piece in self.profile])
        _, first, count = np.unique(np.round(ends / SAME + 0.2345), axis=0, return_index=True, return_counts=True)
        alone = ends[first[count == 1]]
        return alone[alone[:, 0] > SAME]

    def mesh(self, spacing):
        widest = max(piece.at(np.linspace(0, 1, 9))[:, 0].max() for piece in self.profile)
        turns = 4 * ceil(pi * widest / spacing / 2)
        angle = np.linspace(0, 2 * pi, turns + 1)
        parts = []
        for piece in self.profile:
            n = 4 * ceil(piece.length / spacing / 4)
            r, z = piece.at(np.linspace(0, 1, n + 1)).T
            r = np.where(r < SAME, 0.0, r)
            ring = [np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle)), np.outer(z, np.ones_like(angle))]
            parts.append(grid(np.stack(ring, axis=-1).reshape(-1, 3), n, turns))
        return together(parts)

    def feet(self, x):
        r = np.hypot(x[:, 0], x[:, 1])
        with np.errstate(invalid="ignore"):
            direction = np.where(r[:, None] > 0, x[:, :2] / r[:, None], [1.0, 0.0])
        p = np.stack([r, x[:, 2]], axis=1)
        best, found = np.full(len(x), inf), np.zeros_like(p)
        for piece in self.profile:
            foot = piece.feet(p)
            square = ((p - foot) ** 2).sum(axis=1)
            nearer = square < best
            best[nearer], found[nearer] = square[nearer], foot[nearer]
        rim = np.zeros(len(x), dtype=bool)
        for end in self.rims:
            rim |= np.linalg.norm(found - end, axis=1) < SAME
        return np.concatenate([found[:, :1] * direction, found[:, 1:]], axis=1), rim


@dataclass(frozen=True, eq=False)
class Formula:
    """A surface x(u, v), whose feet the parametric source finds by Newton's method."""

    x: tuple
    u: tuple
    v: tuple
    place: Callable
    keys: tuple = ()
    thickness: float = inf

    @cached_property
    def source(self):
        return ck.source("parametric.surface", x=list(self.x), u=list(self.u), v=list(self.v), **dict(self.keys))

    def mesh(self, spacing):
        u, v = (np.linspace(*side, 9) for side in (self.u, self.v))
        points = self.place(*np.meshgrid(u, v, indexing="ij"))
        lengths = [np.linalg.norm(np.diff(points, axis=k), axis=-1).sum(axis=k).max() for k in (0, 1)]
        m, n = (4 * ceil(length / spacing / 4) for length in lengths)
        u, v = np.linspace(*self.u, m + 1), np.linspace(*self.v, n + 1)
        return merged(*grid(self.place(*np.meshgrid(u, v, indexing="ij")).reshape(-1, 3), m, n))

    @cached_property
    def area(self):
        """Gauss' rule on 8 x 8 boxes, tangents by central differences."""
        nodes, weights = np.polynomial.legendre.leggauss(8)
        sides = []
        for low, high in (self.u, self.v):
            step = (high - low) / 16
            middle = low + step * (2 * np.arange(8) + 1)
            sides.append(((middle[:, None] + step * nodes).ravel(), np.tile(step * weights, 8)))
        (u, wu), (v, wv) = sides
        u, v = np.meshgrid(u, v, indexing="ij")
        e = 1e-5
        a = (self.place(u + e, v) - self.place(u - e, v)) / (2 * e)
        b = (self.place(u, v + e) - self.place(u, v - e)) / (2 * e)
        return float(wu @ np.linalg.norm(np.cross(a, b), axis=-1) @ wv)

    def feet(self, x):
        answer = self.source.closest_point(x)
        return answer.points, answer.edge >= 0


@dataclass(frozen=True, eq=False)
class Several:
    """Surfaces side by side."""

    members: tuple
    thickness: float = inf

    @cached_property
    def area(self):
        return sum(member.area for member in self.members)

    def mesh(self, spacing):
        return together([member.mesh(spacing) for member in self.members])

    def feet(self, x):
        answers = [member.feet(x) for member in self.members]
        nearest = np.argmin([((x - feet) ** 2).sum(axis=1) for feet, _ in answers], axis=0)
        rows = np.arange(len(x))
        return np.stack([feet for feet, _ in answers])[nearest, rows], np.stack([rim for _, rim in answers])[
            nearest, rows
        ]


@dataclass(frozen=True, eq=False)
class Moved:
    """A surface turned and moved: x = R y + t."""

    shape: object
    rotation: np.ndarray
    shift: np.ndarray

    @property
    def area(self):
        return self.shape.area

    @property
    def thickness(self):
        return self.shape.thickness

    def mesh(self, spacing):
        vertices, cells = self.shape.mesh(spacing)
        return vertices @ self.rotation.T + self.shift, cells

    def feet(self, x):
        feet, rim = self.shape.feet((x - self.shift) @ self.rotation)
        return feet @ self.rotation.T + self.shift, rim


@dataclass(frozen=True, eq=False)
class BareSurface:
    """A source that answers closest points and nothing else; ``edges`` says whether it tells its rims."""

    shape: object
    edges: bool = True
    dim: int = 3
    manifold_dim: int = 2
    exact: bool = True

    @cached_property
    def bounds(self):
        vertices, _ = self.shape.mesh(0.05)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        margin = 0.0 if isinstance(self.shape, Rectangles) else 2e-3 * (high - low).max()
        return np.stack([low - margin, high + margin])

    def closest_point(self, x, /):
        feet, rim = self.shape.feet(x)
        return ClosestPoints(feet, np.linalg.norm(x - feet, axis=1), np.where(rim & self.edges, 0, -1))


def box(low, high, without=()):
    """Return the six sides of a box as rectangles, without those whose names are given."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    a, b, c = np.diag(high - low)
    sides = {
        "bottom": (low, a, b),
        "top": (low + c, a, b),
        "front": (low, a, c),
        "back": (low + b, a, c),
        "left": (low, b, c),
        "right": (low + a, b, c),
    }
    return [sides[name] for name in sides if name not in without]


def leaf(angle, length, width):
    """Return a rectangle from the x axis on, at an angle about it."""
    return (np.zeros(3), np.array([length, 0, 0.0]), width * np.array([0, cos(angle), sin(angle)]))
