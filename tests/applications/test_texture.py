"""Textures: pixels show the colours of the places that they wrap to; files are read strictly."""

from __future__ import annotations

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.applications import TexturedMesh, bake
from cpmkit.errors import InputError

#: A tube of latitude and longitude, unwrapped to the image with a margin: u goes round, v up.
COLUMNS, ROWS, MARGIN = 48, 9, 0.1


def _tube() -> TexturedMesh:
    j, i = np.divmod(np.arange((COLUMNS + 1) * ROWS), COLUMNS + 1)
    turn, z = 2 * np.pi * i / COLUMNS, 2 * j / (ROWS - 1) - 1
    coordinates = MARGIN + (1 - 2 * MARGIN) * np.stack([i / COLUMNS, j / (ROWS - 1)], axis=1)
    vertex = j * COLUMNS + i % COLUMNS
    vertices = np.zeros((COLUMNS * ROWS, 3))
    vertices[vertex] = np.stack([np.cos(turn), np.sin(turn), z], axis=1)
    a = np.flatnonzero((i < COLUMNS) & (j < ROWS - 1))
    up = COLUMNS + 1
    corners = np.concatenate([np.stack([a, a + 1, a + up + 1], axis=1), np.stack([a, a + up + 1, a + up], axis=1)])
    return TexturedMesh(vertices, vertex[corners], coordinates, corners)


def _rows(mesh: TexturedMesh) -> list[str]:
    faces = [
        "f " + " ".join(f"{v + 1}/{t + 1}" for v, t in zip(*one, strict=True))
        for one in zip(mesh.faces, mesh.corners, strict=True)
    ]
    return [f"v {x} {y} {z}" for x, y, z in mesh.vertices] + [f"vt {u} {v}" for u, v in mesh.coordinates] + faces


@pytest.fixture(scope="module")
def solution() -> ck.Solution:
    """On a cylinder, colours that are linear in z between its rims."""
    mesh = _tube()
    surface = ck.source("mesh.triangles", vertices=mesh.vertices, faces=mesh.faces)
    scene = ck.Scene(surface, ck.Laplace(), edge=ck.Dirichlet(_by_height))
    return ck.solve(scene, 0.2)


def _by_height(points: np.ndarray) -> np.ndarray:
    z = points[:, 2]
    return np.stack([0.5 + 0.5 * z, 0.5 - 0.5 * z, 0 * z + 0.25], axis=1)


def test_pixels_have_the_colours_of_their_places(solution):
    found = bake(solution, _tube(), width=80, height=60)
    line, column = np.nonzero(found.covered)
    v = 1 - (line + 0.5) / 60
    z = 2 * (v - MARGIN) / (1 - 2 * MARGIN) - 1
    np.testing.assert_allclose(found.colours[line, column], _by_height(np.stack([z] * 3, axis=1)), atol=5e-3)
    u = (np.arange(80) + 0.5) / 80
    inside = ((u > MARGIN) & (u < 1 - MARGIN))[None] & (np.abs((np.arange(60) + 0.5) / 60 - 0.5) < 0.5 - MARGIN)[
        :, None
    ]
    np.testing.assert_array_equal(found.covered, inside)


def test_beyond_the_seams_is_the_nearest_colour(solution):
    found = bake(solution, _tube(), width=40)
    at = np.argwhere(found.covered)
    for line, column in np.argwhere(~found.covered)[::37]:
        away = ((at - [line, column]) ** 2).sum(axis=1)
        nearest = at[away == away.min()]
        assert (found.colours[line, column] == found.colours[nearest[:, 0], nearest[:, 1]]).all(axis=1).any()


def test_a_file_and_arrays_bake_the_same_and_the_png_is_one(solution, tmp_path):
    from matplotlib.image import imread

    mesh = _tube()
    (tmp_path / "tube.obj").write_text("\n".join(_rows(mesh)))
    coordinates, corners = ck.read_texture_coordinates(tmp_path / "tube.obj")
    np.testing.assert_array_equal(coordinates[corners], mesh.coordinates[mesh.corners])
    found = bake(solution, tmp_path / "tube.obj", width=32)
    np.testing.assert_allclose(found.colours, bake(solution, mesh, width=32).colours, atol=1e-12)
    read = imread(found.save(tmp_path / "tube.png"))
    np.testing.assert_allclose(read[..., :3], found.colours, atol=0.5 / 255 + 1e-6)


def test_polygons_and_numbers_from_the_end_have_their_coordinates(tmp_path):
    rows = ["v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0.9 0.1 0", "vt 0 0", "vt 1 0", "vt 1 1 0", "vt 0.9 0.1"]
    (tmp_path / "one.obj").write_text("\n".join([*rows, "f 1/-4/1 2/-3/1 3/-2/1 4/-1/1"]))
    (vertices, faces), (coordinates, corners) = (
        read(tmp_path / "one.obj") for read in (ck.read_mesh, ck.read_texture_coordinates)
    )
    np.testing.assert_array_equal(vertices[faces][:, :, :2], coordinates[corners])


@pytest.mark.parametrize(
    ("face", "texture", "words"),
    [
        ("f 1/1 2/2 3", "vt 0 0", "line 6 holds a face with a corner that has none"),
        ("f 1//1 2//1 3//1", "vt 0 0", "a corner that has none"),
        ("f 1/1 2/1 3/2", "vt 0 0", "line 6 names vertex 2, and there are 1"),
        ("f 1/1 2/1 3/x", "vt 0 0", "line 6 holds something else"),
        ("f 1/1 2/1 3/1", "vt 0", "line 4 holds no texture vertex"),
        ("f 1/1 2/1 3/1", "vt 0 a", "something else than numbers"),
    ],
)
def test_damaged_texture_coordinates_are_refused(tmp_path, face, texture, words):
    rows = ["v 0 0 0", "v 1 0 0", "v 0 1 0", texture, "vn 0 0 1", face]
    (tmp_path / "one.obj").write_text("\n".join(rows))
    with pytest.raises(InputError, match=words):
        ck.read_texture_coordinates(tmp_path / "one.obj")


def test_a_real_mesh_without_texture_coordinates_says_so(real_mesh):
    with pytest.raises(InputError, match=r"'spot\.obj': line \d+ holds a face with a corner that has none"):
        ck.read_texture_coordinates(real_mesh("spot.obj"))


def test_what_no_image_can_show_is_refused_or_warned(solution):
    mesh = _tube()
    with pytest.raises(InputError, match=r"from 0 to 1, and exceed that by 0\.9"):
        bake(solution, TexturedMesh(mesh.vertices, mesh.faces, mesh.coordinates + 1.0, mesh.corners))
    with pytest.raises(InputError, match="width in pixels"):
        bake(solution, mesh, width=0)
    folded = mesh.coordinates.copy()
    folded[:, 0] = np.abs(folded[:, 0] - 0.5)
    with pytest.warns(ck.CpmkitWarning, match="triangles overlap at"):
        bake(solution, TexturedMesh(mesh.vertices, mesh.faces, folded, mesh.corners), width=20)
