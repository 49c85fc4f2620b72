"""Curves of many kinds, drawn at random: each with the smallest distance of strands that do not meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from extremes.curve_arcs import Arc, ArcCurve

#: Spacings are from 1/30 to 1/5 of the size, and at most this share of the distance of strands.
FINEST, COARSEST, OF_THICKNESS = 30.0, 5.0, 1 / 1.3
#: Where the lattice lies: as by default, with a corner of the box in a node or halfway between two, or anywhere.
ORIGINS = ("default", "nice", "random")


@dataclass(frozen=True)
class Case:
    """A curve, a spacing and the origins of three lattices; ``name`` says kind and position."""

    name: str
    curve: ArcCurve
    spacing: float
    origins: tuple


def case(kind, seed):
    """Return the case of a kind that a seed draws."""
    rng = np.random.default_rng([sorted(KINDS).index(kind), seed])
    nodes, arcs, thickness = KINDS[kind](rng)
    dim = np.shape(nodes)[1]
    aligned = rng.random() < 0.6
    turn = None if aligned else np.linalg.qr(rng.normal(size=(dim, dim)))[0]
    curve = ArcCurve(nodes, arcs, turn, 0.0 if aligned else rng.uniform(-1, 1, dim))
    size = curve.size
    spacing = min(np.exp(rng.uniform(np.log(size / FINEST), np.log(size / COARSEST))), OF_THICKNESS * thickness)
    spacing = _rounded(rng, float(spacing))
    corner = curve.bounds[0] + rng.choice([0.0, 0.5]) * spacing
    return Case(
        f"{kind} {'aligned' if aligned else 'turned'}", curve, spacing, (None, corner, rng.uniform(0, spacing, dim))
    )


def _rounded(rng, spacing):
    """Return the spacing as it is, to one digit, as 1/n or as 1/(n + 1/2)."""
    which = rng.integers(4)
    if which == 0:
        return 1 / np.ceil(1 / spacing)
    if which == 1:
        return 1 / (np.ceil(1 / spacing) + 0.5)
    return float(f"{0.95 * spacing:.0e}") if which == 2 and float(f"{0.95 * spacing:.0e}") <= spacing else spacing


def _lines(*pairs):
    return [Arc((int(a), int(b))) for a, b in pairs]


def _ring(count, first=0):
    return [(first + i, first + (i + 1) % count) for i in range(count)]


def _chain(count):
    return [(i, i + 1) for i in range(count - 1)]


def _round(radius=1.0, centre=(0.0, 0.0), second=None):
    """Return the derivatives of a circle, or of an ellipse with another half axis ``second``."""
    axes, centre = np.array([radius, radius if second is None else second]), np.asarray(centre)

    def at(t, k):
        return axes * np.stack([np.cos(t + k * np.pi / 2), np.sin(t + k * np.pi / 2)], axis=1) + (
            centre if k == 0 else 0.0
        )

    return at


def _waves(*rows):
    """Return the derivatives of coordinates that are sums of terms (size, frequency, phase) of sines, or polynomials.

    A term (size, 0, power) is size t**power.
    """

    def term(t, k, size, frequency, phase):
        if frequency:
            return size * frequency**k * np.sin(frequency * t + phase + k * np.pi / 2)
        return size * np.polyval(np.polyder(np.eye(int(phase) + 1)[0], k), t) + 0.0 * t

    def at(t, k):
        return np.stack([sum(term(t, k, *one) for one in row) for row in rows], axis=1)

    return at


def _closed(at, dim=2, start=0.0):
    node = at(np.array([start]), 0)
    return node, [Arc((0, 0), at, start, start + 2 * np.pi)]


def _open(at, start, stop):
    return at(np.array([start, stop]), 0), [Arc((0, 1), at, start, stop)]


def _polygon(rng):
    n = int(rng.integers(3, 9))
    angle = 2 * np.pi * np.arange(n) / n + rng.choice([0.0, np.pi / 2, rng.uniform(0, 1)])
    return np.stack([np.cos(angle), np.sin(angle)], axis=1), _lines(*_ring(n)), 2 * np.sin(np.pi / n)


def _rectangle(rng, width=None):
    width = rng.uniform(0.5, 1.5) if width is None else width
    return np.array([[0, 0], [width, 0], [width, 1], [0, 1.0]]), _lines(*_ring(4)), min(width, 1.0)


def _star(rng):
    n, inner = int(rng.integers(4, 8)), rng.uniform(0.4, 0.6)
    angle = np.pi * np.arange(2 * n) / n + np.pi / 2
    reach = np.where(np.arange(2 * n) % 2, inner, 1.0)
    points = reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points, _lines(*_ring(2 * n)), np.linalg.norm(points[1] - points[0])


def _wedge(rng):
    angle = np.deg2rad(rng.uniform(15, 40))
    first = rng.choice([0.0, np.pi / 2, rng.uniform(0, 2 * np.pi)])
    ends = [[np.cos(a), np.sin(a)] for a in (first, first + angle)]
    return np.array([[0.0, 0.0], *ends]), _lines((0, 1), (0, 2)), 1.0


def _open_square(rng):
    gap = rng.uniform(0.3, 0.7)
    points = np.array([[gap, 0], [0, 0], [0, 1], [1, 1], [1, 0.0]])
    return (points, _lines(*_chain(5)), 1 - gap) if rng.random() < 0.5 else (points[1:], _lines(*_chain(4)), 1.0)


def _ell(rng):
    return np.array([[rng.uniform(0.5, 1), 0], [0, 0], [0, 1.0]]), _lines((0, 1), (1, 2)), 1.0


def _tee(rng):
    foot = rng.uniform(0.3, 0.7)
    points = np.array([[0, 0], [foot, 0], [1, 0], [foot, -rng.uniform(0.5, 1)]])
    return points, _lines((0, 1), (1, 2), (1, 3)), 1.0


def _plus(rng):
    x, y = rng.uniform(0.3, 0.7, 2)
    points = np.array([[x, y], [0, y], [1, y], [x, 0], [x, 1.0]])
    return points, _lines(*[(0, i) for i in range(1, 5)]), 0.6


def _grid(rng):
    n, m = rng.integers(2, 5, 2)
    number = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
    points = np.stack(np.meshgrid(np.arange(n + 1.0), np.arange(m + 1.0), indexing="ij"), axis=-1).reshape(-1, 2)
    pairs = [*zip(number[:-1].ravel(), number[1:].ravel(), strict=True)]
    pairs += [*zip(number[:, :-1].ravel(), number[:, 1:].ravel(), strict=True)]
    return points / 3, _lines(*pairs), 1 / 3


def _steps(rng):
    n = int(rng.integers(2, 5))
    points = np.array([[(i + 1) // 2, i // 2] for i in range(2 * n + 1)], dtype=float) / n
    return points, _lines(*_chain(2 * n + 1)), 1 / n


def _two_squares(rng):
    gap = rng.uniform(0.25, 0.5)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    return np.concatenate([square, square + [1 + gap, rng.choice([0.0, 0.3])]]), _lines(*_ring(4), *_ring(4, 4)), gap


def _nested_squares(rng):
    half = rng.uniform(0.3, 0.7)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
    return np.concatenate([square, half * square]), _lines(*_ring(4), *_ring(4, 4)), min(1 - half, 2 * half)


def _circle(rng):
    return *_closed(_round(), 2, rng.uniform(0, 6)), 2.0


def _ellipse(rng):
    ratio = rng.uniform(0.3, 0.9)
    return *_closed(_round(1.0, second=ratio)), 2 * ratio


def _eight(rng):
    at = _waves([(1, 1, 0)], [(rng.uniform(0.3, 0.7), 2, 0)])
    return np.zeros((1, 2)), [Arc((0, 0), at, 0.0, np.pi), Arc((0, 0), at, np.pi, 2 * np.pi)], 0.6


def _crossing_circles(rng):
    radius = rng.uniform(0.6, 1.0)
    apart = rng.uniform(0.7, 1.2) * radius
    x = (1 + apart**2 - radius**2) / (2 * apart)
    y = np.sqrt(1 - x * x)
    left, right = _round(), _round(radius, (apart, 0.0))
    a, b = np.arctan2(y, x), np.arctan2(y, x - apart)
    arcs = [Arc((1, 0), left, -a, a), Arc((0, 1), left, a, 2 * np.pi - a)]
    arcs += [Arc((1, 0), right, -b, b), Arc((0, 1), right, b, 2 * np.pi - b)]
    return np.array([[x, y], [x, -y]]), arcs, min(1 + radius - apart, 1 - radius + apart, 1.0)


def _arc(rng):
    start = rng.uniform(0, 6)
    turn = rng.uniform(1, 5.5)
    return *_open(_round(), start, start + turn), 2 * np.sin(min(np.pi / 2, np.pi - turn / 2))


def _sine(rng):
    rate = rng.uniform(2, 6)
    return *_open(_waves([(1, 0, 1)], [(rng.uniform(0.1, 0.3), rate, rng.uniform(0, 6))]), 0.0, 2.0), 1.5 / rate


def _in_space(points):
    return np.concatenate([points, np.zeros((len(points), 1))], axis=1)


def _square_in_space(rng):
    points, arcs, thick = _rectangle(rng, 1.0)
    return np.roll(_in_space(points), rng.integers(3), axis=1), arcs, thick


def _ell_in_space(rng):
    points, arcs, thick = _ell(rng)
    return np.roll(_in_space(points), rng.integers(3), axis=1), arcs, thick


def _steps_in_space(rng):
    n = int(rng.integers(3, 7))
    walk = np.concatenate([np.zeros((1, 3)), np.cumsum(np.eye(3)[np.arange(n) % 3], axis=0)])
    return walk / 2, _lines(*_chain(n + 1)), 0.5


def _cube_frame(rng):
    points = np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    pairs = [(i, j) for i in range(8) for j in range(i) if np.abs(points[i] - points[j]).sum() == 1]
    return points * [1.0, rng.choice([1.0, 0.7]), 1.0], _lines(*pairs), 0.7


def _tripod(rng):
    return np.concatenate([np.zeros((1, 3)), np.eye(3) * rng.uniform(0.5, 1, 3)]), _lines((0, 1), (0, 2), (0, 3)), 1.0


def _circle_in_space(rng):
    return *_closed(_waves([(1, 1, np.pi / 2)], [(1, 1, 0)], [(0, 1, 0)]), 3), 2.0


def _helix(rng):
    pitch = rng.uniform(0.1, 0.2)
    return *_open(_waves([(0.5, 1, np.pi / 2)], [(0.5, 1, 0)], [(pitch / 2, 0, 1)]), 0.0, 4 * np.pi), np.pi * pitch


def _trefoil(rng):
    x, y = [(1, 2, np.pi / 2), (0.25, 5, np.pi / 2), (0.25, 1, np.pi / 2)], [(1, 2, 0), (0.25, 5, 0), (-0.25, 1, 0)]
    return *_closed(_waves(x, y, [(0.5, 3, 0)]), 3), 0.5


def _segment(rng):
    dim = int(rng.integers(2, 4))
    return np.stack([np.zeros(dim), rng.choice([0.0, 1.0, rng.uniform()], dim) + np.eye(dim)[0]]), _lines((0, 1)), 1.0


def _theta(rng):
    arcs = [Arc((0, 1), _round(), 0.0, np.pi), Arc((1, 0), _round(), np.pi, 2 * np.pi), Arc((0, 1))]
    return np.array([[1.0, 0.0], [-1.0, 0.0]]), arcs, 0.7


def _stadium(rng):
    half = rng.uniform(0.3, 1.0)
    points = np.array([[half, -0.5], [half, 0.5], [-half, 0.5], [-half, -0.5]])
    right, left = _round(0.5, (half, 0.0)), _round(0.5, (-half, 0.0))
    arcs = [Arc((0, 1), right, -np.pi / 2, np.pi / 2), Arc((2, 3), left, np.pi / 2, 1.5 * np.pi)]
    return points, arcs + _lines((1, 2), (3, 0)), 1.0


def _zigzag(rng):
    n, height = int(rng.integers(3, 6)), rng.uniform(0.3, 0.8)
    points = np.stack([np.arange(n + 1.0), height * (np.arange(n + 1) % 2)], axis=1) / 2
    return points, _lines(*_chain(n + 1)), 0.5


def _linked_circles(rng):
    first = _waves([(1, 1, np.pi / 2)], [(1, 1, 0)], [(0, 1, 0)])
    second = _waves([(1, 1, np.pi / 2), (1, 0, 0)], [(0, 1, 0)], [(1, 1, 0)])
    arcs = [Arc((i, i), at, 0, 2 * np.pi) for i, at in enumerate((first, second))]
    return np.array([[1.0, 0, 0], [2.0, 0, 0]]), arcs, 0.9


def _great_circles(rng):
    tilt = rng.uniform(0.6, np.pi / 2)
    first = _waves([(1, 1, np.pi / 2)], [(1, 1, 0)], [(0, 1, 0)])
    second = _waves([(1, 1, np.pi / 2)], [(np.cos(tilt), 1, 0)], [(np.sin(tilt), 1, 0)])
    halves = (((0, 1), 0.0), ((1, 0), np.pi))
    arcs = [Arc(ends, at, start, start + np.pi) for at in (first, second) for ends, start in halves]
    return np.array([[1.0, 0, 0], [-1.0, 0, 0]]), arcs, 1.0


def _crossed_lines(rng):
    """Return three lines through one point of space, at angles of 30 degrees or more."""
    while True:
        ways = rng.normal(size=(3, 3))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        if np.abs((ways @ ways.T)[[0, 0, 1], [1, 2, 2]]).max() < 0.85:
            return np.concatenate([np.zeros((1, 3)), ways, -ways]), _lines(*[(0, i) for i in range(1, 7)]), 0.6


KINDS = {
    "polygon": _polygon,
    "square": lambda rng: _rectangle(rng, 1.0),
    "rectangle": _rectangle,
    "star": _star,
    "wedge": _wedge,
    "open square": _open_square,
    "L": _ell,
    "T": _tee,
    "plus": _plus,
    "grid": _grid,
    "steps": _steps,
    "two squares": _two_squares,
    "nested squares": _nested_squares,
    "circle": _circle,
    "ellipse": _ellipse,
    "eight": _eight,
    "crossing circles": _crossing_circles,
    "arc": _arc,
    "sine": _sine,
    "square in space": _square_in_space,
    "L in space": _ell_in_space,
    "steps in space": _steps_in_space,
    "cube frame": _cube_frame,
    "tripod": _tripod,
    "circle in space": _circle_in_space,
    "helix": _helix,
    "trefoil": _trefoil,
    "segment": _segment,
    "theta": _theta,
    "stadium": _stadium,
    "zigzag": _zigzag,
    "linked circles": _linked_circles,
    "great circles": _great_circles,
    "crossed lines": _crossed_lines,
}
