"""A moved source answers as the canonical one does in the moved frame, to the last bit where nothing is rounded."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from cpmkit_analytic import arc, cap, circle, cylinder, point, segment, sphere, torus
from cpmkit_analytic.frames import space_frame

from cpmkit.plugin import HasMesh, HasNormals, HasTangents, HasTranslation, as_rotation

SPACE = [
    (point, {"at": [0.3, 0.2, -1.0]}),
    (segment, {"start": [0.3, 0.2, -1.0], "end": [1.0, 1.0, 0.5]}),
    (circle, {"normal": [1.0, 2.0, 3.0], "radius": 0.7}),
    (arc, {"normal": [1.0, 2.0, 3.0], "start": -1.0, "end": 2.0}),
    (sphere, {"center": [0.1, 0.2, 0.3]}),
    (cap, {"axis": [0.0, 1.0, 1.0], "height": -0.3}),
    (torus, {"axis": [1.0, 0.0, 0.0], "minor": 0.2}),
    (cylinder, {"axis": [1.0, 1.0, 1.0], "length": 3.0}),
]
PLANE = [
    (point, {"at": [0.3, 0.2]}),
    (segment, {"start": [0.3, 0.2], "end": [1.0, 1.0]}),
    (circle, {"center": [0.5, 0.5], "radius": 0.7}),
    (arc, {"start": -1.0, "end": 2.0, "x_axis": [1.0, 1.0]}),
    (sphere, {"center": [0.1, 0.2]}),
]


def rotations(dim):
    if dim == 2:
        return 0.8, np.array([[np.cos(0.8), -np.sin(0.8)], [np.sin(0.8), np.cos(0.8)]])
    vector = np.array([0.4, -0.3, 1.2])
    angle, axis = np.linalg.norm(vector), vector / np.linalg.norm(vector)
    turned = [
        np.cos(angle) * e + np.sin(angle) * np.cross(axis, e) + (1 - np.cos(angle)) * (axis @ e) * axis
        for e in np.eye(3)
    ]
    return vector, np.stack(turned, axis=1)


@pytest.mark.parametrize(("factory", "keys"), SPACE + PLANE)
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_motion_acts_on_feet_distances_normals_tangents_and_meshes(factory, keys, scale):
    still = factory(**keys)
    given, matrix = rotations(still.dim)
    shift = scale * np.array([5.0, -7.0, 2.0])[: still.dim]
    moved = factory(**keys, rotation=given, translation=shift, scale=scale)
    x = np.random.default_rng(3).uniform(-2, 2, (50, still.dim))
    here, there = still.closest_point(x), moved.closest_point(shift + scale * x @ matrix.T)
    assert there.points == pytest.approx(shift + scale * here.points @ matrix.T, abs=2e-14 * scale)
    assert there.distance == pytest.approx(scale * here.distance, abs=2e-14 * scale)
    assert np.array_equal(there.edge, here.edge)
    for ability in ("normals", "tangents"):
        assert hasattr(moved, ability) == hasattr(still, ability)
        if hasattr(moved, ability):
            turned = getattr(still, ability)(here) @ matrix.T
            assert getattr(moved, ability)(there) == pytest.approx(turned, abs=1e-13)
    vertices, cells = moved.mesh(0.3 * scale)
    assert vertices == pytest.approx(shift + scale * still.mesh(0.3)[0] @ matrix.T, abs=2e-14 * scale)
    assert np.array_equal(cells, still.mesh(0.3)[1])


def test_a_matrix_and_a_rotation_vector_give_the_same_source():
    vector, matrix = rotations(3)
    assert torus(rotation=vector).axes == pytest.approx(torus(rotation=matrix).axes, abs=1e-15)


@pytest.mark.parametrize(
    ("far", "near", "offset"),
    [
        (circle(center=[1e9, 1e9]), circle(), [-1e9, -1e9]),
        (sphere(center=[1e9, -1e9, 3e8]), sphere(), [-1e9, 1e9, -3e8]),
        (torus(center=[1e9, -1e9, 3e8], axis=[1, 2, 3]), torus(axis=[1, 2, 3]), [-1e9, 1e9, -3e8]),
        (segment(start=[1e9, 0], end=[1e9 + 2, 1]), segment(start=[0, 0], end=[2, 1]), [-1e9, 0]),
        (arc(center=[0, 1e9], start=1, end=2), arc(start=1, end=2), [0, -1e9]),
    ],
)
def test_translated_back_from_afar_a_source_is_the_one_at_the_origin_bit_for_bit(far, near, offset):
    back = far.translate(offset)
    x = np.random.default_rng(5).uniform(-2, 2, (200, near.dim))
    first, second = back.closest_point(x), near.closest_point(x)
    assert np.array_equal(first.points, second.points)
    assert np.array_equal(first.distance, second.distance)
    assert np.array_equal(first.edge, second.edge)
    assert np.array_equal(back.bounds, near.bounds)


def test_distances_stay_accurate_far_from_zero():
    x = np.array([[1e9 + 0.5, 1e9], [1e9, 1e9 - 2.0]])  # without rounding
    assert circle(center=[1e9, 1e9]).closest_point(x).distance == pytest.approx([0.5, 1.0], rel=1e-15)


@pytest.mark.parametrize(("factory", "keys"), SPACE + PLANE)
def test_bounds_are_the_smallest_box(factory, keys):
    source = factory(**keys)
    vertices = source.mesh(0.01)[0]
    lower, upper = source.bounds
    assert vertices.min(axis=0) == pytest.approx(lower, abs=1e-4)
    assert vertices.max(axis=0) == pytest.approx(upper, abs=1e-4)
    assert (vertices >= lower - 1e-14).all()
    assert (vertices <= upper + 1e-14).all()


@pytest.mark.parametrize(
    "axis", [*np.eye(3), *-np.eye(3), [1, 1, 1], [1e-8, 1, 0], [1e200, 1e200, 0], [3e-200, 0, 1e-200]]
)
def test_frames_are_right_handed_rotations_with_the_axis_last(axis):
    frame = space_frame(axis)
    assert frame.T @ frame == pytest.approx(np.eye(3), abs=4e-16)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    largest = np.abs(axis).max()
    assert np.cross(frame[:, 2], np.asarray(axis) / largest) == pytest.approx(np.zeros(3), abs=1e-15)
    assert frame[:, 2] @ (np.asarray(axis) / largest) > 0


def test_the_usual_axis_and_no_rotation_leave_coordinates_as_they_are():
    assert np.array_equal(space_frame([0, 0, 2.0]), np.eye(3))
    assert np.array_equal(as_rotation(None, 3), np.eye(3))
    assert np.array_equal(as_rotation(None, 2), np.eye(2))
    assert np.array_equal(as_rotation([0, 0, 0], 3), np.eye(3))


@pytest.mark.parametrize(
    ("source", "normals", "tangents"),
    [
        (point(at=[0, 0]), False, False),
        (point(at=[0, 0, 0]), False, False),
        (segment(start=[0, 0], end=[1, 0]), True, True),
        (segment(start=[0, 0, 0], end=[1, 0, 0]), False, True),
        (circle(), True, True),
        (circle(normal=[0, 0, 1]), False, True),
        (arc(start=0, end=1), True, True),
        (arc(start=0, end=1, center=[0, 0, 0]), False, True),
        (sphere(), True, False),
        (sphere(center=[0, 0]), True, True),
        (cap(), True, False),
        (torus(), True, False),
        (cylinder(), True, False),
    ],
)
def test_a_source_claims_the_abilities_that_it_has_and_no_other(source, normals, tangents):
    assert isinstance(source, HasNormals) == normals
    assert isinstance(source, HasTangents) == tangents
    assert isinstance(source, HasMesh)
    assert isinstance(source, HasTranslation)


def test_tangents_run_from_start_to_end_and_counterclockwise_about_the_normal():
    line = segment(start=[1, 2, 3], end=[-1, 0, 2])
    for source in (line, arc(start=1, end=6, normal=[1, 1, 0]), circle(normal=[1, 2, 2])):
        vertices = source.mesh(0.01)[0]
        ahead = source.tangents(source.closest_point(0.5 * (vertices[1:] + vertices[:-1])))
        steps = np.diff(vertices, axis=0)
        steps /= np.linalg.norm(steps, axis=1, keepdims=True)
        assert ahead == pytest.approx(steps, abs=1e-6)
    ring = circle(center=[1, 1, 1], normal=[0, -2, 0])
    feet = ring.closest_point(np.random.default_rng(1).uniform(-2, 2, (20, 3)))
    turn = np.cross(feet.points - 1.0, ring.tangents(feet))
    assert turn == pytest.approx(np.tile([0.0, -1.0, 0.0], (20, 1)), abs=1e-14)


def test_normals_of_plane_curves_lie_at_the_right_hand_of_travel_which_is_outside_of_a_circle():
    x = np.array([[3.0, 1.0], [0.2, 0.1]])
    for source in (circle(), arc(start=-1, end=2), segment(start=[0, 0], end=[1, 1])):
        feet = source.closest_point(x)
        normals, tangents = source.normals(feet), source.tangents(feet)
        right = np.stack([tangents[:, 1], -tangents[:, 0]], axis=1)
        assert normals == pytest.approx(right)
    feet = circle().closest_point(x)
    assert circle().normals(feet) == pytest.approx(feet.points)


@pytest.mark.parametrize(
    "source", [sphere(radius=2), cap(radius=2, height=-1), torus(axis=[1, 1, 0]), cylinder(), circle()]
)
def test_normals_are_the_gradient_of_the_distance_outside(source):
    rng = np.random.default_rng(11)
    feet = source.closest_point(rng.uniform(-2, 2, (60, source.dim)))
    feet = feet.take(feet.edge < 0)
    normals = source.normals(feet)
    outside, h = feet.points + 0.1 * normals, 1e-5
    gradient = [
        (source.closest_point(outside + h * e).distance - source.closest_point(outside - h * e).distance) / (2 * h)
        for e in np.eye(source.dim)
    ]
    assert np.stack(gradient, axis=1) == pytest.approx(normals, abs=1e-8)
    vertices = source.mesh(0.05)[0]
    farthest = source.closest_point(vertices[vertices[:, 0].argmax(), None])
    assert source.normals(farthest)[0, 0] > 0.9  # outward: the point farthest along x looks along x


def test_translations_add_up():
    steps = [np.zeros(2), np.array([1.5, -2.0]), np.array([0.25, 4.0])]
    source = circle()
    for before, after in pairwise(np.cumsum(steps, axis=0)):
        source = source.translate(after - before)
    assert source.center == pytest.approx([1.75, 2.0])
