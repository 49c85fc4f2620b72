"""Variable diffusivity, advection, reaction and standing waves: second order beside every condition, limits told."""

import numpy as np
import pytest
from model_problems import angle_after, max_error, on_circle, order_of, origins, rotation, sphere_points

import cpmkit as ck

THETA_C = 1.022 * np.pi
SPACINGS = (0.1, 0.05, 0.025)
CIRCLE = ck.source("analytic.circle", center=(0, 0))
SPHERE = ck.source("analytic.sphere")


def curve_terms(s):
    """Right-hand side and coefficients of -(a u')' + w u' + c u = f for u = sin 2 s + cos(s) / 2 + 0.7 s."""

    def f(x):
        t = s(x)
        a, da = 1.5 + np.sin(t), np.cos(t)
        slope = 2 * np.cos(2 * t) - np.sin(t) / 2 + 0.7
        bend = -4 * np.sin(2 * t) - np.cos(t) / 2
        return -(a * bend + da * slope) + (1 + np.cos(t) / 2) * slope + (1 + np.sin(t) / 2) * value(t)

    def velocity(x):
        return (1 + np.cos(s(x)) / 2)[:, None] * np.stack([-x[:, 1], x[:, 0]], axis=1)

    return ck.Elliptic(f, diffusivity=lambda x: 1.5 + np.sin(s(x)), velocity=velocity, c=lambda x: 1 + np.sin(s(x)) / 2)


def value(t):
    return np.sin(2 * t) + np.cos(t) / 2 + 0.7 * t


def condition(kind, t, sign):
    """The condition that u fulfils at t, with the conormal pointing along ``sign`` times the direction of travel."""
    flux = float(sign * (2 * np.cos(2 * t) - np.sin(t) / 2 + 0.7))
    made = {"D": ck.Dirichlet(float(value(t))), "N": ck.Neumann(flux), "R": ck.Robin(1.0, 2.0, flux + 2 * value(t))}
    return made[kind]


#: Of each form the error that is left, and the order: the Galerkin form takes twice the spacings on surfaces.
FORMS = {"collocation": (1.0, 1.8), "galerkin": (0.1, 2.0)}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kinds", ["DD", "NN", "RD", "DN"])
def test_all_terms_on_a_circle_cut_at_a_point(kinds, form):
    cut = ck.source("analytic.point", at=on_circle(np.array([THETA_C]))[0])
    sides = {"left": condition(kinds[0], 2 * np.pi, 1), "right": condition(kinds[1], 0.0, -1)}
    scene = ck.Scene(CIRCLE, curve_terms(angle_after(THETA_C, (0, 0))), [ck.Boundary("cut", cut, **sides)])
    t = np.linspace(1e-6, 2 * np.pi - 1e-6, 2000)
    problem = scene, on_circle(THETA_C + t), value(t)
    at = origins(2)[: 3 if form == "collocation" else 1]
    errors = [np.sqrt(np.mean([max_error(*problem, h, origin=h * o, form=form) ** 2 for o in at])) for h in SPACINGS]
    share, order = FORMS[form]
    assert errors[-1] <= share * 1.2e-3
    assert order_of(SPACINGS, errors) >= order


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", "DNR")
def test_all_terms_on_an_arc(kind, form):
    arc = ck.source("analytic.arc", center=(0, 0), radius=1.0, start=0.3, end=2.7)
    edge = {0: condition(kind, 0.3, -1), 1: condition(kind, 2.7, 1)}
    scene = ck.Scene(arc, curve_terms(lambda x: np.arctan2(x[:, 1], x[:, 0])), edge=edge)
    t = np.linspace(0.3, 2.7, 2000)
    spacings = (*SPACINGS, 0.0125)
    errors = [max_error(scene, on_circle(t), value(t), h, form=form) for h in spacings]
    share, order = FORMS[form]
    assert errors[-1] <= share * 2.5e-4
    assert order_of(spacings, errors) >= order


