"""A picture always results, shows the colours that the solution has, and no renderer's crash is the run's."""

import subprocess
import sys

import numpy as np
import pytest

import cpmkit.view
from cpmkit.errors import InputError, MissingDependencyError
from cpmkit.view import environment, picture, probe
from cpmkit.view.camera import fit
from cpmkit.view.drawing import _disc_radii, discs

image = pytest.importorskip("matplotlib.image")


@pytest.fixture(scope="session")
def answering():
    """Skip where no OpenGL answers."""
    reason = probe()
    if reason:
        pytest.skip(reason)


def near(pixels, colour, tolerance=0.12):
    return (np.abs(pixels[:, :, :3] - colour).max(axis=2) < tolerance).sum()


def show_torus(torus, path, **options):
    drawn = picture(torus(0.15), path, width=300, **options)
    return drawn, image.imread(path)


@pytest.mark.render
def test_opengl_shows_both_sides_in_their_own_colour(answering, torus, tmp_path):
    drawn, pixels = show_torus(torus, tmp_path / "torus.png")
    assert (drawn.renderer, drawn.reason) == ("opengl", "")
    assert pixels.shape[1] == 300
    assert near(pixels, [0.95, 0.35, 0.1]) > 300
    assert near(pixels, [0.1, 0.4, 0.9]) > 300
    assert near(pixels, [0.12, 0.12, 0.14], 0.06) > 100  # the boundary


@pytest.mark.render
def test_the_two_renderers_agree(answering, torus, tmp_path, monkeypatch):
    _, first = show_torus(torus, tmp_path / "first.png")
    monkeypatch.setattr("cpmkit.view._opengl", lambda drawing, path: "not asked")
    _, second = show_torus(torus, tmp_path / "second.png")
    assert first.shape[:2] == second.shape[:2]
    assert np.abs(first[:, :, :3] - second[:, :, :3]).mean() < 0.03


def test_a_crash_of_the_renderer_still_leaves_a_picture(torus, tmp_path, monkeypatch):
    # Without OSMesa this window ends the process with a segmentation fault; with it, it draws.
    monkeypatch.setenv("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")
    drawn, pixels = show_torus(torus, tmp_path / "torus.png")
    assert drawn.renderer == "opengl" or "the OpenGL process" in drawn.reason
    assert near(pixels, [0.95, 0.35, 0.1]) > 300
    assert [found.name for found in tmp_path.iterdir()] == ["torus.png"]


@pytest.mark.parametrize(
    ("ends", "reason"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "ended by SIGSEGV"),
        ("raise ImportError('libGL.so.1 is absent')", "failed: ImportError: libGL.so.1 is absent"),
        ("pass", "failed: exit code 0"),
        ("import time; time.sleep(60)", "did not answer within"),
    ],
)
def test_every_end_of_the_renderer_is_told(torus, tmp_path, monkeypatch, ends, reason):
    run = subprocess.run
    monkeypatch.setattr(subprocess, "run", lambda _, **how: run([sys.executable, "-c", ends], **how))
    monkeypatch.setattr("cpmkit.view.RENDERER_SECONDS", 2.0)
    drawn, pixels = show_torus(torus, tmp_path / "torus.png")
    assert drawn.renderer == "matplotlib"
    assert reason in drawn.reason
    assert np.ptp(pixels) > 0.5


def test_without_curves_there_is_no_ink(torus, tmp_path, monkeypatch):
    monkeypatch.setattr("cpmkit.view._opengl", lambda drawing, path: "not asked")
    _, pixels = show_torus(torus, tmp_path / "torus.png", curves=False)
    assert near(pixels, [0.12, 0.12, 0.14], 0.06) == 0


def test_values_are_shown_in_viridis_beside_a_bar(torus, tmp_path, monkeypatch):
    monkeypatch.setattr("cpmkit.view._opengl", lambda drawing, path: "not asked")
    picture(torus(0.2, channels=1), tmp_path / "torus.png", width=400)
    pixels = image.imread(tmp_path / "torus.png")
    assert pixels.shape[1] == 400
    bar = pixels[:, 360]
    assert np.abs(bar[:, :3] - [0.993, 0.906, 0.144]).max(axis=1).min() < 0.05  # viridis ends in yellow
    assert np.abs(bar[:, :3] - [0.267, 0.005, 0.329]).max(axis=1).min() < 0.05  # and begins in violet


def test_the_plane_needs_no_opengl(square, tmp_path):
    drawn = picture(square(6, line=([1, 0], 0.4)), tmp_path / "square.png", width=200)
    assert drawn.renderer == "matplotlib"
    pixels = image.imread(tmp_path / "square.png")
    left, right = near(pixels, [0.993, 0.906, 0.144], 0.02), near(pixels, [0.267, 0.005, 0.329], 0.02)
    assert left / right == pytest.approx(0.6 / 0.4, rel=0.05)


