"""A curve on a thin or folded part of a surface keeps its sides apart, or the solution says that it cannot."""

import numpy as np
import pytest

import cpmkit as ck


def rings_about_a_tube(minor):
    boundaries = []
    for k, phi in enumerate((0.3, 2.5, 4.4)):
        radial, along = np.array([np.cos(phi), np.sin(phi), 0]), np.array([-np.sin(phi), np.cos(phi), 0])
        ring = ck.source("analytic.circle", center=radial, normal=along, radius=minor)
        boundaries.append(ck.Boundary(f"ring {k}", ring, left=ck.Dirichlet(0.0), right=ck.Dirichlet(1.0)))
    return ck.Scene(ck.source("analytic.torus", major=1.0, minor=minor), ck.Laplace(), boundaries)


@pytest.mark.parametrize("minor", [0.2, 0.1])
def test_rings_about_a_tube_that_is_two_or_four_spacings_thick(minor):
    solution = ck.solve(rings_about_a_tube(minor), 0.05, form="collocation")
    for boundary in solution.scene.boundaries:
        points = boundary.source.mesh(minor / 20)[0]
        for side, value in (("left", 0.0), ("right", 1.0)):
            assert np.abs(solution.evaluate(points, side={boundary.name: side}) - value).max() < 1e-4


def test_a_ring_about_one_of_two_sheets_is_reported():
    """A torus with a hole that is narrower than two spacings: not every stencil finds feet on its own side."""
    torus = ck.source("analytic.torus", major=1.0, minor=0.93)
    ring = ck.source("analytic.circle", center=(1.0, 0, 0), normal=(0, 1, 0), radius=0.93)
    scene = ck.Scene(torus, ck.Laplace(), [ck.Boundary("ring", ring, left=ck.Dirichlet(0.0), right=ck.Dirichlet(1.0))])
    warned = ck.solve(scene, 0.1, solver_tolerance=1e-6, form="collocation").warnings
    assert any("stencils read nodes of a sheet that is not theirs" in warning for warning in warned)
    clean = ck.solve(rings_about_a_tube(0.4), 0.1, solver_tolerance=1e-6).warnings
    assert not clean


@pytest.mark.parametrize(
    ("kind", "keys", "spacing", "warned"),
    [
        ("analytic.sphere", {}, 0.2, False),
        ("analytic.torus", {"major": 1.0, "minor": 0.4}, 0.09, False),
        ("analytic.cap", {"height": 0.3}, 0.15, False),
        ("analytic.torus", {"major": 0.3, "minor": 0.1}, 0.05, True),
    ],
)
def test_sheets_and_bends_inside_the_band_are_reported(kind, keys, spacing, warned):
    scene = ck.Scene(ck.source(kind, **keys), ck.ScreenedPoisson(1.0))
    message = ck.solve(scene, spacing, form="collocation").warnings
    assert any("bends more sharply than the band is wide" in text for text in message) == warned
    assert warned or not message
