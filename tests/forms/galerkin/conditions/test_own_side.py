"""Two materials 1 : 1000, told apart by position: each sample has the one of its cell, wherever the boundary passes."""

import numpy as np
import pytest
from sphere_zones import SPHERE, coupled, errors, sphere_points
from trimesh.creation import icosphere

import cpmkit as ck
from cpmkit.meshing import curved_from_points

SCENE = coupled(1000.0, 0.3)
POINTS = sphere_points(1500)
#: In each a vertex of the mesh lies nearer to the chord of a boundary than this to the boundary.
BESIDE_VERTICES = [(0.0972, 0), (0.0972, 2), (0.1, 4)]
#: On a mesh, in each of which the boundary cuts off slivers beside edges.
WITH_SLIVERS = [
    (0.1608151864583527, [0.14780340773816317, 0.132966069541153, 0.1424051068036103]),
    (0.13273191922045646, [0.08393077088214751, 0.05058911616293762, 0.08968404939134948]),
]


def near(spacing, seed):
    lower = np.array([-1.0, -1.0, -1.0]) + 0.2 * np.random.default_rng(seed).uniform(0, 1, 3)
    return {"spacing": spacing, "origin": lower + 1.0, "form": "galerkin"}


@pytest.mark.parametrize(("spacing", "seed"), BESIDE_VERTICES)
def test_a_boundary_beside_a_vertex_keeps_its_bend(spacing, seed, monkeypatch):
    found, bend = {}, curved_from_points.add_midpoints

    def kept(mesh, source, boundaries=()):
        found["mesh"], found["boundary"] = bend(mesh, source, boundaries), boundaries[0]
        return found["mesh"]

    monkeypatch.setattr(curved_from_points, "add_midpoints", kept)
    solution = ck.solve(SCENE, **near(spacing, seed))
    mesh = found["mesh"]
    edges = mesh.edges
    middles = np.zeros((len(edges.ends), 3))
    middles[edges.of_cells] = mesh.midpoints
    on = middles[mesh.cut_edges]
    assert found["boundary"].closest_point(on).distance.max() < 1e-12
    assert errors(solution, POINTS)[1] < 2.5e-5


@pytest.mark.parametrize(("spacing", "origin"), WITH_SLIVERS)
def test_slivers_beside_edges_have_the_material_of_their_side(spacing, origin):
    ball = icosphere(subdivisions=4)
    surface = ck.source("mesh.triangles", vertices=ball.vertices, faces=ball.faces)
    scene = ck.Scene(surface, SCENE.problem, SCENE.boundaries)
    solution = ck.solve(scene, spacing, origin=origin, form="galerkin", solver="multigrid")
    form = solution.discretized
    on_boundary = form.coefficients.diffusivity(scene.problem.terms().diffusivity)[form.sampled.interior :]
    left = form.sampled.left
    assert np.unique(on_boundary[left]).tolist() == [1.0]
    assert np.unique(on_boundary[~left]).tolist() == [1000.0]


def test_a_boundary_keeps_its_vertices_where_triangles_become_thin():
    """Two of its vertices are .018 spacings apart, and a third vertex lies .01 off: they were put back on chords."""
    origin = [0.0395425133151816, 0.0437351976421664, 0.0145834340286955]
    solution = ck.solve(SCENE, 0.0912954370688479, origin=origin, form="galerkin")
    assert errors(solution, POINTS)[1] < 1e-4


def test_nothing_is_read_elsewhere_where_all_samples_are_on_their_side():
    form = ck.solve(ck.Scene(SPHERE, SCENE.problem, SCENE.boundaries), 0.3, form="galerkin").discretized
    seen = []
    form.data_at_points(lambda x: seen.append(x.copy()) or x[:, 0], "f")
    apart = np.abs(seen[0] - form.points).max(axis=1)
    assert np.count_nonzero(apart) == len(form.coefficients._samples_past_boundary[0])
    assert apart.max() < 0.05 * 0.3
