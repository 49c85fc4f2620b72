"""Films have a frame a frame, all of one scale; pages draw in a browser without an error."""

import base64
import hashlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from PIL import Image, ImageSequence

import cpmkit as ck
from cpmkit.errors import InputError

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
BROWSER_OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--disable-quic"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--enable-logging=stderr", "--window-size=600,500", "--virtual-time-budget=4000"),
)


@pytest.fixture(scope="module")
def cooling():
    ball = ck.source("analytic.sphere")
    heat = ck.Heat(lambda x: x[:, 2], until=0.5, step=0.1, frames=5)
    return ck.solve(ck.Scene(ball, heat), 0.3)


def test_the_frames_are_of_one_scale_and_one_size(cooling, tmp_path):
    import matplotlib

    with Image.open(cooling.animate(tmp_path / "film.gif", width=200)) as film:
        images = [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]
    assert len(images) == len(cooling.frames) == 6
    assert {image.shape for image in images} == {images[0].shape}
    place = 130  # of 200 columns the bar takes 70
    bars = [image[20:, place + 4 :].astype(float) for image in images]
    for bar in bars[1:]:
        assert np.abs(bar - bars[0]).mean() < 1  # of 255: a GIF has 256 colours a frame
    highest = matplotlib.colormaps["viridis"](np.arange(243, 256))[:, :3]  # a twentieth of the bar
    shares = [
        (np.abs(image[30:, : place - 6][:, :, None] / 255 - highest).max(axis=3).min(axis=2) < 0.02).mean()
        for image in images
    ]
    assert shares[0] > 0.01
    assert shares[-1] == 0  # it cools


def test_a_gif_and_an_mp4_have_all_frames(cooling, tmp_path):
    assert cooling.animate(tmp_path / "film.gif", fps=5, width=120) == tmp_path / "film.gif"
    with Image.open(tmp_path / "film.gif") as film:
        assert (film.n_frames, film.info["duration"]) == (6, 200)
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    cooling.animate(tmp_path / "film.mp4", fps=5, width=121)
    assert ffmpeg.count_frames_and_secs(str(tmp_path / "film.mp4"))[0] == 6
    with pytest.raises(InputError, match=r"A film must be a \.gif or \.mp4 file, got 'film\.avi'"):
        cooling.animate(tmp_path / "film.avi")


def test_a_film_of_the_error_is_refused(cooling, tmp_path):
    with pytest.raises(InputError, match="the error at the end"):
        cooling.animate(tmp_path / "film.gif", field="error")
    assert not list(tmp_path.iterdir())


def test_a_page_of_the_error_of_modes_shows_the_largest(tmp_path):
    modes = ck.solve(ck.Scene(ck.source("analytic.circle"), ck.Eigen(count=3)), 0.2)
    (field,) = read(page_of(modes, tmp_path, field="error"))["fields"]
    values = np.frombuffer(base64.b64decode(field["values"]), "<f4")
    assert values == pytest.approx(modes.error.on_mesh(modes.display_mesh()).max(axis=1), rel=1e-5, abs=1e-9)


def test_a_film_needs_frames(tmp_path):
    still = ck.solve(ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0)), 0.3)
    with pytest.raises(InputError, match="a film needs frames, and the solution has none"):
        still.save(tmp_path / "film.gif")
    with pytest.raises(InputError, match="request them from a problem in time, such as Heat"):
        still.animate(tmp_path / "film.gif")
    with pytest.raises(InputError, match=r"cannot be saved as 'a\.png'; solution\.picture\(path\) draws a \.png; "):
        still.save(tmp_path / "a.png")


def read(page):
    return json.loads(re.search(r'<script id="data"[^>]*>(.*?)</script>', page, re.S)[1])


