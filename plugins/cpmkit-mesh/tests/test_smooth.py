"""A smooth mesh answers for the surface that it samples: its feet follow interpolated normals, without jumps."""

import numpy as np
import pytest

from cpmkit_mesh import triangles


def around(rng, count, reach=0.2):
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * rng.uniform(1 - reach, 1 + reach, (count, 1)), direction


def ellipsoid(sphere, level):
    points, faces = sphere(level)
    return points * [1.0, 0.8, 0.6], faces


def phong(mesh, x, rounds=80):
    """Iterate: project the query along the normal at the foot, take the nearest point of that."""
    feet = mesh.closest_point(x)
    for _ in range(rounds):
        normals = mesh.normals(feet)
        height = np.einsum("nk,nk->n", x - feet.points, normals)
        feet = mesh.closest_point(x - height[:, None] * normals)
    return feet


def pair(points, faces):
    return [triangles(vertices=points, faces=faces, closest=closest) for closest in ("smooth", "faceted")]


def test_feet_on_spheres_are_of_second_order_and_far_better_than_facets(sphere):
    x, direction = around(np.random.default_rng(1), 4000)
    errors = []
    for level in (2, 3, 4, 5):
        smooth, faceted = (
            np.linalg.norm(mesh.closest_point(x).points - direction, axis=1) for mesh in pair(*sphere(level))
        )
        errors.append(np.sqrt((smooth**2).mean()))
        tangential = np.linalg.norm(
            np.cross(smooth[:, None] * 0 + pair(*sphere(level))[0].closest_point(x).points, direction), axis=1
        )
        assert tangential.max() < 1e-12
        assert np.sqrt((faceted**2).mean()) > (1.2, 2, 4, 8)[level - 2] * errors[-1]
    order = np.log2(np.array(errors[:-1]) / errors[1:])
    assert order.min() > 1.8
