"""What a study is given is checked first: its tables, its bounds, the files that its scene names, and its records."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.errors import InputError, PluginError, SceneError
from cpmkit.studies.records import append_record, group_into_series, read_records
from cpmkit.studies.reference_values import compute_reference
from cpmkit.studies.report import write_report
from cpmkit.studies.run_one import measure_run, run_study
from cpmkit.studies.studyfile import load_study
from cpmkit.studies.sweep import Sweep

TEXT = """
[surface]
kind = "analytic.circle"

[[boundary]]
name = "cut"
kind = "analytic.point"
at = [0.6, 0.8]
both = { dirichlet = "x + y" }

[problem]
kind = "screened"
f = "2*(x + y)"

[exact]
u = "x + y"
points = 50

[sweep]
spacings = [0.2, 0.1]
"""

#: A line with data at its vertices, in as many places as a scene has.
LINE = """
[surface]
kind = "mesh.polyline"
file = "line.npy"
edge = { 0 = { dirichlet = { values = "ends.npy" } }, 1 = { neumann = 0.0 } }

[[boundary]]
kind = "points"
of = [{ kind = "mesh.polyline", file = "inner.npy" }, { kind = "analytic.point", at = [0.7, 0.0] }]
both = { dirichlet = [{ values = "cut.npy", of = "surface" }] }

[problem]
kind = "screened"
f = [{ values = "source.npy" }]

[let]
source = "y"

[exact]
u = "x"

[sweep]
spacings = [0.2]
"""
FILES = ("line.npy", "ends.npy", "inner.npy", "cut.npy", "source.npy")


def study(folder, text=TEXT):
    (folder / "study.toml").write_text(text)
    return load_study(folder / "study.toml")


@pytest.mark.parametrize("changed", FILES)
@pytest.mark.parametrize("beside", [True, False])
def test_a_file_that_a_scene_names_under_any_key_is_part_of_what_a_record_belongs_to(
    changed, beside, tmp_path, monkeypatch
):
    data = tmp_path if beside else tmp_path / "data"
    data.mkdir(exist_ok=True)
    monkeypatch.setenv("CPMKIT_DATA", str(data))
    for file in FILES:
        np.save(data / file, np.zeros((3, 2)))
    before = study(tmp_path, LINE).content
    assert study(tmp_path, LINE).content == before
    np.save(data / changed, np.ones((3, 2)))
    assert study(tmp_path, LINE).content != before


def test_a_file_under_a_key_of_a_plugin_of_ones_own_counts_too(tmp_path):
    text = TEXT.replace('kind = "analytic.circle"', 'kind = "mine.own"\nweights = ["net.bin", { more = "net.txt" }]')
    before = study(tmp_path, text).content
    for name in ("net.bin", "net.txt"):
        (tmp_path / name).write_bytes(b"1")
        assert study(tmp_path, text).content != before
        (tmp_path / name).unlink()
    assert study(tmp_path, text).content == before


def test_a_study_with_new_vertex_data_is_run_again(tmp_path):
    np.save(tmp_path / "line.npy", [[0, 0], [1.0, 0]])
    text = f"""
