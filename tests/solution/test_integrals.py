"""Integrals of a solution converge at second order over jumps, rims and ends, and the manifold's size at fourth."""

from functools import cache

import numpy as np
import pytest
from bare import Bare
from model_problems import circle_jump, order_of, origins, rotation

import cpmkit as ck

NORMAL, HEIGHT, RIM = rotation()[2], 0.2, 0.35


def squares(problem):
    """-Lap u + u = f on the unit sphere, u = (n . x)^2."""
    return problem(lambda x: 7 * (x @ NORMAL) ** 2 - 2)


def sphere():
    return ck.Scene(ck.source("analytic.sphere"), squares(ck.ScreenedPoisson)), 4 * np.pi / 5, 4 * np.pi


def cap():
    def u(x):
        return x[:, 2] ** 2 + x[:, 0]

    scene = ck.Scene(
        ck.source("analytic.cap", height=RIM),
        ck.ScreenedPoisson(lambda x: 7 * x[:, 2] ** 2 - 2 + 3 * x[:, 0]),
        edge=ck.Dirichlet(u),
    )
    # x averages to zero around the axis, x^2 to (1 - z^2) / 2
    exact = 2 * np.pi * ((1 - RIM**5) / 5 + ((1 - RIM) - (1 - RIM**3) / 3) / 2)
    return scene, exact, 2 * np.pi * (1 - RIM)


def sphere_jump():
    circle = ck.source("analytic.circle", center=HEIGHT * NORMAL, radius=np.sqrt(1 - HEIGHT**2), normal=NORMAL)
    sides = {"left": ck.Dirichlet(HEIGHT**2), "right": ck.Dirichlet(3 + HEIGHT)}
    f = ck.ScreenedPoisson(lambda x: np.where((w := x @ NORMAL) > HEIGHT, 7 * w**2 - 2, 3 * w + 3))
    low = 9 * (1 + HEIGHT) + 3 * (HEIGHT**2 - 1) + (HEIGHT**3 + 1) / 3
    scene = ck.Scene(ck.source("analytic.sphere"), f, [ck.Boundary("circle", circle, **sides)])
    return scene, 2 * np.pi * ((1 - HEIGHT**5) / 5 + low), 4 * np.pi


def cut_circle():
    t = 2 * np.pi
    exact = 2 * t + (10 / np.pi) ** 2 * t**3 / 3  # of (2 cos s + 10 s / pi)^2; the mixed term vanishes
    return circle_jump()[0], exact, t


def disc():
    scene = ck.Scene(
        ck.source("solid", of=ck.source("analytic.circle")),
        ck.ScreenedPoisson(lambda x: (x**2).sum(axis=1) - 4),
        edge=ck.Dirichlet(1.0),
    )
    return scene, np.pi / 3, np.pi


@cache
def solved(case, spacing, shift):
    return ck.solve(case()[0], spacing, origin=np.array(shift) * spacing)


@pytest.mark.parametrize("case", [sphere, cap, sphere_jump, cut_circle, disc], ids=lambda case: case.__name__)
def test_integrals_of_squares_are_of_second_order(case):
    scene, exact, size = case()
    flat = scene.surface.dim == 2
    spacings = [0.1, 0.07, 0.05] if flat else [0.2, 0.14, 0.1]
    shifts = origins(2)[:4] if flat else np.zeros((1, 3))
    errors = []
    for h in spacings:
        solutions = [solved(case, h, tuple(shift)) for shift in shifts]
        off = [one.integrate(lambda _, u: u**2) - exact for one in solutions]
        errors.append(np.sqrt(np.mean(np.square(off))))
    assert order_of(spacings, errors) >= 1.8
    assert errors[-1] < 2.5e-3 * exact
    assert solutions[0].integrate(1.0) == pytest.approx(size, rel=2e-7)


@pytest.mark.parametrize("case", [sphere, cap])
def test_the_area_is_of_fourth_order(case):
    spacings = [0.2, 0.14, 0.1]
    areas = [solved(case, h, (0.0, 0.0, 0.0)).integrate(1.0) for h in spacings]
    assert order_of(spacings, np.abs(np.array(areas) - case()[2])) >= 3.5


