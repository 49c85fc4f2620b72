"""Data that vary within a spacing are warned of, in both forms, and those that do not are not."""

import numpy as np
import pytest
from model_problems import sphere_points

import cpmkit as ck
from cpmkit.scene.data import evaluate_data

CIRCLE, SPHERE = ck.source("analytic.circle"), ck.source("analytic.sphere")
ANGLES = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
ON_CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1)


def told(solution, what="The right-hand side f"):
    return [text for text in solution.warnings if text.startswith(f"{what} varies within a spacing")]


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
@pytest.mark.parametrize("k", [5, 10, 20, 30, 45, 60, 100, 200, 300])
def test_a_wave_on_the_circle_is_warned_of_or_its_error_is_estimated(form, k):
    """-u'' + u = (1 + k^2) cos(k t): k h is .5 to 30, and without a word errors were up to 7,000 ranges."""

    def f(x):
        return (1 + k * k) * np.cos(k * np.arctan2(x[:, 1], x[:, 0]))

    solution = ck.solve(ck.Scene(CIRCLE, ck.ScreenedPoisson(f)), 0.1, form=form)
    error = np.abs(solution.evaluate(ON_CIRCLE) - np.cos(k * ANGLES)).max() / 2
    assert told(solution) or k < 60
    assert not told(solution) or k > 10
    assert told(solution) or 0.4 * error < solution.error.largest[0]


@pytest.mark.parametrize(
    ("form", "degree", "unresolved"), [("galerkin", 8, False), ("galerkin", 40, True), ("collocation", 40, True)]
)
def test_a_harmonic_of_the_sphere(form, degree, unresolved):
    """At degree 40 and h = .2 errors are 8 and 700 ranges."""

    def u(x):
        return ((x[:, 0] + 1j * x[:, 1]) ** degree).real

    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: (1 + degree * (degree + 1)) * u(x)))
    solution = ck.solve(scene, 0.2, form=form)
    assert bool(told(solution)) == unresolved
    if not unresolved:
        points = sphere_points()
        assert np.abs(solution.evaluate(points) - u(points)).max() < 0.06


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_steps_and_small_ripples_are_not(form):
    for f in (lambda x: np.sign(x[:, 0] - 0.1), lambda x: 1 + 0.1 * np.sin(100 * x[:, 0]), lambda x: x[:, 0] * x[:, 1]):
        assert not told(ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(f)), 0.3, form=form))


def jumps(solution):
    return [text for text in solution.warnings if "jumps near" in text]


def test_a_jump_of_f_off_boundaries_is_warned_of_at_any_spacing():
    """u = max(z - .3, 0)^2: errors do not fall, and their estimate is up to five times too small."""

    def f(x):
        z = x[:, 2]
        return np.where(z > 0.3, (z - 0.3) ** 2 - 2 * (1 - z**2) + 4 * z * (z - 0.3), 0.0)

    parallel = ck.source("analytic.circle", center=[0, 0, 0.3], normal=[0, 0, 1], radius=np.sqrt(0.91))
    seam, points, errors = ck.Boundary("seam", parallel, across=ck.Transmission()), sphere_points(), []
    exact = np.maximum(points[:, 2] - 0.3, 0) ** 2
    for spacing in (0.2, 0.1, 0.07):
        with_seam = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(f), [seam]), spacing)
        without = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(f)), spacing)
        (text,) = jumps(without)
        assert "0.3), where no boundary lies" in text
        assert "ck.Transmission() along the jump" in text
        assert not jumps(with_seam)
        errors.append([np.abs(each.evaluate(points) - exact).max() for each in (with_seam, without)])
    assert errors[2][0] < 0.1 * errors[0][0]
    assert errors[2][1] > errors[0][1]


def test_coefficients_that_jump_are_warned_of_and_steep_ones_are_not():
    def step(x):
        return 1.0 + (x[:, 0] > 0.2)

    equator = ck.Boundary("ring", ck.source("analytic.circle", normal=[0, 0, 1]), both=1.0)
    assert jumps(ck.solve(ck.Scene(SPHERE, ck.Elliptic("x", c=step), [equator]), 0.3))
    assert jumps(ck.solve(ck.Scene(SPHERE, ck.Elliptic("x", c=1.0, diffusivity=step), [equator]), 0.3))
    steep, kink = "tanh(40*(x - 0.2))", "abs(x - 0.2)"
    for f in (steep, kink, "exp(-300*(x - 1)**2)", lambda x: 1e-17 * np.sign(np.sin(1e9 * x[:, 0]))):
        assert not jumps(ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(f)), 0.3))


def test_data_that_jump_between_members_and_at_creases_are_not():
    parts = [CIRCLE, ck.source("analytic.segment", start=[1, 0], end=[3, 0])]
    both = ck.source("union", members=parts)
    assert not jumps(ck.solve(ck.Scene(both, ck.ScreenedPoisson(ck.MemberData(both, [1.0, 3.0]))), 0.1))
    box = pytest.importorskip("trimesh").creation.box()
    skin = ck.source("mesh.triangles", vertices=box.vertices, faces=box.faces, closest="faceted")
    assert not jumps(ck.solve(ck.Scene(skin, ck.ScreenedPoisson(lambda x: 1.0 * (x[:, 2] > 0.5 - 1e-9))), 0.15))


