"""What can be known before a solve is told before it: where results cannot go, and what no camera can show."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cpmkit.errors import InputError
from cpmkit.files.whole_files import check_place
from cpmkit.plugin import written_whole
from cpmkit.saving.results import check_request
from cpmkit.scenefile.look import OutputRequest, PictureRequest

CIRCLE = """
[surface]
kind = "analytic.circle"
[problem]
kind = "screened"
f = 1.0
[discretization]
spacing = 0.2
"""


@pytest.fixture
def target(torus, tmp_path, monkeypatch):
    """Return a function that checks a request for results of the torus in the folder ``results``."""
    monkeypatch.chdir(tmp_path)

    def check(files=("summary.json",), picture=None, folder="results", channels=None):
        check_request(OutputRequest(Path(folder), files, picture), torus(0.5).surface, Path(folder), channels)

    return check


def test_a_folder_that_can_be_made_is_not_made_yet(target):
    target(folder="deep/within")
    assert os.listdir() == []


def test_a_folder_that_is_there_stays_as_it_is(target):
    os.mkdir("results")
    target()
    assert os.listdir("results") == []


@pytest.mark.parametrize("folder", ["taken", "taken/deeper/still"])
def test_a_folder_that_is_a_file_or_below_one(target, folder):
    Path("taken").write_text("")
    with pytest.raises(InputError, match=r"The folder taken.* cannot be made: .*/taken is a file\.$"):
        target(folder=folder)


def test_a_file_that_is_a_folder(target):
    os.makedirs("results/summary.json")
    with pytest.raises(InputError, match=r"summary\.json cannot be written: it is a folder\.$"):
        target()


def test_a_series_whose_folder_is_a_file(target):
    os.mkdir("results")
    Path("results/run_frames").write_text("")
    with pytest.raises(InputError, match=r"run_frames cannot be made: .*run_frames is a file\.$"):
        target(("run.pvd",))


def test_a_series_whose_folder_is_a_link_that_leads_out(target):
    os.makedirs("results")
    os.makedirs("elsewhere")
    os.symlink("../elsewhere", "results/run_frames")
    with pytest.raises(InputError, match=r"a link leads 'results/run_frames' out of it"):
        target(("run.pvd",))


@pytest.mark.parametrize(
    ("look", "channels", "message"),
    [
        ({"channel": 1}, 1, "channel must be below 1, the number of channels, got 1"),
        ({"vectors": True}, 2, "vectors have as many channels as coordinates, 3, got 2"),
        ({"isolines": True}, 3, "isolines are those of one channel"),
    ],
)
def test_what_a_solution_of_so_many_channels_cannot_show(target, look, channels, message):
    with pytest.raises(InputError, match=message):
        target(picture=PictureRequest(**look), channels=channels)
    target(picture=PictureRequest(**look))


@pytest.mark.parametrize(("problem", "channel", "code"), [("screened", 1, 1), ("eigen", 1, 0), ("eigen", 3, 1)])
def test_a_channel_that_a_scene_lacks_is_refused_before_the_solve(tmp_path, monkeypatch, problem, channel, code):
    from click.testing import CliRunner

    from cpmkit.cli import main

    monkeypatch.chdir(tmp_path)
    equation = CIRCLE.replace('"screened"\nf = 1.0', '"eigen"\ncount = 3') if problem == "eigen" else CIRCLE
    Path("s.toml").write_text(f"{equation}[output]\npicture = {{ channel = {channel}, width = 100 }}\n")
    done = CliRunner().invoke(main, ["solve", "s.toml"])
    assert (done.exit_code, Path("s").exists()) == (code, code == 0)
    assert ("channel must be below" in done.output) == (code == 1)


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a place where even root cannot write")
def test_a_place_where_nothing_can_be_written(target):
    with pytest.raises(InputError, match=r"^/proc/results/summary\.json cannot be written: .*\.$"):
        target(folder="/proc/results")


def test_a_read_only_folder_is_reported_in_the_words_of_the_system(target, monkeypatch):
    def refuse(dir):
        raise OSError(30, os.strerror(30))

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(InputError, match=r"cannot be written: Read-only file system\.$"):
        target()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("u" * 300 + ".npz", r"^The name 'u+\.\.\. has 304 bytes; accepted are 200 at most\.$"),
        ("é" * 110 + ".npz", "has 224 bytes"),
        ("u\0.npz", "holds the character NUL"),
        ("/".join(["u" * 50] * 100) + ".npz", "4000 bytes at most"),
    ],
)
def test_a_name_that_no_file_can_have(target, name, message):
    with pytest.raises(InputError):
        target((name,))
    with pytest.raises(InputError, match=message):
        check_place(Path(name))
    with pytest.raises(InputError, match=message), written_whole(Path(name)):
        pass


def test_the_longest_name_that_is_accepted_can_be_written(tmp_path):
    path = tmp_path / ("u" * 196 + ".npz")
    check_place(path)
    with written_whole(path) as unfinished:
        unfinished.write_text("u")
    assert path.read_text() == "u"


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        ({"view": (0, 0, 0)}, "view must be a direction, got three zeros"),
        ({"up": (0, 0, 0)}, "up must be a direction"),
        ({"view": (0, 0, 2), "up": (0, 0, -1)}, "view and up must not be parallel"),
        ({"file": "torus.jpg"}, r"must be a \.png file"),
    ],
)
def test_a_picture_that_no_camera_can_show(target, picture, message):
    with pytest.raises(InputError, match=message):
        target(picture=PictureRequest(**picture))


def test_a_view_of_any_length_is_a_direction(target):
    target(picture=PictureRequest(view=(1e-200, 2e-200, 0), up=(0, 0, 1e200)))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere file names have encodings of their own")
@pytest.mark.parametrize(("folder", "code"), [("", 0), ("größe", 1)])
def test_names_of_files_in_a_locale_without_their_characters(tmp_path, folder, code):
    output = f'[output]\nfolder = "{folder}"\nfiles = ["u.json"]\n' if folder else '[output]\nfiles = ["u.vtp"]\n'
    (tmp_path / "széne.toml").write_text(CIRCLE + output, encoding="utf-8")
    run = "import sys; from cpmkit.cli import main; main(['solve', sys.argv[1]])"
    command = [sys.executable, "-c", run, "széne.toml"]
    posix = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "CPMKIT_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, cwd=tmp_path, env=posix, check=False)
    assert done.returncode == code, done.stderr
    if folder:
        assert b"set the environment variable PYTHONUTF8=1" in done.stderr
        assert done.stderr.count(b"\n") == 1
    else:
        assert (tmp_path / "széne" / "u.vtp").read_bytes().rstrip().endswith(b"</VTKFile>")
