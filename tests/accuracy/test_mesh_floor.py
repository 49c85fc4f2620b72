"""What a mesh that is read as smooth leaves of an error is told, by a solution on its triangles where that matters."""

from functools import cache

import coarse_meshes as meshes
import numpy as np
import pytest

import cpmkit as ck
from cpmkit.plugin import HasFacets

PROBLEM = ck.ScreenedPoisson(lambda x: np.cos(2 * x[:, 0]) + 3 * x[:, 1])


def sphere(rounds):
    return meshes.hull(meshes.icosphere(rounds))


def scene(mesh, closest="smooth"):
    return ck.Scene(ck.source("mesh.triangles", vertices=mesh[0], faces=mesh[1], closest=closest), PROBLEM)


@cache
def solved(name):
    """Return a solution on a coarse mesh, and one on a mesh of the same body that is much finer."""
    coarse, fine = {
        "sphere": (sphere(2), sphere(4)),
        "long ellipsoid": ((sphere(2)[0] * [3, 1, 1], sphere(2)[1]), (sphere(4)[0] * [3, 1, 1], sphere(4)[1])),
        "box with fillets": (meshes.rounded_box(1, 0.3)[0], meshes.rounded_box(3, 0.3)[0]),
        "capsule": (meshes.capsule(16)[0], meshes.capsule(48)[0]),
    }[name]
    return ck.solve(scene(coarse), 0.25), ck.solve(scene(fine), 0.25)


@pytest.mark.parametrize("name", ["sphere", "long ellipsoid", "box with fillets", "capsule"])
def test_the_floor_is_above_what_the_mesh_leaves_and_not_far(name):
    solution, exact = solved(name)
    points = solution.scene.surface.vertices
    values = [one.evaluate(points) for one in (solution, exact)]
    true = np.sqrt(np.mean((values[0] - values[1]) ** 2)) / np.ptp(values[1])
    assert 0.8 * true < solution.error.floor[0] < 30 * true


def test_it_is_solved_on_the_triangles_only_where_the_floor_matters(monkeypatch):
    fine, coarse = ck.solve(scene(sphere(4)), 0.25), ck.solve(scene(sphere(1)), 0.25)
    solves = []

    def record(scene, spacing, **options):
        solves.append((scene.surface.smooth, spacing))
        return ck.solve(scene, spacing, estimate=False, **options)

    monkeypatch.setattr("cpmkit.accuracy.estimate.solve_scene", record)
    for solution, further in ((fine, 0), (coarse, 1)):
        solves.clear()
        assert solution.error.floor[0] > 0
        assert solves == [(True, 0.5)] + further * [(False, 0.5)]


def test_an_explanation_that_counts_reports_the_floor_too():
    of = scene(meshes.rounded_box(1, 0.3)[0])
    explanation, solution = ck.explain(of, 0.25, dry_run=True), solved("box with fillets")[0]
    assert solution.error.floor[0] < explanation.floor < 4 * solution.error.floor[0]


def test_a_tolerance_below_the_floor_is_reported():
    with pytest.warns(ck.CpmkitWarning, match="below what the surface's representation alone may leave"):
        solution = ck.solve(scene(sphere(1)), tolerance=1e-3)
    assert solution.solve_history.status == "floor"
    assert solution.error.floor[0] > 1e-3


def test_a_mesh_can_be_read_as_its_triangles():
    smooth = scene(sphere(1)).surface
    assert isinstance(smooth, HasFacets)
    assert smooth.read_as_facets().exact
    x = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_array_equal(
        smooth.read_as_facets().closest_point(x).points, scene(sphere(1), "faceted").surface.closest_point(x).points
    )


def test_a_recipe_whose_solution_on_triangles_is_not_known_has_the_estimate_by_areas():
    """Its solutions on the flat triangles would be those on the smooth mesh, and their difference zero."""
    of = scene(sphere(1))
    with pytest.warns(ck.CpmkitWarning, match="below what the surface's representation alone may leave"):
        solution = ck.solve_by(lambda spacing, origin: ck.solve(of, spacing, origin=origin), of, tolerance=1e-3)
    assert solution.solve_history.status == "floor"
    assert solution.error.floor[0] == solution.discretized.source_error() > 1e-3
