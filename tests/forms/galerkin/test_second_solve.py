"""What a source alone decides is found out once: later solves of it, on other lattices, ask for less."""

import gc
from importlib import import_module
from weakref import ref

import numpy as np
import pytest
from counted_calls import counted_calls

import cpmkit as ck
from cpmkit.meshing import curved_from_normals
from cpmkit.meshing.mesh_cache import MESH_CACHES

SPACING = 0.35
F = ck.ScreenedPoisson(lambda x: np.cos(2 * x[:, 0]), c=1.0)


def ball_mesh(**options):
    """Return a sphere of triangles."""
    vertices, faces = ck.source("analytic.sphere").mesh(0.12)
    return ck.source("mesh.triangles", vertices=vertices, faces=faces, **options)


def counted(monkeypatch, places):
    """Return a list that grows with each call of functions, given as (module, name)."""
    calls = []
    for module, name in places:
        before = getattr(module, name)

        def noted(*arguments, before=before, name=name):
            calls.append(name)
            return before(*arguments)

        monkeypatch.setattr(module, name, noted)
    return calls


def queries(scene, spacing, origin=None):
    return ck.solve(scene, spacing, form="galerkin", origin=origin).work.closest_point_queries


@pytest.mark.parametrize("closest", ["smooth", "faceted"])
def test_cells_of_a_mesh_are_repaired_once(closest):
    scene = ck.Scene(ball_mesh(closest=closest), F)
    first, second = (
        counted_calls(lambda spacing=spacing: ck.solve(scene, spacing, form="galerkin"), "repaired_cells")
        for spacing in (SPACING, 0.8 * SPACING)
    )
    assert first > 0 == second


def test_a_second_solve_asks_for_fewer_points(monkeypatch):
    triangles = import_module("cpmkit_mesh.triangles")
    scene, finer = ck.Scene(ball_mesh(closest="smooth"), F), 0.8 * SPACING
    trees = counted(monkeypatch, [(triangles, "build_tree")])
    first = queries(scene, SPACING)
    assert queries(scene, finer) < 0.1 * first
    assert trees == []


def test_solutions_do_not_depend_on_which_lattice_came_first():
    finer, origin = 0.8 * SPACING, [0.013, 0.007, 0.002]
    alone = ck.solve(ck.Scene(ball_mesh(closest="smooth"), F), finer, form="galerkin", origin=origin)
    scene = ck.Scene(ball_mesh(closest="smooth"), F)
    ck.solve(scene, SPACING, form="galerkin")
    later = ck.solve(scene, finer, form="galerkin", origin=origin)
    assert np.array_equal(alone.values, later.values)


def test_a_mesh_whose_long_edges_are_split_asks_for_what_is_new_alone(monkeypatch):
    scene, spacing, origin = ck.Scene(ball_mesh(closest="smooth"), F), 0.17, [0.013, 0.007, 0.002]
    ck.solve(scene, SPACING, form="galerkin")
    found = ck.solve(scene, spacing, form="galerkin", origin=origin)
    monkeypatch.setattr(
        curved_from_normals,
        "smooth_vertex_normals",
        lambda source, mesh: curved_from_normals.smooth_normals(source, mesh.vertices),
    )
    every = ck.solve(scene, spacing, form="galerkin", origin=origin)
    target = [one.work.closest_point_queries for one in (found, every)]
    vertices = len(scene.surface.mesh(1.0)[0])
    assert target[1] - target[0] >= vertices  # more than its own vertices are asked for: some edges were split
    assert target[1] > 1.05 * vertices
    np.testing.assert_allclose(found.values, every.values, atol=1e-11 * np.ptp(every.values))


def test_cached_values_go_with_their_source():
    source = ball_mesh(closest="smooth")
    ck.solve(ck.Scene(source, F), SPACING, form="galerkin")
    arrays = [one for one in MESH_CACHES[source].values.values() if isinstance(one, np.ndarray)]
    assert sum(one.nbytes for one in arrays) < 8 * (source.vertices.nbytes + source.faces.nbytes)
    number, gone = len(MESH_CACHES), ref(source)
    del source
    gc.collect()
    assert gone() is None
    assert len(MESH_CACHES) < number


def test_a_cloud_is_examined_once(monkeypatch):
    cloud = import_module("cpmkit_pointcloud.cloud")
    rng = np.random.default_rng(0)
    points = rng.normal(size=(1500, 3))
    source = ck.source("pointcloud.points", points=points / np.linalg.norm(points, axis=1)[:, None])
    ck.solve(ck.Scene(source, F), 0.4, form="galerkin")
    calls = counted(monkeypatch, [(cloud, "count_open_samples"), (cloud, "slope_error")])
    ck.solve(ck.Scene(source, F), 0.35, form="galerkin")
    assert calls == []