[surface]
kind = "mesh.polyline"
file = "line.npy"
edge = {{ dirichlet = {{ values = "ends.npy" }} }}
[problem]
kind = "laplace"
{TEXT[TEXT.index("[exact]") :].replace("x + y", "x")}"""
    np.save(tmp_path / "ends.npy", [0.0, 1.0])
    assert run_study(study(tmp_path, text), tmp_path).made == 2
    assert run_study(study(tmp_path, text), tmp_path).made == 0
    np.save(tmp_path / "ends.npy", [0.0, 2.0])
    assert run_study(study(tmp_path, text), tmp_path).made == 2
    errors = [record["max_error"] for record in read_records(tmp_path / "records.jsonl")]
    assert max(errors[:2]) < 1e-6 < 0.9 < min(errors[2:])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[exact]", "discretization = 3\n[exact]", r"\[discretization\] must be a table, got 3"),
        ("[exact]", "solver = [1]\n[exact]", r"\[solver\] must be a table, got \[1\]"),
        ("[exact]", "let = [1]\n[exact]", r"\[let\] must be a table, got \[1\]"),
        ("[exact]", "title = 3\n[exact]", "title must be text of at most 300 characters, got 3"),
        ("points = 50", "points = 10000000000", "at most 1000000 points are accepted"),
        ("points = 50", "points = true", "points of .exact. must be a whole number or text, got True"),
        (
            "[0.2, 0.1]",
            "[0.2, 0.1]\norigins = 1000000000",
            "origins of .sweep. must be .* 10000 at most, got 1000000000",
        ),
        ("[0.2, 0.1]", "[0.2, 0.1]\norigins = true", "origins of .sweep. must be a whole number"),
        ("[0.2, 0.1]", "[0.2, 0.1]\norigins = 10000\ndegrees = [2, 3, 4]\norders = [1, 2]", "makes 120000 runs"),
        ("[0.2, 0.1]", "[0.2, 0.1]\norders = [4]", "orders of .sweep. must be 1 or 2, got 4; use form=.galerkin."),
        (
            "[0.2, 0.1]",
            "[0.2, 0.1]\nmethods = ['balanced']",
            "no method 'balanced' of .sweep. any more; use 'galerkin'",
        ),
        ("[0.2, 0.1]", "[0.2, 0.1]\ndegrees = [true]", "degrees of .sweep. must be one of 2, 3, 4, 5, got True"),
        ("[0.2, 0.1]", "[0.2, 0.1]\nstep_per_spacing = true", "step_per_spacing of .sweep. must be a number, got True"),
        ("[0.2, 0.1]", '["0.1"]', "each spacing of .sweep. must be a finite number above zero, got '0.1'"),
        ("[0.2, 0.1]", "[true]", "each spacing of .sweep. must be a finite number above zero, got True"),
        ("[0.2, 0.1]", f"[1{'0' * 400}]", "an entry of the key 'spacings' is a whole number beyond"),
    ],
)
def test_a_table_of_another_type_or_beyond_all_bounds_is_refused(old, new, message, tmp_path):
    text = TEXT.replace(old, new)
    if new.startswith(("discretization", "solver", "let", "title")):
        text = new.split("\n")[0] + TEXT
    with pytest.raises(SceneError, match=message) as caught:
        study(tmp_path, text)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ('f = "2*(x + y)"', 'f = ["x", "y"]', SceneError, "compares one channel, and the scene has 2"),
        ('kind = "screened"\nf = "2*(x + y)"', 'kind = "eigen"', SceneError, "an eigenvalue problem has many"),
        ('u = "x + y"', 'u = "x + t"', SceneError, "depends on t, and the problem 'screened' has no time"),
        ('u = "x + y"', 'reference = "unheard"', PluginError, "No plugin provides the kind 'unheard'"),
        (
            "[0.2, 0.1]",
            '[0.2, 0.1]\nmethods = ["cpm", "unheard"]',
            PluginError,
            "No plugin provides the kind 'unheard'",
        ),
        ("[0.2, 0.1]", "[0.2, 0.1]\nstep_per_spacing = 0.1", SceneError, "step_per_spacing of .sweep. is for problems"),
        (
            'both = { dirichlet = "x + y" }',
            "both = { neumann = 0.0 }\n#",
            SceneError,
            "the method 'ball' holds one Dirichlet condition",
        ),
    ],
)
def test_what_no_run_could_be_made_with_is_refused_before_anything_is_solved(
    old, new, error, message, tmp_path, monkeypatch
):
    text = TEXT.replace(old, new)
    text = text.replace(
        'at = [0.6, 0.8]\nboth = { dirichlet = "x + y" }', "at = [0.6, 0.8]\nboth = { dirichlet = 0.0 }"
    )
    if "ball" in message:
        text += 'methods = ["cpm", "ball"]\n'
    for name in ("run_one.solve", "reference_values.compute_reference"):
        monkeypatch.setattr(f"cpmkit.studies.{name}", lambda *_, **__: pytest.fail("it was solved"))
    with pytest.raises(error, match=message):
        run_study(study(tmp_path, text), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_study_that_fails_at_once_leaves_no_folder(tmp_path):
    with pytest.raises(InputError, match=r"u of .exact. must be finite"):
        run_study(study(tmp_path, TEXT.replace('u = "x + y"', 'u = "log(x - 9)"')), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_no_run_is_made_twice():
    sweep = Sweep({"degree": [3, 3]}, [0.2, 0.2, 0.1], methods=["cpm", "cpm"])
    assert len(sweep.runs()) == 2


def test_a_billion_frames_are_refused():
    for frames in (10**9, np.linspace(0.1, 0.9, 100_001).tolist(), ["0.1"], [True], "0.1", 3.0, [10**400]):
        with pytest.raises(InputError, match=r"frames of heat must be a number of equal parts .* at most 100000"):
            ck.Heat(1.0, until=1.0, step=0.1, frames=frames)
    assert len(ck.Heat(1.0, until=1.0, step=0.1, frames=np.int64(3)).frame_times) == 4


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return the folder of a study that was run."""
    folder = tmp_path_factory.mktemp("study")
    run_study(study(folder), folder)
    return folder


@pytest.fixture
def folder(made, tmp_path):
    return shutil.copytree(made, tmp_path / "copy")


