"""Pictures show the colours that the solution has, in their place, and the camera all of the model."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

import cpmkit as ck
import cpmkit.view.pictures
from cpmkit.errors import InputError, MissingDependencyError
from cpmkit.plugin import DisplayMesh
from cpmkit.scenefile.look import Look
from cpmkit.view import picture
from cpmkit.view.drawing import draw_mesh
from cpmkit.view.showing import plot

matplotlib = pytest.importorskip("matplotlib")
image = pytest.importorskip("matplotlib.image")
#: Of 255: an eight bit colour and the bar's own steps.
LEVELS = 2.5 / 255


def colour_table(cmap):
    """Return the colours (256, 3) of a map."""
    return matplotlib.colormaps[cmap](np.arange(256))[:, :3]


def model_width(width):
    """Return the columns that the colour bar leaves: it takes 12 percent, at least 78 pixels, at most 35 percent."""
    return width - round(max(0.12 * width, min(78, 0.35 * width)))


def near(pixels, colour, tolerance=0.12):
    return (np.abs(pixels[:, :, :3] - colour).max(axis=2) < tolerance).sum()


def drawn(solution, path, **options):
    picture(solution, path, **{"width": 300, **options})
    return image.imread(path)[:, :, :3]


def test_both_sides_are_in_their_own_colour(torus, tmp_path):
    pixels = drawn(torus(0.15), tmp_path / "torus.png")
    assert pixels.shape[1] == 300
    assert near(pixels, [0.95, 0.35, 0.1]) > 300
    assert near(pixels, [0.1, 0.4, 0.9]) > 300
    assert near(pixels, [0.12, 0.12, 0.14], 0.06) > 100  # the boundary


def test_a_picture_is_the_same_each_time(torus, tmp_path):
    first, second = (drawn(torus(0.2), tmp_path / f"{k}.png") for k in range(2))
    np.testing.assert_array_equal(first, second)


def field(torus, values):
    """Return a solution in one channel on the torus, without boundaries."""
    solution = torus(0.15, channels=1)
    object.__setattr__(solution, "boundaries", {})
    object.__setattr__(solution, "value", lambda x, signs: values(x))
    return solution


def model(pixels):
    """Return the pixels (n, 3) of the model: no background, no dark line, no bar."""
    inside = pixels[:, : model_width(300)].reshape(-1, 3)
    return inside[(inside.min(axis=1) < 0.98) & (np.abs(inside - inside.mean(axis=1)[:, None]).max(axis=1) > 0.05)]


def test_a_constant_has_its_colour_of_the_bar_everywhere(torus, tmp_path):
    solution = field(torus, lambda x: np.full((len(x), 1), 3.0))
    pixels = model(drawn(solution, tmp_path / "flat.png", clim=(0.0, 4.0)))
    want = colour_table("viridis")[round(0.75 * 255)]
    off = np.abs(pixels - want).max(axis=1)
    assert (off <= LEVELS).mean() > 0.97  # the rest is mixed with the background, at the outline
    shaded = model(drawn(solution, tmp_path / "shaded.png", clim=(0.0, 4.0), light="shaded"))
    assert (np.abs(shaded - want).max(axis=1) > 10 / 255).mean() > 0.5


@pytest.mark.parametrize("cmap", ["viridis", "coolwarm"])
def test_every_colour_of_the_model_is_one_of_the_bar(torus, tmp_path, cmap):
    pixels = model(drawn(field(torus, lambda x: np.sin(9 * x[:, :1])), tmp_path / "field.png", cmap=cmap))
    table = colour_table(cmap)
    off = np.abs(pixels[:, None] - table).max(axis=2).min(axis=1)
    assert (off <= LEVELS).mean() > 0.9


def test_a_value_is_where_it_belongs(square, tmp_path):
    solution = square(6, line=([1, 0], 0.4))
    object.__setattr__(solution, "boundaries", {})
    object.__setattr__(solution, "value", lambda x, signs: x[:, :1])
    pixels = drawn(solution, tmp_path / "square.png", width=400)
    row = pixels[len(pixels) // 2, : model_width(400)]
    columns = np.flatnonzero(row.min(axis=1) < 0.98)
    place = np.linspace(0, 1, len(columns))
    want = colour_table("viridis")[np.round(255 * place).astype(int)]
    assert np.abs(row[columns] - want).max(axis=1)[5:-5].max() < 0.02


def test_isolines_are_where_the_value_is(square, tmp_path):
    solution = square(6, line=([1, 0], 0.4))
    object.__setattr__(solution, "boundaries", {})
    object.__setattr__(solution, "value", lambda x, signs: x[:, :1] ** 2)
    pixels = drawn(solution, tmp_path / "lines.png", width=800, isolines=[0.25, 0.64], cmap="Wistia")
    row = pixels[len(pixels) // 3, :700]
    inside = np.flatnonzero(row.min(axis=1) < 0.98)
    dark = np.flatnonzero(row[inside].max(axis=1) < 0.7) / (len(inside) - 1)
    groups = np.split(dark, 1 + np.flatnonzero(np.diff(dark) > 0.02))
    assert [group.mean() for group in groups] == pytest.approx([0.5, 0.8], abs=0.015)  # values are linear in a cell


def test_without_curves_there_is_no_ink(torus, tmp_path):
    pixels = drawn(torus(0.15), tmp_path / "torus.png", curves=False)
    assert near(pixels, [0.12, 0.12, 0.14], 0.06) == 0


def test_values_are_shown_in_viridis_beside_a_bar(torus, tmp_path):
    pixels = drawn(torus(0.2, channels=1), tmp_path / "torus.png", width=400)
    assert pixels.shape[1] == 400
    bar = pixels[:, model_width(400) + 12]
    assert np.abs(bar - [0.993, 0.906, 0.144]).max(axis=1).min() < 0.05  # viridis ends in yellow
    assert np.abs(bar - [0.267, 0.005, 0.329]).max(axis=1).min() < 0.05  # and begins in violet


@pytest.mark.parametrize(("width", "least"), [(200, 5), (300, 7), (400, 7), (900, 9)])
def test_numbers_beside_a_bar_are_tall_enough_to_be_read(torus, tmp_path, width, least):
    pixels = drawn(torus(0.3, channels=1), tmp_path / "torus.png", width=width)
    column = pixels[:, model_width(width) :]
    numbers = column[:, round(0.42 * column.shape[1]) :]
    rows = (numbers.max(axis=2) < 0.6).any(axis=1)
    heights = np.diff(np.flatnonzero(np.diff(np.r_[False, rows, False].astype(int))).reshape(-1, 2), axis=1)
    assert least <= np.median(heights) < 2 * least + 2
    assert model_width(width) > 0.6 * width


def test_the_plane_shows_both_sides_by_their_areas(square, tmp_path):
    pixels = drawn(square(6, line=([1, 0], 0.4)), tmp_path / "square.png", width=200)
    left, right = near(pixels, [0.993, 0.906, 0.144], 0.02), near(pixels, [0.267, 0.005, 0.329], 0.02)
    assert left / right == pytest.approx(0.6 / 0.4, rel=0.05)


def test_a_mixture_shows_each_of_its_parts(mixture, tmp_path):
    pixels = drawn(mixture(), tmp_path / "mixture.png", width=400, view=(0, -1, 0.4))
    pixels = pixels[:, : model_width(400)]
    shown = np.flatnonzero((pixels.min(axis=2) < 0.9).any(axis=1))
    heights = 1 + np.flatnonzero(np.diff(shown) > 3)
    assert len(heights) == 2  # the plane, the line and the cloud, one above the other, do not touch
    rows = np.split(shown, heights)
    assert len(rows[1]) < 10 < min(len(rows[0]), len(rows[2]))
    for part in rows:
        assert (pixels[part][:, :, 2] < 0.5 * pixels[part][:, :, 1]).any()  # yellow on the left of the wall
        assert (pixels[part][:, :, 1] < 0.7 * pixels[part][:, :, 2]).any()  # violet on its right


def test_titles_labels_edges_and_channels(torus, tmp_path):
    plain = drawn(torus(0.2), tmp_path / "a.png", channel=2)
    named = drawn(torus(0.2), tmp_path / "b.png", channel=2, title="Heat", label="temperature", unit="K")
    assert plain.shape[1] == named.shape[1] == 300
    assert near(named[:20], [0, 0, 0], 0.3) > 10
    edges = drawn(torus(0.2), tmp_path / "c.png", channel=2, edges=True)
    assert near(edges, [0.35, 0.35, 0.38], 0.1) > near(plain, [0.35, 0.35, 0.38], 0.1) + 100
    with pytest.raises(InputError, match="channel must be below 3, the number of channels, got 3"):
        picture(torus(0.3), tmp_path / "d.png", channel=3)


def test_arrows_stay_on_the_surface_and_follow_the_vectors(tmp_path):
    ball = ck.source("analytic.sphere")
    around = [lambda x: -x[:, 1], lambda x: x[:, 0], lambda x: 0 * x[:, 0]]
    solution = ck.solve(ck.Scene(ball, ck.ScreenedPoisson(around)), 0.25)
    options = {"width": 600, "view": (0, -1, 0), "up": "z"}
    pixels, bare = (drawn(solution, tmp_path / f"{on}.png", vectors=on, channel=0, **options) for on in (True, False))
    columns = model_width(600) - 4
    dark, light = (
        (np.abs(pixels - colour).max(axis=2) < 0.05) & (np.abs(bare - colour).max(axis=2) > 0.1)
        for colour in ([0.12, 0.12, 0.14], [0.9, 0.9, 0.9])
    )
    arrows, model = (dark | light)[:, :columns], (bare.min(axis=2) < 0.98)[:, :columns]
    assert arrows.sum() > 200
    assert (arrows & ~model).sum() < 0.02 * arrows.sum()
    level, upright = (arrows[:, 1:] & arrows[:, :-1]).sum(), (arrows[1:] & arrows[:-1]).sum()
    assert level > 1.3 * upright  # about the axis, which is upright
    with pytest.raises(InputError, match="vectors have as many channels as coordinates, 3, got 1"):
        picture(ck.solve(ck.Scene(ball, ck.ScreenedPoisson(1.0)), 0.5), tmp_path / "one.png", vectors=True)


def test_the_modes_of_an_eigenproblem_are_a_sheet_and_one_has_its_colours(tmp_path):
    solution = ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.Eigen(count=4)), 0.3)
    sheet = drawn(solution, tmp_path / "modes.png", width=420)
    assert sheet.shape[1] == 420
    assert solution.titles[0] == "\N{GREEK SMALL LETTER LAMDA} = 0"  # not 3e-15
    one = drawn(solution, tmp_path / "mode.png", width=420, channel=1)
    assert near(sheet, colour_table("coolwarm")[-8], 0.1) > 50
    assert near(one, colour_table("coolwarm")[-8], 0.1) > 50
    assert near(one, colour_table("coolwarm")[8], 0.1) > 50


def even(count, spacing):
    return spacing * np.stack(np.meshgrid(np.arange(count), np.arange(count), [0.0]), -1).reshape(-1, 3)


def cloud(points, normals=None, width=300, **look):
    """Return the drawing of points (n, 3), its discs (n, corners, 3) and their radii (n,), in the camera's axes."""
    numbers = np.arange(len(points))
    mesh = DisplayMesh(points, numbers[:, None], np.zeros((len(points), 1)), normals, len(points))
    solution = SimpleNamespace(scene=SimpleNamespace(boundaries=()), spacing=0.1)
    drawing = draw_mesh(solution, mesh, Look(**look), width, False)
    discs = drawing.points[len(points) :].reshape(len(points), -1, 3)
    radii = np.linalg.norm(discs - drawing.points[: len(points), None], axis=2)
    np.testing.assert_allclose(radii, np.repeat(radii[:, :1], radii.shape[1], axis=1))
    return drawing, discs, radii[:, 0]


