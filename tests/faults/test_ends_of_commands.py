"""However a command ends, one sentence says so, and the exit code says which of five ends it was."""

import os
from pathlib import Path
from types import SimpleNamespace

import click
import pytest
from click.testing import CliRunner

import cpmkit
from cpmkit import cli
from cpmkit.errors import SceneError
from cpmkit.scenefile.look import OutputRequest

SCENE = '[surface]\nkind = "analytic.circle"\n[problem]\nkind = "screened"\nf = 1.0\n[discretization]\nspacing = 0.2\n'


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that runs `cpmkit` in a folder that holds a scene."""
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    return lambda *arguments: CliRunner().invoke(cli.main, arguments)


@pytest.fixture
def failing(run, monkeypatch):
    """Return a function that runs `cpmkit solve` on a scene whose solution fails in its stage "band"."""

    def end(raised, *options, before=()):
        def solve(scene, spacing, progress, **how):
            progress("band", 0.5)
            raise raised

        monkeypatch.setattr(cpmkit, "solve", solve, raising=False)
        return run(*before, "solve", "scene.toml", *options)

    return end


def one_line(text, *parts):
    assert text.startswith("Error: ")
    assert text.count("\n") == 1, text
    for part in parts:
        assert part in text, text


DEFECTS = [ZeroDivisionError("a\x1b[2Jdefect"), EOFError(), RecursionError("deep"), KeyError(3)]
COMMANDS = [[], ["solve"], ["explain"], ["plugins"], ["doctor"], ["study", "run"], ["study", "report"]]


@pytest.mark.parametrize("raised", DEFECTS)
@pytest.mark.parametrize("quiet", [(), ("--quiet",)])
def test_a_defect_is_called_one_with_the_file_the_stage_and_the_way_to_its_traceback(failing, raised, quiet):
    result = failing(raised, *quiet)
    assert (result.exit_code, result.stdout) == (3, "")
    one_line(
        result.stderr,
        type(raised).__name__,
        "the stage 'band' of scene.toml",
        "a bug in cpmkit",
        "the option --traceback",
    )
    assert "\x1b" not in result.stderr


def test_an_end_of_file_is_no_interruption(failing):
    assert "Aborted" not in failing(EOFError()).stderr


@pytest.mark.parametrize(("before", "options"), [((), ("--traceback",)), (("--traceback",), ())])
@pytest.mark.parametrize(("raised", "code"), [(ZeroDivisionError("a defect"), 3), (SceneError("It is wrong."), 1)])
def test_the_traceback_is_shown_on_request(failing, before, options, raised, code):
    result = failing(raised, *options, before=before)
    assert result.exit_code == code
    assert result.stderr.startswith("Traceback (most recent call last):")
    assert "raise raised" in result.stderr
    assert result.stderr.splitlines()[-1].startswith("Error: ")


def test_memory_that_runs_out_is_no_defect(failing):
    result = failing(MemoryError())
    assert result.exit_code == 1
    one_line(result.stderr, "Memory ran out during the stage 'band' of scene.toml", "GiB", "a larger spacing")


def test_what_the_system_refuses_is_no_defect(failing):
    result = failing(OSError(28, os.strerror(28), "scratch"))
    assert result.exit_code == 1
    one_line(result.stderr, "the stage 'band' of scene.toml: No space left on device: 'scratch'.")


def test_a_standard_output_that_takes_nothing_belongs_to_no_stage(run, monkeypatch):
    def echo(text, err=False):
        if not err:
            raise OSError(28, os.strerror(28))

    monkeypatch.setattr(cli.click, "echo", echo)
    result = run("solve", "scene.toml")
    assert result.exit_code == 1
    assert Path("scene/summary.json").exists()
    assert result.stderr == "Error: The system refused for scene.toml: No space left on device.\n"


def test_an_interruption_is_one(failing):
    result = failing(KeyboardInterrupt())
    assert (result.exit_code, result.stdout) == (130, "")
    assert result.stderr == "\nInterrupted during the stage 'band' of scene.toml.\n"


def test_a_reader_that_is_gone_is_no_defect(failing):
    result = failing(BrokenPipeError(32, os.strerror(32)))
    assert (result.exit_code, result.stdout, result.stderr) == (1, "", "")


def test_exit_codes_of_click_stay(failing):
    assert failing(click.exceptions.Exit(5)).exit_code == 5
    assert failing(click.UsageError("wrong")).exit_code == 2


@pytest.mark.parametrize(("u", "tolerance"), [("log(-1 - x*x)", 1e-10), ("x", -1.0)])
def test_a_study_that_fails_at_once_leaves_no_folder(run, u, tolerance):
    Path("study.toml").write_text(
        'title = "A circle"\n[surface]\nkind = "analytic.circle"\n[problem]\nkind = "screened"\nf = "2*x"\n'
        f'[exact]\nu = "{u}"\n[sweep]\nspacings = [0.2]\n[solver]\ntolerance = {tolerance}\n'
    )
    result = run("study", "run", "study.toml", "--output", "records")
    assert result.exit_code == 1, result.output
    assert not Path("records").exists()


def test_a_defect_of_a_study_names_its_file(run, monkeypatch):
    def load(file):
        raise TypeError("a defect")

    monkeypatch.setattr("cpmkit.studies.studyfile.load_study", load)
    result = run("study", "run", "scene.toml")
    assert result.exit_code == 3
    one_line(result.stderr, "TypeError: 'a defect' during the stage 'read' of scene.toml")


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_offers_the_traceback(run, command):
    assert "--traceback" in run(*command, "--help").stdout


def test_the_help_lists_the_exit_codes(run):
    message = " ".join(run("--help").stdout.split())
    assert "0 done; 1 the scene or its solution failed; 2 the command line is wrong; 3 a bug" in message
    assert "130 interrupted" in message
    assert "are replaced" in " ".join(run("solve", "--help").stdout.split())


def test_results_that_are_lost_are_reported_with_those_that_are_there(run, square, monkeypatch):
    """The summary is printed and written, and the exit code says that something is amiss."""
    request = OutputRequest(Path("results"), ("u.npz", "summary.json"), None)
    loaded = SimpleNamespace(scene=square(3).scene, spacing=0.5, options={}, output=request)
    monkeypatch.setattr(cpmkit, "load_scene", lambda path: loaded, raising=False)
    monkeypatch.setattr(cpmkit, "solve", lambda scene, **how: square(3), raising=False)

    def fail(solution, path, *vertices, **options):
        raise SceneError(f"{path} cannot be written: No space left on device.")

    monkeypatch.setattr("cpmkit.saving.results.save", fail)
    result = run("solve", "scene.toml")
    assert result.exit_code == 1
    assert "results/summary.json" in result.stdout
    assert "u.npz" not in result.stdout
    assert result.stderr == (
        "Error: results/u.npz cannot be written: No space left on device; written into results were summary.json.\n"
    )