def wave(x):
    return 1.5 + np.sin(250 * x[:, 0])


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_so_are_coefficients_and_data_of_conditions(form):
    c = ck.solve(ck.Scene(SPHERE, ck.Elliptic("x", c=wave)), 0.3, form=form)
    assert told(c, "The factor c")
    a = ck.solve(ck.Scene(SPHERE, ck.Elliptic("x", c=1.0, diffusivity=wave)), 0.3, form=form)
    assert told(a, "The diffusivity")
    ring = ck.Boundary("ring", ck.source("analytic.circle", normal=[0, 0, 1]), both=ck.Dirichlet(wave))
    assert told(ck.solve(ck.Scene(SPHERE, ck.Laplace(), [ring]), 0.3, form=form), "The datum of boundary 'ring'")
    slow = ck.Boundary("ring", ring.source, both=ck.Dirichlet(lambda x: np.sin(3 * x[:, 0])))
    assert not told(ck.solve(ck.Scene(SPHERE, ck.Laplace(), [slow]), 0.3, form=form), "The datum of boundary 'ring'")


def test_an_evolution_is_warned_of_its_load_too():
    heat = ck.Heat(0.0, until=0.1, step=0.05, f=lambda x: np.sin(250 * x[:, 0]))
    assert told(ck.solve(ck.Scene(SPHERE, heat), 0.2))


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_data_that_are_zero_but_for_rounding_are_resolved(form, turn):
    """u = x is 0 on a side of a plate, to some 1e-17."""
    c, s = np.cos(turn), np.sin(turn)
    vertices = np.array([[x * c - y * s, x * s + y * c, 0.0] for x in (0, 0.5, 1) for y in (0, 1)])
    plate = ck.source("mesh.triangles", vertices=vertices, faces=[[0, 2, 3], [0, 3, 1], [2, 4, 5], [2, 5, 3]])

    def u(x):
        return x[:, 0] * c + x[:, 1] * s

    sides = [(ck.Dirichlet(u), lambda x: u(x) < 1e-4), (ck.Dirichlet(u), lambda x: u(x) > 0.9999), ck.Neumann(0.0)]
    edge = sides if form == "galerkin" else ck.Dirichlet(u)
    solution = ck.solve(ck.Scene(plate, ck.Laplace(), edge=edge), 0.1, form=form)
    assert not [text for text in solution.warnings if "varies within a spacing" in text]
    assert solution.evaluate([[0.3 * c - 0.4 * s, 0.3 * s + 0.4 * c, 0]])[0] == pytest.approx(0.3, abs=1e-3)


def test_data_of_members_that_meet_may_differ_there():
    segments = [ck.source("analytic.segment", start=[-x, -y], end=[x, y]) for x, y in ((0.5, 0.0), (0.0, 0.5))]
    union = ck.source("union", members=[ck.source("analytic.box", lower=[-1, -1], upper=[1, 1]), *segments])
    f = ck.MemberData(union, [0.0, "-8 - 2*abs(x)", "8 - 2*abs(y)"])
    scene = ck.Scene(union, ck.ScreenedPoisson(f), edge=ck.Dirichlet(0.0))
    assert not told(ck.solve(scene, 0.1, estimate=False))


def test_noise_at_vertices_that_the_equation_smooths_over_two_spacings_is_not():
    """At half the length of smoothing u is known to a tenth of its size (linear elements on the mesh agree)."""
    ball, length = pytest.importorskip("trimesh").creation.icosphere(5), 0.6
    surface = ck.source("mesh.triangles", vertices=ball.vertices, faces=ball.faces)
    noise = np.random.default_rng(0).normal(size=len(ball.vertices))
    blur = ck.ScreenedPoisson(noise / length**2, c=1 / length**2)
    exact, errors = ck.solve(ck.Scene(surface, blur), 0.1).at_vertices(), []
    for spacing, warned in ((0.6, True), (0.3, False), (0.15, False)):
        solution = ck.solve(ck.Scene(surface, blur), spacing)
        assert bool(told(solution)) == warned
        errors.append(np.sqrt(np.mean((solution.at_vertices() - exact) ** 2) / np.mean(exact**2)))
    assert errors[0] > 1.5 * errors[1] > 2.25 * errors[2]
    assert errors[1] < 0.15
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(ck.VertexData(surface, noise / length**2), c=1 / length**2))
    assert told(ck.solve(scene, 0.3))  # the values are read on another mesh
    assert told(ck.solve(ck.Scene(surface, blur), 0.3, form="collocation"))


def test_noise_at_points_that_the_equation_smooths_over_two_spacings_is_not():
    points, length = sphere_points(1500), 0.2
    data = ck.VertexData(ck.source("points", at=points), np.random.default_rng(0).normal(size=1500) / length**2)
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(data, c=1 / length**2))
    coarse, fine = (ck.solve(scene, spacing=spacing) for spacing in (0.1, 0.05))
    assert not coarse.warnings
    assert np.sqrt(np.mean((coarse.evaluate(points) - fine.evaluate(points)) ** 2)) < 0.02
    with pytest.warns(ck.CpmkitWarning, match="varies within a spacing"):
        ck.solve(scene, spacing=0.2)


def test_data_that_are_not_finite_are_refused_with_a_place():
    points = np.array([[0, 0, 0.5], [0, 0, 1.0], [0, 0, 2.0]])
    with pytest.raises(ck.InputError, match=r"the load must be finite, got NaN or infinity at \(0, 0, 1\)\."):
        evaluate_data(lambda x: np.where(x[:, 2] == 1, np.inf, 1.0), points, 1, "the load")
    with pytest.raises(ck.InputError, match=r"infinity at 2 points, such as \(0, 0, 1\)\."):
        evaluate_data(lambda x: np.where(x[:, 2] < 1, 1.0, np.nan), points, 1, "the load")
