"""What a newcomer asks for: which kinds there are and what they take, a schema, a first scene, the examples."""

import json
import tomllib
import zipfile
from importlib.metadata import entry_points
from pathlib import Path

import jsonschema
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.scenefile.application_files import load_application

ROOT = Path(__file__).parents[2]
SCENE = {"surface": {"kind": "analytic.sphere"}, "problem": {"kind": "poisson", "f": "x*y"}}


def run(*arguments):
    return CliRunner().invoke(main, [str(one) for one in arguments])


def schema(name):
    return json.loads(run("schema", name).output)


def test_every_kind_has_a_sentence_for_itself_and_each_key():
    kinds = ck.kinds()
    installed = {point.name for point in entry_points(group="cpmkit.kinds")}
    assert {kind.name for kind in kinds} >= installed | {"heat", "poisson", "dirichlet"}
    summaries = {(kind.name, key.name): key.summary for kind in kinds for key in kind.keys}
    summaries |= {(kind.name, ""): kind.summary for kind in kinds}
    assert [name for name, summary in summaries.items() if not summary] == []
    marked = [name for name, summary in summaries.items() if "`~" in summary or ":class:" in summary]
    assert marked == []  # no markup of docstrings


def test_keys_are_those_of_the_factory():
    (torus,) = ck.kinds("analytic.torus")
    assert (torus.sort, torus.distribution) == ("source", "cpmkit-analytic")
    assert {key.name: key.default for key in torus.keys}["minor"] == 0.4
    (heat,) = ck.kinds("heat")
    assert [key.name for key in heat.keys if key.needed] == ["initial", "until", "step"]
    assert {one.name.partition(".")[0] for one in ck.kinds("levelset")} == {"levelset"}
    with pytest.raises(ck.PluginError, match=r"no kind 'analytic.tours' .did you mean 'analytic.torus'"):
        ck.kinds("analytic.tours")


def test_the_command_describes_a_kind():
    assert "minor (number, default 0.4): Radius of the tube" in run("plugins", "analytic.torus").output
    assert json.loads(run("plugins", "wave", "--json").output)[0]["sort"] == "equation"
    done = run("plugins", "waev")
    assert done.exit_code == 1
    assert "did you mean 'wave'" in done.output


@pytest.mark.parametrize(("name", "folder"), [("scene", "."), ("study", "studies")])
def test_the_schema_accepts_every_example(name, folder):
    made = schema(name)
    jsonschema.Draft7Validator.check_schema(made)
    validator = jsonschema.Draft7Validator(made)
    files = sorted((ROOT / "examples" / folder).glob("*.toml"))
    assert len(files) > 5
    for file in files:
        assert list(validator.iter_errors(tomllib.loads(file.read_text()))) == [], file.name


@pytest.mark.parametrize("command", ["vectors", "map", "paint"])
def test_the_schemas_of_applications_accept_their_examples_and_nothing_else(command):
    validator = jsonschema.Draft7Validator(schema(command))
    files = sorted((ROOT / "examples" / "applications").glob("*.toml"))
    accepted = [file.name for file in files if validator.is_valid(tomllib.loads(file.read_text()))]
    assert accepted == [file.name for file in files if file.name.startswith(command)]


@pytest.mark.parametrize(
    "wrong",
    [
        {"surfaces": {}},
        {"surface": {"kind": "analytic.sphere", "radiuss": 1.0}},
        {"surface": {"kind": "analytic.nothing"}},
        {"surface": {"kind": "analytic.arc", "start": 0.0}},
        {"problem": {"kind": "heat", "initial": "x", "until": 1.0}},
        {"discretization": {"spacing": "fine"}},
        {"discretization": {"degre": 2}},
        {"boundary": [{"kind": "analytic.point", "at": [0, 0, 1], "both": {"dirichlett": 1.0}}]},
        {"output": {"picture": {"widht": 100}}},
    ],
)
def test_the_schema_refuses_what_the_reader_refuses(wrong, tmp_path):
    validator = jsonschema.Draft7Validator(schema("scene"))
    assert validator.is_valid(SCENE)
    assert not validator.is_valid({**SCENE, **wrong})


def test_a_first_scene_is_written_and_loads(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("new", "first").exit_code == 0
    loaded = ck.load_scene("first.toml")
    assert loaded.output.folder == Path("first")
    assert jsonschema.Draft7Validator(schema("scene")).is_valid(tomllib.loads(Path("first.toml").read_text()))
    assert ck.solve(loaded.scene, 3 * loaded.spacing).evaluate([1.4, 0, 0], side="both") == pytest.approx(
        [1, 1.4], abs=0.05
    )
    for name, message in (("first", "is there already"), ("first.json", "must be a .toml"), ('a"b', "without quotes")):
        done = run("new", name)
        assert done.exit_code == 1
        assert message in done.output


def test_examples_are_listed_and_copied(tmp_path):
    listed = run("examples").output
    assert "01-first-curves.toml" in listed
    assert "studies/degrees-heat.toml" in listed
    assert "applications/map-spot.toml" in listed
    assert run("examples", "--to", tmp_path / "all").exit_code == 0
    assert ck.load_scene(tmp_path / "all" / "05-square.toml").spacing
    assert load_application(tmp_path / "all" / "applications" / "map-dziuk.toml", "map").spacing
    assert len(list((tmp_path / "all" / "curves").iterdir())) == len(list((ROOT / "examples" / "curves").iterdir()))
    assert "is there already" in run("examples", "--to", tmp_path / "all").output


@pytest.mark.slow
def test_the_wheel_holds_the_examples(tmp_path):
    from hatchling.builders.wheel import WheelBuilder

    wheel = next(WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"]))
    names = zipfile.ZipFile(wheel).namelist()
    assert "cpmkit/examples/01-first-curves.toml" in names
    assert "cpmkit/examples/curves/spot-belly.npy" in names