@pytest.mark.parametrize("points", [even(20, 0.1), 2.0 * np.random.default_rng(0).uniform(size=(400, 3)) * [1, 1, 0]])
def test_discs_leave_no_hole_in_a_cloud(points):
    radii = cloud(points)[2]
    inside = np.random.default_rng(1).uniform(0.2, 1.7, (4000, 2))
    apart = np.linalg.norm(inside[:, None] - points[:, :2], axis=2)
    assert (apart < np.cos(np.pi / 8) * radii).any(axis=1).mean() > 0.98
    assert radii.max() < 0.4


def test_points_that_are_no_cloud_are_small_discs():
    lonely = np.array([[3.0, 0, 0], [0, 3, 0]])
    radii = cloud(np.concatenate([even(5, 0.1), lonely]))[2]
    assert radii[-1] == pytest.approx(radii[-2])
    assert radii[-1] < 0.04 < 0.05 < radii[:-2].min()
    assert cloud(lonely)[2].max() < 0.04


def test_discs_lie_in_their_planes_and_face_the_viewer_where_they_have_none():
    normals = np.concatenate([np.eye(3), -np.eye(3), np.zeros((1, 3)), [[0.6, 0.0, 0.8]]])
    centres = 0.1 * np.random.default_rng(2).normal(size=(8, 3))
    drawing, discs, _ = cloud(centres, normals)
    normals = normals @ drawing.camera.axes.T
    normals[6] = [0, 0, 1]
    offsets = discs - drawing.points[:8, None]
    np.testing.assert_allclose(np.einsum("pkd,pd->pk", offsets, normals), 0, atol=1e-15)
    a, b, c = (drawing.points[drawing.triangles[:, k]] for k in range(3))
    towards = np.einsum("td,td->t", np.cross(b - a, c - a), np.repeat(normals, len(drawing.triangles) // 8, axis=0))
    assert towards.min() > 0


@pytest.mark.parametrize(
    ("view", "up"),
    [(None, None), ((0, 0, 1), None), ((0, 1, 0), None), (None, "y"), ((1, 0, 0), (0, 1, 0)), ((3, 1, -2), (1, 1, 1))],
)
def test_the_camera_shows_all_points_as_large_as_it_can(view, up):
    points = np.random.default_rng(3).normal(size=(200, 3)) * [5, 1, 2] + 1e3
    camera = cloud(points, width=800, view=view, up=up)[0].camera
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    seen = np.abs(camera.project(points)[:, :2]).max(axis=0) / camera.half
    assert seen.max() < 1
    assert seen.max() > 0.9
    assert camera.pixels[1] / camera.pixels[0] == pytest.approx(camera.half[1] / camera.half[0], rel=2e-3)
    if view is not None:
        np.testing.assert_allclose(camera.axes[2], np.array(view) / np.linalg.norm(view))
    if up == "y":
        assert camera.axes[1, 1] > 0.8


def test_a_model_that_stands_on_its_lowest_y_is_upright_and_its_description_says_so():
    height = np.linspace(0, 2, 400)
    angle = 170.0 * height
    radius = 0.5 - 0.2 * height
    cone = np.column_stack([radius * np.cos(angle), height, radius * np.sin(angle)])
    camera = cloud(cone)[0].camera
    assert camera.axes[1, 1] > 0.8
    assert camera.description == "seen from (0.43, 0.47, 0.78), y up, on which the model stands"
    lying = cone[:, [0, 2, 1]]
    assert cloud(lying)[0].camera.description == "seen from (0.43, -0.78, 0.47), z up"
    assert cloud(cone, up="z")[0].camera.axes[1, 2] > 0.8


@pytest.mark.parametrize("name", ["spot.obj", "nefertiti-lowres.obj"])
def test_real_models_stand_upright(real_mesh, name):
    assert cloud(ck.read_mesh(real_mesh(name))[0])[0].camera.axes[1, 1] > 0.8


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 2}, "width in pixels must be a whole number from 16 to 16384, got 2"),
        ({"view": (0, 0, 0)}, "view must be a direction"),
        ({"view": (0, 1, 0), "up": (0, -2, 0)}, "view and up must not be parallel"),
        ({"up": "w"}, "up of a picture, unless it is three numbers, must be 'x' or 'y' or 'z', got 'w'"),
        ({"light": "bright"}, "light of a picture must be 'flat' or 'shaded', got 'bright'"),
        ({"cmap": "virids"}, r"cmap must name .* got 'virids' \(did you mean 'viridis'\?\)"),
        ({"clim": (2, 1)}, "clim must be two numbers, the lower first, got 2 and 1"),
        ({"isolines": -1}, "isolines must be a whole number from 0 to 1000, got -1"),
        ({"isolines": 3}, "isolines are those of one channel; give channel=."),
        ({"colourmap": "jet"}, "a picture has no option 'colourmap'; accepted are width, view, up"),
        ({"edges": 1}, "edges of a picture must be true or false, got 1"),
    ],
)
def test_options_that_no_picture_can_show_are_refused(torus, tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        picture(torus(0.3), tmp_path / "torus.png", **options)
    assert not list(tmp_path.iterdir())


def test_a_picture_is_a_png_file(torus):
    with pytest.raises(InputError, match=r"must be a \.png file, got 'torus\.jpg'"):
        picture(torus(0.3), "torus.jpg")


def test_without_matplotlib_the_extra_is_named(torus, monkeypatch):
    monkeypatch.setattr(cpmkit.view.pictures, "find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'cpmkit\[view\]'"):
        picture(torus(0.3), "torus.png")
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'cpmkit\[view\]'"):
        plot(torus(0.3))
