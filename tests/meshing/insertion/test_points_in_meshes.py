"""Points cut curves, and are vertices of surfaces."""

import numpy as np
import pytest
from cut_meshes import check_sound, cut, icosphere

import cpmkit as ck
from cpmkit.meshing.insertion.surface_matching import ProjectionSearch
from cpmkit.plugin import Mesh


def ring(count, dim):
    angle = 2 * np.pi * np.arange(count) / count
    vertices = np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)[:, :dim]
    return Mesh.of(vertices, np.stack([np.arange(count), (np.arange(count) + 1) % count], axis=1))


@pytest.mark.parametrize("dim", [2, 3])
def test_points_cut_a_curve(dim):
    angles = [0.1, 0.11, 2.0]
    points = [ck.source("analytic.point", at=[np.cos(t), np.sin(t), 0.0][:dim]) for t in angles]
    mesh = cut(ring(40, dim), *points, spacing=0.3).mesh
    places = mesh.vertices[mesh.cut[:, 0]]
    assert np.arctan2(places[:, 1], places[:, 0]) == pytest.approx(angles, abs=2e-3)
    assert mesh.owner.tolist() == [0, 1, 2]
    assert len(mesh.cells) == 43
    assert not mesh.beyond_tip.any()
    ends = np.sort(mesh.cells.ravel())
    assert (ends == np.repeat(np.arange(43), 2)).all()


def test_a_point_at_a_vertex_is_that_vertex():
    mesh = cut(ring(40, 2), ck.source("analytic.point", at=[1.0, 1e-5]), spacing=0.3).mesh
    assert mesh.cut.tolist() == [[0]]
    assert len(mesh.cells) == 40


def test_points_on_a_surface_are_vertices_and_cut_nothing():
    sphere, place = icosphere(3), np.array([0.36, 0.48, 0.8])
    result = cut(sphere, ck.source("analytic.point", at=place))
    (vertex,) = result.point_vertices[0]
    assert np.linalg.norm(result.mesh.vertices[vertex] - place) < 0.01
    assert len(result.mesh.cut) == 0
    assert result.empty == ()
    check_sound(sphere, result.mesh)


def test_no_points_have_no_projections():
    sphere = icosphere(1)
    search = ProjectionSearch(sphere, np.ones(len(sphere.cells)))
    for projections in (search.candidates(np.zeros((0, 3))), search.nearest(np.zeros((0, 3)))):
        assert len(projections.point) == len(projections.cell) == len(projections.distance) == 0
        assert projections.shares.shape == (0, 3)
