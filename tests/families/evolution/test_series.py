"""Frames of a run are solutions, files and pictures; a run goes on from a checkpoint as if it had not stopped."""

import json
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from click.testing import CliRunner
from model_problems import on_circle

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.errors import SceneError
from cpmkit.saving.saved_solutions import draw_frames, save
from cpmkit.scenefile.look import Look

POINTS = on_circle(np.linspace(0, 6, 50))


def scene(problem, value=0.5):
    cut = ck.source("analytic.point", at=[0.6, 0.8])
    return ck.Scene(ck.source("analytic.circle"), problem, [ck.Boundary("cut", cut, both=ck.Dirichlet(value))])


def heat(until=0.6, step=0.05, frames=(), **keys):
    return ck.Heat(lambda x: x[:, 0], until=until, step=step, frames=frames, **keys)


def wave(until=0.6, step=0.05, frames=(), **keys):
    return ck.Wave(
        lambda x: x[:, 0], until=until, step=step, frames=frames, initial_rate=lambda x, t=0.0: x[:, 1], **keys
    )


def test_frames_are_the_solutions_of_shorter_runs():
    solution = ck.solve(scene(heat(frames=3)), 0.1)
    assert [frame.time for frame in solution.frames] == pytest.approx([0.0, 0.2, 0.4, 0.6])
    assert [frame.steps for frame in solution.frames] == [0, 4, 8, 12]
    assert all(frame.discretized is solution.discretized for frame in solution.frames)
    np.testing.assert_allclose(solution.frames[0].evaluate(POINTS[:1]), POINTS[:1, 0], atol=1e-3)
    shorter = ck.solve(scene(heat(until=0.4)), 0.1)
    np.testing.assert_allclose(solution.frames[2].evaluate(POINTS), shorter.evaluate(POINTS), rtol=1e-9)
    np.testing.assert_array_equal(solution.frames[-1].values, solution.values)
    messages = solution.summary()["time"]
    assert (messages["time"], messages["steps"], messages["scheme"]) == (0.6, 12, "bdf2")
    assert solution.arrays()["frames"].shape == (4, *solution.values.shape)


def test_more_frames_than_fit_the_memory_are_refused_before_the_first_step(monkeypatch):
    monkeypatch.setattr("cpmkit.families.evolution.stepping.available_bytes", lambda: 1_000_000)
    steps = []
    with pytest.raises(ck.ResolutionError, match=r"1001 frames of \d+ unknowns need .* GiB are available; ask for \d+"):
        ck.solve(scene(heat(frames=1000)), 0.1, progress=lambda stage, share: steps.append(stage))
    assert "steps" not in steps


def test_a_list_of_times_and_no_frames():
    assert [frame.time for frame in ck.solve(scene(heat(frames=[0.37, 0.11])), 0.1).frames] == [0.11, 0.37]
    assert ck.solve(scene(heat()), 0.1).frames == ()


