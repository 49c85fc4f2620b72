"""Bare surfaces drawn at random: kinds, sizes, positions, spacings and origins, with their truths."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import cos, inf, pi, radians, sin

import numpy as np
from extremes.bare_shapes import (
    Arc,
    BareSurface,
    Formula,
    Line,
    Moved,
    Rectangles,
    Revolved,
    Several,
    box,
    leaf,
)

import cpmkit as ck


def rectangles(*parts, thickness=inf):
    return Rectangles(
        tuple((np.asarray(c, float), np.asarray(a, float), np.asarray(b, float)) for c, a, b in parts), thickness
    )


def sphere(rng, radius=1.0):
    return Revolved((Arc((0.0, 0.0), radius, -pi / 2, pi / 2),), 2 * radius)


def torus(rng):
    minor = rng.uniform(0.25, 0.5)
    return Revolved((Arc((1.0, 0.0), minor, 0.0, 2 * pi),), 2 * min(minor, 1 - minor))


def capsule(rng):
    r, half = rng.uniform(0.2, 0.5), rng.uniform(0.3, 0.8)
    caps = Arc((0.0, -half), r, -pi / 2, 0.0), Line((r, -half), (r, half)), Arc((0.0, half), r, 0.0, pi / 2)
    return Revolved(caps, 2 * r)


def lens(rng):
    angle = radians(rng.uniform(35, 75))  # between the axis and the crease, seen from the centres
    depth = cos(angle)
    return Revolved(
        (Arc((0.0, -depth), 1.0, pi / 2, pi / 2 - angle), Arc((0.0, depth), 1.0, -pi / 2 + angle, -pi / 2)),
        2 * (1 - depth),
    )


def open_cylinder(rng):
    r, half = rng.uniform(0.3, 0.8), rng.uniform(0.3, 0.9)
    return Revolved((Line((r, -half), (r, half)),), 2 * r)


def capped_cylinder(rng):
    r, half = rng.uniform(0.3, 0.8), rng.uniform(0.2, 0.9)
    return Revolved(
        (Line((0, -half), (r, -half)), Line((r, -half), (r, half)), Line((r, half), (0, half))), 2 * min(r, half)
    )


def open_cone(rng):
    r, height = rng.uniform(0.4, 1.0), rng.uniform(0.5, 1.2)
    return Revolved((Line((0, height), (r, 0)),))


def closed_cone(rng):
    r = rng.uniform(0.5, 0.8)
    height = r * rng.uniform(0.58, 1.8)  # 30 degrees and more at the base
    return Revolved((Line((0, height), (r, 0)), Line((r, 0), (0, 0))))


def double_cone(rng):
    r = rng.uniform(0.4, 0.9)
    height = r * rng.uniform(0.6, 1.2)
    return Revolved((Line((0, height), (r, 0)), Line((r, 0), (0, -height))))


def frustum(rng):
    r, top, half = rng.uniform(0.5, 0.9), rng.uniform(0.25, 0.5), rng.uniform(0.3, 0.8)
    return Revolved((Line((r, -half), (top, half)),), 2 * top)


def cup(rng):
    r, half = rng.uniform(0.4, 0.8), rng.uniform(0.3, 0.9)
    return Revolved((Line((0, -half), (r, -half)), Line((r, -half), (r, half))), 2 * r)


def disc(rng):
    return Revolved((Line((0, 0), (rng.uniform(0.6, 1.0), 0)),))


def annulus(rng):
    inner = rng.uniform(0.25, 0.6)
    return Revolved((Line((inner, 0), (1, 0)),), 1 - inner)


def bowl(rng):
    angle = radians(rng.uniform(35, 70))
    return Revolved((Arc((0.0, 0.0), 1.0, -pi / 2, -pi / 2 + angle),))


def hemisphere(rng):
    return Revolved((Arc((0.0, 0.0), 1.0, -pi / 2, 0.0),))


def vase(rng):
    foot, belly, neck = rng.uniform(0.25, 0.4), rng.uniform(0.5, 0.8), rng.uniform(0.25, 0.45)
    profile = (
        Line((0, 0), (foot, 0)),
        Line((foot, 0), (belly, 0.6)),
        Line((belly, 0.6), (neck, 1.2)),
        Line((neck, 1.2), (neck + 0.15, 1.5)),
    )
    return Revolved(profile, 2 * min(foot, neck))


def hat(rng):
    r = rng.uniform(0.4, 0.7)
    return Revolved((Arc((0.0, 0.0), r, pi / 2, 0.0), Line((r, 0), (r + rng.uniform(0.3, 0.6), 0))), 0.6)


def washer(rng):
    inner, half = rng.uniform(0.3, 0.6), rng.uniform(0.15, 0.4)
    p = [(inner, -half), (1.0, -half), (1.0, half), (inner, half)]
    return Revolved(tuple(Line(p[k], p[(k + 1) % 4]) for k in range(4)), min(2 * half, 1 - inner))


def nested_spheres(rng):
    gap = rng.uniform(0.25, 0.5)
    return Several((sphere(rng), sphere(rng, 1 - gap)), gap)


def torus_ring(rng):
    start, width = rng.uniform(0, 2 * pi), rng.uniform(1.5, 4.5)
    minor = rng.uniform(0.3, 0.5)
    return Revolved((Arc((1.0, 0.0), minor, start, start + width),), minor)


def plate(rng):
    return rectangles(([0, 0, 0], [rng.uniform(0.6, 1.5), 0, 0], [0, 1, 0]))


def cuboid(rng):
    size = rng.uniform(0.4, 1.0, 3)
    return rectangles(*box([0, 0, 0], size), thickness=size.min())


def cube(rng):
    return rectangles(*box([0, 0, 0], [1, 1, 1]), thickness=1.0)


def open_box(rng):
    size = rng.uniform(0.5, 1.0, 3)
    return rectangles(*box([0, 0, 0], size, ["top"]), thickness=size[:2].min())


def tube_of_four(rng):
    size = rng.uniform(0.5, 1.0, 3)
    return rectangles(*box([0, 0, 0], size, ["top", "bottom"]), thickness=size[:2].min())


def corner(rng):
    return rectangles(*box([0, 0, 0], rng.uniform(0.6, 1.0, 3), ["top", "back", "right"]))


def thin_box(rng):
    size = [1.0, rng.uniform(0.6, 1.0), rng.uniform(0.12, 0.3)]
    return rectangles(*box([0, 0, 0], size), thickness=size[2])


def two_boxes(rng):
    gap = rng.uniform(0.25, 0.35)
    one, other = box([0, 0, 0], [0.6, 0.8, 0.7]), box([0.6 + gap, 0, 0], [1.2 + gap, 0.8, 0.7])
    return rectangles(*one, *other, thickness=gap)


def two_plates(rng):
    gap = rng.uniform(0.15, 0.4)
    return rectangles(([0, 0, 0], [1, 0, 0], [0, 1, 0]), ([0, 0, gap], [1, 0, 0], [0, 1, 0]), thickness=gap)


def fold(rng):
    angle = radians(rng.uniform(50, 130))
    return rectangles(leaf(0, 1.0, 0.8), leaf(angle, 1.0, 0.8))


def zigzag(rng):
    angle = radians(rng.uniform(25, 75))  # 30 to 130 degrees between the leaves
    parts, start = [], np.zeros(3)
    for k in range(4):
        side = 0.5 * np.array([cos(angle), 0, (-1) ** k * sin(angle)])
        parts.append((start, side, np.array([0, 0.8, 0])))
        start = start + side
    return rectangles(*parts, thickness=0.5)


def steps(rng):
    rise, parts = rng.uniform(0.25, 0.4), []
    for k in range(3):
        parts.append(([0.35 * k, 0, rise * k], [0.35, 0, 0], [0, 0.8, 0]))
        parts.append(([0.35 * (k + 1), 0, rise * k], [0, 0, rise], [0, 0.8, 0]))
    return rectangles(*parts, thickness=0.5)


def t_sheets(rng):
    return rectangles(leaf(0, 1.0, 0.6), leaf(pi, 1.0, 0.6), leaf(pi / 2, 1.0, 0.7))


def y_sheets(rng):
    first = radians(rng.uniform(0, 40))
    second = first + radians(rng.uniform(80, 140))
    third = second + radians(rng.uniform(80, 140))
    return rectangles(*(leaf(angle, 1.0, 0.6) for angle in (first, second, third)))


def x_sheets(rng):
    angle = radians(rng.uniform(50, 130))
    return rectangles(*(leaf(turn, 1.0, 0.6) for turn in (0, angle, pi, pi + angle)))


def torus_patch(rng):
    u, v, minor = rng.uniform(1.5, 4.5), rng.uniform(1.5, 4.0), 0.4

    def place(s, t):
        ring = 1 + minor * np.cos(t)
        return np.stack([ring * np.cos(s), ring * np.sin(s), minor * np.sin(t)], axis=-1)

    x = (f"(1 + {minor}*cos(v))*cos(u)", f"(1 + {minor}*cos(v))*sin(u)", f"{minor}*sin(v)")
    return Formula(x, (0.0, u), (0.0, v), place, thickness=0.8)


def moebius(rng):
    half = rng.uniform(0.25, 0.4)

    def place(s, t):
        ring = 1 + t * np.cos(s / 2)
        return np.stack([ring * np.cos(s), ring * np.sin(s), t * np.sin(s / 2)], axis=-1)

    x = ("(1 + v*cos(u/2))*cos(u)", "(1 + v*cos(u/2))*sin(u)", "v*sin(u/2)")
    return Formula(x, (0.0, 2 * pi), (-half, half), place, (("periodic_u", True), ("glue_u", "flip")), thickness=0.6)


def saddle(rng):
    bend = rng.uniform(0.3, 0.8)
    x = ("u", "v", f"{bend}*(u**2 - v**2)")
    return Formula(x, (-0.7, 0.7), (-0.7, 0.7), lambda s, t: np.stack([s, t, bend * (s**2 - t**2)], axis=-1))


def waves(rng):
    rise = rng.uniform(0.1, 0.2)
    x = ("u", "v", f"{rise}*sin(4*u)*cos(3*v)")
    place = lambda s, t: np.stack([s, t, rise * np.sin(4 * s) * np.cos(3 * t)], axis=-1)  # noqa: E731
    return Formula(x, (-0.8, 0.8), (-0.6, 0.6), place)


@dataclass(frozen=True, eq=False)
class Cloud:
    """A sphere by the points of a cloud."""

    seed: int
    thickness: float = 2.0
    area: float = 4 * pi

    @cached_property
    def source(self):
        points = np.random.default_rng(self.seed).normal(size=(6000, 3))
        return ck.source("pointcloud.points", points=points / np.linalg.norm(points, axis=1)[:, None], closed=True)

    def mesh(self, spacing):
        return sphere(None).mesh(spacing)

    def feet(self, x):
        answer = self.source.closest_point(x)
        return answer.points, answer.edge >= 0


def cloud(rng):
    return Cloud(int(rng.integers(1000)))


KINDS = {
    kind.__name__: kind
    for kind in (
        sphere, torus, capsule, lens, open_cylinder, capped_cylinder, open_cone, closed_cone, double_cone, frustum, cup,
        disc, annulus, bowl, hemisphere, vase, hat, washer, nested_spheres, torus_ring, plate, cuboid, cube, open_box,
        tube_of_four, corner, thin_box, two_boxes, two_plates, fold, zigzag, steps, t_sheets, y_sheets, x_sheets,
        torus_patch, moebius, saddle, waves, cloud,
    )
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Case:
    """A bare surface, a spacing and an origin of the lattice."""

    name: str
    source: BareSurface
    spacing: float
    origin: np.ndarray

    def __str__(self):
        return self.name


def rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def spacing_of(rng, size, thickness):
    """Return a spacing from size/13 to size/5, a quarter each 1/n, 1/(n + 1/2), one digit, at random."""
    wanted = min(rng.uniform(size / 13, size / 5), thickness / 1.3)
    kind = rng.integers(4)
    if kind == 0:
        return 1 / np.ceil(1 / wanted)
    if kind == 1:
        return 1 / (np.ceil(1 / wanted) + 0.5)
    if kind == 2:
        digit = 10.0 ** np.floor(np.log10(wanted))
        return float(np.round(np.floor(wanted / digit) * digit, 10))
    return wanted


def draws(seed, count, kinds=tuple(KINDS)):
    """Yield the cases of ``count`` draws, three origins each: the default, a corner in a lattice or knot plane, any."""
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        kind = kinds[rng.integers(len(kinds))]
        shape = KINDS[kind](rng)
        aligned = rng.random() < 0.6
        if not aligned:
            shape = Moved(shape, rotation(rng), rng.uniform(-0.1, 0.1, 3))
        source = BareSurface(shape)
        low, high = source.bounds
        spacing = float(spacing_of(rng, (high - low).max(), shape.thickness))
        nice = low + 0.5 * spacing * rng.integers(2)
        anywhere = 0.5 * (low + high) + spacing * rng.uniform(-0.5, 0.5, 3)
        for name, origin in (("default", 0.5 * (low + high)), ("nice", nice), ("random", anywhere)):
            label = f"{kind} {seed}:{number} {'aligned' if aligned else 'turned'} h={spacing:.4g} {name}"
            yield Case(label, source, spacing, origin)
