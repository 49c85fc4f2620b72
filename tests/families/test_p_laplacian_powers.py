"""p-Laplacians from the Laplacian to p = 10, whose diffusivity vanishes where u is flat, against exact solutions."""

import numpy as np
import pytest

import cpmkit as ck

SPHERE, CIRCLE = ck.source("analytic.sphere"), ck.source("analytic.circle")
REGULARIZATION = 1e-3


def on_circle(p, c):
    """u = y: -d/dt(|cos t|^(p - 2) cos t) = (p - 1) |cos t|^(p - 2) sin t."""
    f = lambda x: (p - 1) * np.abs(x[:, 0]) ** (p - 2) * x[:, 1] + c * x[:, 1]  # noqa: E731
    return ck.Scene(CIRCLE, ck.PLaplacian(p, f, c, regularization=REGULARIZATION))


def on_sphere(p, c):
    """u = z with slope s: -div(s^(p - 2) grad z) = p s^(p - 2) z."""
    f = lambda x: (p * np.maximum(1 - x[:, 2] ** 2, 0) ** (p / 2 - 1) + c) * x[:, 2]  # noqa: E731
    return ck.Scene(SPHERE, ck.PLaplacian(p, f, c, regularization=REGULARIZATION))


def error(scene, spacing):
    points = np.random.default_rng(0).normal(size=(100, scene.surface.dim))
    points /= np.linalg.norm(points, axis=1)[:, None]
    found = ck.solve(scene, spacing)
    return np.abs(found.evaluate(points) - points[:, -1]).max() / 2


@pytest.mark.parametrize("c", [0.0, 1.0])
@pytest.mark.parametrize("p", [5.0, 10.0])
def test_circles(p, c):
    assert error(on_circle(p, c), 0.1) < 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("c", [0.0, 1.0])
@pytest.mark.parametrize("p", [2.0, 3.0, 4.0, 6.0, 8.0])
def test_circles_of_all_powers(p, c):
    assert error(on_circle(p, c), 0.1) < 3e-4


@pytest.mark.slow
@pytest.mark.parametrize("c", [0.0, 1.0])
@pytest.mark.parametrize("p", [2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0])
def test_spheres_of_all_powers(p, c):
    assert error(on_sphere(p, c), 0.25) < 1e-2


def test_steps_that_do_not_settle_raise(monkeypatch):
    monkeypatch.setattr("cpmkit.families.quasilinear.MOST_STEPS", {"newton": 2})
    with pytest.raises(ck.ConvergenceError, match=r"'p-laplacian' did not converge in 2 steps"):
        error(on_circle(8.0, 0.0), 0.2)