WRONG = [
    ({"max_error": None}, "max_error of line 2 of .* must be a finite number of at least 0 .*, got None"),
    ({"max_error": float("nan")}, "max_error of line 2 of .* got nan"),
    ({"max_error": "0.1"}, "max_error of line 2 of .* got '0.1'"),
    ({"max_error": True}, "max_error of line 2"),
    ({"max_error": -1.0}, "max_error of line 2"),
    ({"max_error": 10**400}, "max_error of line 2"),
    ({"rms_error": [1.0]}, "rms_error of line 2"),
    ({"content": ...}, "line 2 of .* lacks 'content', which must be text"),
    ({"content": 3}, "content of line 2"),
    ({"title": {}}, "title of line 2"),
    ({"method": ["cpm"]}, r"method of line 2 of .* must be text, got \['cpm'\]"),
    ({"method": ...}, "lacks 'method'"),
    ({"spacing": 0}, "spacing of line 2"),
    ({"spacing": 1e300}, "spacing of line 2"),
    ({"degree": [3]}, "degree of line 2"),
    ({"order": 2.5}, "order of line 2"),
    ({"origin": "a"}, "origin of line 2"),
    ({"unknowns": 0}, "unknowns of line 2"),
    ({"twins": "none"}, "twins of line 2"),
    ({"imbalances": [{}]}, "imbalances of line 2"),
    ({"imbalances": 3}, "imbalances of line 2"),
    ({"half_range": None}, "half_range of line 2"),
    ({"error": None}, "error of line 2"),
]


@pytest.mark.parametrize("number", range(len(WRONG)))
def test_a_record_that_is_none_is_refused_with_its_line(number, folder):
    changes, message = WRONG[number]
    lines = (folder / "records.jsonl").read_text().splitlines()
    record = {key: value for key, value in (json.loads(lines[1]) | changes).items() if value is not ...}
    (folder / "records.jsonl").write_text(f"{lines[0]}\n{json.dumps(record)}\n")
    for use in (lambda: write_report(folder), lambda: run_study(load_study(folder / "study.toml"), folder)):
        with pytest.raises(InputError, match=f"{message}.*; remove that line, its run is made again"):
            use()


@pytest.mark.parametrize("line", ["3", "[]", "null", "{", "[" * 100_000, "\ud800"])
def test_a_line_that_is_no_record_is_refused(line, folder):
    with (folder / "records.jsonl").open("ab") as file:
        file.write(line.encode(errors="surrogatepass") + b"\n")
    with pytest.raises(InputError, match=r"line 3 of .* is not a JSON object"):
        read_records(folder / "records.jsonl")


def test_records_that_cannot_be_written_or_read_are_reported(tmp_path):
    with pytest.raises(InputError, match="cannot be written: No such file or directory"):
        append_record(tmp_path / "nowhere" / "records.jsonl", {})
    (tmp_path / "records.jsonl").mkdir()
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        read_records(tmp_path / "records.jsonl")


def test_a_solution_beyond_all_use_is_recorded_as_an_error(tmp_path):
    one = study(tmp_path)
    truth = compute_reference(one)
    truth = replace(truth, values=np.full_like(truth.values, 1e300))
    record = measure_run(one, one.sweep.runs()[0], truth)
    assert record["error"].startswith("ResolutionError: the error 1e+300 of the solution")


def record(method="cpm", spacing=0.1, error=0.1, **changes):
    plain = {"title": "A $1 study of $2 | bars", "content": "c", "method": method, "spacing": spacing, "degree": 3}
    costs = {"order": 2, "origin": None, "unknowns": 10, "iterations": 1, "cpu_seconds": 1.0, "reference": None}
    return {**plain, **costs, "max_error": error, "rms_error": error, **changes}


def test_titles_with_dollars_and_escapes_are_drawn_and_written_as_they_are(tmp_path):
    append_record(tmp_path / "records.jsonl", record(title="$x^ is not mathematics \x1b[31m", method="$\\frac"))
    append_record(tmp_path / "records.jsonl", record(title="$x^", method="cpm", error=0.2))
    done = CliRunner().invoke(main, ["study", "report", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "\x1b" not in done.output + (tmp_path / "report.md").read_text()


@pytest.mark.parametrize("reference", [None, "fem"])
def test_errors_of_zero_and_constants_make_a_report(reference, tmp_path):
    values = {"reference": reference, "half_range": 0.0, "rms_without_mean": 0.0, "twins": None, "imbalances": []}
    for more in (0.0, 0.1):
        for method in ("cpm", "ball"):  # two methods have a figure of their work as well
            append_record(tmp_path / "records.jsonl", record(method, 0.1 + more, 0.0, **values))
    report = write_report(tmp_path)
    assert len(report.files) > 1  # a table and figures
    assert all(file.is_file() for file in report.files)
    series = group_into_series(read_records(tmp_path / "records.jsonl"))
    assert series[0].fitted_order is None


def test_two_spacings_that_are_one_have_no_order():
    series = group_into_series([record(spacing=0.1), record(spacing=0.1 * (1 + 1e-15), error=0.2)])
    assert series[0].fitted_order is None
