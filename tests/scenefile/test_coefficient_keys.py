"""Tensors, and diffusivities that depend on u, in scene files."""

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.errors import CpmkitError

CIRCLE = '[surface]\nkind = "analytic.circle"\n[discretization]\nspacing = 0.2\n[problem]\n'
AT = [[1.0, 0.0], [0.0, -1.0]]


def solved(folder, problem):
    path = folder / "scene.toml"
    path.write_text(CIRCLE + problem)
    made = ck.load_scene(path)
    return ck.solve(made.scene, made.spacing, **made.options).evaluate(AT)


def by_hand(problem):
    return ck.solve(ck.Scene(ck.source("analytic.circle"), problem), 0.2).evaluate(AT)


def test_a_tensor(tmp_path):
    found = solved(tmp_path, 'kind = "elliptic"\nf = "x"\nc = 1\ndiffusivity = [[2, "x*y"], ["x*y", 3]]\n')

    def tensor(x):
        o = x[:, 0] * x[:, 1]
        return np.stack([np.stack([2 + 0 * o, o], axis=1), np.stack([o, 3 + 0 * o], axis=1)], axis=1)

    assert np.allclose(found, by_hand(ck.Elliptic(lambda x: x[:, 0], tensor, c=1.0)), atol=1e-12)


def test_formulas_of_u_and_s(tmp_path):
    found = solved(tmp_path, 'kind = "nonlinear-diffusion"\nf = "x"\nc = 1\ndiffusivity = "1 + u**2 + s"\n')
    wanted = by_hand(ck.NonlinearDiffusion(lambda u, s: 1 + u**2 + s, lambda x: x[:, 0], 1.0))
    assert np.allclose(found, wanted, atol=1e-9)


def test_the_p_laplacian_and_total_variation(tmp_path):
    found = solved(tmp_path, 'kind = "p-laplacian"\np = 3\nf = "x"\nc = 1\nregularization = 0.1\n')
    assert np.allclose(found, by_hand(ck.PLaplacian(3.0, lambda x: x[:, 0], 1.0, regularization=0.1)), atol=1e-9)
    found = solved(tmp_path, 'kind = "total-variation"\nf = "x > 0"\nc = 10\nregularization = 0.1\n')
    assert np.allclose(found, by_hand(ck.TotalVariation(lambda x: 1.0 * (x[:, 0] > 0), 10.0, 0.1)), atol=1e-9)


@pytest.mark.parametrize(("problem", "message"), [
    ('kind = "elliptic"\ndiffusivity = [1, 2]', "a list of 2 lists of 2 numbers or formulas"),
    ('kind = "elliptic"\ndiffusivity = [[1, 2], [0, 1]]', "symmetric"),
    ('kind = "nonlinear-diffusion"\ndiffusivity = "1 + v"', "diffusivity of .problem."),
    ('kind = "p-laplacian"\np = 3', "regularization"),
])  # fmt: skip
def test_what_is_refused(tmp_path, problem, message):
    with pytest.raises(CpmkitError, match=message):
        solved(tmp_path, problem)
