"""The error of a case: solved, perhaps saved and read back, and compared with what is exact."""

import numpy as np

import cpmkit as ck
from pairs.case import BESIDE, RING_CENTER, RING_RADIUS
from pairs.scene import scene_of

#: Points nearer than this to a boundary may lie on either side of it.
CLEAR = 2e-3
#: Neighbouring points of one curve are nearer to each other than this.
GAP = 0.2


def points_of(case):
    """Points of the manifold in local coordinates, away from where u jumps."""
    found = []
    for part in case.parts:
        angle = np.linspace(-np.pi, np.pi, 300)
        radius = part.radius * np.ones(300)
        if case.solid:
            radius *= np.sqrt(np.random.default_rng(0).uniform(0, 0.999, 300))
            angle = np.random.default_rng(1).uniform(-np.pi, np.pi, 300)
        found.append(np.asarray(part.center) + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    x = np.concatenate(found)
    x = x[case.keeps(x)]
    beside = [case.constants(x + CLEAR * step) for step in np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])]
    return x[np.ptp(beside, axis=0) == 0]


def pieces_of(case, x):
    """The piece (n,) on which the constant is free of each point; a transmission joins the two sides."""
    number = case.part_of(x)
    if not case.solid:
        return _pieces_of_curves(case, x, number)
    rings = [RING_RADIUS]
    if case.crowded:
        rings.append(RING_RADIUS + BESIDE * case.spacing)
    if case.inside == "transmission":
        rings = rings[1:]
    away = np.linalg.norm(x - RING_CENTER, axis=1)
    return number * 10 + np.sum([away < ring for ring in rings], axis=0) * (number == 0)


def _pieces_of_curves(case, x, number):
    """Points follow each other along the curves, from the angle -pi on, where closed curves go on."""
    key = 10 * number + 2 * case.lifted(x) + (case.inside != "transmission") * case.raised(x)
    ends = np.linalg.norm(np.diff(x, axis=0, prepend=x[:1]), axis=1) > GAP
    piece = np.cumsum((np.diff(key, prepend=key[0]) != 0) | ends)
    for one in np.unique(number):
        rows = np.flatnonzero(number == one)
        if np.linalg.norm(x[rows[0]] - x[rows[-1]]) < GAP and key[rows[0]] == key[rows[-1]]:
            piece[piece == piece[rows[-1]]] = piece[rows[0]]
    return piece


def error_of(case, folder):
    """The largest error at points of the manifold, and the solution."""
    scene = scene_of(case)
    solution = ck.solve(scene, case.spacing, **case.options)
    x = points_of(case)
    exact = case.u(x) * (1.1 if case.heat else 1.0)
    read = solution
    if case.reloaded:
        solution.save(folder / "solution.npz")
        read = ck.load(folder / "solution.npz", scene)
    off = read.evaluate(case.to_world(x)) - exact
    if case.free and not case.heat:
        pieces = pieces_of(case, x)
        for piece in np.unique(pieces):
            off[pieces == piece] -= off[pieces == piece].mean()
    return float(np.abs(off).max()), solution
