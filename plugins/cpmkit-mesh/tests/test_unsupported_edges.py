"""A mesh that is read as smooth says how much of its area does not support that."""

import coarse_meshes as meshes
import numpy as np
import pytest
from cpmkit_mesh import triangles
from cpmkit_mesh.unsupported_edges import tilt_normals_at_unsupported_edges

import cpmkit as ck


def warnings(mesh, **keys):
    return [text for text in triangles(vertices=mesh[0], faces=mesh[1], **keys).advice(0.1).warnings if "area" in text]


@pytest.mark.parametrize(
    ("mesh", "percent"),
    [
        (meshes.rounded_box(2, 0.15)[0], 98),
        (meshes.capsule(16)[0], 67),
        (meshes.terrain(1.0, 0.06, 0.03, 5), 93),
    ],
    ids=["box", "capsule", "terrain"],
)
def test_there_is_a_warning_of_flat_faces_beside_narrow_turns(mesh, percent):
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
    warnings = ck.prepare(ck.Scene(source, ck.ScreenedPoisson(1.0)), 0.2, form=form).discretized.warnings()
    assert any("of the mesh's area" in text for text in warnings)


def above(mesh, inside, height):
    """Return points at a height above those triangles of a mesh that are horizontal and ``inside``."""
    corners = mesh[0][mesh[1]]
    level = (np.ptp(corners[:, :, 2], axis=1) < 1e-9) & inside(corners[:, :, 2].min(axis=1))
    mixes = np.random.default_rng(0).dirichlet(np.ones(3), 20)
    return np.einsum("qc,fck->fqk", mixes, corners[level]).reshape(-1, 3) + [0, 0, height]


@pytest.mark.parametrize(
    ("mesh", "inside"),
    [
        (meshes.rounded_box(2, 0.15)[0], lambda z: z > 0.44),
        (meshes.rounded_box(2, 0.3)[0], lambda z: z > 0.59),
        (meshes.terrain(1.0, 0.06, 0.03, 5), lambda z: z > 0.02),
    ],
    ids=["box", "box with wide fillets", "terrain"],
)
def test_closest_points_on_flat_faces_beside_fillets_are_straight_below(mesh, inside):
    x = above(mesh, inside, 0.1)
    assert len(x) > 30
    feet = triangles(vertices=mesh[0], faces=mesh[1]).closest_point(x).points
    assert np.abs(feet - x)[:, :2].max() < 2e-3


@pytest.mark.parametrize(
    "mesh",
    [
        meshes.hull(meshes.icosphere(2)),
        meshes.torus(48, 12),
        meshes.torus(16, 32),
        (meshes.hull(meshes.icosphere(2))[0] * [1, 1, 0.3], meshes.hull(meshes.icosphere(2))[1]),
        ck.source("analytic.cylinder").mesh(0.3),
    ],
    ids=["sphere", "torus of long triangles", "torus of short triangles", "ellipsoid", "cylinder"],
)
def test_closest_points_on_smooth_shapes_follow_the_normals_as_they_are(mesh):
    smooth = triangles(vertices=mesh[0], faces=mesh[1])
    assert tilt_normals_at_unsupported_edges(smooth) is smooth.normals_at_corners
