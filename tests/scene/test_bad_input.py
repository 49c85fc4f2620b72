"""Every bad input gets one sentence: what was got, what is accepted, what to do."""

from functools import partial

import numpy as np
import pytest
from model_problems import circle_jump

import cpmkit as ck
from cpmkit import plugins
from cpmkit.runtime import memory


def sphere_scene(**changes):
    parts = {"surface": ck.source("analytic.sphere"), "problem": ck.ScreenedPoisson(1.0), "boundaries": []}
    return ck.Scene(**(parts | changes))


def one_sentence(error, *parts):
    text = str(error.value)
    assert "\n" not in text
    assert text.endswith(".")
    for part in parts:
        assert part in text, text


@pytest.mark.parametrize("spacing", [-0.1, 0.0, np.nan, np.inf, "fine", [0.1, 0.2]])
def test_a_spacing_that_is_none(spacing):
    with pytest.raises(ck.InputError) as error:
        ck.solve(sphere_scene(), spacing)
    one_sentence(error, "spacing must be", "above zero")


def test_no_spacing_suggests_one_that_works():
    with pytest.raises(ck.InputError) as error:
        ck.solve(sphere_scene())
    one_sentence(error, "try spacing=")
    suggested = float(str(error.value).rpartition("=")[2].rstrip("."))
    assert 1e3 < ck.explain(sphere_scene(), suggested, dry_run=True).unknowns < 1e5


FORMS = pytest.mark.parametrize("form", ["collocation", "galerkin"])


@FORMS
def test_a_spacing_beyond_the_machines_memory(monkeypatch, form):
    monkeypatch.setattr(memory, "machine_bytes", lambda: 64 * 2**20)
    scene = sphere_scene()
    for call in (ck.solve, ck.explain):
        with pytest.raises(ck.ResolutionError) as error:
            call(scene, 0.005, form=form)
        one_sentence(error, "spacing=0.005 needs about", "GiB", "or more would fit")
    fits = float(str(error.value).partition("; spacing=")[2].split()[0])
    assert ck.explain(scene, fits, form=form, dry_run=True).bytes < 64 * 2**20


@FORMS
def test_an_absurdly_small_spacing_is_refused_at_once(form):
    with pytest.raises(ck.ResolutionError, match="would fit"):
        ck.solve(sphere_scene(), 1e-9, form=form)


@pytest.mark.parametrize(("form", "coarsest"), [("collocation", 0.5), ("galerkin", 0.8)])
def test_a_spacing_that_is_coarser_than_the_surface(form, coarsest):
    for call in (ck.solve, ck.explain):
        with pytest.raises(ck.ResolutionError) as error:
            call(sphere_scene(), 0.9, form=form)
        one_sentence(error, "spacing=0.9 is too coarse", "largest side is 2", f"{coarsest} or less")
    assert ck.solve(sphere_scene(), coarsest, form=form).report.converged


@pytest.mark.parametrize("degree", [1, 6, 3.5])
def test_a_degree_that_is_not_offered(degree):
    with pytest.raises(ck.InputError) as error:
        ck.solve(sphere_scene(), 0.2, form="collocation", degree=degree)
    one_sentence(error, "degree must be one of 2, 3, 4, 5")
    if degree == 1:
        one_sentence(error, "does not converge")
    else:
        with pytest.raises(ck.InputError) as error:
            ck.solve(sphere_scene(), 0.2, degree=degree)
        one_sentence(error, "degree must be 1, 2 or 3 in the form 'galerkin'", "form='collocation' takes 2 to 5")


@pytest.mark.parametrize("order", [0, 5, True, "2"])
def test_an_order_that_is_not_offered(order):
    with pytest.raises(ck.InputError) as error:
        ck.solve(sphere_scene(), 0.2, order=order)
    one_sentence(error, "order must be a whole number from 1 to 2")


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"order": 3}, "order must be 1 or 2, got 3; use form=.galerkin."),
        ({"order": 4, "degree": 5}, "order must be 1 or 2, got 4; use form=.galerkin."),
        ({"sheets": "unfolded"}, "sheets must be true or false, got 'unfolded'; use form=.galerkin."),
        ({"balance": 5}, "no option `balance` any more: use form=.galerkin."),
    ],
)
def test_options_that_left_name_what_to_use_instead(option, message):
    for ask in (ck.solve, ck.explain, ck.prepare, ck.discretize, ck.estimate_error):
        with pytest.raises(ck.InputError, match=message):
            ask(sphere_scene(), 0.2, **option)


def test_orders_of_conditions_that_left_name_what_to_use_instead():
    for kind in (ck.Dirichlet, ck.Neumann, ck.Steklov):
        with pytest.raises(ck.InputError, match=f"order of {kind.__name__} must be 1 or 2, got 3; use form=.galerkin."):
            kind(order=3) if kind is ck.Steklov else kind(0.0, order=3)


