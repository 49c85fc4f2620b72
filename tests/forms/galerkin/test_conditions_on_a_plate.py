"""Slits, junctions, lines that nearly touch and lines beside a rim, on a plate that is tilted in space."""

import numpy as np
import pytest
from model_problems import order_of
from plane_zones import FRAME, junction, off, slit, solved, strips
from scipy.sparse.linalg import splu

import cpmkit as ck

Y = 0.3 + 2 * np.pi / 3 * np.arange(3)
T = 0.2 + np.pi / 2 * np.arange(3)
X = 0.4 + np.pi / 2 * np.arange(4)


def positive(solution):
    """Whether no pivot is at zero or below."""
    form = solution.discretized
    matrix = form.stiffness(form.scene.problem.terms()).matrix.tocsc()
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return factors.U.diagonal().min() > 0


@pytest.mark.parametrize("angles", [Y, T, X])
@pytest.mark.parametrize("materials", [(1, 1, 1, 1), (1, 1000, 1, 1000), (1, 10, 100, 1000)])
def test_junctions(angles, materials):
    scene, value = junction(angles, materials[: len(angles)])
    spacings = [0.28, 0.2, 0.14]
    found = [off(solved(scene, spacing), value)[1] for spacing in spacings]
    assert order_of(spacings, found) > 1.3
    assert found[-1] < 2e-4


@pytest.mark.parametrize("gap", [0.1, 1e-6])
@pytest.mark.parametrize("spacing", [0.2, 0.1])
def test_lines_that_nearly_touch(gap, spacing):
    scene, value = strips(0.1, 0.1 + gap * spacing)
    for shift in range(2):
        solution = solved(scene, spacing, shift)
        assert positive(solution)
        assert off(solution, value)[1] < {0.2: 4e-4, 0.1: 1e-4}[spacing]


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_a_line_beside_a_rim(share):
    """The strip between is read from its own needles, and the plate beside it from its own triangles."""
    scene, value = strips(1 - 0.1 * share)
    solution = solved(scene, 0.1)
    assert positive(solution)
    largest, mean = off(solution, value)
    assert largest < 5e-4
    assert mean < 1.5e-4


@pytest.mark.parametrize(("kind", "bound"), [("flux", 3e-3), ("value", 5e-3)])
def test_slits(kind, bound):
    scene, value = slit(kind)
    spacings = [0.28, 0.2, 0.14]
    found = np.array([np.mean([off(solved(scene, h, k), value) for k in range(3)], axis=0) for h in spacings])
    assert order_of(spacings, found[:, 1]) > 0.9  # that of finite elements, whose spaces hold no square root either
    assert found[-1, 1] < bound
    assert order_of(spacings, found[:, 0]) > 0.45


def test_values_that_contradict_at_a_point():
    """Unlike values of two curves that meet: an error that stays, at that point alone."""
    scene, _ = junction(X, (1, 1, 1, 1))
    sides = [ck.Dirichlet(float(k % 2)) for k in range(4)]
    lines = [
        ck.Boundary(one.name, one.source, left=sides[k], right=sides[k - 1]) for k, one in enumerate(scene.boundaries)
    ]
    at = (0.3 * np.stack([np.cos(X + 0.8), np.sin(X + 0.8)], axis=1)) @ FRAME[:2]
    fine = [solved(ck.Scene(scene.surface, ck.Laplace(), lines), h).evaluate(at) for h in (0.14, 0.07)]
    np.testing.assert_allclose(fine[0], [0, 1, 0, 1], atol=1e-3)
    np.testing.assert_allclose(fine[1], [0, 1, 0, 1], atol=1e-3)
