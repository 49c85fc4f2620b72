"""Three curves meet, each zone with its own material and solution: full order, and definite at a contrast of 1e4."""

import numpy as np
import pytest
from model_problems import order_of
from small_galerkin import small

import cpmkit as ck
from cpmkit.mesh.subdivision import subdivide
from cpmkit.plugin import Mesh

SPACINGS = (0.2, 0.14, 0.1)
#: Rows: two axes of the hexagon's plane, and its normal.
FRAME = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
FRAME[2] = np.cross(FRAME[0], FRAME[1])
ARMS = 2 * np.pi / 3 * np.arange(3)


def hexagon():
    """Six triangles about the origin; three of their edges are the curves, from the middle outwards."""
    angles = np.pi / 3 * np.arange(6)
    flat = np.append(np.stack([np.cos(angles), np.sin(angles)], axis=1), [[0, 0]], axis=0)
    cells = np.stack([np.full(6, 6), np.arange(6), (np.arange(6) + 1) % 6], axis=1)
    cut = np.array([[6, 0], [6, 2], [6, 4]])
    return Mesh(flat @ FRAME[:2], cells, None, cut, np.arange(3), np.zeros(3, dtype=bool))


def plane(x):
    return x @ FRAME[:2].T


def zone_of(x):
    """Zone z lies from arm z counterclockwise to the next."""
    u, v = plane(x).T
    return np.minimum((np.mod(np.arctan2(v, u), 2 * np.pi) / (2 * np.pi / 3)).astype(int), 2)


def solution(zone, x):
    """u, grad u (n, 2) and Lap u in a zone: sin(3 u + zone) + zone v^2 + zone."""
    u, v = plane(x).T
    value = np.sin(3 * u + zone) + zone * v**2 + zone
    return value, np.stack([3 * np.cos(3 * u + zone), 2 * zone * v], axis=1), -9 * np.sin(3 * u + zone) + 2.0 * zone


def exact(x, zone=None):
    zone = zone_of(x) if zone is None else zone
    return solution(zone, x)[0]


def junction(materials):
    materials = np.asarray(materials)

    def f(x):
        zone = zone_of(x)
        value, _, laplacian = solution(zone, x)
        return value - materials[zone] * laplacian

    def arm(number):
        left, right = number, (number - 1) % 3
        along = np.array([np.cos(ARMS[number]), np.sin(ARMS[number])])
        out_of_left = np.array([along[1], -along[0]])

        def jump(x):
            return exact(x, left) - exact(x, right)

        def flux(x):
            slopes = [solution(zone, x)[1] @ out_of_left for zone in (left, right)]
            return materials[left] * slopes[0] - materials[right] * slopes[1]

        line = ck.source("analytic.segment", start=np.zeros(3), end=along @ FRAME[:2])
        return ck.Boundary(f"arm {number}", line, across=ck.Transmission(jump, flux))

    mesh = hexagon()
    surface = ck.source("mesh.triangles", vertices=mesh.vertices, faces=mesh.cells, closest="faceted")
    problem = ck.Elliptic(f, diffusivity=lambda x: materials[zone_of(x)], c=1.0)
    return ck.Scene(surface, problem, [arm(number) for number in range(3)], edge=ck.Dirichlet(exact))


def solve(scene, spacing, place, share=0.15):
    return small(scene, subdivide(hexagon(), share * spacing), spacing, spacing * np.asarray(place))


@pytest.mark.parametrize("materials", [(1.0, 1.0, 1.0), (1.0, 10.0, 1000.0)])
def test_order(materials):
    scene, found = junction(materials), []
    for spacing in SPACINGS:
        one = solve(scene, spacing, (0.3, 0.1, 0.7))
        found.append(np.sqrt(np.mean((one.solved()[:, 0] - exact(one.points)) ** 2)))
    assert order_of(SPACINGS, found) > 2.5
    assert found[2] < 1e-4


def test_definite_at_any_position():
    scene = junction((1.0, 100.0, 0.01))
    for place in np.random.default_rng(4).uniform(size=(12, 3)):
        assert solve(scene, 0.2, place, 0.5).definite()
