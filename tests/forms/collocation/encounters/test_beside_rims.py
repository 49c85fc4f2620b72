"""A boundary beside a rim holds, however near; on the rim it replaces the edge, and a curve unseen is refused."""

import numpy as np
import pytest

import cpmkit as ck


def cut_segment(at, spacing=0.1, values=(0.0, 2.0), **condition):
    segment = ck.source("analytic.segment", start=[0, 0], end=[1, 0])
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[at, 0]), **(condition or {"both": ck.Dirichlet(1.0)}))
    edge = {0: ck.Dirichlet(values[0]), 1: ck.Dirichlet(values[1])}
    return ck.solve(ck.Scene(segment, ck.Laplace(), [cut], edge=edge), spacing, form="collocation")


@pytest.mark.parametrize("at", [0.001, 0.02, 0.05, 0.08, 0.13, 0.2])
def test_a_cut_at_any_distance_from_an_end_holds(at):
    x = np.linspace(at + 1e-3, 1, 20)
    found = cut_segment(at).evaluate(np.stack([x, 0 * x], axis=1))
    np.testing.assert_allclose(found, 1 + (x - at) / (1 - at), atol=1e-9)


def test_a_scene_far_away_and_tiny_behaves_alike():
    shift = 1e6
    segment = ck.source("analytic.segment", start=[shift, 0], end=[shift + 1, 0])
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[shift + 0.0625, 0]), both=ck.Dirichlet(1.0))
    edge = {0: ck.Dirichlet(0.0), 1: ck.Dirichlet(2.0)}
    far = ck.solve(ck.Scene(segment, ck.Laplace(), [cut], edge=edge), 0.1, form="collocation")
    np.testing.assert_allclose(far.evaluate([[shift + 0.5, 0]]), 1 + 0.4375 / 0.9375, atol=1e-6)


@pytest.mark.parametrize("at_edge", [0.0, 1.0])
def test_on_the_rim_the_boundary_replaces_the_edge(at_edge):
    np.testing.assert_allclose(cut_segment(0.0, values=(at_edge, 2.0)).evaluate([[0.5, 0]]), 1.5, atol=1e-9)


def test_coupled_sides_beside_a_rim_need_a_finer_spacing():
    with pytest.raises(ck.ResolutionError, match=r"whose sides are coupled.*0.05 from the manifold's rim; use 0.017"):
        cut_segment(0.05, across=ck.Transmission(jump=1.0))


def cut_cap(height, spacing, condition):
    circle = ck.source("analytic.circle", center=[0, 0, height], radius=np.sqrt(1 - height**2), normal=[0, 0, 1])
    above = ck.Boundary("circle", circle, left=condition, right=ck.Dirichlet(1.0), left_of=[0, 0, 1])
    scene = ck.Scene(
        ck.source("analytic.cap", height=0.0),
        ck.ScreenedPoisson(lambda x: 3 * x[:, 2], 1.0),
        [above],
        edge=ck.Dirichlet(0.0),
    )
    return ck.solve(scene, spacing, form="collocation")


@pytest.mark.parametrize("height", [0.03, 0.2])
@pytest.mark.parametrize("kind", ["dirichlet", "neumann"])
def test_a_circle_beside_the_rim_of_a_half_sphere_holds(height, kind):
    """u = z above the circle."""
    condition = ck.Dirichlet(height) if kind == "dirichlet" else ck.Neumann(-np.sqrt(1 - height**2))
    angle = np.linspace(np.arcsin(height) + 1e-3, np.pi / 2, 50)
    points = np.stack([0.6 * np.cos(angle), 0.8 * np.cos(angle), np.sin(angle)], axis=1)
    found = cut_cap(height, 0.2, condition).evaluate(points)
    assert np.abs(found - points[:, 2]).max() < 0.012


def test_a_slanted_curve_that_ends_on_a_rim_is_no_strip():
    disc = ck.source("analytic.box", lower=[-1, -1], upper=[1, 1])
    slant = ck.source("analytic.segment", start=[-1, -0.7], end=[1, 0.7])
    cut = ck.Boundary("slant", slant, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
    solution = ck.solve(ck.Scene(disc, ck.Laplace(), [cut]), 0.2)
    assert not [text for text in solution.warnings if "rim" in text]
    np.testing.assert_allclose(solution.evaluate([[-0.5, 0.5], [0.5, -0.5]]), [1.0, 0.0], atol=1e-9)


def test_a_curve_too_short_for_the_spacing_is_refused():
    arc = ck.source("analytic.arc", center=[0, 0, 0.3], radius=np.sqrt(0.91), start=0, end=0.02, normal=[0, 0, 1])
    short = ck.Boundary("short", arc, left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0))
    with pytest.raises(ck.ResolutionError, match=r"too coarse for boundary 'short' near \(0.95.*use 0.0048 or less"):
        ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.Laplace(), [short]), 0.2, form="collocation")