@pytest.mark.parametrize(
    "sides",
    [
        {"left": ck.Dirichlet(1.0)},
        {"right": ck.Neumann()},
        {},
        {"both": ck.Dirichlet(1.0), "left": ck.Neumann()},
    ],
)
def test_a_condition_on_one_side_only(sides):
    with pytest.raises(ck.SceneError) as error:
        ck.Boundary("brow", ck.source("analytic.point", at=[0, 0, 1.0]), **sides)
    one_sentence(error, "'brow'", "give `both`, or `left` and `right`")


def test_sides_of_a_point_on_a_surface():
    pin = ck.Boundary(
        "pin", ck.source("analytic.point", at=[0, 0, 1.0]), left=ck.Dirichlet(1.0), right=ck.Dirichlet(2.0)
    )
    with pytest.raises(ck.SceneError) as error:
        ck.solve(sphere_scene(boundaries=[pin]), 0.2)
    one_sentence(error, "'pin'", "no left and right", "give `both`")


def test_places_of_a_point_source_that_are_none():
    with pytest.raises(ck.InputError) as error:
        ck.PointSource("abc")
    one_sentence(error, "must be points", "'abc'")


@pytest.mark.parametrize(
    ("form", "farthest"), [("collocation", "tube's radius 0.346"), ("galerkin", "3 spacings, 0.3")]
)
def test_a_boundary_away_from_the_surface(form, farthest):
    far = ck.Boundary(
        "far", ck.source("analytic.circle", radius=3.0, center=[0, 0, 0], normal=[0, 0, 1]), both=ck.Dirichlet(1.0)
    )
    for call in (ck.solve, partial(ck.explain, dry_run=True)):
        with pytest.raises(ck.SceneError) as error:
            call(sphere_scene(boundaries=[far]), 0.1, form=form)
        one_sentence(error, "'far'", "2 away", farthest, "; move it onto the surface")


@FORMS
@pytest.mark.parametrize(("surface", "at"), [("sphere", [0, 0, 2.0]), ("circle", [0, 2.0])])
def test_a_point_away_from_the_manifold(form, surface, at):
    far = ck.Boundary("far", ck.source("analytic.point", at=at), both=ck.Dirichlet(1.0))
    scene = ck.Scene(ck.source(f"analytic.{surface}"), ck.ScreenedPoisson(1.0), [far])
    with pytest.raises(ck.SceneError, match="'far' is up to 1 away from the surface, more than"):
        ck.solve(scene, 0.1, form=form)


@FORMS
def test_a_boundary_somewhat_off_the_surface_gives_a_warning(form):
    off = ck.Boundary("off", ck.source("analytic.circle", radius=1.07, normal=[0, 0, 1]), both=ck.Dirichlet(1.0))
    (message,) = [text for text in ck.solve(sphere_scene(boundaries=[off]), 0.1, form=form).warnings if "'off'" in text]
    assert message.startswith("Boundary 'off' lies up to 0.07")
    assert "off the surface, 0.7" in message


def test_a_boundary_of_another_dimension():
    flat = ck.Boundary("flat", ck.source("analytic.point", at=[1.0, 0.0]), both=ck.Dirichlet(1.0))
    with pytest.raises(ck.SceneError) as error:
        ck.solve(sphere_scene(boundaries=[flat]), 0.1)
    one_sentence(error, "2D", "3D")
    thick = ck.Boundary("thick", ck.source("analytic.sphere"), both=ck.Dirichlet(1.0))
    with pytest.raises(ck.SceneError) as error:
        ck.solve(sphere_scene(boundaries=[thick]), 0.1)
    one_sentence(error, "dimension 2")


def test_two_boundaries_of_one_name():
    pins = [ck.Boundary("pin", ck.source("analytic.point", at=[0, 0, 1.0]), both=ck.Dirichlet(1.0))] * 2
    with pytest.raises(ck.SceneError) as error:
        sphere_scene(boundaries=pins)
    one_sentence(error, "share the name 'pin'")


def test_channels_that_disagree():
    pins = [
        ck.Boundary(f"pin {k}", ck.source("analytic.point", at=[0, 0, z]), both=ck.Dirichlet(value))
        for k, (z, value) in enumerate([(1.0, [1.0, 2.0]), (-1.0, [1.0, 2.0, 3.0])])
    ]
    with pytest.raises(ck.SceneError) as error:
        sphere_scene(boundaries=pins)
    one_sentence(error, "2 channels where others have 3")


