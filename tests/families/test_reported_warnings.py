"""What a solution warns of reaches whoever asked for it: once, by one category, and last of all on the command line."""

import json
import warnings
from pathlib import Path

import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit import cli
from cpmkit.runtime.messages import collected_warnings, warn_each

#: Nothing flows out of a circle, so a right-hand side of mean 1 has no solution.
CIRCLE = '[surface]\nkind = "analytic.circle"\n[problem]\nkind = "poisson"\nf = 1.0\n[discretization]\nspacing = 0.1\n'
SAID = "do not balance"


def unbalanced():
    return ck.Scene(ck.source("analytic.circle"), ck.Poisson(1.0))


def reported_by(work):
    """Return what Python shows in ``work``, by a fresh set of filters."""
    with warnings.catch_warnings(record=True) as shown:
        warnings.resetwarnings()
        warnings.simplefilter("default")
        work()
    return shown


def test_a_solve_warns_of_what_its_solution_says_in_the_name_of_its_caller():
    shown = reported_by(lambda: ck.solve(unbalanced(), 0.1))
    assert [str(one.message) for one in shown] == [*ck.solve(unbalanced(), 0.1).warnings]
    assert SAID in str(shown[0].message)
    assert {(one.category, one.filename) for one in shown} == {(ck.CpmkitWarning, __file__)}


def test_a_solve_without_warnings_is_silent():
    assert reported_by(lambda: ck.solve(ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0)), 0.1)) == []


def test_they_can_be_made_errors_or_nothing_by_their_category():
    with warnings.catch_warnings():
        warnings.simplefilter("error", ck.CpmkitWarning)
        with pytest.raises(ck.CpmkitWarning, match=SAID):
            ck.solve(unbalanced(), 0.1)

    def silenced():
        warnings.simplefilter("ignore", ck.CpmkitWarning)
        ck.solve(unbalanced(), 0.1)

    assert reported_by(silenced) == []


def test_an_estimate_warns_once_though_it_solves_twice():
    shown = reported_by(lambda: ck.estimate_error(unbalanced(), 0.1))
    assert len(shown) == 1
    assert shown[0].filename == __file__


def test_each_sentence_is_reported_once_and_cannot_steer_a_terminal():
    shown = reported_by(lambda: warn_each(["a", "b\x1b[2J", "a"], stacklevel=1))
    assert [str(one.message) for one in shown] == ["a", "b\\x1b[2J"]


def test_only_those_of_cpmkit_are_overheard():
    def work():
        with collected_warnings() as heard:
            warn_each(["a", "a", "b"])
            warnings.warn("of another library", RuntimeWarning, stacklevel=1)
        assert heard == ["a", "b"]

    assert [str(one.message) for one in reported_by(work)] == ["of another library"]


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("circle.toml").write_text(CIRCLE)
    return lambda *arguments: CliRunner().invoke(cli.main, arguments)


def test_the_command_reports_them_last_and_once(run):
    result = run("solve", "circle.toml")
    assert result.exit_code == 0
    *_, written, warning = result.stdout.splitlines()
    assert written.startswith("written    ")
    assert warning.startswith("warning    ")
    assert SAID in warning
    assert (result.stdout + result.stderr).count(SAID) == 1


def test_with_json_they_are_in_the_summary_alone(run):
    result = run("solve", "circle.toml", "--json")
    assert SAID in json.loads(result.stdout)["warnings"][0]
    assert result.stderr == ""


def test_with_quiet_they_go_to_standard_error(run):
    result = run("solve", "circle.toml", "--quiet")
    assert (result.exit_code, result.stdout) == (0, "")
    assert result.stderr.startswith("warning    ")
    assert SAID in result.stderr
    assert result.stderr.count("\n") == 1


def test_what_is_reported_while_a_scene_is_read_is_reported_too(run, monkeypatch):
    load = ck.load_scene

    def load_scene(path):
        warnings.warn("A triangle is dropped.", ck.CpmkitWarning, stacklevel=1)
        return load(path)

    monkeypatch.setattr(ck, "load_scene", load_scene)
    assert "warning    A triangle is dropped.\n" in run("solve", "circle.toml").stdout
    assert "A triangle is dropped." in json.loads(Path("circle/summary.json").read_text())["warnings"]
    assert run("explain", "circle.toml").stdout.endswith("warning    A triangle is dropped.\n")
    result = run("explain", "circle.toml", "--json")
    assert json.loads(result.stdout)["unknowns"] > 50
    assert result.stderr == "warning    A triangle is dropped.\n"


def test_they_are_reported_where_a_solve_fails_after_them(run, monkeypatch):
    def solve(scene, **options):
        warnings.warn("A triangle is dropped.", ck.CpmkitWarning, stacklevel=1)
        raise ck.ResolutionError("The spacing is too coarse.")

    monkeypatch.setattr(ck, "solve", solve)
    result = run("solve", "circle.toml")
    assert result.stderr == "warning    A triangle is dropped.\nError: The spacing is too coarse.\n"
