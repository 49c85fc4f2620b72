"""Areas of the plane and solids in space: second order inside, at edges, and across boundaries inside them."""

import numpy as np
import pytest
from model_problems import order_of

import cpmkit as ck

SPACINGS = [0.2, 0.1, 0.05]


def u(x):
    return x[:, 0] ** 2 * x[:, 1] + np.sin(x[:, 0])


def gradient(x):
    return np.stack([2 * x[:, 0] * x[:, 1] + np.cos(x[:, 0]), x[:, 0] ** 2], axis=1)


def f(x):
    return np.sin(x[:, 0]) - 2 * x[:, 1] + u(x)


def inside(points, radius=1.0, center=0.0):
    return np.sum((points - center) ** 2, axis=1) < radius**2


POINTS = np.random.default_rng(0).uniform(-1, 1, (4000, 2))
DISC = ck.source("solid", of=ck.source("analytic.circle"))
BOX = ck.source("analytic.box", lower=[-1, -1], upper=[1, 1])


def errors(surface, points, exact, spacings, edge, boundaries=(), source=f):
    scene = ck.Scene(surface, ck.ScreenedPoisson(source, 1.0), boundaries, edge)
    return [np.abs(ck.solve(scene, h).evaluate(points) - exact).max() for h in spacings]


@pytest.mark.parametrize(
    ("edge", "bound"),
    [
        (ck.Dirichlet(u), 3e-3),
        (ck.Neumann(lambda x: np.sum(gradient(x) * x, axis=1)), 3e-4),
    ],
    ids=["dirichlet", "neumann"],
)
def test_a_disc(edge, bound):
    points = POINTS[inside(POINTS)]
    found = errors(DISC, points, u(points), SPACINGS, edge)
    assert found[-1] < bound
    assert order_of(SPACINGS, found) > 1.8


def test_a_square():
    found = errors(BOX, POINTS, u(POINTS), SPACINGS, ck.Dirichlet(u))
    assert found[-1] < 5e-3
    assert order_of(SPACINGS, found) > 1.8


def test_the_sides_of_a_square_have_conditions_of_their_own():
    edge = {
        0: ck.Neumann(lambda x: -gradient(x)[:, 0]),
        1: ck.Dirichlet(u),
        2: ck.Neumann(lambda x: -gradient(x)[:, 1]),
        3: ck.Dirichlet(u),
    }
    found = errors(BOX, POINTS, u(POINTS), SPACINGS, edge)
    assert found[-1] < 5e-3
    assert order_of(SPACINGS, found) > 1.5


def test_a_jump_across_a_closed_curve_in_a_disc():
    """Left of a circle that runs counterclockwise is its inside."""
    center = np.array([0.1, 0.05])
    curve = ck.source("analytic.circle", center=center, radius=0.5)
    cut = ck.Boundary("cut", curve, left=ck.Dirichlet(lambda x: u(x) + 3), right=ck.Dirichlet(u))

    def jump(x):
        return 3.0 * inside(x, 0.5, center)

    points = POINTS[inside(POINTS) & (np.abs(np.linalg.norm(POINTS - center, axis=1) - 0.5) > 1e-6)]
    spacings = [0.1, 0.05, 0.025]
    found = errors(DISC, points, u(points) + jump(points), spacings, ck.Dirichlet(u), [cut], lambda x: f(x) + jump(x))
    assert found[-1] < 6e-4
    assert order_of(spacings, found) > 1.8


def test_a_jump_across_a_sphere_in_a_ball():
    """Left of a closed surface in a solid is where its normal points: outside."""
    center = np.array([0.1, 0.0, 0.0])
    ball = ck.source("solid", of=ck.source("analytic.sphere"))
    shell = ck.source("analytic.sphere", center=center, radius=0.5)

    def smooth(x):
        return x[:, 0] * x[:, 1] + np.sin(x[:, 2])

    def jump(x):
        return 3.0 * inside(x, 0.5, center)

    cut = ck.Boundary("shell", shell, left=ck.Dirichlet(smooth), right=ck.Dirichlet(lambda x: smooth(x) + 3))
    points = np.random.default_rng(0).uniform(-1, 1, (4000, 3))
    points = points[inside(points)]
    spacings = [0.35, 0.25, 0.18]
    found = errors(
        ball,
        points,
        smooth(points) + jump(points),
        spacings,
        ck.Dirichlet(smooth),
        [cut],
        lambda x: np.sin(x[:, 2]) + smooth(x) + jump(x),
    )
    assert found[-1] < 4e-3
    assert order_of(spacings, found) > 1.8


def test_a_point_in_an_area_has_no_sides_and_is_warned_of():
    pin = ck.source("analytic.point", at=[0.2, 0.1])
    two_sided = ck.Boundary("pin", pin, left=ck.Dirichlet(1), right=ck.Dirichlet(0))
    scene = ck.Scene(DISC, ck.Laplace(), [two_sided])
    with pytest.raises(ck.CpmkitError, match="dimension 0 where the manifold has 2"):
        ck.solve(scene, 0.1)
    rim = ck.source("analytic.circle", radius=0.8)
    scene = ck.Scene(
        DISC,
        ck.Laplace(),
        [ck.Boundary("pin", pin, both=ck.Dirichlet(1)), ck.Boundary("ring", rim, both=ck.Dirichlet(0))],
    )
    assert any("'pin'" in message and "too small" in message for message in ck.solve(scene, 0.1).warnings)


@pytest.mark.parametrize("normal", [[1.0, 0.0], [0.83, 0.41]], ids=["square to the rim", "at a slant"])
def test_a_curve_from_rim_to_rim_parts_the_solid(normal):
    """Where a boundary ends on the rim nothing leaks around its end: each side keeps its own constant."""
    normal = np.array(normal) / np.linalg.norm(normal)
    chord = ck.source("cut.plane", surface=DISC, point=0.3 * normal, normal=normal)
    height = POINTS @ normal - 0.3
    chosen = inside(POINTS) & (np.abs(height) > 1e-6)
    scene = ck.Scene(DISC, ck.Laplace(), [ck.Boundary("chord", chord, left=ck.Dirichlet(1), right=ck.Dirichlet(0))])
    for spacing in (0.2, 0.1):
        found = ck.solve(scene, spacing).evaluate(POINTS[chosen])
        assert np.abs(found - (height[chosen] > 0)).max() < 1e-9
