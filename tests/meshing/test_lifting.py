"""A coarse mesh that is read as smooth is bent to the surface that it samples, with what is cut into it."""

import numpy as np
import pytest
from sample_shapes import box, equator, octahedron, with_cut

import cpmkit as ck
from cpmkit.mesh.cell_quadrature import quadrature
from cpmkit.meshing.curved_from_normals import curve_cells, fit_vertices_to_normals
from cpmkit.meshing.source_cells import source_cells
from cpmkit.plugin import Mesh, localize

UNIT_BOX = box([-0.5] * 3, [0.5] * 3)


def mesh_source(vertices, faces, closest="smooth"):
    return localize(ck.source("mesh.triangles", vertices=vertices, faces=faces, closest=closest), np.zeros(3))


def areas(source, spacing):
    drawn = source_cells(source, 0.7 * spacing, 0.5 * spacing)
    return drawn.geometry, quadrature(curve_cells(drawn.mesh, drawn.geometry, source, (), spacing)).weights.sum()


def test_meshes_of_a_sphere_have_its_area_to_order_four():
    errors = []
    for rounds in (2, 3, 4):
        sphere = octahedron(rounds)
        bend, area = areas(mesh_source(sphere.vertices, sphere.cells), 0.1 / 0.7)
        assert bend == "normals"
        errors.append(abs(area / (4 * np.pi) - 1))
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 3.5).all()
    assert errors[-1] < 1e-5


def test_meshes_of_a_torus_have_its_area_to_order_three():
    errors = []
    for spacing in (0.4, 0.2, 0.1):
        source = mesh_source(*ck.source("analytic.torus").mesh(spacing))
        errors.append(abs(areas(source, 0.2)[1] / (1.6 * np.pi**2) - 1))
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 3.0).all()
    assert errors[-1] < 1e-4


def cylinder(sections, rings, half=0.75):
    """A capped cylinder of radius 1: its vertices, and triangles in rings about the axis."""
    angle = 2 * np.pi * np.arange(sections) / sections
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    heights = np.linspace(-half, half, rings + 1)
    side = np.concatenate([np.column_stack([around, np.full(sections, z)]) for z in heights])
    i, ring = np.arange(sections), np.arange(rings)[:, None] * sections
    a, b = (ring + i).ravel(), (ring + (i + 1) % sections).ravel()
    faces = [np.stack([a, b, b + sections], axis=1), np.stack([a, b + sections, a + sections], axis=1)]
    top, bottom, last = len(side), len(side) + 1, rings * sections
    faces += [np.stack([last + i, last + (i + 1) % sections, np.full(sections, top)], axis=1)]
    faces += [np.stack([(i + 1) % sections, i, np.full(sections, bottom)], axis=1)]
    return np.concatenate([side, [[0, 0, half], [0, 0, -half]]]), np.concatenate(faces)


@pytest.mark.parametrize("spacing", [2.0, 0.3, 0.1])
def test_a_box_is_a_box(spacing):
    bend, area = areas(mesh_source(*UNIT_BOX), spacing)
    assert bend == "normals"
    assert area == pytest.approx(6.0, rel=1e-12)


def test_boxes_that_are_moved_or_stand_side_by_side_are_boxes():
    vertices, faces = UNIT_BOX
    one, other = (ck.source("mesh.triangles", vertices=vertices + shift, faces=faces) for shift in (0.0, 3.0))
    moved = ck.source("moved", of=one, scale=2.0, translation=[3.0, -5.0, 0.3])
    for source, area in ((moved, 24.0), (ck.source("union", members=[one, other]), 12.0)):
        assert areas(localize(source, np.zeros(3)), 0.3)[1] == pytest.approx(area, rel=1e-12)


def test_triangles_beside_creases_stay_flat_and_others_are_curved():
    """Caps are polygons; between the rings at their rims the side is round to the fourth order."""
    errors = []
    for sections in (16, 32, 64):
        rings = sections // 4
        source = mesh_source(*cylinder(sections, rings))
        chord, height = 2 * np.sin(np.pi / sections), 1.5 / rings
        caps = sections * np.sin(2 * np.pi / sections)
        sides = 2 * height * sections * chord + 2 * np.pi * (1.5 - 2 * height)
        errors.append(abs(areas(source, 10.0)[1] / (caps + sides) - 1))
    assert (np.log2(np.array(errors[:-1]) / errors[1:]) > 2.5).all()
    assert errors[-1] < 1e-4