def u(x):
    return x[:, 0] * x[:, 1] + x[:, 2]


def tangential(gradient, x):
    return gradient - x * np.sum(x * gradient, axis=1)[:, None]


def slope(x):
    return tangential(np.stack([x[:, 1], x[:, 0], np.ones(len(x))], axis=1), x)


def surface_problem():
    """All terms on the unit sphere, for u = x y + z, with a velocity that turns about an axis."""
    axis = rotation()[2]

    def a(x):
        return 1.5 + 0.9 * x[:, 0] * x[:, 2]

    def velocity(x):
        return 2 * np.cross(axis, x)

    def f(x):
        zero = np.zeros(len(x))
        of_a = 0.9 * np.stack([x[:, 2], zero, x[:, 0]], axis=1)
        laplacian = -6 * x[:, 0] * x[:, 1] - 2 * x[:, 2]
        advected = np.sum((velocity(x) - of_a) * slope(x), axis=1)
        return -a(x) * laplacian + advected + (1 + x[:, 1] ** 2) * u(x)

    return ck.Elliptic(f, diffusivity=a, velocity=velocity, c=lambda x: 1 + x[:, 1] ** 2)


def surface_condition(kind, flux):
    """The condition that u fulfils where ``flux`` is the slope along the conormal."""
    made = {"D": ck.Dirichlet(u), "N": ck.Neumann(flux), "R": ck.Robin(1.0, 2.0, lambda x: flux(x) + 2 * u(x))}
    return made[kind]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kinds", ["", "DD", "NN", "RD"])
def test_all_terms_on_a_sphere(kinds, form):
    normal = rotation()[0]  # of a great circle; its left is where this points
    circle = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=normal)
    boundaries = []
    if kinds:
        left = surface_condition(kinds[0], lambda x: -slope(x) @ normal)
        right = surface_condition(kinds[1], lambda x: slope(x) @ normal)
        boundaries = [ck.Boundary("circle", circle, left=left, right=right)]
    scene = ck.Scene(SPHERE, surface_problem(), boundaries)
    coarse, points = form == "galerkin", sphere_points()
    spacings, solver = ((0.4, 0.3, 0.2), "auto") if coarse else ((0.25, 0.18, 0.125), "reference")
    errors = [max_error(scene, points, u(points), h, solver=solver, form=form) for h in spacings]
    share, order = FORMS[form]
    assert errors[-1] <= share * 1e-2
    assert order_of(spacings, errors) >= order


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", "DNR")
def test_all_terms_on_a_cap(kind, form):
    axis = rotation()[1]

    def flux(x):
        outward = x * (x @ axis)[:, None] - axis
        return np.sum(slope(x) * outward, axis=1) / np.linalg.norm(outward, axis=1)

    cap = ck.source("analytic.cap", axis=axis, height=0.35)
    scene = ck.Scene(cap, surface_problem(), edge=surface_condition(kind, flux))
    points = sphere_points()[sphere_points() @ axis > 0.35]
    coarse = form == "galerkin"
    spacings, solver = ((0.3, 0.2, 0.1333), "auto") if coarse else ((0.2, 0.1, 0.05), "reference")
    errors = [max_error(scene, points, u(points), h, solver=solver, form=form) for h in spacings]
    share, order = (0.2, 2.5) if coarse else FORMS[form]
    assert errors[-1] <= share * 1.2e-3
    assert order_of(spacings, errors) >= order


