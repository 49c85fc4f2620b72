"""Curves that were inserted along chords lie on themselves after, wherever edges of the mesh run beside them."""

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck

SPHERE = ck.source("analytic.sphere")
TORUS = ck.source("analytic.torus", major=1.0, minor=0.4)
#: Of a torus: along it on its top, along it in its hole, around it.
RINGS = [
    ((0, 0, 0.4), (0, 0, 1), 1.0),
    ((0, 0, 0.2), (0, 0, 1), 1 - np.sqrt(0.12)),
    ((np.cos(1), np.sin(1), 0), (-np.sin(1), np.cos(1), 0), 0.4),
]


def circle(center, normal, radius):
    return ck.source("analytic.circle", center=center, normal=normal, radius=radius)


def sampled(surface, curve, spacing, shift):
    scene = ck.Scene(surface, ck.Laplace(), [ck.Boundary("ring", curve, both=ck.Dirichlet(1.0))])
    origin = np.random.default_rng(shift).uniform(0, spacing, 3)
    return ck.discretize(scene, spacing, form="galerkin", origin=origin).sampled


def off(curve, one):
    mesh = one.mesh
    return curve.closest_point(one.lattice.to_scene(mesh.vertices[np.unique(mesh.cut)])).distance.max()


@pytest.mark.parametrize("height", [0.5, -0.4, 0.85065, -0.4908266547])
def test_rings_of_a_sphere(height):
    """At 0.5 one runs along edges of the mesh that the sphere draws: 352 of 422 vertices were left beside it."""
    ring, length = circle((0, 0, height), (0, 0, 1), np.sqrt(1 - height**2)), 2 * np.pi * np.sqrt(1 - height**2)
    found = []
    for spacing in (0.2, 0.14, 0.1):
        one = sampled(SPHERE, ring, spacing, 0)
        assert off(ring, one) < 1e-12
        assert one.boundary.weights[one.left].sum() == pytest.approx(length, rel=5e-6)
        assert one.samples.weights.sum() == pytest.approx(4 * np.pi, rel=2e-6)
        found.append(abs(one.samples.weights.sum() / (4 * np.pi) - 1))
    assert order_of([0.2, 0.14, 0.1], found) > 3


@pytest.mark.parametrize("shift", range(8))
def test_rings_across_a_sphere(shift):
    generator = np.random.default_rng(shift)
    axis, height = generator.normal(size=3), generator.uniform(-0.9, 0.9)
    axis /= np.linalg.norm(axis)
    ring = circle(height * axis, axis, np.sqrt(1 - height**2))
    assert off(ring, sampled(SPHERE, ring, generator.choice([0.25, 0.15]), shift)) < 1e-12


@pytest.mark.parametrize("place", RINGS)
@pytest.mark.parametrize("spacing", [0.2, 0.15])
def test_rings_of_a_torus(place, spacing):
    ring = circle(*place)
    assert off(ring, sampled(TORUS, ring, spacing, 1)) < 1e-12


def test_fluxes_through_rings_add_up():
    """Of u = atanh z between two rings: as many orders better than u as the energy is."""
    rings = [circle((0, 0, z), (0, 0, 1), np.sqrt(1 - z * z)) for z in (0.5, -0.4)]
    sides = [
        ck.Boundary(name, ring, both=ck.Dirichlet(value))
        for name, ring, value in zip("ab", rings, (1.0, 0.0), strict=True)
    ]
    exact, spacings, found = 2 * np.pi / (np.arctanh(0.5) + np.arctanh(0.4)), [0.28, 0.2, 0.14], []
    for spacing in spacings:
        solution = ck.solve(ck.Scene(SPHERE, ck.Laplace(), sides), spacing, form="galerkin", solver="direct")
        fluxes = [solution.flux(name, side) for name in "ab" for side in ("left", "right")]
        assert abs(sum(fluxes)) < 1e-11
        assert abs(fluxes[0]) < 1e-11  # u is constant above
        found.append(abs(fluxes[1] / exact - 1))
    assert order_of(spacings, found) > 3.5
    assert found[-1] < 4e-6


def test_each_side_of_a_ring_has_its_area():
    """Also where a triangle has two edges of it: they stayed straight, and errors were twenty times what they are."""
    height, places = 0.3, [(0.15152056317770446, [0.019481029531460782, 0.07565086289908668, 0.0911393698975554])]
    axis = np.array([0.3, -0.5, 0.81]) / np.linalg.norm([0.3, -0.5, 0.81])
    generator = np.random.default_rng(1)
    places += [(spacing, generator.uniform(0, spacing, 3)) for spacing in generator.uniform(0.1, 0.2, 20)]
    ring = circle(height * axis, axis, np.sqrt(1 - height**2))
    scene = ck.Scene(SPHERE, ck.Laplace(), [ck.Boundary("ring", ring, both=ck.Dirichlet(1.0))])
    for spacing, origin in places[:8]:
        one = ck.discretize(scene, spacing, form="galerkin", origin=origin)
        at, weights = one.points, one.point_weights
        assert weights[at @ axis > height].sum() / weights.sum() == pytest.approx(
            (1 - height) / 2, abs=4e-5 * spacing**3
        )