@pytest.mark.parametrize(
    "value", [np.nan, "red", [0.1, np.inf], lambda x: np.zeros((len(x), 2, 2)), lambda x: np.zeros(len(x) + 1)]
)
def test_data_that_are_no_finite_numbers_of_the_right_shape(value):
    with pytest.raises(ck.InputError):
        sphere_scene(
            boundaries=[ck.Boundary("pin", ck.source("analytic.point", at=[0, 0, 1.0]), both=ck.Dirichlet(value))]
        )


@pytest.mark.parametrize("c", [0.0, -1.0, np.nan])
def test_a_screening_that_is_none(c):
    with pytest.raises(ck.InputError, match="c of screened"):
        ck.ScreenedPoisson(1.0, c=c)


def test_an_unknown_kind_names_those_installed_and_what_would_add_it(monkeypatch):
    with pytest.raises(ck.PluginError) as error:
        ck.source("voxel.grid", file="x")
    one_sentence(error, "'voxel.grid'", "analytic.torus", "mesh.triangles")
    assert "pip install" not in str(error.value)  # nobody knows who would own a distribution of such a name
    shapes = [kind for kind in plugins.installed_kinds() if not kind.kind.startswith("levelset.")]
    monkeypatch.setattr(plugins, "installed_kinds", lambda: shapes)
    assert "pip install 'cpmkit[levelset]'" in plugins._unknown_kind_message("levelset.noise")
    analytic = [kind for kind in shapes if kind.kind.startswith("analytic.")]
    monkeypatch.setattr(plugins, "installed_kinds", lambda: analytic)
    assert "pip install 'cpmkit[combinations]'" in plugins._unknown_kind_message("points")
    monkeypatch.setattr(plugins, "installed_kinds", lambda: shapes)
    with pytest.raises(ck.PluginError) as error:
        ck.source("analytic.cube")
    one_sentence(error, "'analytic.cube'", "analytic.circle")


def test_an_unknown_key_of_a_kind_names_the_accepted_ones():
    with pytest.raises(ck.SceneError) as error:
        ck.source("analytic.torus", major=1.0, minor=0.3, radius=2.0)
    one_sentence(error, "'radius'", "major, minor")


def test_an_unknown_key_of_an_equation_names_the_accepted_ones():
    with pytest.raises(ck.SceneError) as error:
        ck.Heat("x", until=1.0, step=0.1, velocities=[1, 0, 0])
    one_sentence(error, "Heat has the unknown key 'velocities' (did you mean 'velocity'?)", "initial, until, step")


def test_what_is_no_source():
    with pytest.raises(ck.InputError, match="must be a closest point source"):
        sphere_scene(surface=lambda x: x)


def test_a_problem_that_is_none():
    with pytest.raises(ck.SceneError, match=r"an equation, such as Laplace\(\)"):
        sphere_scene(problem="laplace")


def test_a_tolerance_out_of_reach_says_what_was_reached():
    scene, _, _ = circle_jump()
    with pytest.raises(ck.ConvergenceError) as error:
        ck.solve(scene, 0.02, solver="reference", solver_tolerance=1e-10, max_iterations=3)
    one_sentence(error, "relative residual", "3 iterations", "max_iterations")
    assert error.value.report.residual > 1e-10
    assert not error.value.report.converged
    report = ck.solve(scene, 0.02, solver="direct", solver_tolerance=1e-30).report
    assert report.converged  # what rounding leaves of a residual is accepted
    assert 0 < report.residual < 1e-12


@pytest.mark.parametrize("solver", ["magic", ["direct"], None])
def test_an_unknown_solver(solver):
    with pytest.raises(ck.InputError, match="auto, direct, multigrid, jacobi, reference, or"):
        ck.solve(sphere_scene(), 0.3, solver=solver)


@pytest.mark.parametrize(
    ("call", "error", "part"),
    [
        (lambda: ck.source(3), ck.PluginError, "got 3"),
        (lambda: sphere_scene(boundaries=None), ck.SceneError, "must be a list of cpmkit.Boundary"),
        (lambda: sphere_scene(boundaries=3), ck.SceneError, "got 3"),
        (lambda: sphere_scene(surface=("a", np.array([[0, 1, 2]]))), ck.InputError, "vertices must be numbers"),
        (lambda: ck.prepare(sphere_scene(), 0.5).solve(data=[1]), ck.SceneError, "must be a table of conditions"),
    ],
)
def test_values_of_another_kind_than_the_argument(call, error, part):
    with pytest.raises(error) as caught:
        call()
    one_sentence(caught, part)


def test_a_single_boundary_is_a_list_of_one():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0, 0, 1.0]), both=ck.Dirichlet(1.0))
    assert sphere_scene(boundaries=pin).boundaries[0].name == "pin"
