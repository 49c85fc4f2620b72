"""A cylinder with rims and curves across it: a mesh of it, and conditions that a known solution keeps."""

import numpy as np

import cpmkit as ck
from cpmkit.plugin import Mesh

RADIUS, LENGTH, CUT = 0.5, 1.0, 0.44
AXIS = np.array([0.36, 0.48, 0.8])
#: Rows: the frame of the cylinder, its axis last.
FRAME = np.array([[0.8, -0.6, 0.0], [0.48, 0.64, -0.6], AXIS])


def placed(z, angle):
    return np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), z - 0.5 * LENGTH], axis=-1) @ FRAME


def local(x):
    """The height z from the lower rim, and the angle."""
    y = x @ FRAME.T
    return y[..., 2] + 0.5 * LENGTH, np.arctan2(y[..., 1], y[..., 0])


def cylinder_mesh(spacing, cut=CUT):
    """Quadratic triangles that go round the cylinder in rings, one of which is the cut."""
    heights = [
        np.linspace(*ends, int(np.ceil(abs(ends[1] - ends[0]) / (0.25 * spacing))) + 1)
        for ends in ((0, cut), (cut, LENGTH))
    ]
    z = np.unique(np.concatenate(heights))
    around = int(np.ceil(2 * np.pi * RADIUS / (0.25 * spacing)))
    ring, step = np.meshgrid(np.arange(len(z) - 1), np.arange(around), indexing="ij")
    a, b = ring * around + step, ring * around + (step + 1) % around
    c, d = a + around, b + around
    cells = np.concatenate([np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)])
    place = np.stack(np.meshgrid(z, 2 * np.pi * np.arange(around) / around, indexing="ij"), axis=-1).reshape(-1, 2)
    ends = place[cells]
    turned = np.mod(ends[..., 1] - ends[:, :1, 1] + np.pi, 2 * np.pi) - np.pi + ends[:, :1, 1]
    flat = np.stack([ends[..., 0], turned], axis=-1)
    middles = 0.5 * (np.roll(flat, -1, axis=1) + np.roll(flat, -2, axis=1))
    at = int(np.flatnonzero(np.isclose(z, cut))[0]) * around + np.arange(around)
    edges = np.stack([at, np.roll(at, -1)], axis=1)
    owner = np.zeros(around, dtype=np.int64)
    return Mesh(placed(*place.T), cells, placed(middles[..., 0], middles[..., 1]), edges, owner, owner > 0)


def below(z):
    return np.sin(2 * z) + 0.5, 2 * np.cos(2 * z), -4 * np.sin(2 * z)


def above(z):
    return np.cos(3 * z), -3 * np.sin(3 * z), -9 * np.cos(3 * z)


def exact_of(mesh, upper=above, cut=CUT):
    """u = Z(z) (1 + cos(angle)) on both sides of the cut, told apart by the cells."""
    centre = local(mesh.vertices[mesh.cells].mean(axis=1))[0]

    def exact(x, cell):
        z, angle = local(x)
        return np.where(centre[cell] < cut, below(z)[0], upper(z)[0]) * (1 + np.cos(angle))

    return exact


def problem(k_above=1.0, upper=above):
    def f(x):
        z, angle = local(x)
        k, (u, _, u_zz) = np.where(z < CUT, 1.0, k_above), np.where(z < CUT, below(z), upper(z))
        return (u - k * u_zz) * (1 + np.cos(angle)) + k * u * np.cos(angle) / RADIUS**2

    return ck.Elliptic(f, diffusivity=lambda x: np.where(local(x)[0] < CUT, 1.0, k_above), c=1.0)


def times(number):
    """A datum: ``number`` on the axis' profile, times what u depends on round the cylinder."""
    return lambda x: number * (1 + np.cos(local(x)[1]))


def condition(kind, value, slope):
    if kind == "dirichlet":
        return ck.Dirichlet(times(value))
    if kind == "neumann":
        return ck.Neumann(times(slope))
    alpha = float(kind)
    return ck.Robin(alpha, 1.0, times(alpha * slope + value))


def scene(boundary, edge, k_above=1.0, upper=above):
    surface = ck.source("analytic.cylinder", axis=AXIS, radius=RADIUS, length=LENGTH)
    circle = ck.source("analytic.circle", center=(CUT - 0.5 * LENGTH) * AXIS, normal=AXIS, radius=RADIUS)
    edge = edge or {0: condition("dirichlet", below(0.0)[0], 0), 1: condition("neumann", 0, upper(LENGTH)[1])}
    return ck.Scene(surface, problem(k_above, upper), [ck.Boundary("cut", circle, **boundary)], edge)


def unlike(above_kind, below_kind):
    """The circle's left is above it: counterclockwise about the axis, with the normal outwards."""
    return {
        "left": condition(above_kind, above(CUT)[0], -above(CUT)[1]),
        "right": condition(below_kind, below(CUT)[0], below(CUT)[1]),
    }