@pytest.mark.parametrize("software", [False, True])
def test_a_mixture_shows_each_of_its_parts(mixture, tmp_path, monkeypatch, software):
    if software:
        monkeypatch.setattr("cpmkit.view._opengl", lambda drawing, path: "not asked")
    picture(mixture(), tmp_path / "mixture.png", width=400, view=(0, -1, 0.4))
    pixels = image.imread(tmp_path / "mixture.png")[:, :340]
    shown = np.flatnonzero((pixels[:, :, :3].min(axis=2) < 0.9).any(axis=1))
    heights = 1 + np.flatnonzero(np.diff(shown) > 3)
    assert len(heights) == 2  # the plane, the line and the cloud, one above the other, do not touch
    rows = np.split(shown, heights)
    assert len(rows[1]) < 10 < min(len(rows[0]), len(rows[2]))
    for part in rows:
        coloured = pixels[part][:, :, :3]
        assert (coloured[:, :, 2] < 0.5 * coloured[:, :, 1]).any()  # yellow on the left of the wall
        assert (coloured[:, :, 1] < 0.7 * coloured[:, :, 2]).any()  # violet on its right


def even(count, spacing):
    return spacing * np.stack(np.meshgrid(np.arange(count), np.arange(count), [0.0]), -1).reshape(-1, 3)


@pytest.mark.parametrize("points", [even(20, 0.1), 2.0 * np.random.default_rng(0).uniform(size=(400, 3)) * [1, 1, 0]])
def test_discs_leave_no_hole_in_a_cloud(points):
    radii = _disc_radii(points, 0.1, 0.0, 1e-9)
    inside = np.random.default_rng(1).uniform(0.2, 1.7, (4000, 2))
    apart = np.linalg.norm(inside[:, None] - points[:, :2], axis=2)
    assert (apart < np.cos(np.pi / 8) * radii).any(axis=1).mean() > 0.98
    assert radii.max() < 0.4


def test_points_that_are_no_cloud_are_small_discs():
    lonely = np.array([[5.0, 0, 0], [0, 5, 0]])
    radii = _disc_radii(np.concatenate([even(5, 0.1), lonely]), 0.1, 0.0, 0.01)
    np.testing.assert_array_equal(radii[-2:], 0.01)
    assert radii[:-2].min() > 0.05
    np.testing.assert_array_equal(_disc_radii(lonely, 0.1, 0.0, 0.01), 0.01)


def test_discs_lie_in_their_planes_and_face_the_viewer_where_they_have_none():
    normals = np.concatenate([np.eye(3), -np.eye(3), np.zeros((1, 3)), [[0.6, 0.0, 0.8]]])
    centres, radii = np.random.default_rng(2).normal(size=(8, 3)), np.linspace(0.1, 0.8, 8)
    viewer = np.array([0.0, 0.6, 0.8])
    vertices, triangles = discs(centres, normals, radii, viewer)
    offsets = vertices.reshape(8, -1, 3) - centres[:, None]
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=2), np.repeat(radii[:, None], offsets.shape[1], axis=1))
    normals[6] = viewer
    np.testing.assert_allclose(np.einsum("pkd,pd->pk", offsets, normals), 0, atol=1e-15)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    towards = np.einsum("td,td->t", np.cross(b - a, c - a), np.repeat(normals, len(triangles) // 8, axis=0))
    assert towards.min() > 0


@pytest.mark.parametrize(
    ("view", "up"), [(None, None), ((0, 0, 1), None), ((1, 0, 0), (0, 1, 0)), ((3, 1, -2), (1, 1, 1))]
)
def test_the_camera_shows_all_points_as_large_as_it_can(view, up):
    points = np.random.default_rng(3).normal(size=(200, 3)) * [5, 1, 2] + 1e3
    camera = fit(points, 800, view, up)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    seen = np.abs(camera.project(points)[:, :2]).max(axis=0) / camera.half
    assert seen.max() < 1
    assert seen.max() > 0.9
    assert camera.pixels[1] / camera.pixels[0] == pytest.approx(camera.half[1] / camera.half[0], rel=2e-3)
    if view is not None:
        np.testing.assert_allclose(camera.axes[2], np.array(view) / np.linalg.norm(view))


def test_egl_is_chosen_where_there_is_no_display_and_no_choice():
    window = "VTK_DEFAULT_OPENGL_WINDOW"
    assert environment({})[window] == "vtkEGLRenderWindow"
    assert window not in environment({"DISPLAY": ":0"})
    assert environment({window: "vtkOSOpenGLRenderWindow"})[window] == "vtkOSOpenGLRenderWindow"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 2}, "width in pixels must be a whole number from 16 to 16384, got 2"),
        ({"view": (0, 0, 0)}, "view must be a direction"),
        ({"view": (0, 1, 0), "up": (0, -2, 0)}, "view and up must not be parallel"),
    ],
)
def test_what_no_camera_can_show_is_refused(torus, tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        picture(torus(0.3), tmp_path / "torus.png", **options)


def test_a_picture_is_a_png_file(torus):
    with pytest.raises(InputError, match=r"must be a \.png file, got 'torus\.jpg'"):
        picture(torus(0.3), "torus.jpg")


def test_without_matplotlib_the_extra_is_named(torus, monkeypatch):
    monkeypatch.setattr(cpmkit.view, "find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'cpmkit\[view\]'"):
        picture(torus(0.3), "torus.png")
