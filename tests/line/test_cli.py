"""The command line: what it prints and writes, its exit codes, and that a failure leaves nothing behind."""

import io
import json
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit
from cpmkit import cli
from cpmkit.errors import SceneError
from cpmkit.runtime.progress import ProgressLine
from cpmkit.scenefile.look import OutputRequest, PictureRequest


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that runs `cpmkit` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text("")
    return lambda *arguments: CliRunner().invoke(cli.main, arguments)


@pytest.fixture
def solved(square, monkeypatch):
    """Let every scene file hold the square; return a dict that records what `solve` was asked, and takes changes."""
    target = {"error": None, "files": ("u.npz", "summary.json"), "picture": PictureRequest(width=64), "warnings": ()}

    def load_scene(path):
        request = OutputRequest(Path("results"), target["files"], target["picture"])
        return SimpleNamespace(scene=square(4).scene, spacing=0.5, options={"degree": 2}, output=request)

    def solve(scene, spacing, progress, **options):
        target.update(spacing=spacing, options=options)
        if target["error"]:
            raise target["error"]
        progress("solve", 1.0)
        solution = square(4, line=([1, 0], 0.4))
        object.__setattr__(solution, "warnings", target["warnings"])
        return solution

    monkeypatch.setattr(cpmkit, "load_scene", load_scene, raising=False)
    monkeypatch.setattr(cpmkit, "solve", solve, raising=False)
    return target


def names(folder):
    return sorted(found.name for found in Path(folder).iterdir())


def test_solve_writes_what_the_scene_asks_for_and_says_so(run, solved):
    solved["warnings"] = ("The edge is rough.",)
    result = run("solve", "scene.toml")
    assert result.exit_code == 0, result.output
    assert names("results") == ["picture.png", "summary.json", "u.npz"]
    assert (solved["spacing"], solved["options"]) == (0.5, {"degree": 2})
    for said in ("12,345", "of which ghosts 67", "relative residual 1e-12", "build 1.2", "The edge is rough."):
        assert said in result.stdout
    assert f"{Path('results', 'picture.png')} (the plane from above)" in result.stdout


def test_the_summary_says_what_the_picture_shows(run, solved):
    run("solve", "scene.toml", "--quiet")
    summary = json.loads(Path("results/summary.json").read_text())
    assert summary["picture"] == {"file": "picture.png", "camera": "the plane from above"}
    assert set(summary["seconds"]) == {"build", "solve", "write", "picture"}
    assert summary["files"] == ["u.npz", "summary.json"]


def test_json_is_alone_on_standard_output(run, solved):
    result = run("solve", "scene.toml", "--json")
    assert json.loads(result.stdout) == json.loads(Path("results/summary.json").read_text())


def test_quiet_says_nothing(run, solved):
    result = run("solve", "scene.toml", "--quiet")
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", "")


def test_the_command_line_overrides_the_file(run, solved):
    run("solve", "scene.toml", "--spacing", "0.25", "--output", "deep/elsewhere")
    assert solved["spacing"] == 0.25
    assert names("deep/elsewhere") == ["picture.png", "summary.json", "u.npz"]
    assert not Path("results").exists()


def test_a_scene_that_fails_is_one_line_and_leaves_nothing(run, solved):
    solved["error"] = SceneError("The scene is wrong; mend it.")
    result = run("solve", "scene.toml")
    assert (result.exit_code, result.stdout, result.stderr) == (1, "", "Error: The scene is wrong; mend it.\n")
    assert names(".") == ["scene.toml"]


def test_what_cannot_be_written_is_refused_before_solving(run, solved):
    solved["files"] = ("u.ply",)
    solved["error"] = AssertionError("it was solved")
    object.__setattr__(solved["picture"], "file", "picture.jpg")
    result = run("solve", "scene.toml")
    assert result.exit_code == 1
    assert "picture.jpg" in result.stderr


def test_a_folder_that_cannot_be_made_is_one_line(run, solved):
    Path("results").write_text("a file")
    result = run("solve", "scene.toml")
    assert result.exit_code == 1
    assert result.stderr == f"Error: The folder results cannot be made: {Path('results').absolute()} is a file.\n"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["solve"], "Missing argument 'SCENE.toml'"),
        (["solve", "absent.toml"], "'absent.toml' does not exist"),
        (["solve", "scene.toml", "--spacing", "-1"], "-1.0 is not in the range x>0"),
        (["solve", "scene.toml", "--spacing", "nan"], "nan is not a finite number"),
        (["explain", "scene.toml", "--spacing", "inf"], "inf is not a finite number"),
        (["slove", "scene.toml"], "No such command 'slove'"),
    ],
)
def test_a_wrong_command_line_exits_with_2(run, arguments, said):
    result = run(*arguments)
    assert result.exit_code == 2
    assert said in result.stderr


@pytest.mark.parametrize("command", [[], ["solve"], ["explain"], ["plugins"], ["doctor"]])
def test_every_command_explains_itself(run, command):
    result = run(*command, "--help")
    assert result.exit_code == 0
    assert "..." not in result.stdout.replace("[ARGS]...", "")  # no sentence is cut off
    assert "Usage:" in result.stdout


