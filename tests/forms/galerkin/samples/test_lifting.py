"""A coarse mesh that is read as smooth is bent to the surface that it samples, with what is cut into it."""

import numpy as np
import pytest
from sample_shapes import equator, octahedron, with_cut

import cpmkit as ck
from cpmkit.forms.galerkin.samples.bending import bent
from cpmkit.forms.galerkin.samples.clipping import CLIPPED_EDGE_SPACINGS
from cpmkit.forms.galerkin.samples.quadrature import samples_of
from cpmkit.forms.galerkin.samples.sources import cells_of
from cpmkit.manifold.local_source import localize


def mesh_source(vertices, faces, closest="smooth"):
    return localize(ck.source("mesh.triangles", vertices=vertices, faces=faces, closest=closest), np.zeros(3))


def areas(source, spacing):
    drawn = cells_of(source, spacing)
    return drawn.bend, samples_of(bent(drawn.mesh, drawn.bend, source, (), spacing)).weights.sum()


def test_meshes_of_a_sphere_have_its_area_to_order_four():
    errors = []
    for rounds in (2, 3, 4):
        sphere = octahedron(rounds)
        bend, area = areas(mesh_source(sphere.vertices, sphere.cells), 0.1 / CLIPPED_EDGE_SPACINGS)
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


def test_a_faceted_mesh_stays_flat():
    sphere = octahedron(2)
    bend, area = areas(mesh_source(sphere.vertices, sphere.cells, "faceted"), 0.2)
    assert bend == "flat"
    assert area == pytest.approx(samples_of(sphere).weights.sum(), rel=1e-13)


def test_what_lies_on_a_boundary_is_lifted_too():
    sphere = octahedron(3)
    source = mesh_source(sphere.vertices, sphere.cells)
    mesh = with_cut(sphere, equator(sphere))
    sunk = mesh.vertices.copy()
    sunk[np.unique(mesh.cut)] *= 0.99
    sunk[np.unique(mesh.cut), 2] += 0.01
    ring = localize(ck.source("analytic.circle", center=[0, 0, 0]), np.zeros(3))
    found = bent(with_cut(type(mesh).of(sunk, mesh.cells), mesh.cut), "normals", source, [ring], 0.2)
    assert np.abs(found.vertices[np.unique(mesh.cut), 2]).max() < 1e-3
    assert np.abs(np.linalg.norm(found.vertices, axis=1) - 1).max() < 1e-3
    assert np.abs(np.linalg.norm(found.midpoints, axis=2) - 1).max() < 1e-3
