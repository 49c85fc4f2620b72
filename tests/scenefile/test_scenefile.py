"""A scene file says the same as Python, and a wrong one is answered with one sentence and leaves nothing behind."""

import re

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit import Dirichlet, Neumann
from cpmkit.cli import main
from cpmkit.runtime.deprecation import RenamedWarning
from cpmkit.scenefile.scene_files import read_options

GOOD = """
[surface]
kind = "analytic.cap"
height = 0.1
edge = { dirichlet = "x + 2" }

[[boundary]]
name = "ring"
kind = "analytic.circle"
center = [0, 0, 0.5]
normal = [0, 0, 1]
radius = 0.8660254037844386
left = { dirichlet = ["0.5 + 0.5*sin(x/20)", 0.4, 0.1], order = 1 }
right = { neumann = 0 }

[problem]
kind = "screened"
f = ["x*y", 1, 2]
c = 2.5

[discretization]
spacing = 0.15
degree = 3
order = 2

[solver]
kind = "reference"
tolerance = 1e-9

[output]
folder = "out"
files = ["summary.json"]
"""


def written(folder, text, name="scene.toml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_says_what_it_says(tmp_path):
    loaded = ck.load_scene(written(tmp_path, GOOD))
    scene = loaded.scene
    (ring,) = scene.boundaries
    left, right = ring.condition("left"), ring.condition("right")
    assert (loaded.spacing, loaded.options) == (
        0.15,
        {"degree": 3, "order": 2, "solver": "reference", "solver_tolerance": 1e-9},
    )
    assert isinstance(left, Dirichlet)
    assert left.order == 1
    assert isinstance(right, Neumann)
    assert right.flux == 0.0
    assert left.value[0](np.array([[10.0, 0, 0]])) == pytest.approx(0.5 + 0.5 * np.sin(0.5))
    assert scene.edge.value(np.array([[3.0, 0, 0]])) == 5.0
    assert (scene.problem.kind, scene.problem.c, scene.channels) == ("screened", 2.5, 3)
    assert (str(loaded.output.folder), loaded.output.files, loaded.output.picture) == ("out", ("summary.json",), None)


def test_a_file_gives_the_same_solution_as_python(tmp_path):
    loaded = ck.load_scene(written(tmp_path, GOOD))
    ring = ck.source("analytic.circle", center=[0, 0, 0.5], normal=[0, 0, 1], radius=np.sqrt(0.75))
    value = [lambda x: 0.5 + 0.5 * np.sin(x[:, 0] / 20), 0.4, 0.1]
    scene = ck.Scene(
        ck.source("analytic.cap", height=0.1),
        ck.ScreenedPoisson([lambda x: x[:, 0] * x[:, 1], 1.0, 2.0], c=2.5),
        [ck.Boundary("ring", ring, left=ck.Dirichlet(value, order=1), right=ck.Neumann(0.0))],
        edge=ck.Dirichlet(lambda x: x[:, 0] + 2),
    )
    one = ck.solve(loaded.scene, loaded.spacing, **loaded.options)
    two = ck.solve(scene, 0.15, solver="reference", solver_tolerance=1e-9)  # orders are of the collocation form
    assert one.discretized.form == two.discretized.form == "collocation"
    np.testing.assert_allclose(one.values, two.values, atol=1e-12)


def test_edges_by_loop_number(tmp_path):
    text = GOOD.replace('edge = { dirichlet = "x + 2" }', "edge = { 0 = { dirichlet = 1.0 }, 1 = { neumann = 0 } }")
    edge = ck.load_scene(written(tmp_path, text)).scene.edge
    assert {loop: condition.kind for loop, condition in edge.items()} == {0: "dirichlet", 1: "neumann"}


def test_array_files_are_found_beside_the_scene(tmp_path, monkeypatch):
    np.save(tmp_path / "curve.npy", np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]))
    text = GOOD.replace(
        'kind = "analytic.circle"\ncenter = [0, 0, 0.5]\nnormal = [0, 0, 1]\nradius = 0.8660254037844386',
        'kind = "mesh.polyline"\nfile = "curve.npy"',
    )
    path = written(tmp_path, text)
    monkeypatch.chdir("/")
    assert ck.load_scene(path).scene.boundaries[0].source.bounds.tolist() == [[0, 0, 0], [1, 1, 1]]


def test_meshes_are_found_in_the_data_folder_and_the_cache(tmp_path, monkeypatch):
    from cpmkit.files.whole_files import find_file

    for folder, variable in (("data", "CPMKIT_DATA"), ("cache", "CPMKIT_CACHE")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / f"{folder}.obj").write_text("v 0 0 0")
        monkeypatch.setenv(variable, str(tmp_path / folder))
    assert find_file("data.obj", tmp_path) == tmp_path / "data" / "data.obj"
    assert find_file("cache.obj", tmp_path) == tmp_path / "cache" / "cache.obj"


