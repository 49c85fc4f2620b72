"""Surfaces known by closest points alone are triangulated with the right pieces and rims, and areas of order four."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
import pytest
from extremes.bare_shapes import BareSurface, Moved, Rectangles, box, leaf
from meshing.contouring.measures import area, pieces, topology
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import cpmkit as ck
from cpmkit import ClosestPoints
from cpmkit.meshing.contour_edges import collapse_edges, remove_small_components
from cpmkit.meshing.contouring.contoured_surfaces import contour_surface
from cpmkit.meshing.curved_from_points import curve_cells_by_closest_points
from cpmkit.plugin import localize

TURN = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
SMOOTH = {
    "sphere": ({"kind": "analytic.sphere"}, 4 * pi, (1, 0, 2)),
    "torus": ({"kind": "analytic.torus", "major": 1.0, "minor": 0.4}, 1.6 * pi**2, (1, 0, 0)),
    "hemisphere": ({"kind": "analytic.cap", "height": 0.0}, 2 * pi, (1, 1, 1)),
}


def made(kind, **keys):
    return ck.source(kind, **keys)


def contoured(source, spacing, origin=None):
    """Return the mesh, the report, and how many queries were asked for each unknown that there will be."""
    seen = localize(source, source.bounds.mean(axis=0) if origin is None else np.asarray(origin, dtype=float))
    mesh, report = contour_surface(seen, spacing)
    mesh = curve_cells_by_closest_points(mesh, seen)
    return mesh, report, seen.queries["points"] / (4.5 * area(mesh) / spacing**2)


@pytest.mark.parametrize("name", SMOOTH)
def test_areas_of_smooth_surfaces_are_of_order_four(name):
    keys, exact, shape = SMOOTH[name]
    errors = []
    for spacing in (0.2, 0.14, 0.1):
        mesh, report, queries = contoured(made(**keys), spacing)
        assert topology(mesh) == shape
        assert len(report.defects.cracks) == 0
        assert report.nonmanifold_share == 0
        assert queries < 22
        errors.append(abs(area(mesh) / exact - 1))
    assert errors[2] < 1e-6
    assert np.log2(errors[0] / errors[2]) > 3.4


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", SMOOTH)
def test_anywhere_on_the_lattice(name, seed):
    keys, exact, shape = SMOOTH[name]
    mesh, report, _ = contoured(made(**keys), 0.1, np.random.default_rng(seed).uniform(0, 0.1, 3))
    assert (topology(mesh), len(report.defects.cracks), len(report.missed)) == (shape, 0, 0)
    assert area(mesh) == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize("name", SMOOTH)
def test_of_any_size(name, scale):
    keys, exact, shape = SMOOTH[name]
    mesh, _, _ = contoured(made(**keys, scale=scale), 0.15 * scale)
    assert topology(mesh) == shape
    assert area(mesh) == pytest.approx(exact * scale**2, rel=6e-6)


def test_vertices_lie_on_the_surface_and_those_of_the_border_on_the_rim():
    mesh, _, _ = contoured(made("analytic.cap", height=0.0), 0.1, [0, 0, 0])
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1).max() < 1e-12
    edges, count = np.unique(np.sort(mesh.facets.reshape(-1, 2), axis=1), axis=0, return_counts=True)
    assert np.abs(mesh.vertices[edges[count == 1], 2]).max() < 1e-12


def test_spheres_a_third_of_a_spacing_apart_are_two():
    ball = [made("analytic.sphere", radius=0.5, center=[x, 0, 0]) for x in (0.0, 1.03)]
    mesh, _, _ = contoured(made("union", members=ball), 0.1)
    assert topology(mesh) == (2, 0, 4)
    assert area(mesh) == pytest.approx(2 * pi, rel=2e-6)


def moebius_area(half_width=0.35, count=400):
    """Return the area of the strip by Gauss' rule across it and the trapezoidal rule around it."""
    v, weights = np.polynomial.legendre.leggauss(20)
    u, v = np.meshgrid(np.arange(count) * 2 * pi / count, half_width * v)
    around = 1 + v * np.cos(u / 2)
    return (half_width * weights @ np.sqrt(0.25 * v**2 + around**2)).sum() * 2 * pi / count


