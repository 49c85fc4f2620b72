"""The lowest eigenvalues of -Lap on real meshes have the right sign and are near those of the mesh itself."""

import numpy as np
import pytest
from cpmkit_fem.assembly import stiffness_and_mass
from scipy.sparse.linalg import eigsh

import cpmkit as ck

COUNT = 6


@pytest.fixture
def lowest(real_mesh):
    """The lowest eigenvalues of a mesh in a box of side 1, by linear finite elements and a function of the spacing."""

    def made(name):
        vertices, faces = ck.read_mesh(real_mesh(name))
        vertices = vertices / np.ptp(vertices, axis=0).max()
        stiffness, mass = stiffness_and_mass(vertices, faces)
        reference = np.sort(eigsh(stiffness, k=COUNT, M=mass, sigma=-0.5, v0=np.ones(len(vertices)))[0])
        scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), ck.Eigen(count=COUNT))
        return reference, lambda spacing, **options: ck.solve(scene, spacing, **options).eigenvalues

    return made


def off(found, reference):
    """The largest relative difference of those that are not zero, the first of which must be."""
    assert abs(found[0]) <= 1e-6 * reference[-1]
    return np.abs(found[1:] / reference[1:] - 1).max()


CASES = {
    # spacing, degree, and by how much at least the plain method is off
    "5,000 unknowns": ("fish.obj", 0.035, 2, 0.2),
    "9,000 unknowns": ("fish.obj", 0.025, 2, 0.3),
    "25,000 unknowns": ("fish.obj", 0.0171, 3, None),
    "28,000 unknowns": ("koala.obj", 0.0146, 2, 0.05),
}


@pytest.mark.parametrize(
    "name", [name if name == "5,000 unknowns" else pytest.param(name, marks=pytest.mark.slow) for name in CASES]
)
def test_real_meshes(name, lowest):
    mesh, spacing, degree, worse = CASES[name]
    reference, solve = lowest(mesh)
    assert off(solve(spacing, degree=degree), reference) <= 0.1
    if worse is None:  # of a positive operator
        with pytest.raises(ck.ResolutionError, match=r"eigenvalue of the wrong sign, -\d\d"):
            solve(spacing, degree=degree, sheets=False)
    else:
        assert off(solve(spacing, degree=degree, sheets=False), reference) >= worse


LEVELS = {"fish": ("fish.obj", (0.0275, 0.0195, 0.0138)), "koala": ("koala.obj", (0.0292, 0.0208, 0.0146))}


@pytest.mark.slow  # always: the fish at 5,000 unknowns
@pytest.mark.parametrize(
    ("name", "level"),
    [(name, level) for name, (_, spacings) in LEVELS.items() for level in range(len(spacings))],
)
def test_the_galerkin_form_needs_no_fine_spacing(name, level, lowest):
    """From 7,000 nodes on it is within half a percent, where separated sheets leave 5 to 50."""
    mesh, spacings = LEVELS[name]
    reference, solve = lowest(mesh)
    assert off(solve(spacings[level], form="galerkin"), reference) <= 0.005
