"""The studies run, and the tables in the documentation are what they print: their cheapest rows are printed again."""

import importlib.util
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import cpmkit as ck

ROOT = Path(__file__).parents[2]
TABLES = ROOT / "benchmarks" / "tables"


def module(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    made = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = made
    spec.loader.exec_module(made)
    return made


@pytest.fixture(scope="module")
def representations():
    return module(ROOT / "examples" / "studies" / "representations.py")


@pytest.fixture(scope="module")
def backends():
    return module(ROOT / "examples" / "studies" / "backends.py")


def rows(table):
    """Return the rows of a file of tables, as lists of cells."""
    lines = (TABLES / table).read_text(encoding="utf-8").splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("| ")]


@pytest.mark.parametrize("name", ["sphere", pytest.param("torus", marks=pytest.mark.slow)])
def test_representations_agree_as_far_as_their_closest_points_do(representations, name):
    """A mesh and a cloud of a few thousand points, and the formulas, each against the closed form at one spacing."""
    small = {"sphere": {"cloud": 2000, "times": 4}, "torus": {"cloud": 6000, "around": 80, "across": 32}}[name]
    manifold = getattr(representations, name)(**small)
    manifold = replace(manifold, spacings=manifold.spacings[:1])
    points = manifold.points()
    closed = manifold.makers["closed form"]()
    problem = "Poisson, Dirichlet on a curve"
    spread, plain = np.ptp(representations.u(points)), {"origin": [0, 0, 0], "form": "collocation"}
    exact = ck.solve(representations.scenes(manifold, closed)[problem], manifold.spacings[0], **plain)
    for make in list(manifold.makers.values())[1:]:
        surface = make()
        scene = representations.scenes(manifold, surface)[problem]
        solution = ck.solve(scene, manifold.spacings[0], **plain)
        difference = np.abs(solution.evaluate(points) - exact.evaluate(points)).max() / spread
        off = representations.feet_off(surface, manifold, 4 * manifold.spacings[0])
        assert difference < 3 * off / manifold.spacings[0] + 3e-6


def test_the_table_of_representations_is_what_the_study_prints(representations):
    sphere = representations.sphere(cloud=10, times=1)
    scene = representations.scenes(sphere, sphere.makers["closed form"]())["Poisson, Dirichlet on a curve"]
    points = sphere.points()
    exact = representations.u(points)
    error = np.abs(ck.solve(scene, 0.2, origin=[0, 0, 0], form="collocation").evaluate(points) - exact).max() / np.ptp(
        exact
    )
    closed = [row for row in rows("representations.md") if row[0] == "closed form"]
    assert len(closed) == 4
    assert closed[1][2] == f"{error:.1e}"
    assert len([row for row in rows("representations.md") if row[0] != "representation"]) == 20


def test_the_floor_that_is_predicted_is_that_of_the_form_whose_solutions_are_compared(representations):
    """The floor of a mesh in the Galerkin form is lower by far: beside these differences it says nothing."""
    sphere = representations.sphere(cloud=10, times=4)
    kept = {name: make for name, make in sphere.makers.items() if name == "closed form" or name.startswith("mesh")}
    tables = representations.study(replace(sphere, spacings=[0.4], makers=kept))
    closed, mesh = tables["screened Poisson, closed"]
    assert closed.floor == 0
    scene = representations.scenes(sphere, sphere.makers[mesh.representation]())["screened Poisson, closed"]
    floors = [ck.explain(scene, 0.4, origin=[0, 0, 0], form=form).floor for form in ("collocation", "galerkin")]
    assert mesh.floor == pytest.approx(floors[0])
    assert floors[0] > 20 * floors[1]
    printed = [row for row in rows("representations.md") if row[0].startswith(("mesh", "cloud"))]
    assert len(printed) == 8
    for row in printed:
        assert float(row[-2]) / 5 < float(row[-1]) < 5 * float(row[-2]), row


def test_the_orders_in_the_table_are_two(representations):
    for row in rows("representations.md"):
        if row[0] in ("closed form", "level set", "parametric"):
            assert abs(float(row[5]) - 2) < 0.15


@cache
def on_spot(backends, file):
    """Return the vertices, the first problem's name and scene, and its solution by finite elements."""
    vertices, faces = ck.read_mesh(file)
    problem, scene = next(iter(backends.scenes(vertices, faces).items()))
    return vertices, problem, scene, ck.solve(scene, backend="fem")


@pytest.mark.parametrize("form", ["collocation", "galerkin"])
def test_the_table_of_back_ends_is_what_the_study_prints(backends, real_mesh, form):
    vertices, problem, scene, by_elements = on_spot(backends, real_mesh("spot.obj"))
    row, _ = backends.compare("spot.obj", problem, scene, vertices, 0.04, by_elements, form)
    printed = [line for line in backends.as_markdown([row]).splitlines() if line.startswith("| spot")]
    assert [cell.strip() for cell in printed[0].strip("|").split("|")] in rows("backends.md")
    assert {line[0] for line in rows("backends.md")} == {"mesh", "spot", "fish", "nefertiti-lowres"}


@pytest.mark.parametrize("name", ["double-torus", pytest.param("moebius", marks=pytest.mark.slow)])
def test_vector_fields_are_tangent_and_keep_their_directions(name):
    design = module(ROOT / "examples" / "vector_fields.py").DESIGNS[name]()
    field = design.solve(2 * design.spacing)
    points = design.surface.mesh(0.2)[0]
    vectors = field.evaluate(points)
    assert np.abs(np.linalg.norm(vectors, axis=1) - 1).max() < 1e-9
    assert np.abs(np.sum(vectors * ck.normals_at(design.surface, points), axis=1)).max() < 1e-9
    vortex, _ = design.directions[0]
    feet = vortex.closest_point(vortex.mesh(0.1)[0])
    assert np.median(np.abs(np.sum(field.evaluate(feet.points) * vortex.tangents(feet), axis=1))) > 0.99
    if name == "double-torus":  # closed: whatever the field, to the last unit
        assert sum(one.index for one in field.singularities) == -2
