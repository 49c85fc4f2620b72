"""Normals at vertices agree with the chords between them, and so come nearer to those of the surface sampled."""

import numpy as np
import pytest
from cpmkit_mesh import triangles
from cpmkit_mesh.corner_normals import ROUGH_CHORD_RADIANS, corner_normals, fit_normals_to_chords
from cpmkit_mesh.topology import topology
from scipy.spatial import ConvexHull

AXES = np.array([1.0, 0.7, 0.45])


def at_vertices(points, faces):
    normals = np.zeros_like(points)
    normals[faces.ravel()] = triangles(vertices=points, faces=faces).normals_at_corners.reshape(-1, 3)
    return normals


def averages(points, faces):
    """Return the normals before they are tilted: averages over the triangles around each vertex."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("cpmkit_mesh.corner_normals.fit_normals_to_chords", lambda *arguments: arguments[3])
        normals = np.zeros_like(points)
        normals[faces.ravel()] = corner_normals(points, faces, topology(points, faces)).reshape(-1, 3)
    return normals


def ellipsoid(points, faces):
    """Return a mesh inscribed in an ellipsoid, its triangles wound outwards, and the ellipsoid's normals."""
    normals = points / AXES
    return points * AXES, faces, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def scattered(count):
    """Return random points of the unit sphere and the triangles between them."""
    points = np.random.default_rng(count).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = ConvexHull(points).simplices.copy()
    inwards = np.linalg.det(points[faces]) < 0
    faces[inwards] = faces[inwards, ::-1]
    return points, faces


def wave(count):
    """Return an open patch of a graph, its triangles wound upwards, and the graph's normals."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, count)] * 2, indexing="ij")
    points = np.stack([x, y, 0.3 * np.sin(2 * x + y)], axis=2).reshape(-1, 3)
    slope = 0.3 * np.cos(2 * x + y).ravel()
    normals = np.stack([-2 * slope, -slope, np.ones_like(slope)], axis=1)
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = np.concatenate([corner[:, None] + [0, count, count + 1], corner[:, None] + [0, count + 1, 1]])
    return points, faces, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def rms(vectors):
    return np.sqrt((vectors**2).sum(axis=1).mean())


def errors(meshes):
    """Return the rms errors of averages and of tilted normals on each mesh of points, faces and exact normals."""
    return np.array([[rms(find(*mesh[:2]) - mesh[2]) for find in (averages, at_vertices)] for mesh in meshes])


def test_normals_of_an_ellipsoid_become_more_than_twice_as_accurate(sphere):
    tilted = errors([ellipsoid(*sphere(level)) for level in (3, 4, 5, 6)])
    assert (tilted[:, 0] > 2.5 * tilted[:, 1]).all()


def test_normals_of_scattered_vertices_become_more_accurate():
    tilted = errors([ellipsoid(*scattered(count)) for count in (600, 2400, 9600)])
    assert (tilted[:, 0] > 1.5 * tilted[:, 1]).all()


def test_normals_of_an_open_patch_become_more_accurate_and_stay_of_second_order():
    tilted = errors([wave(count) for count in (9, 17, 33, 65)])
    assert (tilted[:, 0] > 1.3 * tilted[:, 1]).all()
    assert np.log2(tilted[:-1] / tilted[1:]).min() > 2


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_normals_of_a_sphere_stay_as_they_are(sphere, scale):
    points, faces = sphere(3)
    np.testing.assert_allclose(at_vertices(points * scale, faces), points, atol=1e-13)


def test_tilts_are_those_of_least_squares(sphere):
    points, faces, _ = ellipsoid(*sphere(1))
    before = averages(points, faces)
    edges = {tuple(sorted(pair)) for face in faces.tolist() for pair in zip(face, face[1:] + face[:1], strict=True)}
    rows, right = [], []
    for a, b in edges:
        chord = (points[b] - points[a]) / np.linalg.norm(points[b] - points[a])
        off = chord @ (before[a] + before[b])
        row = np.zeros_like(points)
        row[a], row[b] = (chord - (chord @ before[k]) * before[k] for k in (a, b))
        weight = (1 + (off / ROUGH_CHORD_RADIANS) ** 2) ** -0.5
        rows.append(weight * row.ravel())
        right.append(-weight * off)
    matrix = np.concatenate([np.array(rows), np.eye(points.size)])
    tilt = np.linalg.lstsq(matrix, np.r_[right, np.zeros(points.size)])[0].reshape(-1, 3)
    assert 1e-3 < np.linalg.norm(tilt, axis=1).max() < 0.1
    after = before + tilt
    after /= np.linalg.norm(after, axis=1, keepdims=True)
    np.testing.assert_allclose(fit_normals_to_chords(points, faces, topology(points, faces), before), after, atol=1e-10)


def test_creases_are_hardly_tilted():
    """A strip folded by a right angle: the chords beside the crease tell nothing of a smooth surface."""
    x, y = np.meshgrid(np.arange(-4.0, 5), np.arange(9.0), indexing="ij")
    points = np.stack([np.minimum(x, 0), y, np.maximum(x, 0)], axis=2).reshape(-1, 3)
    corner = (np.arange(8)[:, None] * 9 + np.arange(8)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 9, 10], corner[:, None] + [0, 10, 1]])
    flipped = np.einsum("ij,ij->i", averages(points, faces), at_vertices(points, faces))
    assert flipped.min() > np.cos(0.02)
