"""The form is found by its name, refuses in one sentence what it cannot do, and stays lazy."""

import json
import subprocess
import sys

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.testing import kinds_without_case

SCENE = """
[surface]
kind = "analytic.sphere"

[[boundary]]
name = "equator"
kind = "analytic.circle"
normal = [0, 0, 1]
both = { dirichlet = 0.0 }

[problem]
kind = "screened"
f = "3*z"
c = 1.0

[discretization]
spacing = 0.2
degree = 2
order = 1

[solver]
kind = "reference"
tolerance = 1e-9
max_iterations = 50

[output]
folder = "out"
files = ["solution.vtp", "solution.ply", "solution.npz", "summary.json"]
picture = { file = "picture.png", width = 100 }
"""
SPHERE = ck.source("analytic.sphere")
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])


def solve(surface=SPHERE, problem=None, spacing=0.2, **conditions):
    boundaries = [ck.Boundary("equator", EQUATOR, **conditions)] if conditions else []
    return ck.solve(ck.Scene(surface, problem or ck.Laplace(), boundaries), spacing, backend="fem")


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that runs `cpmkit solve` on the scene, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    return lambda *arguments: CliRunner().invoke(main, ["solve", "scene.toml", *arguments])


def test_the_command_writes_what_the_scene_asks_for(run, tmp_path):
    import pyvista

    done = run("--backend", "fem")
    assert done.exit_code == 0, done.output
    assert "ghosts" not in done.output
    assert "direct: relative residual" in done.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["discretization"]["backend"] == "fem"
    assert summary["report"]["tolerance"] == 1e-9
    saved = pyvista.read(tmp_path / "out" / "solution.vtp")
    assert saved.n_points == summary["work"]["vertices"]
    assert np.abs(saved["u"] - saved.points[:, 2]).max() < 0.05
    with np.load(tmp_path / "out" / "solution.npz") as arrays:
        np.testing.assert_allclose(arrays["values"][:, 0], saved["u"], rtol=1e-12)
    assert {"picture.png", "solution.ply"} <= {file.name for file in (tmp_path / "out").iterdir()}


def test_the_command_takes_another_spacing_and_prints_json(run):
    coarse, fine = (
        json.loads(run("--backend", "fem", "--json", "--spacing", h).stdout)["work"]["unknowns"] for h in ("0.2", "0.1")
    )
    assert 3 < fine / coarse < 5


def test_the_command_names_an_unknown_back_end(run, tmp_path):
    done = run("--backend", "fea")
    assert done.exit_code == 1
    assert "No plugin provides the kind 'fea'" in done.output
    assert not (tmp_path / "out").exists()


def test_names_of_back_ends():
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(1.0))
    with pytest.raises(ck.PluginError, match=r"kind 'fea'. Installed: .*\bfem\b"):
        ck.solve(scene, 0.2, backend="fea")
    with pytest.raises(ck.PluginError, match=r"'mesh.triangles' is not among .* cpmkit_backends"):
        ck.solve(scene, 0.2, backend="mesh.triangles")
    with pytest.raises(ck.PluginError, match=r"'fem' is not among .* cpmkit_sources"):
        ck.source("fem")
    assert "fem" not in kinds_without_case()


@pytest.mark.parametrize("option", [{"order": 1}, {"origin": [0, 0, 0]}, {"sheets": False}, {"pace": 2}])
def test_options_of_the_lattice_are_refused(option):
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(1.0))
    with pytest.raises(
        ck.SceneError, match=f"'fem' has the unknown key '{next(iter(option))}'; accepted are .*tolerance"
    ):
        ck.solve(scene, 0.2, backend="fem", **option)


def test_progress_and_tolerance():
    seen = []
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: x[:, 0]))
    solution = ck.solve(
        scene, 0.2, backend="fem", solver_tolerance=1e-8, progress=lambda stage, share: seen.append((stage, share))
    )
    assert seen == [("build", 0.0), ("build", 1.0), ("solve", 0.0), ("solve", 1.0)]
    assert solution.report.converged
    assert solution.report.tolerance == 1e-8
    report = ck.solve(scene, 0.2, backend="fem", solver_tolerance=1e-300).report
    assert report.converged  # what rounding leaves of a residual is accepted
    assert 0 < report.residual < 1e-12
    with pytest.raises(ck.InputError, match="tolerance must be"):
        ck.solve(scene, 0.2, backend="fem", solver_tolerance=0)