def test_explain_prints_for_people_and_for_programs(run, solved, monkeypatch):
    class Explanation:
        def as_dict(self):
            return {"unknowns": 7}

        def __str__(self):
            return "seven unknowns"

    monkeypatch.setattr(cpmkit, "explain", lambda scene, spacing, **options: Explanation(), raising=False)
    assert run("explain", "scene.toml").stdout == "seven unknowns\n"
    assert json.loads(run("explain", "scene.toml", "--json").stdout) == {"unknowns": 7}


def test_python_runs_the_package_as_the_command():
    done = subprocess.run([sys.executable, "-m", "cpmkit", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("cpmkit, version ")


def test_plugins_lists_kinds_with_their_distributions(run):
    assert "analytic.circle" in run("plugins").stdout
    listed = json.loads(run("plugins", "--json").stdout)
    assert {"kind", "distribution", "version", "module"} == set(listed[0])


@pytest.fixture
def plugged(monkeypatch):
    """Offer the commands `greet`, `broken` and `number` as plugins do."""
    points = [
        EntryPoint("greet", f"{__name__}_commands:greet", "cpmkit.commands"),
        EntryPoint("broken", "cpmkit_absent:command", "cpmkit.commands"),
        EntryPoint("number", "math:pi", "cpmkit.commands"),
    ]
    monkeypatch.setattr("cpmkit.commands.group.entry_points", lambda group: points)
    greet = click.Command("greet", callback=lambda: click.echo("good day"))
    monkeypatch.setitem(__import__("sys").modules, f"{__name__}_commands", SimpleNamespace(greet=greet))


def test_commands_of_plugins_are_listed_without_import_and_run(run, plugged):
    listed = run("--help")
    assert listed.exit_code == 0
    assert "from cpmkit_absent:command" in listed.stdout
    assert run("greet").stdout == "good day\n"


def test_a_broken_plugin_command_is_one_line(run, plugged):
    result = run("broken")
    assert result.exit_code == 1
    assert result.stderr.startswith(
        "Error: The command 'broken' (from cpmkit_absent:command) does not import: No module"
    )
    assert "is 3.14" in run("number").stderr


class Terminal(io.StringIO):
    def isatty(self):
        return True


def stages(stream):
    """Report a stage of 3 s and one of 0.2 s to a progress line on ``stream``."""
    times = iter([0.0, 0.0, 1.5, 3.0, 3.0, 3.1, 3.2, 3.2, 3.2, 3.2, 3.2])
    with ProgressLine(stream, lambda: next(times)) as progress:
        progress("band", 0.0)
        progress("band", 0.5)
        progress("band", 1.0)
        progress("solve", 0.5)
        progress("solve", 1.0)
    return stream.getvalue()


def test_off_a_terminal_a_long_stage_is_one_plain_line():
    assert stages(io.StringIO()) == "band         3.0 s\n"


def test_on_a_terminal_the_bar_moves_and_long_stages_stay():
    shown = stages(Terminal())
    assert "###############...............]  50%" in shown
    assert shown.replace("\r", "\n").count("band         3.0 s\n") == 1
    assert "solve        0." not in shown
    assert shown.endswith("\r\x1b[K")


CIRCLE = """
[surface]
kind = "analytic.circle"
center = [0, 0]
radius = 1

[[boundary]]
name = "east"
kind = "analytic.point"
at = [1, 0]
both = { dirichlet = 0 }

[[boundary]]
name = "west"
kind = "analytic.point"
at = [-1, 0]
left = { dirichlet = 1 }
right = { dirichlet = 2 }

[problem]
kind = "laplace"

[discretization]
spacing = 0.1

[output]
folder = "circle"
files = ["u.npz", "u.vtp", "summary.json"]
picture = { file = "circle.png", width = 64 }
"""


def test_a_real_scene_is_solved_from_file_to_files(run):
    Path("scene.toml").write_text(CIRCLE)
    result = run("solve", "scene.toml", "--json")
    assert result.exit_code == 0, result.stderr
    assert names("circle") == ["circle.png", "summary.json", "u.npz", "u.vtp"]
    assert json.loads(result.stdout)["report"]["converged"]
    with np.load("circle/u.npz") as saved:
        x, y = saved["points"].T
        u = saved["values"][:, 0]
    # u is linear in the angle on either half circle: up to 1 where the circle comes from, to 2 where it goes.
    angle = np.abs(np.arctan2(y, x)) / np.pi
    at_west = (x < 0) & (np.abs(y) < 1e-3)
    np.testing.assert_allclose(u[~at_west], (angle * np.where(y > 0, 1, 2))[~at_west], atol=0.02)
    np.testing.assert_allclose(np.sort(u[at_west]), [1, 2], atol=1e-3)


def test_a_real_scene_is_explained(run):
    Path("scene.toml").write_text(CIRCLE)
    told = json.loads(run("explain", "scene.toml", "--json").stdout)
    assert told["unknowns"] > 50
    assert "dry_run=True (--dry-run)" in run("explain", "scene.toml").stdout
    rehearsed = run("explain", "scene.toml", "--dry-run").stdout
    assert "samples" in rehearsed
    assert "--dry-run" not in rehearsed


def test_a_real_scene_with_a_wrong_key_is_one_line(run):
    Path("scene.toml").write_text(CIRCLE.replace("radius", "radios"))
    result = run("solve", "scene.toml")
    assert result.exit_code == 1
    assert result.stderr.startswith("Error: ")
    assert "'radios'" in result.stderr
    assert result.stderr.count("\n") == 1