def test_a_moebius_strip_has_one_component_and_one_rim():
    errors = []
    for spacing in (0.2, 0.14, 0.1):
        mesh, report, _ = contoured(made("parametric.moebius"), spacing)
        assert (topology(mesh), len(report.defects.cracks)) == ((1, 1, 0), 0)
        errors.append(area(mesh) / moebius_area() - 1)
    assert np.abs(errors).max() < 1e-3


def half_plane(angle):
    x = [f"{np.cos(angle)}*u", f"{np.sin(angle)}*u", "v"]
    return made("parametric.surface", x=x, u=[0, 1], v=[0, 1])


def test_three_sheets_that_meet_in_a_line_are_one_component():
    tripod = made("union", members=[half_plane(angle) for angle in (0.1, 2.2, 4.3)])
    mesh, report, _ = contoured(tripod, 0.1)
    edges, count = np.unique(np.sort(mesh.facets.reshape(-1, 2), axis=1), axis=0, return_counts=True)
    along = np.linalg.norm(np.diff(mesh.vertices[edges[count == 3]], axis=1)[:, 0], axis=1).sum()
    assert pieces(mesh.cells[:, :2].tolist() + mesh.cells[:, 1:].tolist()) == 1
    assert (count.max(), report.lattice_spacing) == (3, 0.5)
    assert along == pytest.approx(1.0, abs=0.15)
    assert area(mesh) == pytest.approx(3.0, rel=2e-3)


def test_a_thin_ellipsoid_is_closed():
    z = 0.1
    e = np.sqrt(1 - z**2)
    exact = 2 * pi * (1 + z**2 / e * np.arctanh(e))
    lens = made("levelset.expression", phi="x**2 + y**2 + 100*z**2 - 1", bounds=[[-1.1, -1.1, -0.2], [1.1, 1.1, 0.2]])
    mesh, report, _ = contoured(lens, 0.1)
    assert (topology(mesh), len(report.defects.cracks)) == ((1, 0, 2), 0)
    assert area(mesh) == pytest.approx(exact, rel=3e-3)


@dataclass(frozen=True)
class Capsule:
    """All points at a distance from a segment of length one, known by closest points alone."""

    radius: float
    dim: int = 3
    manifold_dim: int = 2
    exact: bool = True

    @property
    def bounds(self):
        half = self.radius + np.array([0.5, 0.0, 0.0])
        return np.array([-half, half])

    def closest_point(self, x):
        axis = np.zeros_like(x)
        axis[:, 0] = np.clip(x[:, 0], -0.5, 0.5)
        away = x - axis
        feet = axis + self.radius * away / np.linalg.norm(away, axis=1)[:, None]
        return ClosestPoints(feet, np.linalg.norm(x - feet, axis=1), np.full(len(x), -1))


@pytest.mark.parametrize("radius", [0.06, 0.08, 0.12])
def test_a_thin_capsule_is_closed(radius):
    mesh, report, _ = contoured(Capsule(radius), 0.1, [0.013, 0.031, 0.007])
    assert (topology(mesh), len(report.defects.cracks)) == ((1, 0, 2), 0)
    assert area(mesh) == pytest.approx(2 * pi * radius + 4 * pi * radius**2, rel=0.01)


def test_a_cloud_of_points():
    points = np.random.default_rng(1).normal(size=(4000, 3))
    mesh, _, _ = contoured(made("pointcloud.points", points=points / np.linalg.norm(points, axis=1)[:, None]), 0.15)
    assert topology(mesh) == (1, 0, 2)
    assert area(mesh) == pytest.approx(4 * pi, rel=4e-6)


@pytest.mark.parametrize("spacing", [0.2, 0.14])
def test_a_level_set_that_is_no_distance(spacing):
    bounds = [[-2.1, -1.1, -0.9], [2.1, 1.1, 0.9]]
    tamarind = made("levelset.expression", phi="x**2/4 + y**2 + 4*z**2/(1 + sin(pi*x)/2)**2 - 1", bounds=bounds)
    mesh, report, queries = contoured(tamarind, spacing)
    assert (topology(mesh), len(report.defects.cracks)) == ((1, 0, 2), 0)
    assert area(mesh) == pytest.approx(16.8342, rel=3e-3 * spacing)
    assert queries < 22


