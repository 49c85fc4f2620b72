"""The command that draws the gallery: what it draws, that it goes on where it was, and that one failure stops none."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
#: Processor time that two cores have in 20 minutes, less a quarter for waiting at the end.
MOST_SECONDS = 2 * 1200 * 0.75


@pytest.fixture(scope="module")
def gallery():
    spec = importlib.util.spec_from_file_location("gallery", ROOT / "examples" / "gallery.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["gallery"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["gallery"]


def written(gallery, name, text="drawn"):
    code = f"import sys; open(sys.argv[1], 'w').write({text!r})"
    return gallery.Job((name,), 1.0, ("-c", code, "PICTURE"))


def test_every_picture_of_the_gallery_has_a_job_and_what_the_job_runs_is_there(gallery):
    drawn = [name for job in gallery.JOBS for name in job.pictures]
    assert len(drawn) == len(set(drawn))
    shown = re.findall(r"\]\(images/([^)]+)\)", (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8"))
    assert set(shown) - set(drawn) == set()
    assert {name for name in drawn if not (ROOT / "docs" / "images" / name).is_file()} == set()
    for job in gallery.JOBS:
        files = [part for part in job.command if part.endswith((".toml", ".py", ".svg"))]
        assert files
        assert all((gallery.EXAMPLES / file).is_file() for file in files)


def test_it_fits_into_twenty_minutes_of_two_cores(gallery):
    assert sum(job.seconds for job in gallery.JOBS) < MOST_SECONDS


def test_no_picture_of_the_documentation_is_too_large(gallery):
    for name in (name for job in gallery.JOBS for name in job.pictures):
        assert (ROOT / "docs" / "images" / name).stat().st_size <= gallery.MOST_BYTES, name


def test_what_is_drawn_is_not_drawn_again(gallery, tmp_path, capsys):
    jobs = [written(gallery, "a.png"), written(gallery, "b.png")]
    assert gallery.main([str(tmp_path), "--only", "a.png"], jobs) == 0
    assert not (tmp_path / "b.png").exists()
    (tmp_path / "a.png").write_text("kept")
    assert gallery.main([str(tmp_path)], jobs) == 0
    assert (tmp_path / "a.png").read_text() == "kept"
    assert (tmp_path / "b.png").read_text() == "drawn"
    assert "1 to draw, 1 drawn before" in capsys.readouterr().out
    assert gallery.main([str(tmp_path)], [written(gallery, "a.png", "by another command")]) == 0
    assert (tmp_path / "a.png").read_text() == "by another command"
    assert gallery.main([str(tmp_path), "--again"], jobs) == 0
    assert (tmp_path / "a.png").read_text() == "drawn"
    assert set(json.loads((tmp_path / gallery.RECORDS).read_text())) == {"a.png", "b.png"}


def test_one_that_fails_stops_no_other_and_is_reported(gallery, tmp_path, capsys):
    broken = gallery.Job(("broken.png",), 2.0, ("-c", "raise SystemExit('no such mesh')"))
    lazy = gallery.Job(("lazy.png",), 1.5, ("-c", "pass"))
    assert gallery.main([str(tmp_path), "--at-once", "1"], [broken, lazy, written(gallery, "b.png")]) == 1
    message = capsys.readouterr().out
    assert message.index("broken.png begins, about 2 s") < message.index("[1/3] broken.png: FAILED: no such mesh")
    assert "lazy.png: FAILED: it did not write lazy.png" in message
    assert "[3/3] b.png: 0 s" in message
    assert "2 failed: broken.png, lazy.png" in message
    assert (tmp_path / "b.png").is_file()
    assert {path.name for path in tmp_path.iterdir()} == {"b.png", gallery.RECORDS}


def test_a_command_of_cpmkit_gives_the_picture_of_its_output(gallery, tmp_path, monkeypatch):
    scene = (
        '[surface]\nkind = "analytic.circle"\n[problem]\nkind = "screened"\nf = "x"\n[discretization]\nspacing = 0.2\n'
    )
    (tmp_path / "one.toml").write_text(scene + '[output]\npicture = { file = "picture.png", width = 100 }\n')
    monkeypatch.setattr(gallery, "EXAMPLES", tmp_path)
    assert gallery.main([str(tmp_path / "drawn")], [gallery.scene("circle.png", 1.0, "one.toml", 64)]) == 0
    from matplotlib.image import imread

    assert imread(tmp_path / "drawn" / "circle.png").shape[1] == 64
    before = gallery.scene("circle.png", 1.0, "one.toml", 64).digest()
    (tmp_path / "one.toml").write_text(scene.replace("0.2", "0.1"))
    assert gallery.scene("circle.png", 1.0, "one.toml", 64).digest() != before


def test_pictures_that_are_not_there_are_refused(gallery, tmp_path, capsys):
    with pytest.raises(SystemExit):
        gallery.main([str(tmp_path), "--only", "nothing.png"])
    assert "no picture 'nothing.png'" in capsys.readouterr().err
    assert gallery.main(["--list", "--only", "harmonic-after.png"]) == 0
    assert "harmonic-before.png, harmonic-after.png" in capsys.readouterr().out