def test_a_velocity_with_a_free_constant_on_a_sphere_that_a_curve_cuts():
    """-Lap u + v . grad u = f with u = x, v = 2 e_z x p, and no c: the pieces are looked for, and the tables stay."""
    ring = ck.source("analytic.circle", center=[0, 0, 0.3], radius=np.sqrt(1 - 0.09), normal=[0, 0, 1])
    known = ck.Boundary("ring", ring, both=ck.Dirichlet(lambda x: x[:, 0]))
    spacings, points = (0.3, 0.22, 0.16), sphere_points()
    for c in (0.0, lambda x: 0 * x[:, 0]):
        problem = ck.Elliptic(
            lambda x: 2 * x[:, 0] - 2 * x[:, 1],
            velocity=lambda x: 2 * np.stack([-x[:, 1], x[:, 0], 0 * x[:, 2]], axis=1),
            c=c,
        )
        scene = ck.Scene(SPHERE, problem, [known])
        errors = [max_error(scene, points, points[:, 0], h, form="collocation") for h in spacings]
        assert errors[-1] <= 9e-3
        assert order_of(spacings, errors) >= 1.8


def test_channels_are_solved_together():
    both = ck.Elliptic([lambda x: x[:, 0], 1.0], diffusivity=lambda x: 2 + x[:, 1], c=1.0)
    one = ck.Elliptic(lambda x: x[:, 0], diffusivity=lambda x: 2 + x[:, 1], c=1.0)
    points = on_circle(np.linspace(0, 6, 50))
    found = ck.solve(ck.Scene(CIRCLE, both), 0.1).evaluate(points)
    assert found[:, 0] == pytest.approx(ck.solve(ck.Scene(CIRCLE, one), 0.1).evaluate(points), abs=1e-12)
    assert found[:, 1] == pytest.approx(1.0, abs=1e-10)


def test_constants_stay_where_nothing_reacts():
    scene = ck.Scene(CIRCLE, ck.Elliptic(3.0, diffusivity=lambda x: 2 + x[:, 1], c=3.0))
    assert np.abs(ck.solve(scene, 0.1).evaluate([[1, 0], [0, -1]]) - 1).max() <= 1e-12


@pytest.mark.parametrize(("form", "bound"), [("collocation", 1e-3), ("galerkin", 1e-12)])
def test_the_normal_part_of_a_velocity_carries_nothing(form, bound):
    def around(x):
        return np.stack([-x[:, 1], x[:, 0]], axis=1)

    points = on_circle(np.linspace(0, 6, 100))
    problems = [ck.Elliptic(lambda x: x[:, 0], velocity=v, c=1.0) for v in (around, lambda x: around(x) + x)]
    found = [ck.solve(ck.Scene(CIRCLE, one), 0.025, form=form).evaluate(points) for one in problems]
    assert np.abs(found[0] - found[1]).max() <= bound
    assert np.abs(found[0]).max() >= 0.4


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"diffusivity": lambda x: x[:, 0]}, "diffusivity must be above zero"),
        ({"diffusivity": lambda x: np.where(x[:, 0] > 0, np.nan, 1.0)}, "diffusivity must be finite"),
        ({"diffusivity": lambda x: x}, "diffusivity has 2 channels"),
        ({"velocity": lambda x: x[:, 0]}, r"velocity must be vectors of shape \(n, 2\)"),
        ({"velocity": [1, "x", 0]}, "the velocity has 3 entries where the manifold lies in 2D; give 2"),
        ({"velocity": lambda x: np.full((len(x), 2), np.inf)}, "velocity must be finite"),
        ({"c": lambda x: x[:-1, 0]}, "factor c must give shape"),
    ],
)
def test_coefficients_that_are_none_are_refused(keys, words):
    with pytest.raises(ck.InputError, match=words):
        ck.solve(ck.Scene(CIRCLE, ck.Elliptic(1.0, **{"c": 1.0, **keys})), 0.1)


def test_a_constant_diffusivity_must_be_above_zero():
    with pytest.raises(ck.InputError, match="diffusivity of elliptic"):
        ck.Elliptic(diffusivity=0.0)


