"""Faces of more than three corners: cut into triangles that fill them, from files as from arrays."""

import numpy as np
import pytest
from cpmkit_mesh import read_mesh, triangles

from cpmkit.errors import InputError

COMB = [(0, 0), (9, 0), (9, 4), (7, 4), (7, 1), (5, 1), (5, 4), (4, 4), (4, 1), (2, 1), (2, 4), (0, 4)]
#: A square with a square hole, joined to the outline by an edge that is passed twice.
KEYHOLE = [(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]
#: Corners on straight sides, and a reflex one.
NOTCHED = [(0, 0), (1, 0), (2, 0), (4, 0), (4, 4), (3, 4), (2, 1), (1, 4), (0, 4), (0, 2)]
PENTAGON = [(0, 0), (2, 0), (3, 1), (1, 2), (0, 1)]


def in_space(flat, axis):
    """Return the polygon in a plane across an axis, or in one across none of them."""
    points = np.column_stack([flat, np.zeros(len(flat))])
    if axis is None:
        return points @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    return np.roll(points, axis, axis=1)


def areas(points, cells):
    a, b, c = (points[cells[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


@pytest.mark.parametrize("axis", [0, 1, 2, None])
@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize(
    ("flat", "area"),
    [(COMB, 24.0), (KEYHOLE, 8.0), (NOTCHED, 13.0), (PENTAGON, 4.0)],
    ids=["comb", "keyhole", "notched", "fan"],
)
def test_a_polygon_is_filled_once(flat, area, flipped, axis):
    points = in_space(flat[::-1] if flipped else flat, axis)
    mesh = triangles(vertices=points, faces=[list(range(len(points)))], closest="faceted")
    parts = areas(mesh.vertices, mesh.faces)
    total = parts.sum(axis=0)
    assert np.linalg.norm(total) == pytest.approx(area, rel=1e-12)
    assert np.linalg.norm(parts, axis=1).sum() == pytest.approx(area, rel=1e-12)
    around = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    assert total @ around > 0


def test_polygons_come_from_files_too(tmp_path):
    lines = [f"v {x} {y} 0" for x, y in COMB] + ["f " + " ".join(str(k + 1) for k in range(len(COMB)))]
    (tmp_path / "comb.obj").write_text("\n".join(lines))
    points, cells = read_mesh(tmp_path / "comb.obj")
    parts = areas(points, cells)[:, 2]
    assert parts.min() > 0
    assert parts.sum() == pytest.approx(24)


def test_a_polygon_that_crosses_itself_is_refused():
    star = [(np.cos(4 * np.pi * k / 5), np.sin(4 * np.pi * k / 5)) for k in range(5)]
    with pytest.raises(InputError, match="face 1 is a polygon of 5 corners that crosses itself, one of 1; cut"):
        triangles(vertices=in_space(star, None), faces=[[0, 1, 2, 3, 4]])


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("axis", [0, 2, None])
def test_a_bow_tie_whose_areas_cancel_is_refused(axis, scale):
    """Its triangles cover each other's sides with opposite winding, and its mean normal vanishes."""
    points = scale * in_space([(0, 0), (1, 1), (1, 0), (0, 1)], axis)
    with pytest.raises(InputError, match="face 1 is a polygon of 4 corners that crosses itself"):
        triangles(vertices=points, faces=[[0, 1, 2, 3]])


def test_a_polygon_whose_corners_lie_on_a_line_is_left_out():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 1, 0]])
    assert triangles(vertices=points, faces=[[0, 1, 2, 3], [0, 3, 4]]).given_mesh[1].shape == (3, 3)


@pytest.mark.parametrize(
    "faces", [[[0, 1, 2, 3]], np.array([[0, 1, 2, 3]]), [[0, 1, 2], [0, 2, 3]], [(0, 1, 2), np.array([0, 2, 3])]]
)
@pytest.mark.parametrize("dim", [2, 3])
def test_arrays_and_lists_of_faces_are_one_mesh(faces, dim):
    """Vertices in the plane are those at z = 0."""
    points = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]])
    mesh = triangles(vertices=points[:, :dim], faces=faces)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert np.array_equal(mesh.vertices, points)


def test_faces_of_unlike_numbers_of_corners_are_one_mesh():
    points = np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0], [3, 0.5, 0]])
    mesh = triangles(vertices=points, faces=[[0, 1, 2, 3], [1, 4, 2]])
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