def test_a_series_is_an_index_and_a_mesh_a_frame(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    solution = ck.solve(scene(heat(frames=3)), 0.1)
    solution.save(tmp_path / "run.pvd")
    reader = pyvista.get_reader(str(tmp_path / "run.pvd"))
    assert reader.time_values == pytest.approx([0.0, 0.2, 0.4, 0.6])
    for frame, time in zip(solution.frames, reader.time_values, strict=True):
        reader.set_active_time_value(time)
        read, mesh = reader.read()[0], frame.display_mesh()
        np.testing.assert_allclose(read.points[:, :2], mesh.points, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(read.point_data["u"], mesh.values[:, 0], rtol=0, atol=1e-12)


def test_a_shorter_series_replaces_a_longer_one_and_leaves_other_files(tmp_path):
    pytest.importorskip("pyvista")
    for frames in (4, 2):
        ck.solve(scene(heat(frames=frames)), 0.2).save(tmp_path / "run.pvd")
        (tmp_path / "run_frames" / "notes.txt").write_text("mine")
    files = sorted(file.name for file in (tmp_path / "run_frames").iterdir())
    assert files == ["frame-0000.vtp", "frame-0001.vtp", "frame-0002.vtp", "notes.txt"]
    named = [entry.get("file") for entry in ElementTree.parse(tmp_path / "run.pvd").iter("DataSet")]
    assert named == [f"run_frames/frame-000{number}.vtp" for number in range(3)]


def test_an_index_that_fails_leaves_all_files_of_the_earlier_one(tmp_path, monkeypatch):
    pytest.importorskip("pyvista")
    ck.solve(scene(heat(frames=4)), 0.2).save(tmp_path / "run.pvd")

    def fail(path):
        raise ck.InputError("full")

    monkeypatch.setattr("cpmkit.saving.saved_solutions.written_whole", fail)
    with pytest.raises(ck.InputError, match="full"):
        ck.solve(scene(heat(frames=2)), 0.2).save(tmp_path / "run.pvd")
    named = [entry.get("file") for entry in ElementTree.parse(tmp_path / "run.pvd").iter("DataSet")]
    assert len(named) == 5
    assert all((tmp_path / file).is_file() for file in named)


def test_a_series_that_fails_leaves_the_earlier_one(tmp_path, monkeypatch):
    pytest.importorskip("pyvista")
    solution = ck.solve(scene(heat(frames=2)), 0.2)
    solution.save(tmp_path / "run.pvd")
    before = {file: file.read_bytes() for file in tmp_path.rglob("*.*") if file.is_file()}

    def fail(mesh, path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("cpmkit.saving.saved_solutions.write_vtp", fail)
    with pytest.raises(ck.InputError, match=r"run_frames cannot be written: No space left on device\.$"):
        solution.save(tmp_path / "run.pvd")
    assert {file: file.read_bytes() for file in tmp_path.rglob("*.*") if file.is_file()} == before


def test_without_frames_there_is_no_series(tmp_path):
    pytest.importorskip("pyvista")
    for problem in (heat(), ck.Laplace()):
        with pytest.raises(ck.InputError, match=r"run\.pvd needs frames, .* Heat\(\.\.\., frames=10\)"):
            save(ck.solve(scene(problem), 0.2), tmp_path / "run.pvd")


def test_frames_are_drawn_in_the_same_colours(tmp_path, monkeypatch):
    bars = []

    def composed(model, bar, title, width):
        bars.append((title, *bar.ends))
        return np.zeros((4, 4, 3), dtype=np.uint8)

    monkeypatch.setattr("cpmkit.view.pictures.compose_picture", composed)
    solution = ck.solve(scene(heat(frames=2)), 0.2)
    files = draw_frames(solution, tmp_path / "u.png", Look(width=300))
    assert [file.name for file in files] == ["u-0000.png", "u-0001.png", "u-0002.png"]
    assert all(file.stat().st_size > 0 for file in files)
    assert [title for title, *_ in bars] == [f"t = {frame.time:.4g}" for frame in solution.frames]
    ((low, high),) = {(low, high) for _, low, high in bars}
    assert low <= -0.9
    assert high >= 0.9


class StoppedError(Exception):
    pass


def stop_at(share):
    """A progress callback that ends the run on the way."""

    def progress(stage, fraction):
        if stage == "steps" and fraction > share:
            raise StoppedError

    return progress


RUNS = {
    "bdf2": heat(frames=4),
    "odd frames": heat(frames=[0.07, 0.31, 0.33]),
    "crank-nicolson": heat(scheme="crank-nicolson"),
    "leapfrog": wave(frames=[0.07, 0.31]),
    "implicit": wave(scheme="implicit"),
}


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("solver", ["direct", "reference"])
def test_a_run_goes_on_from_a_checkpoint_bit_by_bit(name, solver, tmp_path):
    value = ck.Dirichlet(lambda x, t: 0.5 + 0.1 * t).value
    options = {"spacing": 0.1 if solver == "direct" else 0.3, "solver": solver}
    whole = ck.solve(scene(RUNS[name], value), **options)
    file = tmp_path / "run.npz"
    with pytest.raises(StoppedError):
        ck.solve(scene(RUNS[name], value), checkpoint=file, checkpoint_every=3, progress=stop_at(0.6), **options)
    resumed = ck.solve(scene(RUNS[name], value), resume=file, **options)
    np.testing.assert_array_equal(resumed.values, whole.values)
    assert len(resumed.frames) == len(whole.frames)
    for ours, theirs in zip(resumed.frames, whole.frames, strict=True):
        np.testing.assert_array_equal(ours.values, theirs.values)
    assert resumed.report == whole.report


def test_a_finished_run_goes_on_to_a_later_time(tmp_path):
    file = tmp_path / "run.npz"
    ck.solve(scene(heat(until=0.3)), 0.1, checkpoint=file)
    later = ck.solve(scene(heat(until=0.6)), 0.1, resume=str(file))
    np.testing.assert_array_equal(later.values, ck.solve(scene(heat(until=0.6)), 0.1).values)


def test_the_checkpoint_of_another_run_is_refused(tmp_path):
    file = tmp_path / "run.npz"
    ck.solve(scene(heat(until=0.3)), 0.1, checkpoint=file)
    others = [
        (scene(heat(step=0.02)), 0.1, "its step is 0.05, and here it is 0.02"),
        (scene(heat(scheme="backward-euler")), 0.1, "its scheme is 'bdf2', and here it is 'backward-euler'"),
        (scene(heat()), 0.05, "its spacing is 0.1, and here it is 0.05"),
        (scene(heat(frames=[0.1])), 0.1, "its 6 steps and their frames"),
        (scene(heat(until=0.2)), 0.1, "its 6 steps and their frames"),
        (scene(heat(), 0.4), 0.1, "the scene, its data"),
        (scene(heat(f=0.1)), 0.1, "the scene, its data"),
        (scene(heat(kappa=2.0)), 0.1, "the scene, its data"),
        (scene(ck.Heat(lambda x: x[:, 1], until=0.6, step=0.05)), 0.1, "the scene, its data"),
        (scene(heat(), lambda x, t: 0.5 + t * (t > 0.2)), 0.1, "the scene, its data"),
    ]
    for other, spacing, messages in others:
        with pytest.raises(ck.InputError, match=rf"run\.npz is of another run: {messages}"):
            ck.solve(other, spacing, resume=file)
    file.write_text("nothing")
    with pytest.raises(ck.InputError, match=r"'run\.npz' is damaged or not a checkpoint of a run in time"):
        ck.solve(scene(heat()), 0.1, resume=file)


def test_requests_for_checkpoints_are_checked_first(tmp_path):
    wrong = [
        (ck.Laplace(), {"checkpoint": tmp_path / "a.npz"}, "are for problems in time, not for 'laplace'"),
        (heat(), {"checkpoint": tmp_path / "a.txt"}, "must be an .npz file in a folder that exists"),
        (heat(), {"checkpoint": tmp_path / "b" / "a.npz"}, "must be an .npz file in a folder that exists"),
        (heat(), {"resume": tmp_path / "a.npz"}, "no checkpoint"),
        (heat(), {"checkpoint": tmp_path / "a.npz", "checkpoint_every": 0}, "checkpoint_every must be"),
    ]
    for problem, options, messages in wrong:
        with pytest.raises(ck.InputError, match=messages):
            ck.solve(scene(problem), 0.1, **options)


SCENE = """
[surface]
kind = "analytic.circle"

[[boundary]]
kind = "analytic.point"
at = [0.6, 0.8]
both = { dirichlet = "0.5 + t" }

[problem]
kind = "KIND"
initial = "x"
until = 0.3
step = 0.02
frames = [0.1, 0.3]

[discretization]
spacing = 0.1

[output]
folder = "out"
files = ["run.pvd", "run.npz", "summary.json"]
picture = { file = "u.png", width = 200, frames = true }
"""


@pytest.mark.parametrize("kind", ["heat", "wave"])
def test_a_scene_file_runs_in_time_and_goes_on(kind, tmp_path, monkeypatch):
    pytest.importorskip("pyvista")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.toml").write_text(SCENE.replace("KIND", kind))
    done = CliRunner().invoke(main, ["solve", "run.toml", "--checkpoint", "state.npz", "--quiet"])
    assert (done.exit_code, done.output) == (0, "")
    written = sorted(str(file.relative_to(tmp_path / "out")) for file in (tmp_path / "out").rglob("*.*"))
    frames = ["run_frames/frame-0000.vtp", "run_frames/frame-0001.vtp"]
    pictures = ["u-0000.png", "u-0001.png", "u.png"]
    assert written == ["run.npz", "run.pvd", *frames, "summary.json", *pictures]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["picture"]["frames"] == pictures[:2]
    assert summary["time"]["frames"] == [0.1, 0.3]
    with np.load(tmp_path / "out" / "run.npz") as file:
        first = file["lattice_frames"]
    resumed = CliRunner().invoke(main, ["solve", "run.toml", "--resume", "state.npz"])
    assert resumed.exit_code == 0
    with np.load(tmp_path / "out" / "run.npz") as file:
        np.testing.assert_array_equal(file["lattice_frames"], first)


def test_a_scene_file_that_asks_for_frames_must_have_some(tmp_path):
    file = tmp_path / "run.toml"
    file.write_text(SCENE.replace("KIND", "heat").replace("frames = [0.1, 0.3]\n", ""))
    with pytest.raises(SceneError, match=r"\[output\] asks for frames, and \[problem\] gives none"):
        ck.load_scene(file)
