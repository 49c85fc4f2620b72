"""A value beside a flux on one smooth part of the edge: the border is where it is given, and estimates hold there."""

from __future__ import annotations

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.mesh.mesh import Mesh
from cpmkit.mesh.part_borders import split_at_parts

BOXES = {
    "area": ck.source("analytic.box", lower=[-1, 0], upper=[1, 1]),
    "surface": ck.source("parametric.surface", x=["u", "v", "0"], u=[-1, 1], v=[0, 1]),
    "solid": ck.source("analytic.box", lower=[-1, 0, 0], upper=[1, 1, 0.5]),
}


def root(border):
    """Return u, harmonic, zero on y = 0 at x > border, with no flux through y = 0 at x < border."""
    return lambda x: np.sqrt(x[:, 0] - border + 1j * np.maximum(x[:, 1], 0)).imag


def solve(name, border, spacing, given=None, **options):
    def without_flux(x):
        in_lids = (np.abs(x[:, 2] - 0.25) > 0.25 - 1e-9) if name == "solid" else np.zeros(len(x), dtype=bool)
        return in_lids | ((x[:, 1] < 1e-9) & (x[:, 0] < border))

    edge = [(ck.Neumann(0.0), without_flux), ck.Dirichlet(given or root(border))]
    return ck.solve(ck.Scene(BOXES[name], ck.Laplace(), edge=edge), spacing, **options)


def places(name, count=4000):
    x = np.random.default_rng(0).uniform([-1, 0, 0], [1, 1, 0.5], (count, 3))
    return x[:, :2] if name == "area" else x * [1, 1, name == "solid"]


@pytest.mark.parametrize("name", BOXES)
def test_the_estimate_is_right_and_gives_the_reason(name):
    shares = []
    for border in (0.037, -0.31) if name == "solid" else (0.037, 0.0, -0.31):
        points = places(name)
        near = points[:1000] * 0.05  # where errors are largest
        points = np.concatenate([points, near + np.eye(near.shape[1])[0] * border])
        exact = root(border)(points)
        for spacing in (0.2, 0.13) if name == "solid" else (0.2, 0.1, 0.07, 0.05):
            solution = solve(name, border, spacing)
            error = np.abs(solution.evaluate(points) - exact) / np.ptp(exact)
            true = np.sqrt(np.mean(error[: -len(near)] ** 2)), error.max()
            shares += [solution.error.of(norm) / size for norm, size in zip(("rms", "max"), true, strict=True)]
            assert solution.error.slow.startswith("a value and a flux are prescribed side by side at the edge;")
    shares = np.array(shares)
    assert np.mean((shares > 0.4) & (shares < 3)) >= 0.9
    assert 0.3 < shares.min() < shares.max() < 4


def test_where_the_data_fit_a_smooth_solution_the_estimate_is_near():
    def smooth(x):
        return np.exp(x[:, 0]) * np.sin(x[:, 1])

    edge = [
        (ck.Neumann(lambda x: -np.exp(x[:, 0])), lambda x: (x[:, 1] < 1e-9) & (x[:, 0] < 0.13)),
        ck.Dirichlet(smooth),
    ]
    solution = ck.solve(ck.Scene(BOXES["area"], ck.Laplace(), edge=edge), 0.1)
    error = np.sqrt(np.mean((solution.evaluate(places("area")) - smooth(places("area"))) ** 2))
    assert 0.5 < solution.error.of("rms") * solution.error.unit[0] / error < 4


@pytest.mark.parametrize("name", BOXES)
@pytest.mark.parametrize("border", [0.013, 0.127, -0.31])
def test_the_solution_moves_with_the_border(name, border):
    """Between two samples too: a border that is moved twice as far moves u twice as far."""
    points, steps = places(name, 500), np.array([0.0, 1e-3, 2e-3])
    u = [solve(name, border + step, 0.15, root(border), estimate=False).evaluate(points) for step in steps]
    once, twice = u[1] - u[0], u[2] - u[0]
    assert np.sqrt(np.mean(once**2)) > 1e-4
    assert np.sqrt(np.mean((twice - 2 * once) ** 2)) < 0.1 * np.sqrt(np.mean(twice**2))


def test_parts_of_numbered_sides_have_the_same_border():
    edge = [(ck.Neumann(0.0), lambda x: (x[:, 1] < 1e-9) & (x[:, 0] < 0.037)), ck.Dirichlet(root(0.037))]
    for name, count in (("area", 4), ("surface", 1)):
        whole, sides = (
            ck.solve(ck.Scene(BOXES[name], ck.Laplace(), edge=each), 0.15).evaluate(places(name))
            for each in (edge, dict.fromkeys(range(count), edge))
        )
        np.testing.assert_allclose(sides, whole, atol=1e-8)


def test_a_border_at_a_vertex_splits_no_edge():
    mesh = Mesh.of(np.array([[0.0, 0], [1, 0], [2, 0], [0.5, 1]]), np.array([[0, 1], [1, 2], [2, 3], [3, 0]]))
    for border, count in ((1.0, 5), (1.0 + 1e-12, 5), (1.5, 6)):
        parted = split_at_parts(mesh, np.arange(4), lambda x, border=border: (x[:, 0] < border) * 1, "flat", None)
        assert len(parted.vertices) == count


def test_where_the_edge_is_curved_the_border_is_on_it():
    """By symmetry u is the same on both sides of a turned disk, whatever the lattice."""
    disk = ck.source("solid", of=ck.source("analytic.circle"))
    angle = 0.3
    turned = ck.ScreenedPoisson(1.0, 1.0)
    half = [(ck.Neumann(0.0), lambda x: x @ [np.cos(angle), np.sin(angle)] > 0.2), ck.Dirichlet(0.0)]
    mirrored = [(ck.Neumann(0.0), lambda x: x @ [-np.cos(angle), np.sin(angle)] > 0.2), ck.Dirichlet(0.0)]
    first, second = (ck.solve(ck.Scene(disk, turned, edge=edge), 0.1) for edge in (half, mirrored))
    points = np.random.default_rng(0).uniform(-0.7, 0.7, (500, 2))
    np.testing.assert_allclose(first.evaluate(points), second.evaluate(points * [-1, 1]), atol=1e-6)