@pytest.fixture(scope="module")
def thin():
    """Return a thin ellipsoid, places on it and a solution's values there."""
    bounds = [[-1.2, -1.2, -0.3], [1.2, 1.2, 0.3]]
    surface = ck.source("levelset.expression", phi="x*x + y*y + 100*z*z - 1", bounds=bounds)
    at = surface.closest_point(np.random.default_rng(0).uniform(-1, 1, (500, 3)) * [1, 1, 0.1]).points
    fine = ck.solve(ck.Scene(surface, ck.ScreenedPoisson("x")), 0.08, form="galerkin", estimate=False)
    return surface, at, fine.evaluate(at)


@pytest.mark.slow
@pytest.mark.parametrize("spacing", [0.21393043699751346, 0.17989333758486972, 0.15127166270314324])
def test_a_thin_surface_is_one_piece(spacing, thin):
    """An ellipsoid as thick as the spacing: specks beside it had values of their own, or none, a singular system."""
    surface, at, fine = thin
    solution = ck.solve(ck.Scene(surface, ck.ScreenedPoisson("x")), spacing, form="galerkin", estimate=False)
    dof_map = solution.discretized.space.dof_map
    touching = coo_array((np.ones(len(dof_map.touching)), dof_map.touching.T), shape=(len(dof_map.cells),) * 2)
    assert connected_components(touching, directed=False)[0] == 1
    has_warning = any("pieces of the triangulation by closest points" in text for text in solution.warnings)
    assert has_warning == (spacing < 0.2)  # the first is right as it is
    assert np.abs(solution.evaluate(at) - fine).max() < 0.15 * np.ptp(fine)


@pytest.mark.parametrize("angle", [40, 60, 75])
def test_a_sharp_fold_is_one_piece(angle):
    """Two leaves at an acute angle were separated along the crease: the gap shrinks by a tenth in a bisection."""
    leaves = Rectangles((leaf(0.0, 1.0, 0.8), leaf(np.radians(angle), 1.0, 0.8)))
    turned = Moved(leaves, TURN, np.zeros(3))
    mesh, report, _ = contoured(BareSurface(turned), 0.1)
    assert (topology(mesh), report.defects.severity) == ((1, 1, 1), 0)
    assert area(mesh) == pytest.approx(1.6, rel=0.02)


@pytest.mark.parametrize("edges", [True, False])
def test_the_rims_of_an_open_box_are_found_with_edge_numbers_and_without(edges):
    turned = Moved(Rectangles(tuple(box([0, 0, 0], [1, 0.8, 0.6], ["top"]))), TURN, np.zeros(3))
    mesh, report, _ = contoured(BareSurface(turned, edges), 0.1)
    assert topology(mesh) == (1, 1, 1)
    assert area(mesh) == pytest.approx(turned.area, rel=0.002)
    assert not edges or report.defects.severity == 0


@pytest.mark.parametrize("angle", [50, 90])
def test_two_sheets_that_cross_stay_joined(angle):
    turns = np.radians([0, angle, 180, 180 + angle])
    cross = Rectangles(tuple(leaf(turn, 1.0, 0.6) for turn in turns))
    mesh, report, _ = contoured(BareSurface(cross), 0.1)
    assert (topology(mesh)[0], topology(mesh)[2], report.defects.severity) == (1, 1, 0)


def test_isolated_components_are_left_out():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0], [3, 0.3, 0], [3.3, 0, 0], [5, 5, 5]])
    cells = np.array([[0, 1, 2], [3, 4, 5], [6, 6, 6]])
    remaining, count = remove_small_components(vertices, cells, cells, 1.0)
    np.testing.assert_array_equal(remaining, cells[:1])
    assert count == 2
    remaining, count = remove_small_components(vertices, cells[1:], cells[1:], 1.0)  # nothing else is there
    np.testing.assert_array_equal(remaining, cells[1:])
    assert count == 0


def test_edges_with_common_vertices_collapse_to_one():
    cells = np.array([[0, 3, 4], [1, 4, 5], [2, 5, 6]])
    np.testing.assert_array_equal(
        collapse_edges(cells, np.array([[0, 1], [0, 2], [1, 2]]), 7), [[0, 3, 4], [0, 4, 5], [0, 5, 6]]
    )