def test_a_spacing_is_needed_where_there_is_no_mesh(octahedron):
    with pytest.raises(ck.InputError, match="spacing is needed"):
        solve(spacing=None, both=ck.Dirichlet(1.0))
    with pytest.raises(ck.InputError, match="spacing must be"):
        solve(spacing=-1, both=ck.Dirichlet(1.0))
    vertices, faces = octahedron(2)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    assert len(solve(mesh, ck.ScreenedPoisson(1.0), spacing=None).discretized.faces) == len(faces)
    assert len(solve(mesh, spacing=None, both=ck.Dirichlet(1.0)).discretized.faces) > len(faces)


def test_a_point_takes_a_value_alone():
    pin = ck.Boundary("pin", ck.source("analytic.point", at=[0, 0, 1]), both=ck.Neumann(0.0))
    with pytest.raises(ck.SceneError, match=r"'pin' is a point of a surface .* give it a value"):
        ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson(1.0), [pin]), 0.3, backend="fem")


def test_a_cloud_has_no_triangles():
    cloud = ck.source("pointcloud.points", points=np.random.default_rng(0).normal(size=(30, 3)), method="nearest")
    with pytest.raises(ck.InputError, match=r"needs triangles, and NearestSamples gives only points; .*'cpm'"):
        solve(cloud, both=ck.Dirichlet(1.0))


def test_its_solution_is_summed_up_in_the_words_of_every_other():
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(1.0), [ck.Boundary("equator", EQUATOR, both=ck.Dirichlet(2.0))])
    own, other = ck.solve(scene, 0.3, backend="fem").summary(), ck.solve(scene, 0.3).summary()
    assert own.keys() == other.keys()
    assert own["scene"] == other["scene"]
    assert own["discretization"].keys() == {"backend", "spacing", "degree", "channels"}
    assert {"cpmkit-fem", "scikit-fem"} <= own["versions"].keys()


def test_equal_data_on_two_sides_are_one_condition():
    two = solve(left=ck.Dirichlet(lambda x: x[:, 0]), right=ck.Dirichlet(lambda x: 1.0 * x[:, 0]))
    np.testing.assert_array_equal(two.values, solve(both=ck.Dirichlet(lambda x: x[:, 0])).values)


def test_the_nearer_boundary_wins_a_vertex(octahedron):
    vertices, faces = octahedron(2)
    mesh = ck.source("mesh.triangles", vertices=vertices, faces=faces)
    near = {"off": ([1e-7, 0, 1], 2.0), "on": ([0, 0, 1], 1.0)}
    pins = [
        ck.Boundary(name, ck.source("analytic.point", at=at), both=ck.Dirichlet(value))
        for name, (at, value) in near.items()
    ]
    for order in ([0, 1], [1, 0]):
        solution = ck.solve(ck.Scene(mesh, ck.Laplace(), [pins[k] for k in order]), backend="fem")
        np.testing.assert_allclose(solution.values, 1.0, rtol=1e-12)


def test_solvers_are_those_of_every_form():
    scene = ck.Scene(SPHERE, ck.ScreenedPoisson(lambda x: x[:, 0]))
    factorised, iterated = (ck.solve(scene, 0.2, backend="fem", solver=name) for name in ("auto", "reference"))
    assert [one.report.solver for one in (factorised, iterated)] == ["direct", "reference"]
    np.testing.assert_allclose(iterated.values, factorised.values, atol=1e-8)
    with pytest.raises(ck.InputError, match="solver must be auto"):
        ck.solve(scene, 0.2, backend="fem", solver="fast")
    with pytest.raises(ck.ConvergenceError):
        ck.solve(scene, 0.2, backend="fem", solver="reference", max_iterations=2)


@pytest.mark.parametrize(
    ("problem", "what"),
    [
        (ck.Elliptic(1.0, velocity=lambda x: np.cross([0, 0, 1.0], x), c=1.0), "takes no velocity"),
        (
            ck.Wave(1.0, until=1.0, step=0.01, scheme="leapfrog"),
            "no explicit steps, which 'wave' needs; use scheme 'newmark' or 'implicit', or",
        ),
        (ck.Biharmonic(1.0), "no second Laplacian, which 'biharmonic' needs; use"),
    ],
)
def test_unsupported_problems_are_refused_with_an_alternative(problem, what):
    with pytest.raises(ck.SceneError, match=f"{what}.* backend='cpm'"):
        solve(problem=problem)


def test_what_it_does_not_read():
    solution = solve(both=ck.Dirichlet(1.0))
    for target in (
        lambda: solution.gradient([[0, 0, 1]]),
        lambda: solution.flux("equator", "left"),
        lambda: solution.signed_distance("equator", [[0, 0, 1]]),
    ):
        with pytest.raises(ck.InputError, match="the form 'fem'"):
            target()


