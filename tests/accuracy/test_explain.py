"""What a solve will build and cost is said before it is built: unknowns to 10 percent, bytes to a factor of 2."""

import tracemalloc

import numpy as np
import pytest
from model_problems import circle_jump, rotation, sphere_poisson

import cpmkit as ck


def test_predictions_on_a_surface_with_curves(monkeypatch):
    monkeypatch.setattr("cpmkit.forms.collocation.collocation_cost.DRY_RUN_CELLS", 3_000)
    spacing = 0.04
    scene, _, _ = sphere_poisson([rotation()[:, 0], rotation()[:, 1]])
    explanation = ck.explain(scene, spacing, form="collocation", dry_run=True)
    assert not explanation.exact
    ck.solve(scene, 0.3, form="collocation")  # what is read for the first time is no table
    tracemalloc.start()
    solution = ck.solve(scene, spacing, solver_tolerance=1e-2, form="collocation")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert explanation.unknowns == pytest.approx(solution.work.unknowns, rel=0.1)
    assert explanation.closest_point_queries == pytest.approx(solution.work.closest_point_queries, rel=0.1)
    assert 0.5 <= explanation.bytes / peak <= 2
    assert explanation.solver == solution.report.solver


def test_predictions_for_a_direct_solve():
    scene, _, _ = circle_jump()
    explanation = ck.explain(scene, 0.002, form="collocation", dry_run=True)
    tracemalloc.start()
    solution = ck.solve(scene, 0.002, form="collocation")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert explanation.exact
    assert explanation.unknowns == solution.work.unknowns
    assert explanation.closest_point_queries == solution.work.closest_point_queries
    assert 0.5 <= explanation.bytes / peak <= 2


def test_each_part_has_its_reason_and_what_is_not_required_is_not_built():
    scene = ck.Scene(ck.source("analytic.torus", major=1.0, minor=0.4), ck.ScreenedPoisson(1.0))
    explanation = ck.explain(scene, 0.1, form="galerkin", dry_run=True)
    assert [part.name for part in explanation.parts][-1] == "solver 'multigrid'"
    assert "a cut (no boundary)" in explanation.left_out
    explanation = ck.explain(scene, 0.1, form="collocation", dry_run=True)
    assert [part.name for part in explanation.parts] == ["inner nodes", "outer nodes", "solver 'reference'"]
    assert "crossing tests and ghosts (no boundary)" in explanation.left_out
    text = str(ck.explain(circle_jump()[0], 0.1, order=1, dry_run=True))
    assert "ghosts of 'cut'" in text
    assert "Dirichlet" in text
    assert "mirror points (order 1)" in text


def test_nothing_is_requested_of_a_surface_that_a_scene_does_not_require():
    """No boundary and a closed surface: cells and nodes are asked for, nothing else."""
    from layouts import build_layout

    from cpmkit.plugin import cell_levels, localize

    sphere = ck.source("analytic.sphere")
    layout = build_layout(ck.Scene(sphere, ck.ScreenedPoisson(1.0)), 0.1)
    counted = localize(sphere, np.zeros(3))
    list(cell_levels(counted, 0.1, 0.0))
    assert layout.queries["surface"] == counted.queries["points"] + len(layout.band.nodes)


def test_order_one_makes_no_mirror_query():
    from layouts import build_layout

    scene, _, _ = sphere_poisson([[1.0, 2.0, 3.0]])
    assert build_layout(scene, 0.1, order=1).queries["surface"] < build_layout(scene, 0.1).queries["surface"]


def test_an_option_that_solve_would_refuse_is_refused():
    scene, _, _ = circle_jump()
    assert (
        ck.explain(scene, 0.1, solver="reference", solver_tolerance=1e-6, max_iterations=5, dry_run=True).unknowns > 0
    )
    with pytest.raises(ck.InputError, match="no option 'degre'"):
        ck.explain(scene, 0.1, degre=3, dry_run=True)