def test_advection_that_outweighs_diffusion_is_refused_with_a_spacing_that_is_not():
    def scene(speed):
        turn = ck.Elliptic(1.0, velocity=lambda x: speed * np.stack([-x[:, 1], x[:, 0]], axis=1), c=1.0)
        return ck.Scene(CIRCLE, turn)

    with pytest.raises(ck.ResolutionError, match=r"use 0\.05 or less"):
        ck.solve(scene(40.0), 0.1, form="collocation")
    assert ck.solve(scene(39.0), 0.05, form="collocation").evaluate([[1, 0]]) == pytest.approx(1.0)


@pytest.mark.parametrize("wavenumber", [1.5, 3.3, 7.4])
def test_standing_waves_on_a_circle(wavenumber):
    def angle(x):
        return np.arctan2(x[:, 1], x[:, 0])

    def f(x):
        return (4 - wavenumber**2) * np.sin(2 * angle(x)) + (9 - wavenumber**2) * np.cos(3 * angle(x)) / 2

    t = np.linspace(0, 2 * np.pi, 999)
    scene = ck.Scene(CIRCLE, ck.Helmholtz(f, wavenumber))
    errors = [max_error(scene, on_circle(t), np.sin(2 * t) + np.cos(3 * t) / 2, h) for h in (0.08, 0.04, 0.02)]
    assert order_of((0.08, 0.04, 0.02), errors) >= 1.9


@pytest.mark.parametrize(("form", "bound", "order"), [("collocation", 1.3e-2, 1.75), ("galerkin", 1e-3, 2.7)])
@pytest.mark.parametrize("cut", [False, True])
def test_standing_waves_on_a_sphere(cut, form, bound, order):
    square = 4.0

    def f(x):
        return (6 - square) * x[:, 0] * x[:, 1] + (2 - square) * x[:, 2]

    circle = ck.source("analytic.circle", center=[0, 0, 0], radius=1.0, normal=rotation()[0])
    boundaries = [ck.Boundary("circle", circle, both=ck.Dirichlet(u))] if cut else []
    scene = ck.Scene(SPHERE, ck.Helmholtz(f, 2.0), boundaries)
    spacings = (0.25, 0.18, 0.125) if form == "collocation" else (0.4, 0.28, 0.2)
    solver = "reference" if form == "collocation" else "direct"
    errors = [max_error(scene, sphere_points(), u(sphere_points()), h, solver=solver, form=form) for h in spacings]
    assert errors[-1] <= bound
    assert order_of(spacings, errors) >= order


@pytest.mark.parametrize(
    ("form", "messages", "least", "fine", "refused", "needed"),
    [("collocation", 7.0, "0.086", 5.5, 11.0, "0.055"), ("galerkin", 20.3, "0.089", 15.5, 25.3, "0.071")],
)
def test_too_few_nodes_a_wavelength_are_reported_and_far_too_few_refused(form, messages, least, fine, refused, needed):
    def warnings(wavenumber):
        return ck.solve(ck.Scene(CIRCLE, ck.Helmholtz(1.0, wavenumber)), 0.1, form=form).warnings

    assert any(
        "nodes a wavelength" in sentence and f"use {least} or less" in sentence for sentence in warnings(messages)
    )
    assert not warnings(fine)
    with pytest.raises(ck.ResolutionError, match=f"use {needed} or less"):
        warnings(refused)


RESONANCES = {
    "collocation": [(2.001, True), (2.0, True), (2.06, False), (3.0, False)],
    "galerkin": [(2.00002, True), (1.99998, True), (2.0005, False), (3.0, False)],
}


