"""Facets of a bent surface are sampled as roughly as it turns at their edges; what is flat is not, nor beside cuts."""

from dataclasses import replace

import numpy as np
import pytest
from trimesh.creation import box, icosphere

import cpmkit as ck
from cpmkit.mesh.cell_quadrature import one_point_limits, quadrature
from cpmkit.plugin import Mesh

BALL = icosphere(subdivisions=3)


def mesh(vertices, faces):
    return Mesh.of(np.array(vertices, dtype=float), np.array(faces, dtype=np.int64))


def roof(slope):
    """Return two triangles with a common edge, one of which rises by ``slope``."""
    return mesh([[0, 0, 0], [0, 1, 0], [-1, 0, 0], [1, 0, slope]], [[0, 1, 2], [1, 0, 3]])


def test_the_least_angle_at_an_edge_decides_whichever_way_triangles_are_wound():
    """Around each triangle of a tetrahedron three neighbours turn alike; one of a pyramid's base is turned back."""
    low = mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.3, 0.3, 0.002]], [[0, 1, 2], [0, 1, 3], [3, 1, 2], [2, 0, 3]])
    normals = np.cross(*(low.vertices[low.cells[:, k]] - low.vertices[low.cells[:, 0]] for k in (1, 2)))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    sine = np.linalg.norm(np.cross(normals[:, None], normals[None]), axis=2) + 9 * np.eye(4)
    np.testing.assert_allclose(one_point_limits(low, 1.0), 0.5 * sine.min(axis=1), rtol=1e-12)


def test_planes_rims_and_edges_of_three_have_all_samples():
    curved = roof(0.01)
    third = replace(curved, vertices=np.r_[curved.vertices, [[0, 0, 1]]], cells=np.r_[curved.cells, [[0, 1, 4]]])
    for one in (roof(0.0), curved, third, mesh(*(getattr(box(), name) for name in ("vertices", "faces")))):
        np.testing.assert_allclose(one_point_limits(one, 1.0), 0.0, atol=1e-15)
    assert one_point_limits(mesh(BALL.vertices, BALL.faces), 1.0).min() == 5e-3


def test_curved_triangles_much_smaller_than_a_spacing_have_one_sample_and_cost_no_accuracy():
    fine = icosphere(subdivisions=5)
    surface = ck.source("mesh.triangles", vertices=fine.vertices, faces=fine.faces)
    scene, at = ck.Scene(surface, ck.ScreenedPoisson("13*x*y*z")), fine.vertices[::7]
    errors, samples = [], []
    for limit in (0.0, 1e-4):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("cpmkit.mesh.cell_quadrature.CURVED_SINGLE_MOMENT", limit)
            found = [ck.solve(scene, 0.45, form="galerkin", origin=[x, 0.1, 0.2]) for x in (0.0, 0.13)]
        errors.append(np.sqrt(np.mean([(one.evaluate(at) - at.prod(axis=1)) ** 2 for one in found])))
        samples.append(found[0].work.samples)
    assert errors[1] < 1.01 * errors[0]
    assert samples[1] < 0.4 * samples[0]


def test_triangles_that_touch_a_boundary_have_all_samples():
    ball = mesh(BALL.vertices, BALL.faces)
    cut = replace(ball, cut=ball.cells[:1, :2])
    touching = np.isin(ball.cells, cut.cut).any(axis=1)
    assert 0 < touching.sum() < 20
    np.testing.assert_array_equal(one_point_limits(cut, 1.0) == 0, touching)


def test_facets_cost_two_thirds_of_the_samples_and_no_accuracy():
    """The facets' own solution is that on half of the spacing, all samples taken."""
    surface = ck.source("mesh.triangles", vertices=BALL.vertices, faces=BALL.faces, closest="faceted")
    scene, spacing, at = ck.Scene(surface, ck.ScreenedPoisson("x*y + z**3")), 0.18, BALL.vertices
    origins = [np.zeros(3), np.array([0.06, 0.03, 0.01])]
    fewer = [ck.solve(scene, spacing, form="galerkin", origin=origin) for origin in origins]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "cpmkit.mesh.cell_quadrature.one_point_limits",
            lambda one, _spacing: np.zeros(len(one.cells)),
        )
        every = [ck.solve(scene, spacing, form="galerkin", origin=origin) for origin in origins]
        fine = ck.solve(scene, spacing / 2, form="galerkin").evaluate(at)
    assert sum(one.work.samples for one in fewer) < 0.67 * sum(one.work.samples for one in every)
    off = [np.sqrt(np.mean([(one.evaluate(at) - fine) ** 2 for one in each])) for each in (fewer, every)]
    assert off[0] < 1.06 * off[1]


def test_small_whole_facets_have_one_sample_each():
    ball = mesh(BALL.vertices, BALL.faces)
    whole = np.zeros(len(ball.cells), dtype=bool)
    for spacing, each in ((1.0, 1), (0.18, 3)):
        found = quadrature(ball, spacing, clipped=whole)
        assert len(found) == each * len(ball.cells)
        assert (np.diff(found.cell) >= 0).all()
        assert found.weights.sum() == pytest.approx(BALL.area, rel=1e-12)
        flat = np.einsum("qi,qi->q", found.normals[:, 0], found.points - ball.vertices[ball.cells[found.cell, 0]])
        assert np.abs(flat).max() < 1e-12


def test_the_area_is_kept():
    ball = mesh(BALL.vertices, BALL.faces)
    assert quadrature(ball, 0.18).weights.sum() == pytest.approx(BALL.area, rel=1e-12)
