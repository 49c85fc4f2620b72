"""Whole spectra of the Galerkin form: the exact ones with their multiplicities, and those that meshes have."""

import numpy as np
import pytest
from cpmkit_fem.assembly import stiffness_and_mass
from exact_eigenvalues import sphere_eigenvalues, torus_eigenvalues
from scipy.sparse.linalg import eigsh

import cpmkit as ck

SURFACES = {
    "sphere": (ck.source("analytic.sphere"), sphere_eigenvalues),
    "torus": (ck.source("analytic.torus", major=1.0, minor=0.4), torus_eigenvalues),
}


@pytest.mark.parametrize(
    ("name", "spacing", "count", "share"),
    [
        ("sphere", 0.25, 25, 3e-3),
        ("torus", 0.25, 13, 4e-3),
        pytest.param("sphere", 0.1, 100, 2e-3, marks=pytest.mark.slow),
        pytest.param("torus", 0.1, 50, 5e-4, marks=pytest.mark.slow),
    ],
)
def test_every_eigenvalue_is_there_and_none_is_made_up(name, spacing, count, share):
    source, exact = SURFACES[name]
    found = ck.solve(ck.Scene(source, ck.Eigen(count)), spacing).eigenvalues
    assert abs(found[0]) <= 1e-10
    assert np.abs(found[1:] / exact(count)[1:] - 1).max() <= share


def test_the_exact_values_of_the_torus_are_exact():
    assert np.abs(torus_eigenvalues(50, nodes=97) - torus_eigenvalues(50)).max() <= 1e-10


CASES = {
    "spot": ("spot.obj", 0.0564),
    "fish": ("fish.obj", 0.0323),
    "koala": ("koala.obj", 0.0345),
}


@pytest.mark.filterwarnings("ignore:The manifold is thin")
@pytest.mark.parametrize("name", ["spot", *[pytest.param(name, marks=pytest.mark.slow) for name in ("fish", "koala")]])
def test_meshes_with_few_unknowns_have_the_eigenvalues_of_finite_elements(name, real_mesh):
    mesh, spacing = CASES[name]
    vertices, faces = ck.read_mesh(real_mesh(mesh))
    vertices = vertices / np.ptp(vertices, axis=0).max()
    stiffness, mass = stiffness_and_mass(vertices, faces)
    reference = np.sort(eigsh(stiffness, k=6, M=mass, sigma=-0.5, v0=np.ones(len(vertices)))[0])
    scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), ck.Eigen(6))
    solution = ck.solve(scene, spacing)
    assert solution.discretized.size < 5000
    assert abs(solution.eigenvalues[0]) <= 1e-9 * reference[-1]
    assert np.abs(solution.eigenvalues[1:] / reference[1:] - 1).max() <= 0.01