@pytest.mark.parametrize(
    ("form", "square", "resonant"), [(form, *one) for form in RESONANCES for one in RESONANCES[form]]
)
def test_an_eigenvalue_within_the_error_of_the_scheme_is_reported(form, square, resonant):
    scene = ck.Scene(SPHERE, ck.Helmholtz(lambda x: x[:, 2], np.sqrt(square)))
    messages = [
        sentence
        for sentence in ck.solve(scene, 0.125, form=form, solver_tolerance=1e-8).warnings
        if "eigenvalue" in sentence
    ]
    assert len(messages) == resonant


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
@pytest.mark.parametrize("square", [1.9999, 2.0, 2.000001, 6.0, 6.001])
def test_a_mode_that_is_lost_near_resonance_is_warned_of_and_in_the_estimate(form, square):
    """By collocation the part z of xy + z is lost: its load is (2 - k^2) z, its eigenvalue 2.017."""

    def f(x):
        return (6 - square) * x[:, 0] * x[:, 1] + (2 - square) * x[:, 2]

    solution = ck.solve(ck.Scene(SPHERE, ck.Helmholtz(f, np.sqrt(square))), 0.2, form=form)
    assert any(f"of k^2={square:.6g}" in sentence for sentence in solution.warnings)
    points = sphere_points()
    exact = points[:, 0] * points[:, 1] + points[:, 2]
    error = np.abs(solution.evaluate(points) - exact).max() / np.ptp(exact)
    assert solution.error.largest[0] > 0.9 * error


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
@pytest.mark.parametrize("k", [1, 2, 3])
def test_at_resonance_on_the_circle_the_solution_is_not_determined(form, k):
    """At k = 1 and 2 a part of 2 xy + x is lost, at k = 3 neither, but cos 3t is free."""

    def f(x):
        return (4 - k * k) * x[:, 0] * x[:, 1] * 2 + (1 - k * k) * x[:, 0]

    solution = ck.solve(ck.Scene(CIRCLE, ck.Helmholtz(f, k)), 0.05, form=form)
    assert abs(solution.resonance.gap) < 1e-2
    assert any(f"of k^2={k * k}" in sentence for sentence in solution.warnings)
    assert solution.error.largest[0] >= 1
    assert "not determined" in solution.error.slow


@pytest.mark.parametrize(("form", "k2"), [("collocation", 1.9), ("galerkin", 1.99), ("galerkin", 2.01)])
def test_what_a_near_eigenvalue_multiplies_is_in_the_estimate(form, k2):
    def f(x):
        return (6 - k2) * x[:, 0] * x[:, 1] + (2 - k2) * x[:, 2]

    solution = ck.solve(ck.Scene(SPHERE, ck.Helmholtz(f, np.sqrt(k2))), 0.2, form=form)
    points = sphere_points()
    exact = points[:, 0] * points[:, 1] + points[:, 2]
    error = np.abs(solution.evaluate(points) - exact).max() / np.ptp(exact)
    assert 0.4 * error < solution.error.largest[0] < 3 * error


HEMISPHERE = ck.source("trimmed", of=SPHERE, trim="-z")


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
@pytest.mark.parametrize(("beta", "resonant"), [(-1.0, True), (-2.0, True), (-1.2, False), (0.5, False)])
def test_robin_at_minus_a_steklov_eigenvalue_is_warned_of(form, beta, resonant):
    """u = x / (1 + z) has du/db = u on the hemisphere's rim: Steklov's eigenvalues are 1, 2, 3."""
    rim = ck.Robin(1.0, beta, lambda x: (1 + beta) * x[:, 0])
    solution = ck.solve(ck.Scene(HEMISPHERE, ck.Laplace(), edge=rim), 0.15, form=form, solver="direct")
    messages = [sentence for sentence in solution.warnings if "to which conditions or c bring it" in sentence]
    assert len(messages) == resonant
    if not resonant:
        points = sphere_points()
        points = points[points[:, 2] > 0.05]
        bound = {"collocation": 0.04, "galerkin": 2e-4}[form]
        assert np.abs(solution.evaluate(points) - points[:, 0] / (1 + points[:, 2])).max() < bound


def test_a_factor_that_varies_is_reported_of_at_resonance_too():
    c = lambda x: -(1.0 + 1e-12 * x[:, 0])  # noqa: E731
    solution = ck.solve(ck.Scene(CIRCLE, ck.Elliptic(1.0, c=c)), 0.05)
    assert any("to which conditions or c bring it" in sentence for sentence in solution.warnings)