def test_files_named_in_python_are_found_there_too(tmp_path, monkeypatch):
    (tmp_path / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    monkeypatch.setenv("CPMKIT_DATA", str(tmp_path))
    assert ck.source("mesh.triangles", file="one.obj").bounds.tolist() == [[0, 0, 0], [1, 1, 0]]
    with pytest.raises(ck.InputError, match=f"no file 'other.obj'; looked in .*{tmp_path}"):
        ck.source("mesh.triangles", file="other.obj")


def test_a_mesh_is_fetched_into_the_cache_and_its_checksum_verified(tmp_path, monkeypatch):
    import hashlib

    from cpmkit.files.whole_files import find_file

    pytest.importorskip("pooch")
    origin = tmp_path / "origin"
    origin.mkdir()
    (origin / "small.obj").write_text("v 0 0 0\n")
    right = hashlib.sha256(b"v 0 0 0\n").hexdigest()
    monkeypatch.setattr(
        "cpmkit.files.whole_files.KNOWN_MESHES",
        {"small.obj": ("small.obj", right), "other.obj": ("small.obj", "0" * 64)},
    )
    monkeypatch.setenv("CPMKIT_ORIGIN", origin.as_uri())
    monkeypatch.setenv("CPMKIT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("CPMKIT_FETCH", raising=False)
    assert find_file("small.obj", tmp_path).read_text() == "v 0 0 0\n"
    with pytest.raises(ck.InputError, match="checksum"):
        find_file("other.obj", tmp_path)
    assert [path.name for path in (tmp_path / "cache").iterdir()] == ["small.obj"]


WRONG = {
    "not TOML": ("kind = [", "is not TOML"),
    "an unknown table": (GOOD + "\n[extra]\na = 1", "unknown key 'extra'; accepted are surface, boundary, problem"),
    "no surface": ('[problem]\nkind = "laplace"', r"needs the tables \[surface\] and \[problem\]"),
    "no kind": (GOOD.replace('kind = "analytic.cap"', ""), r"\[surface\] needs a kind"),
    "an unknown kind": (GOOD.replace("analytic.cap", "voxel.cap"), "voxel.cap.*Installed: .*analytic.cap"),
    "an unknown key of a kind": (
        GOOD.replace("height = 0.1", "height = 0.1\nwidth = 3"),
        "unknown key 'width'; accepted are .*height",
    ),
    "an unknown key of a boundary": (
        GOOD.replace('name = "ring"', 'name = "ring"\ncolour = 3'),
        "unknown key 'colour'",
    ),
    "an unknown condition": (
        GOOD.replace("right = { neumann = 0 }", "right = { neuman = 0 }"),
        "right of .*'ring' must be one of .*dirichlet.*neumann",
    ),
    "two conditions on a side": (
        GOOD.replace("right = { neumann = 0 }", "right = { neumann = 0, dirichlet = 1 }"),
        "must be one of",
    ),
    "a condition on one side": (
        GOOD.replace("right = { neumann = 0 }", ""),
        "'ring' has conditions on left; give `both`, or",
    ),
    "an unknown problem": (
        GOOD.replace('"screened"', '"heatt"'),
        "must be one of laplace, poisson, screened, .*, got 'heatt'",
    ),
    "an unknown key of a problem": (GOOD.replace("c = 2.5", "d = 2.5"), "unknown key 'd'; accepted are f, c"),
    "an unknown key of the lattice": (
        GOOD.replace("spacing = 0.15", "space = 0.15"),
        "unknown key 'space'; accepted are spacing, origin, form, tolerance, norm, seconds, memory, estimate, degree",
    ),
    "a formula that is none": (GOOD.replace('"x + 2"', '"x +"'), "does not parse"),
    "a value that is none": (GOOD.replace('"x + 2"', "true"), "must be a number, a formula"),
    "a negative spacing": (
        GOOD.replace("spacing = 0.15", "spacing = -1.0"),
        "spacing must be a finite number above zero, got -1",
    ),
    "degree 1": (GOOD.replace("degree = 3", "degree = 1"), "degree must be one of 2, 3, 4, 5"),
    "a missing file": (
        GOOD.replace('kind = "analytic.cap"\nheight = 0.1', 'kind = "mesh.triangles"\nfile = "nose.obj"'),
        "no file 'nose.obj'; looked in",
    ),
    "an unknown file type": (GOOD.replace("summary.json", "summary.docx"), r"accepted are .*\.vtp"),
    "a picture that is none": (GOOD + 'picture = { file = "a.png", widht = 3 }', "unknown key 'widht'"),
    "an unknown solver": (
        GOOD.replace('"reference"', '"fast"'),
        "solver must be auto, direct, multigrid, jacobi, reference, or",
    ),
    "a boundary far away": (
        GOOD.replace("center = [0, 0, 0.5]", "center = [0, 0, 2.5]"),
        "'ring' is up to .* away from the surface",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_scene_gets_one_sentence_and_nothing_is_written(name, tmp_path, monkeypatch):
    text, message = WRONG[name]
    monkeypatch.chdir(tmp_path)
    path = written(tmp_path, text)
    result = CliRunner().invoke(main, ["solve", str(path), "--quiet"])
    assert result.exit_code == 1, result.output
    assert result.output.count("\n") == 1
    assert result.output.startswith("Error: ")
    assert re.search(message, result.output.replace("\n", " ")), result.output
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene.toml"]


def test_an_unknown_solver_is_refused_before_a_solve():
    with pytest.raises(ck.SceneError, match=r"^\[solver\]: solver must be auto, .*, got 'foo'"):
        read_options({"solver": {"kind": "foo", "bla": 3}})


def test_a_key_under_its_old_and_new_name_names_its_table():
    given = {"form": "galerkin", "strength": 1.0, "stabilisation": 1.0}
    twice = r"^\[discretization\]: stabilisation is given twice"
    with pytest.warns(RenamedWarning), pytest.raises(ck.SceneError, match=twice):
        read_options({"discretization": given})


def test_a_missing_scene(tmp_path):
    with pytest.raises(ck.SceneError, match="no scene file"):
        ck.load_scene(tmp_path / "none.toml")


def test_every_error_of_a_scene_file_names_it(tmp_path):
    text = GOOD.replace("right = { neumann = 0 }", "right = { neumann = 0, order = 7 }")
    with pytest.raises(ck.InputError, match=r"^scene.toml: order of .* must be"):
        ck.load_scene(written(tmp_path, text))
