"""Modes of the Galerkin form are saved, read back, foreseen, and found on prepared tables."""

import numpy as np
import pytest
from model_problems import sphere_points

import cpmkit as ck

SCENE = ck.Scene(ck.source("analytic.sphere"), ck.Eigen(4))


def test_it_is_the_form_that_auto_takes():
    solution = ck.solve(SCENE, 0.25)
    assert solution.discretized.form == "galerkin"
    assert solution.summary()["discretization"]["form_reason"] == "the default"
    assert "form 'galerkin': the default" in str(ck.explain(SCENE, 0.25, dry_run=True))


def test_modes_that_are_saved_are_read_back_to_the_last_bit(tmp_path):
    solution = ck.solve(SCENE, 0.25)
    solution.save(tmp_path / "modes.npz")
    again = ck.load(tmp_path / "modes.npz", SCENE)
    assert np.array_equal(again.evaluate(sphere_points(50)), solution.evaluate(sphere_points(50)))
    assert np.array_equal(ck.load(tmp_path / "modes.npz").arrays["lattice_eigenvalues"], solution.eigenvalues)


def test_they_are_found_on_prepared_tables():
    prepared = ck.prepare(ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson(1.0)), 0.25, solver="direct")
    modes = prepared.solve(problem=SCENE.problem)
    assert np.array_equal(modes.eigenvalues, ck.solve(SCENE, 0.25, solver="direct").eigenvalues)


@pytest.mark.parametrize(("count", "near", "solver"), [(6, None, "multigrid"), (6, 6.0, "direct")])
def test_explain_foresees_the_solver(count, near, solver):
    scene = ck.Scene(ck.source("analytic.sphere"), ck.Eigen(count, near=near))
    assert ck.explain(scene, 0.06, dry_run=True).solver == solver