@pytest.mark.parametrize("solver", ["direct", "multigrid"])
def test_an_eigenvalue_that_is_free_is_warned_of_by_every_solver(solver):
    scene = ck.Scene(SPHERE, ck.Helmholtz(lambda x: x[:, 2] + x[:, 0] * x[:, 1], np.sqrt(2)))
    solution = ck.solve(scene, 0.2, form="galerkin", solver=solver)
    assert any("An eigenvalue lies within" in text and "of k^2=2" in text for text in solution.warnings)
    assert (solution.error.largest >= 1).all()  # the size of the mode is not determined


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_at_an_eigenvalue_of_the_lattice_there_is_no_solution(form):
    circle = ck.source("analytic.circle")
    value = ck.solve(ck.Scene(circle, ck.Eigen(3)), 0.1, form=form, solver_tolerance=1e-11).eigenvalues[1]
    with pytest.raises(ck.ConvergenceError, match=r"did not converge.*eigenvalue.*another wavenumber"):
        ck.solve(ck.Scene(circle, ck.Helmholtz(lambda x: x[:, 0] + x[:, 1] ** 3, np.sqrt(value))), 0.1, form=form)


def test_a_resonance_that_a_boundary_drives_is_reported():
    cut = ck.source("analytic.point", at=[1, 0])
    for wavenumber, resonant in ((0.5, True), (0.55, False)):
        scene = ck.Scene(CIRCLE, ck.Helmholtz(0.0, wavenumber), [ck.Boundary("cut", cut, both=ck.Dirichlet(1.0))])
        solution = ck.solve(scene, 0.05, form="collocation")
        assert len(solution.warnings) == resonant
        if not resonant:
            assert solution.evaluate([[-1, 0]]) == pytest.approx(1 / np.cos(wavenumber * np.pi), rel=2e-3)


def test_indefinite_systems_are_factorised_up_to_a_larger_size():
    f = ck.Helmholtz(1.0, 2.0)
    for problem, solver in ((f, "direct"), (ck.ScreenedPoisson(1.0), "reference")):
        assert ck.explain(ck.Scene(SPHERE, problem), 0.15, form="collocation", dry_run=True).solver == solver
    assert ck.explain(ck.Scene(SPHERE, f), 0.1, form="galerkin", dry_run=True).solver == "multigrid"
    assert (
        ck.explain(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0)), 0.05, form="galerkin", dry_run=True).solver == "multigrid"
    )
    assert (
        ck.explain(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0)), 0.1, form="collocation", dry_run=True).solver
        == "reference"
    )


def test_a_scene_file_holds_all_terms(tmp_path):
    text = """
    [surface]
    kind = "analytic.sphere"
    [problem]
    kind = "elliptic"
    f = "3*x*y"
    c = "1 + z**2"
    diffusivity = "1.5 + x*y/2"
    velocity = ["-y", "x", 0]
    [discretization]
    spacing = 0.25
    """
    (tmp_path / "scene.toml").write_text(text)
    loaded = ck.load_scene(tmp_path / "scene.toml")
    same = ck.Elliptic(
        lambda x: 3 * x[:, 0] * x[:, 1],
        diffusivity=lambda x: 1.5 + x[:, 0] * x[:, 1] / 2,
        velocity=lambda x: np.stack([-x[:, 1], x[:, 0], 0 * x[:, 0]], axis=1),
        c=lambda x: 1 + x[:, 2] ** 2,
    )
    found = [ck.solve(one, 0.25).values for one in (loaded.scene, ck.Scene(SPHERE, same))]
    assert np.abs(found[0] - found[1]).max() <= 1e-13
    assert str(loaded.scene.problem) == "-div(a grad u) + v . grad u + c u = f"