@pytest.mark.parametrize("spacing", [2.0, 0.2])
def test_a_cone_is_flat_up_to_its_tip(spacing):
    """Its triangles turn by 11 degrees from one to the next, and all have corners at the crease around the base."""
    angle = 2 * np.pi * np.arange(32) / 32
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(32)], axis=1)
    i, j = np.arange(32), (np.arange(32) + 1) % 32
    sides = np.stack([i, j, np.full(32, 32)], axis=1), np.stack([j, i, np.full(32, 33)], axis=1)
    source = mesh_source(np.concatenate([rim, [[0, 0, 2.0], [0, 0, 0]]]), np.concatenate(sides))
    half, inner = np.sin(np.pi / 32), np.cos(np.pi / 32)
    assert areas(source, spacing)[1] == pytest.approx(32 * half * (inner + np.hypot(2.0, inner)), rel=1e-12)


def test_the_angle_of_a_crease_is_the_users():
    vertices, faces = cylinder(24, 6)
    keys = {"vertices": vertices, "faces": faces, "closest": "smooth"}
    found = [
        areas(localize(ck.source("mesh.triangles", crease_angle=angle, **keys), np.zeros(3)), 0.2)[1]
        for angle in (40.0, 80.0, 120.0)
    ]
    assert found[0] == found[1]
    assert abs(found[2] - found[0]) > 0.01 * found[0]  # rounded off


def test_a_faceted_mesh_stays_flat():
    sphere = octahedron(2)
    bend, area = areas(mesh_source(sphere.vertices, sphere.cells, "faceted"), 0.2)
    assert bend == "flat"
    assert area == pytest.approx(quadrature(sphere).weights.sum(), rel=1e-13)


def test_what_lies_on_a_boundary_is_lifted_too():
    sphere = octahedron(3)
    source = mesh_source(sphere.vertices, sphere.cells)
    mesh = with_cut(sphere, equator(sphere))
    sunk = mesh.vertices.copy()
    sunk[np.unique(mesh.cut)] *= 0.99
    sunk[np.unique(mesh.cut), 2] += 0.01
    ring = localize(ck.source("analytic.circle", center=[0, 0, 0]), np.zeros(3))
    found = curve_cells(with_cut(type(mesh).of(sunk, mesh.cells), mesh.cut), "normals", source, [ring], 0.2)
    assert np.abs(found.vertices[np.unique(mesh.cut), 2]).max() < 1e-3
    assert np.abs(np.linalg.norm(found.vertices, axis=1) - 1).max() < 1e-3
    assert np.abs(np.linalg.norm(found.midpoints, axis=2) - 1).max() < 1e-3


def test_an_inserted_curve_lies_on_the_sphere_as_the_vertices_of_the_mesh_do():
    """Its vertices that are dense along the curve were left at half their depth below the sphere."""
    sphere = octahedron(4)
    ring = ck.source("analytic.circle", center=[0, 0, 0.3], radius=np.sqrt(0.91))
    source = mesh_source(sphere.vertices, sphere.cells).source
    scene = ck.Scene(source, ck.Laplace(), [ck.Boundary("ring", ring, both=ck.Dirichlet(0.0))])
    sampled = ck.discretize(scene, 0.2, form="galerkin").sampled
    off = np.abs(np.linalg.norm(sampled.lattice.to_scene(sampled.mesh.vertices), axis=1) - 1)
    on_curve = np.unique(sampled.mesh.cut)
    assert off[on_curve].max() < 2 * np.delete(off, on_curve).max() < 1e-5


def test_without_any_vertex_beside_the_curve_nothing_moves():
    flat = Mesh.of(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]), np.array([[0, 1, 2], [1, 3, 2]]))
    moved = fit_vertices_to_normals(flat, np.arange(4), np.tile([0.0, 0, 1], (4, 1)))
    np.testing.assert_array_equal(moved.vertices, flat.vertices)
