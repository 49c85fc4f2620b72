"""A mesh that is read as smooth says how much of its area does not support that."""

import coarse_meshes as meshes
import pytest
from cpmkit_mesh import triangles

import cpmkit as ck


def warnings(mesh, **keys):
    return [text for text in triangles(vertices=mesh[0], faces=mesh[1], **keys).own_warnings(0.1) if "area" in text]


@pytest.mark.parametrize(
    ("mesh", "percent"),
    [
        (meshes.rounded_box(2, 0.15)[0], 98),
        (meshes.capsule(16)[0], 67),
        (meshes.terrain(1.0, 0.06, 0.03, 5), 93),
    ],
    ids=["box", "capsule", "terrain"],
)
def test_flat_faces_beside_narrow_turns_are_told_with_what_to_do(mesh, percent):
    (text,) = warnings(mesh)
    assert text.startswith(f"{percent}% of the mesh's area ")
    assert "closest = 'faceted'" in text
    assert not warnings(mesh, closest="faceted")


@pytest.mark.parametrize(
    "mesh",
    [
        meshes.hull(meshes.icosphere(2)),
        meshes.torus(16, 32),
        meshes.random_sphere(200),
        meshes.random_sphere(500, (1, 1, 0.3)),
        ck.source("analytic.cylinder").mesh(0.3),
        meshes.hull(meshes.HALF * [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]),
    ],
    ids=["sphere", "torus", "random sphere", "random ellipsoid", "cylinder", "box"],
)
def test_smooth_shapes_and_bodies_with_sharp_edges_are_not(mesh):
    assert not warnings(mesh)


@pytest.mark.parametrize("form", ["galerkin", "collocation"])
def test_both_forms_say_so_where_a_mesh_was_moved_too(form):
    (vertices, faces), _ = meshes.rounded_box(1, 0.3)
    source = ck.source("moved", of=ck.source("mesh.triangles", vertices=vertices, faces=faces), translation=[5, 0, 0])
    told = ck.prepare(ck.Scene(source, ck.ScreenedPoisson(1.0)), 0.2, form=form).discretized.warnings()
    assert any("of the mesh's area" in text for text in told)
