"""A piece on which nothing is given has zero for its solution, and a sentence says so, with its place."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit import cli

SPHERE = ck.source("analytic.sphere")
EQUATOR = ck.source("analytic.circle", normal=[0, 0, 1])
SAID = "Nothing is given on the piece of the manifold near ("
FORMS = ("galerkin", "collocation")


def messages(solution):
    return [sentence for sentence in solution.warnings if sentence.startswith(SAID)]


@pytest.mark.parametrize("form", FORMS)
def test_a_surface_without_conditions(form):
    solution = ck.solve(ck.Scene(SPHERE, ck.Laplace()), 0.4, form=form)
    assert np.abs(solution.values).max() == 0
    assert len(messages(solution)) == 1
    assert "100% of the nodes" in messages(solution)[0]


@pytest.mark.parametrize("form", FORMS)
def test_the_piece_that_sees_no_value_is_named(form):
    half = [ck.Boundary("equator", EQUATOR, left=ck.Dirichlet(2.0), right=ck.Neumann(0.0))]
    solution = ck.solve(ck.Scene(SPHERE, ck.Laplace(), half), 0.3, form=form)
    assert len(messages(solution)) == 1
    near = [float(x) for x in messages(solution)[0].removeprefix(SAID).partition(")")[0].split(",")]
    assert near[2] < 0
    assert solution.evaluate([[0, 0, -1], [0, 0, 1]]) == pytest.approx([0, 2], abs=1e-6)


@pytest.mark.parametrize("form", FORMS)
def test_what_is_given_says_nothing(form):
    walls = [ck.Boundary("equator", EQUATOR, left=ck.Dirichlet(0.0), right=ck.Dirichlet(0.0))]
    fluxes = [ck.Boundary("equator", EQUATOR, left=ck.Neumann(lambda x: x[:, 0]), right=ck.Neumann(lambda x: x[:, 1]))]
    for scene in (
        ck.Scene(SPHERE, ck.Laplace(), walls),
        ck.Scene(SPHERE, ck.Laplace(), fluxes),
        ck.Scene(SPHERE, ck.Poisson(lambda x: x[:, 0])),
        ck.Scene(SPHERE, ck.Poisson([lambda x: x[:, 0], 0.0])),  # one channel of it
        ck.Scene(SPHERE, ck.ScreenedPoisson(0.0)),
    ):
        assert messages(ck.solve(scene, 0.4, form=form)) == []


def test_the_command_reports_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("free.toml").write_text(
        '[surface]\nkind = "analytic.circle"\n[problem]\nkind = "laplace"\n[discretization]\nspacing = 0.2\n'
    )
    done = CliRunner().invoke(cli.main, ["solve", "free.toml"])
    assert done.exit_code == 0
    assert f"warning    {SAID}" in done.stdout
    assert json.loads(Path("free/summary.json").read_text())["warnings"][0].startswith(SAID)
