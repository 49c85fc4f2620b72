"""Limbs few spacings thick, neighbours few spacings apart: no negative eigenvalue, and nothing leaks."""

import numpy as np
import pytest
from palm_mesh import FINGER_RADIUS, palm

import cpmkit as ck
from cpmkit.forms.galerkin.dof_map import connected_pieces

#: Of the palm below, by linear finite elements on its mesh split twice, extrapolated.
PALM = np.array([7.277, 9.673, 10.513, 12.051])


def lowest(source, spacing, count, **options):
    """Return the lowest eigenvalues of -Lap, by the direct solver."""
    scene = ck.Scene(source, ck.Eigen(count))
    return ck.solve(scene, spacing, form="galerkin", solver="direct", **options).eigenvalues


@pytest.mark.filterwarnings("ignore:The manifold is thin")
@pytest.mark.parametrize(
    ("thickness", "share"), [(2.0, 0.01), (1.5, 0.02), pytest.param(1.0, 0.05, marks=pytest.mark.slow)]
)
def test_eigenvalues_of_a_palm(thickness, share):
    vertices, faces = palm()
    source = ck.source("mesh.triangles", vertices=vertices, faces=faces, closest="faceted")
    spacing, errors = 2 * FINGER_RADIUS / thickness, []
    for shift in np.random.default_rng(0).uniform(0, spacing, (2, 3)):
        found = lowest(source, spacing, 5, origin=shift)
        assert found[0] == pytest.approx(0, abs=1e-8)
        errors.append(found[1:] / PALM - 1)
    assert np.abs(np.mean(errors, axis=0)).max() < share
    assert np.min(errors) > -1e-3  # Galerkin's eigenvalues lie above the exact ones


def test_seven_eigenvalues_of_a_moebius_band():
    fine = np.array([1.0054988, 1.0058354, 3.9761759, 3.9761977, 8.7798754, 8.7798889, 15.2338549])  # at h = .033
    found = lowest(ck.source("parametric.moebius"), 0.1, 8)
    np.testing.assert_allclose(found[1:], fine, rtol=1e-4)


@pytest.mark.filterwarnings("ignore:The manifold is thin")
@pytest.mark.parametrize("thickness", [1.0, 1.5, 2.0, 2.5])
def test_a_ring_around_a_limb_keeps_two_constants_apart(thickness):
    spacing = 0.1
    radius = 0.5 * thickness * spacing
    limb = ck.source("analytic.cylinder", radius=radius, length=2.0)
    ring = ck.source("analytic.circle", radius=radius, normal=[0, 0, 1])
    scene = ck.Scene(limb, ck.Laplace(), [ck.Boundary("ring", ring, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))])
    angle, z = np.linspace(0, 6, 50), np.linspace(-0.95, 0.95, 50)
    at = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    for shift in np.random.default_rng(0).uniform(0, spacing, (3, 3)):
        solution = ck.solve(scene, spacing, form="galerkin", solver="direct", origin=shift)
        exact = np.where(solution.signed_distance("ring", at) > 0, 1.0, 0.0)
        assert exact.sum() == 25
        np.testing.assert_allclose(solution.evaluate(at), exact, atol=1e-6)


@pytest.mark.parametrize("gap", [4.0, 2.0, 1.5, 0.3])
def test_spheres_side_by_side_do_not_feel_each_other(gap):
    spacing, radius = 0.1, 0.3
    apart = 2 * radius + gap * spacing
    spheres = [ck.source("analytic.sphere", radius=radius, center=[x, 0, 0]) for x in (0, apart)]
    pair = ck.source("union", members=spheres)

    def sign(x):
        return np.where(x[:, 0] < apart / 2, 1.0, -1.0)

    solution = ck.solve(ck.Scene(pair, ck.ScreenedPoisson(sign)), spacing, form="galerkin", solver="direct")
    assert connected_pieces(solution.discretized.space.dof_map)[0] == 2
    at = solution.discretized.points
    np.testing.assert_allclose(solution.evaluate(at), sign(at), atol=1e-9)


def test_an_arc_does_not_feel_its_other_end_over_a_gap():
    spacing = 0.05
    gap = 1.5 * spacing
    arc = ck.source("analytic.arc", start=gap / 2, end=2 * np.pi - gap / 2)
    angle = np.linspace(gap / 2, 2 * np.pi - gap / 2, 400)
    at, exact = np.stack([np.cos(angle), np.sin(angle)], axis=1), 1 - 2 * (angle - gap / 2) / (2 * np.pi - gap)
    scene = ck.Scene(arc, ck.Laplace(), edge=ck.Dirichlet(lambda x: np.sign(x[:, 1])))
    for shift in np.random.default_rng(0).uniform(0, spacing, (4, 2)):
        found = ck.solve(scene, spacing, form="galerkin", solver="direct", origin=shift).evaluate(at)
        np.testing.assert_allclose(found, exact, atol=1e-5)


def test_a_sphere_does_not_feel_its_other_side_over_a_slit():
    """A zone of the sphere, slit along a meridian two spacings wide: u is linear in the longitude."""
    spacing = 0.1
    turn = {"u": [spacing, 2 * np.pi - spacing], "v": [-0.3, 0.3]}
    zone = ck.source("parametric.surface", x=["cos(u)*cos(v)", "sin(u)*cos(v)", "sin(v)"], **turn)

    def exact(x):
        return 1 - (np.arctan2(x[:, 1], x[:, 0]) % (2 * np.pi) - spacing) / (np.pi - spacing)

    rng = np.random.default_rng(0)
    u, v = rng.uniform(*turn["u"], 500), rng.uniform(*turn["v"], 500)
    at = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], axis=1)
    for shift in rng.uniform(0, spacing, (2, 3)):
        scene = ck.Scene(zone, ck.Laplace(), edge=ck.Dirichlet(exact))
        found = ck.solve(scene, spacing, form="galerkin", solver="direct", origin=shift).evaluate(at)
        np.testing.assert_allclose(found, exact(at), atol=1e-3)
