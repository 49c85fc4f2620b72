"""Curved cells lie on the manifold to the order of quadratics, on its rim and on boundaries where they have to."""

import numpy as np
import pytest
from sample_shapes import equator, octahedron, with_cut

import cpmkit as ck
from cpmkit.mesh.adjacency import repair
from cpmkit.mesh.cell_quadrature import quadrature
from cpmkit.mesh.subdivision import subdivide
from cpmkit.meshing.curved_from_normals import curve_cells
from cpmkit.meshing.curved_from_points import curve_cells_by_closest_points
from cpmkit.meshing.source_cells import source_cells
from cpmkit.plugin import Mesh, localize


def samples(source, spacing, origin=None):
    local = localize(source, np.zeros(source.dim) if origin is None else np.asarray(origin))
    drawn = source_cells(local, (0.7 if source.manifold_dim == 2 else 0.5) * spacing, 0.5 * spacing)
    mesh = subdivide(repair(drawn.mesh)[0], 0.55 * spacing)
    return quadrature(curve_cells(mesh, drawn.geometry, local, (), spacing))


def orders(errors):
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


SHAPES = {
    "sphere": ({"kind": "analytic.sphere"}, 4 * np.pi, 0.4),
    "hemisphere": ({"kind": "analytic.cap"}, 2 * np.pi, 0.4),
    "torus": ({"kind": "analytic.torus", "major": 1.0, "minor": 0.4}, 1.6 * np.pi**2, 0.2),
    "circle": ({"kind": "analytic.circle", "center": [0, 0, 0]}, 2 * np.pi, 0.4),
}


@pytest.mark.parametrize("name", SHAPES)
def test_the_area_converges_at_order_four(name):
    keys, area, spacing = SHAPES[name]
    source = ck.source(**keys)
    errors = [abs(samples(source, spacing / 2**k).weights.sum() / area - 1) for k in range(4)]
    assert (orders(errors)[1:] > 3.4).all()
    assert errors[-1] < 1e-6


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_units_change_nothing(unit):
    one, other = (samples(ck.source("analytic.cap", height=-0.3 * r, radius=r), 0.2 * r) for r in (1.0, unit))
    assert other.points / unit == pytest.approx(one.points, abs=1e-12)
    assert other.weights / unit**2 == pytest.approx(one.weights, rel=1e-9)


def test_normals_and_points_are_those_of_the_manifold():
    errors = []
    for spacing in (0.4, 0.2, 0.1):
        found = samples(ck.source("analytic.sphere"), spacing)
        radial = found.points / np.linalg.norm(found.points, axis=1, keepdims=True)
        across = np.linalg.norm(np.cross(found.normals[:, 0], radial), axis=1)
        errors.append([np.abs(np.linalg.norm(found.points, axis=1) - 1).max(), across.max()])
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > [2.5, 1.8]).all()


def test_normals_of_curves_are_orthonormal_and_across():
    found = samples(ck.source("parametric.helix", radius=1.0, pitch=0.5, turns=2.0), 0.2)
    gram = np.einsum("qid,qjd->qij", found.normals, found.normals)
    assert gram == pytest.approx(np.tile(np.eye(2), (len(found), 1, 1)), abs=1e-13)


def test_the_rim_is_curved_onto_the_rim():
    source = localize(ck.source("analytic.cap", height=0.4), np.zeros(3))
    mesh = curve_cells_by_closest_points(subdivide(repair(source_cells(source, 0.28, 0.2).mesh)[0], 0.2), source)
    ends = np.sort(mesh.facets, axis=2).reshape(-1, 2)
    _, place, times = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    rim = times[place.ravel()] == 1
    middles = mesh.midpoints.reshape(-1, 3)
    assert mesh.vertices[np.unique(ends[rim])][:, 2] == pytest.approx(np.full(rim.sum(), 0.4), abs=1e-13)
    assert middles[rim][:, 2] == pytest.approx(np.full(rim.sum(), 0.4), abs=1e-13)
    assert np.linalg.norm(middles, axis=1) == pytest.approx(np.ones(len(middles)), abs=1e-13)


