"""Fluxes at corners of a rim are those of its sides, wherever nodes lie: of squares and of a cube.

A datum that is read at the corner itself is that of one side: errors fell with order 1 and were told a fifth as large.
"""

import functools

import numpy as np
import pytest

import cpmkit as ck

WAVE = np.array([0.9, 1.3, -0.7])
BETA = 0.5


def u(x):
    return np.sin(x @ WAVE[: x.shape[1]] + 0.4)


def gradient(x):
    return np.cos(x @ WAVE[: x.shape[1]] + 0.4)[:, None] * WAVE[: x.shape[1]]


def outward(x, dims):
    """Return the outward normals of the square or cube from -1 to 1, of the side that is nearest."""
    axis = np.argmax(np.abs(x[:, :dims]), axis=1)
    return np.sign(x[np.arange(len(x)), axis])[:, None] * np.eye(x.shape[1])[axis]


def flux(x, dims):
    return np.sum(gradient(x) * outward(x, dims), axis=1)


def square():
    corners = np.array([[x, y, 0.0] for x in (-1, 1) for y in (-1, 1)])
    return ck.source("mesh.triangles", vertices=corners, faces=[[0, 2, 3], [0, 3, 1]], closest="faceted")


SOURCES = {
    "square in the plane": (lambda: ck.source("analytic.box", lower=[-1, -1], upper=[1, 1]), 2),
    "square in space": (square, 2),
    "cube": (lambda: ck.source("analytic.box", lower=[-1, -1, -1], upper=[1, 1, 1]), 3),
}
CONDITIONS = {
    "neumann": lambda dims: ck.Neumann(lambda x: flux(x, dims)),
    "robin": lambda dims: ck.Robin(1.0, BETA, lambda x: flux(x, dims) + BETA * u(x)),
}


@functools.cache
def solved(name, condition, spacing, origin):
    """Return a solution, and its error, root mean square, as a share of the range."""
    source, dims = SOURCES[name][0](), SOURCES[name][1]
    k = WAVE[:dims] @ WAVE[:dims]
    scene = ck.Scene(source, ck.ScreenedPoisson(lambda x: (1 + k) * u(x)), edge=CONDITIONS[condition](dims))
    solution = ck.solve(scene, spacing, form="collocation", origin=np.full(source.dim, origin))
    points = np.random.default_rng(1).uniform(-1, 1, (2000, source.dim))
    points[:, dims:] = 0
    return solution, np.sqrt(np.mean((solution.evaluate(points) - u(points)) ** 2)) / np.ptp(u(points))


@pytest.mark.parametrize("origin", [0.0, 0.013])
@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("name", SOURCES)
def test_order(name, condition, origin):
    spacings = (0.2, 0.1, 0.05) if name != "cube" else (0.2, 0.14, 0.1)
    errors = [solved(name, condition, spacing, origin)[1] for spacing in spacings]
    assert np.log(errors[0] / errors[-1]) / np.log(spacings[0] / spacings[-1]) > 1.7, errors


@pytest.mark.parametrize("origin", [0.0, 0.013])
def test_estimate(origin):
    solution, true = solved("square in space", "neumann", 0.1, origin)
    assert 0.5 < solution.error.rms[0] / true < 3


def test_beside_sides_through_which_nothing_flows():
    box = SOURCES["square in the plane"][0]()
    half = 0.5 * np.pi

    def u(x):
        return np.sin(x[:, 0] + 0.4) * np.cos(half * (x[:, 1] + 1))

    def slope(x):
        return np.cos(x[:, 0] + 0.4) * np.cos(half * (x[:, 1] + 1))

    edge = {0: ck.Neumann(lambda x: -slope(x)), 1: ck.Neumann(slope), 2: ck.Neumann(0.0), 3: ck.Neumann(0.0)}
    scene = ck.Scene(box, ck.ScreenedPoisson(lambda x: (2 + half**2) * u(x)), edge=edge)
    points = np.random.default_rng(1).uniform(-1, 1, (2000, 2))
    spacings = (0.2, 0.1, 0.05)
    solutions = [ck.solve(scene, h, form="collocation", origin=[0.013, 0.03]) for h in spacings]
    errors = [np.sqrt(np.mean((one.evaluate(points) - u(points)) ** 2)) for one in solutions]
    assert np.log2(errors[0] / errors[-1]) / 2 > 1.7, errors