def test_a_page_holds_the_mesh_and_the_values_and_loads_nothing(cooling, tmp_path):
    cooling.save(tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert not re.search(r"(src|href)\s*=|https?://|import\s*\(|fetch\(", page)
    data, mesh = read(page), cooling.display_mesh()
    points = np.frombuffer(base64.b64decode(data["points"]), "<f4").reshape(-1, 3)
    assert np.ptp(points, axis=0) == pytest.approx(np.ptp(mesh.points, axis=0), rel=1e-6)
    values = [np.frombuffer(base64.b64decode(field["values"]), "<f4") for field in data["fields"]]
    assert [len(one) for one in values] == [len(mesh.points)] * 6
    assert values[-1] == pytest.approx(cooling.frame_meshes()[-1].values[:, 0], abs=1e-6)
    assert data["ends"] == pytest.approx([min(map(np.min, values)), max(map(np.max, values))])


def test_titles_cannot_leave_their_place(cooling, tmp_path):
    page = page_of(cooling, tmp_path, title="</title><script>alert(1)</script>", label="</script><b>")
    assert page.count("<script") == 2
    assert read(page)["label"] == "</script><b>"
    tag = "<img src=x onerror=alert(1)>"
    page = page_of(cooling, tmp_path, title="__DATA____TITLE__", label=f"__TITLE__{tag}&amp;")
    assert page.count("__DATA____TITLE__") == 2  # the title, and the header
    assert tag not in page
    assert read(page)["label"] == f"__TITLE__{tag}&amp;"


def page_of(solution, folder, **options):
    """Return the text of the page that a solution is saved as."""
    solution.save(folder / "page.html", **options)
    return (folder / "page.html").read_text()


def digest_of(text):
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def test_a_page_runs_its_own_script_alone(cooling, tmp_path):
    page = page_of(cooling, tmp_path, title="'; script-src *")
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    for tag in ("script", "style"):
        (content,) = re.findall(f"<{tag}>(.*?)</{tag}>", page, re.S)
        assert rules[f"{tag}-src"] == f"'sha256-{digest_of(content)}'"


def opened(page, tmp_path):
    """Return the page's pixels in a browser, and what its console says."""
    (tmp_path / "page.html").write_text(page)
    shot = tmp_path / "shot.png"
    command = [str(CHROMIUM), *BROWSER_OPTIONS, f"--user-data-dir={tmp_path / 'user'}", f"--screenshot={shot}"]
    done = subprocess.run(
        [*command, (tmp_path / "page.html").as_uri()], capture_output=True, text=True, timeout=120, check=False
    )
    said = [line for line in done.stderr.splitlines() if "CONSOLE" in line and "GL Driver Message" not in line]
    with Image.open(shot) as image:
        return np.asarray(image.convert("RGB")).astype(float) / 255, said


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed: the page was not opened")
def test_a_browser_draws_the_page_without_an_error(cooling, tmp_path):
    page = page_of(cooling, tmp_path, clim=(-2.0, 2.0))
    pixels, said = opened(page, tmp_path)
    assert said == []
    model = pixels[60:430, 60:440]
    coloured = model[np.ptp(model, axis=2) > 0.1]
    assert len(coloured) > 0.2 * model.shape[0] * model.shape[1]
    ends = [np.frombuffer(base64.b64decode(read(page)["table"]), "u1").reshape(-1, 3)[k] / 255 for k in (90, 185)]
    for end in ends:  # u runs from -1 to 1 on a bar from -2 to 2
        assert np.abs(coloured - end).max(axis=1).min() < 0.02


@pytest.mark.browser
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed: the page was not opened")
def test_a_page_of_colours_can_be_resized(tmp_path):
    """It has no bar, which the second size once looked for."""
    red = ck.solve(ck.Scene(ck.source("analytic.sphere"), ck.ScreenedPoisson([1.0, 0.1, 0.1])), 0.5)
    resize = "console.log('resized'); window.onresize(); window.onresize(); console.log('drawn');\n"
    page = page_of(red, tmp_path)
    (script,) = re.findall("<script>(.*?)</script>", page, re.S)
    changed = page.replace(script, script + resize).replace(digest_of(script), digest_of(script + resize))
    pixels, said = opened(changed, tmp_path)
    assert [re.search("resized|drawn|$", line)[0] for line in said] == ["resized", "drawn"], said
    assert (np.abs(pixels - [1.0, 0.1, 0.1]).max(axis=2) < 0.6).mean() > 0.1


def test_a_notebook_gets_a_frame_and_a_terminal_a_browser(cooling, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or True)
    page = cooling.show()
    assert opened == [page.file.as_uri()]
    page.file.unlink()
    monkeypatch.setattr("webbrowser.open", lambda address: False)
    with pytest.raises(InputError, match=r"no browser opens here; copy .*\.html to where one does") as error:
        cooling.show()
    (file,) = re.findall(r"/\S+\.html", str(error.value))
    Path(file).unlink()
    shell = type("ZMQInteractiveShell", (), {})()
    kernel = ModuleType("IPython")
    kernel.get_ipython = lambda: shell
    monkeypatch.setitem(sys.modules, "IPython", kernel)
    html = cooling.show()._repr_html_()
    assert html.startswith("<iframe srcdoc=")
    assert "<canvas" not in html  # escaped


def test_a_plot_is_on_the_axes_that_are_given(cooling):
    shown = []
    axes = SimpleNamespace(imshow=shown.append, set_axis_off=lambda: None)
    assert cooling.plot(axes, width=150) is axes
    assert shown[0].shape[1] == 150