def test_the_error_itself_is_integrated_on_each_side_with_its_own_values():
    spacings = [0.2, 0.14, 0.1]

    def squared_error(x, u):
        w = x @ NORMAL
        return (u - np.where(w > HEIGHT, w**2, 3 + w)) ** 2

    errors = [np.sqrt(solved(sphere_jump, h, (0.0, 0.0, 0.0)).mean(squared_error)) for h in spacings]
    assert order_of(spacings, errors) >= 1.8  # a value from the other side would be wrong by 3
    assert errors[-1] < 1e-3


def test_channels_are_integrated_each():
    scene = ck.Scene(ck.source("analytic.circle", radius=2.0), ck.ScreenedPoisson([1.0, lambda x: x[:, 0] ** 2]))
    solution = ck.solve(scene, 0.1)
    np.testing.assert_allclose(solution.integrate(), [4 * np.pi, 8 * np.pi], rtol=1e-3)
    np.testing.assert_allclose(solution.mean(), [1.0, 2.0], rtol=1e-3)
    assert solution.integrate(lambda x, u: u[:, 0] - u[:, 0]) == pytest.approx(0.0, abs=1e-12)


def test_a_mixed_union_is_integrated_by_dimension():
    sphere, line = ck.source("analytic.sphere"), ck.source("analytic.segment", start=[1, 0, 0], end=[2, 0, 0])
    both = ck.source("union", members=[sphere, line])
    solution = ck.solve(ck.Scene(both, ck.ScreenedPoisson(2.0), junctions=ck.Junction(radius=0.1)), 0.1)
    assert solution.integrate(dim=1) == pytest.approx(2.0, rel=1e-6)
    assert solution.integrate(dim=2) == pytest.approx(8 * np.pi, rel=1e-5)
    with pytest.raises(ck.InputError, match="dimensions 1 and 2, whose sizes do not add up"):
        solution.integrate()
    with pytest.raises(ck.InputError, match="dim must be 1 or 2, the dimensions of the manifold, got 3"):
        solution.mean(dim=3)


def test_finite_elements_integrate_alike():
    vertices, faces = ck.source("analytic.sphere").mesh(0.1)
    scene = ck.Scene(ck.source("mesh.triangles", vertices=vertices, faces=faces), squares(ck.ScreenedPoisson))
    exact = 4 * np.pi / 3
    assert ck.solve(scene, backend="fem").integrate() == pytest.approx(exact, rel=5e-3)
    assert ck.solve(scene, 0.1).integrate() == pytest.approx(exact, rel=1e-2)


def test_what_cannot_be_integrated_is_answered_in_one_sentence():
    def on(source):
        return ck.solve(ck.Scene(source, ck.ScreenedPoisson(1.0)), 0.2, form="collocation")

    with pytest.raises(ck.InputError, match=r"has no method mesh\(spacing\)"):
        on(Bare(ck.source("analytic.sphere"))).integrate()
    with pytest.raises(ck.InputError, match="has triangles where a manifold of dimension 3"):
        on(ck.source("analytic.box", lower=[0, 0, 0], upper=[1, 1, 1])).integrate()
    points = ck.source("analytic.sphere").mesh(0.1)[0]
    with pytest.raises(ck.InputError, match="has points where a manifold of dimension 2"):
        on(ck.source("pointcloud.points", points=points)).integrate()
    with pytest.raises(ck.InputError, match="the integrand"):
        on(ck.source("analytic.sphere")).integrate(lambda x, u: "none")


@pytest.mark.parametrize("kind", ["closest points", "cloud", "smooth mesh"])
def test_surfaces_without_a_mesh_and_meshes_read_as_smooth_have_the_area_of_the_surface(kind):
    ball = ck.source("analytic.sphere")
    vertices, faces = ball.mesh(0.2 if kind == "smooth mesh" else 0.1)
    source = {
        "closest points": lambda: Bare(ball),
        "cloud": lambda: ck.source("pointcloud.points", points=vertices),
        "smooth mesh": lambda: ck.source("mesh.triangles", vertices=vertices, faces=faces),
    }[kind]()
    solution = ck.solve(ck.Scene(source, squares(ck.ScreenedPoisson)), 0.2)
    assert solution.integrate(1.0) == pytest.approx(4 * np.pi, rel=1e-3)
    assert solution.integrate() == pytest.approx(4 * np.pi / 3, rel=1e-3)