def test_concave_corners_of_the_rim_stay_where_they_are():
    outline = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    vertices = np.array([[x, y, 0] for x, y in outline], dtype=float)
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])
    source = localize(ck.source("mesh.triangles", vertices=vertices, faces=faces), np.zeros(3))
    mesh = subdivide(Mesh.of(vertices, faces), 0.3)
    moved = curve_cells_by_closest_points(mesh, source)
    assert moved.vertices == pytest.approx(mesh.vertices, abs=1e-6)
    assert quadrature(moved).weights.sum() == pytest.approx(3.0, abs=1e-6)


def test_a_coarse_mesh_far_from_the_manifold_still_reaches_its_rim():
    source = localize(ck.source("analytic.cap"), np.zeros(3))
    coarse = octahedron()
    half = Mesh.of(coarse.vertices, coarse.cells[:4])
    mesh = curve_cells_by_closest_points(subdivide(repair(half)[0], 0.1), source)
    single = np.unique(np.sort(mesh.facets.reshape(-1, 2), axis=1), axis=0, return_counts=True)
    rim = np.unique(single[0][single[1] == 1])
    assert mesh.vertices[rim, 2] == pytest.approx(np.zeros(len(rim)), abs=1e-13)
    assert np.linalg.norm(mesh.vertices, axis=1) == pytest.approx(np.ones(len(mesh.vertices)), abs=1e-13)


def test_boundaries_are_curved_onto_theirs_and_their_extensions_are_not():
    sphere = localize(ck.source("analytic.sphere"), np.zeros(3))
    ring = localize(ck.source("analytic.circle", center=[0, 0, 0]), np.zeros(3))
    mesh = octahedron(2)
    mesh = with_cut(mesh, equator(mesh))
    raised = mesh.vertices.copy()
    on = np.unique(mesh.cut)
    raised[on, 2] += 0.02 * np.cos(3 * on)
    extends = np.arange(len(mesh.cut)) >= 4
    mesh = Mesh(raised, mesh.cells, None, mesh.cut, mesh.owner, extends)
    moved = curve_cells_by_closest_points(mesh, sphere, [ring])
    imposed = np.unique(mesh.cut[~extends])
    free = np.setdiff1d(on, imposed)
    assert moved.vertices[imposed, 2] == pytest.approx(np.zeros(len(imposed)), abs=1e-13)
    assert (np.abs(moved.vertices[free, 2]) > 1e-3).any()
    assert np.linalg.norm(moved.midpoints, axis=2) == pytest.approx(np.ones((len(mesh.cells), 3)), abs=1e-13)
    apart = {frozenset(ends) for ends in mesh.cut[~extends].tolist()}
    beside = np.array([[frozenset(ends) in apart for ends in cell] for cell in mesh.facets.tolist()])
    assert moved.midpoints[beside][:, 2] == pytest.approx(np.zeros(beside.sum()), abs=1e-13)


def test_cells_beside_an_edge_share_its_midpoint():
    mesh = curve_cells_by_closest_points(octahedron(2), localize(ck.source("analytic.sphere"), np.zeros(3)))
    ends = np.sort(mesh.facets.reshape(-1, 2), axis=1)
    order = np.lexsort(ends.T)
    shared = mesh.midpoints.reshape(-1, 3)[order].reshape(-1, 2, 3)
    assert (shared[:, 0] == shared[:, 1]).all()


def test_a_foot_far_from_the_chord_is_a_crease():
    corner = localize(ck.source("mesh.polyline", points=[[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]]), np.zeros(2))
    mesh = Mesh.of(np.array([[0.0, 0.5], [0.5, 0.0]]), np.array([[0, 1]]))
    curved = curve_cells_by_closest_points(mesh, corner)
    assert curved.midpoints[0, 0].tolist() == curved.vertices.mean(axis=0).tolist() != [0.0, 0.0]


def test_segments_end_where_the_curve_crosses_knot_planes():
    circle = localize(ck.source("analytic.circle"), np.array([0.03, -0.02]))
    mesh = curve_cells_by_closest_points(source_cells(circle, 0.1).mesh, circle, spacing=0.2)
    centred = mesh.vertices + np.array([0.03, -0.02])
    assert np.linalg.norm(centred, axis=1) == pytest.approx(np.ones(len(centred)), abs=1e-12)
    z = quadrature(mesh).points.reshape(-1, 3, 2) / 0.2
    assert (np.round(z) == np.round(z[:, :1])).all()
