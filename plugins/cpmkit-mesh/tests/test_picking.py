"""Clicks on a surface become a line on it, which is saved and read as a boundary."""

import numpy as np
import pytest
from cpmkit_mesh.picking import start_line, write_line

import cpmkit as ck
from cpmkit.errors import InputError

SPHERE = ck.source("analytic.sphere")
CLICKS = np.array([[1.0, 0.0, 0.2], [0.1, 1.0, 0.2], [-1.0, 0.1, 0.2], [0.0, -1.1, 0.2]])


def drawn(surface=SPHERE, clicks=CLICKS, closed=False, step=0.02):
    line = start_line(surface, step, closed)
    for click in clicks:
        line = line.with_click(click)
    return line


def test_clicks_are_put_on_the_surface_and_the_line_follows_it():
    line = drawn()
    np.testing.assert_allclose(line.clicks, CLICKS / np.linalg.norm(CLICKS, axis=1, keepdims=True), atol=1e-12)
    points = line.checked_points()
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-12)
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() < 2 * line.step
    apart = np.linalg.norm(points[:, None] - line.clicks, axis=2).min(axis=0)
    np.testing.assert_allclose(apart, 0, atol=1e-12)
    assert np.linalg.norm(drawn(closed=True).checked_points()[[0, -1]] - line.clicks[0], axis=1).max() < 1e-12


def test_the_last_click_is_taken_back_and_the_same_one_counts_once():
    line = drawn()
    assert line.with_click(CLICKS[-1]) is line
    np.testing.assert_array_equal(line.without_last().clicks, line.clicks[:-1])
    assert len(start_line(SPHERE, 0.1).without_last().clicks) == 0


@pytest.mark.parametrize("name", ["line.csv", "line.obj", "line.npy"])
@pytest.mark.parametrize("closed", [False, True])
def test_what_is_written_is_read_as_the_same_polyline(tmp_path, name, closed):
    points = drawn(closed=closed, step=0.2).checked_points()
    write_line(points, tmp_path / name)
    read = ck.source("mesh.polyline", file=tmp_path / name)
    np.testing.assert_array_equal(read.vertices, points[: len(points) - closed])
    assert len(read.segments) == len(points) - 1


def test_a_line_that_jumps_is_refused():
    apart = ck.source("union", members=[SPHERE, ck.source("analytic.sphere", center=[5, 0, 0])])
    line = drawn(apart, CLICKS[:1])
    with pytest.raises(InputError, match="the straight line between two points leaves the surface near"):
        line.with_click([6.0, 0.0, 0.0])
    with pytest.raises(InputError, match="leaves the surface near"):
        drawn(clicks=[[1, 0, 0], [-1, 1e-9, 0]])
    with pytest.raises(InputError, match="a closed line needs 3 points at least, and 2 were picked"):
        drawn(clicks=CLICKS[:2], closed=True).checked_points()
    with pytest.raises(InputError, match="a line needs 2 points at least, and 1 were picked"):
        drawn(clicks=CLICKS[:1]).checked_points()
    with pytest.raises(InputError, match="lines are drawn on surfaces, and this is a curve"):
        start_line(ck.source("analytic.circle"), 0.1)


@pytest.fixture
def clicking(monkeypatch):
    """Let the next window be off screen, and be clicked into instead of shown: at pixels, or by calls."""
    pyvista = pytest.importorskip("pyvista")
    monkeypatch.setattr(pyvista, "OFF_SCREEN", True)

    def on_show(act):
        def show(plotter, *arguments, **options):
            plotter.render()
            act(plotter)
            plotter.close()

        monkeypatch.setattr(pyvista.Plotter, "show", show)

    return on_show


def test_a_window_takes_clicks_and_keys(clicking, tmp_path):
    def act(plotter):
        plotter.camera_position = [(0, 0, 10), (0, 0, 0), (0, 1, 0)]
        plotter.render()
        width, height = plotter.window_size
        for x, y in ((0, 0), (60, 0), (60, 60), (width // 2 - 1, 0), (-30, 30)):  # the fourth is beside the sphere
            plotter.iren.interactor.SetEventInformation(width // 2 + x, height // 2 + y)
            for event in ("RightButtonPressEvent", "RightButtonReleaseEvent"):
                plotter.iren.interactor.InvokeEvent(event)
        plotter.iren.interactor.SetKeySym("BackSpace")
        plotter.iren.interactor.InvokeEvent("KeyPressEvent")

    clicking(act)
    points = ck.pick_line(SPHERE, tmp_path / "line.csv")
    np.testing.assert_allclose(points[0], [0, 0, 1], atol=1e-2)
    assert points[-1, 0] == pytest.approx(points[-1, 1], abs=0.01)
    assert points[-1, 0] > 0.05
    np.testing.assert_array_equal(ck.source("mesh.polyline", file=tmp_path / "line.csv").vertices, points)


def test_a_window_shows_a_solution_and_its_line_is_a_boundary(clicking, monkeypatch, tmp_path):
    import cpmkit_mesh.picking as picking

    made = []
    before = picking.Canvas.__init__
    monkeypatch.setattr(picking.Canvas, "__init__", lambda self, *given: (made.append(self), before(self, *given))[0])
    clicking(lambda plotter: [made[0].click(point) for point in [*CLICKS, [0.0, 1.0, 0.0]][:4]])
    solution = ck.solve(ck.Scene(SPHERE, ck.ScreenedPoisson("x")), spacing=0.3)
    ring = ck.source("mesh.polyline", points=ck.pick_line(solution, closed=True))
    cut = ck.Boundary("ring", ring, left=1.0, right=0.0)
    found = ck.solve(ck.Scene(SPHERE, ck.Laplace(), [cut]), spacing=0.2)
    np.testing.assert_allclose(found.evaluate([[0, 0, 1], [0, 0, -1]]), [1, 0], atol=1e-6)  # left is at the left hand


@pytest.mark.parametrize(
    ("name", "sentence"), [("line.txt", "saved as .csv, .obj, .npy, got 'line.txt'"), ("line", "got 'line'")]
)
def test_other_files_are_refused_before_a_window_opens(name, sentence):
    with pytest.raises(InputError, match=sentence):
        ck.pick_line(SPHERE, name)
    square = ck.source("solid", of=ck.source("analytic.circle"))
    with pytest.raises(InputError, match="OBJ files hold points of space"):
        ck.pick_line(square, "line.obj")