class Solid:
    """A ball, whose points are closest to themselves."""

    dim, manifold_dim, exact, bounds = 3, 3, True, SPHERE.bounds

    def closest_point(self, x):
        return SPHERE.closest_point(x)


def test_solids_that_give_no_triangles():
    with pytest.raises(
        ck.InputError, match="needs a mesh of the boundary of a solid, and Solid has none; use backend='cpm'"
    ):
        ck.solve(ck.Scene(Solid(), ck.ScreenedPoisson(1.0)), 0.3, backend="fem")


class Flattened:
    """The unit sphere, drawn with a triangle whose corners lie on a line."""

    dim, manifold_dim, exact, bounds = 3, 2, True, SPHERE.bounds

    def closest_point(self, x):
        return SPHERE.closest_point(x)

    def mesh(self, spacing):
        del spacing
        return np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 1, 3]])


def test_triangles_without_area_are_refused():
    with pytest.raises(ck.InputError, match="got 1 of 2 without"):
        solve(Flattened(), ck.ScreenedPoisson(1.0))


def test_boundaries_off_the_mesh_and_everywhere(octahedron):
    far = ck.Boundary("far", ck.source("analytic.point", at=[0, 0, 3]), both=ck.Dirichlet(1.0))
    with pytest.raises(ck.SceneError, match="'far' is up to 2 away from the surface"):
        ck.solve(ck.Scene(SPHERE, ck.Laplace(), [far]), 0.2, backend="fem")
    triangle = ck.source("mesh.triangles", vertices=np.eye(3), faces=[[0, 1, 2]])
    with pytest.raises(ck.ResolutionError, match="All 3 vertices"):
        ck.solve(ck.Scene(triangle, ck.Laplace(), edge=ck.Dirichlet(1.0)), backend="fem")
    with pytest.raises(ck.SceneError, match="has the loops 3, and the manifold's loops 0 are missing"):
        ck.solve(ck.Scene(triangle, ck.ScreenedPoisson(1.0), edge={3: ck.Neumann()}), backend="fem")


def test_reading():
    solution = solve(both=ck.Dirichlet(lambda x: x[:, 0]))
    points = [[0, 0.6, 0.8], [1, 0, 0]]
    assert solution.evaluate(points).shape == (2,)
    for side in ("left", "right", {"equator": "left"}):
        np.testing.assert_allclose(solution.evaluate(points, side=side), solution.evaluate(points), atol=1e-13)
    for side, message in (("above", "must be 'left' or 'right'"), ({"rim": "left"}, "no boundary has the name 'rim'")):
        with pytest.raises(ck.InputError, match=message):
            solution.evaluate(points, side=side)
    with pytest.raises(ck.InputError, match="NaN or infinity"):
        solution.evaluate([[np.nan, 0, 0]])
    np.testing.assert_allclose(solution.evaluate(solution.discretized.vertices), solution.values[:, 0], atol=1e-13)
    assert "Solution of laplace" in repr(solution)
    assert "form fem" in repr(solution)


def test_scikit_fem_is_imported_by_its_own_solve_alone():
    code = """
import sys
import cpmkit as ck
from cpmkit import plugins
for kind in plugins.installed_kinds():
    plugins.load_plugin(kind.kind)
scene = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0))
ck.solve(scene, 0.2)
assert "cpmkit_fem" in sys.modules
assert not any(name.partition(".")[0] == "skfem" for name in sys.modules)
ck.solve(scene, 0.2, backend="fem")
assert "skfem" in sys.modules
"""
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("kind", ["neumann", "robin"])
def test_fluxes_jump_at_corners_of_the_rim(kind):
    """A linear function on a square: each side has the flux of its own normal at the corners."""
    square, slope = ck.source("analytic.box", lower=[-0.5, -0.5], upper=[0.5, 0.5]), np.array([1.0, -2.0])

    def linear(x):
        return x @ slope + 0.3

    def flux(x):
        axis = np.abs(x).argmax(axis=1)
        return (np.sign(x) * slope)[np.arange(len(x)), axis]

    edge = ck.Neumann(flux) if kind == "neumann" else ck.Robin(1.0, 2.0, lambda x: flux(x) + 2 * linear(x))
    solution = ck.solve(ck.Scene(square, ck.ScreenedPoisson(linear), edge=edge), 0.2, backend="fem")
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (100, 2))
    np.testing.assert_allclose(solution.evaluate(points), linear(points), atol=1e-11)
