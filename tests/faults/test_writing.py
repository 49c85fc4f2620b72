"""Whatever happens while results are written, each file is whole, and what is there is told."""

import io
import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.errors import InputError
from cpmkit.files.whole_files import unfinished_name
from cpmkit.plugin import no_progress, written_whole
from cpmkit.runtime.progress import ProgressLine
from cpmkit.saving.results import write_results
from cpmkit.saving.saved_solutions import save
from cpmkit.scenefile.look import OutputRequest
from cpmkit.studies.records import append_record, drop_unfinished_line

#: Writes a letter 60,000 times into a file, in three pieces, again and again.
WRITER = """
import sys, time
from pathlib import Path
from cpmkit.files.whole_files import written_whole
path, letter, stop = Path(sys.argv[1]), sys.argv[2].encode(), sys.argv[3:] == ["stop"]
while True:
    with written_whole(path) as unfinished, unfinished.open("wb") as opened:
        for _ in range(3):
            opened.write(20_000 * letter)
            opened.flush()
            time.sleep(0.002)
            if stop and path.exists():
                print("stopped", flush=True)
                time.sleep(3600)
"""


@contextmanager
def writing(path, letter, *stop):
    """Run a process that writes, from when its first file is there; at the end it is killed.

    With "stop" it halts in the middle of its second file, and says so.
    """
    command = [sys.executable, "-P", "-c", WRITER, str(path), letter, *stop]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        try:
            while not path.exists() and process.poll() is None:
                time.sleep(0.005)
            yield process
        finally:
            process.kill()


def is_whole(path):
    content = path.read_bytes()
    return len(content) == 60_000 and len(set(content)) == 1


def leftovers(path):
    return [found for found in path.parent.iterdir() if found.name.startswith(".")]


def test_a_run_killed_at_any_moment_leaves_whole_files(tmp_path):
    path, moments = tmp_path / "run.npz", random.Random(1)
    for _ in range(3):
        with writing(path, "a") as process:
            time.sleep(moments.uniform(0.0, 0.02))
            process.send_signal(signal.SIGKILL)
            process.wait()
            assert is_whole(path)
        path.unlink()


def test_the_run_after_one_that_was_killed_in_the_middle_clears_up(tmp_path):
    path = tmp_path / "run.npz"
    for _ in range(2):
        with writing(path, "a", "stop") as process:
            assert process.stdout.readline() == b"stopped\n"
        assert is_whole(path)
        assert len(leftovers(path)) == 1  # the second run removed what the first had left
    with written_whole(path) as unfinished:
        unfinished.write_bytes(b"whole")
    assert os.listdir(tmp_path) == ["run.npz"]


def test_two_runs_in_one_folder_write_whole_files(tmp_path):
    path, seen = tmp_path / "u.vtp", set()
    with writing(path, "a") as one, writing(path, "b") as other:
        while len(seen) < 2 and one.poll() is None and other.poll() is None:
            assert is_whole(path)
            seen |= {*path.read_bytes()[:1]}
            assert len(leftovers(path)) <= 2
    assert seen == {*b"ab"}


@pytest.mark.parametrize("name", ["u.NPZ", "u.Csv", "u.OBJ", "u.PLY", "u.VTP", "u.Vtu", "u.JSON"])
def test_a_suffix_may_be_of_any_case(torus, tmp_path, name):
    """Writers that add their own suffix to one in capitals would leave the file under another name."""
    solution = torus(0.5)
    save(solution, tmp_path / name)
    save(solution, tmp_path / name.lower())
    assert sorted(os.listdir(tmp_path)) == sorted([name, name.lower()])
    assert (tmp_path / name).stat().st_size == pytest.approx((tmp_path / name.lower()).stat().st_size, rel=0.01)


def test_only_what_dead_processes_left_of_this_file_is_removed(tmp_path):
    dead = subprocess.Popen([sys.executable, "-P", "-c", ""])
    dead.wait()
    kept = [f".u.{os.getppid()}.npz", f".v.{dead.pid}.npz", f".u.{dead.pid}.vtp", f".u.x{dead.pid}.npz", ".u.npz"]
    for name in (*kept, f".u.{dead.pid}.npz", ".u.9999999999.npz"):
        (tmp_path / name).write_text("")
    with written_whole(tmp_path / "u.npz") as unfinished:
        unfinished.write_text("u")
    assert sorted(os.listdir(tmp_path)) == sorted([*kept, "u.npz"])


def test_a_file_is_on_the_disk_before_it_takes_its_name(tmp_path, monkeypatch):
    """Else a machine that goes down leaves an empty checkpoint."""
    done, sync, replace = [], os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda handle: (done.append("sync"), sync(handle)))
    monkeypatch.setattr(os, "replace", lambda *names: (done.append("replace"), replace(*names)))
    with written_whole(tmp_path / "u.npz") as unfinished:
        unfinished.write_text("u")
    assert done == ["sync", "replace"]


@contextmanager
def full_disk(size):
    """Let no file of this process grow beyond ``size`` bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("name", ["u.vtp", "u.ply", "u.npz"])
def test_a_full_disk_is_reported_and_the_earlier_file_stays(torus, tmp_path, name):
    pytest.importorskip("pyvista")
    solution = torus(0.3)
    save(solution, tmp_path / name)
    earlier = (tmp_path / name).read_bytes()
    with full_disk(len(earlier) // 2), pytest.raises(InputError, match=rf"{name} cannot be written: File too large\.$"):
        save(solution, tmp_path / name)
    assert os.listdir(tmp_path) == [name]
    assert (tmp_path / name).read_bytes() == earlier


@pytest.mark.parametrize("raised", [OSError(28, os.strerror(28)), MemoryError(), ZeroDivisionError("a defect")])
def test_a_file_that_fails_keeps_no_other_from_being_written(square, tmp_path, monkeypatch, raised):
    def fail(solution, path, *vertices, **options):
        if path.name == "lost.npz":
            with written_whole(path):
                raise raised
        save(solution, path, *vertices, **options)

    monkeypatch.setattr("cpmkit.saving.results.save", fail)
    request = OutputRequest(tmp_path / "r", ("lost.npz", "u.npz", "summary.json"), None)
    written = write_results(square(3), request, tmp_path / "r", no_progress)
    assert sorted(os.listdir(tmp_path / "r")) == ["summary.json", "u.npz"]
    assert written.summary["files"] == ["u.npz", "summary.json"]
    assert list(written.summary["unwritten"]) == ["lost.npz"]
    assert json.loads((tmp_path / "r" / "summary.json").read_text()) == written.summary
    if isinstance(raised, ZeroDivisionError):
        with pytest.raises(ZeroDivisionError):
            written.check()
        return
    with pytest.raises(InputError) as told:
        written.check()
    said = "memory ran out" if isinstance(raised, MemoryError) else "No space left on device"
    assert str(told.value) == (
        f"{tmp_path / 'r' / 'lost.npz'} cannot be written: {said}; "
        f"written into {tmp_path / 'r'} were u.npz, summary.json."
    )


def test_an_unfinished_series_of_a_killed_run_is_removed(tmp_path):
    from cpmkit.files.whole_files import remove_leftovers

    folder = tmp_path / "u_frames"
    left = tmp_path / ".u_frames.9999999999"
    left.mkdir()
    (left / "frame-0000.vtp").write_text("half")
    mine = unfinished_name(folder)
    mine.mkdir()
    remove_leftovers(folder)
    assert os.listdir(tmp_path) == [mine.name]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere a fork of a process with threads may crash")
@pytest.mark.filterwarnings("ignore:.*use of fork:DeprecationWarning")
def test_two_solves_into_one_folder_leave_whole_results(tmp_path, monkeypatch):
    (tmp_path / "circle.toml").write_text(
        '[surface]\nkind = "analytic.circle"\n[problem]\nkind = "screened"\nf = "x"\n[discretization]\nspacing = 0.1\n'
        '[output]\nfolder = "shared"\nfiles = ["u.npz", "summary.json"]\n'
    )
    forked, together = get_context("fork"), get_context("fork").Barrier(2)

    def solve():
        together.wait()
        main(["solve", "circle.toml", "--quiet"])

    monkeypatch.chdir(tmp_path)
    runs = [forked.Process(target=solve) for _ in range(2)]
    for run in runs:
        run.start()
    for run in runs:
        run.join()
    assert [run.exitcode for run in runs] == [0, 0]
    assert sorted(os.listdir(tmp_path / "shared")) == ["summary.json", "u.npz"]
    json.loads(Path(tmp_path, "shared", "summary.json").read_text())
    with np.load(tmp_path / "shared" / "u.npz") as read:
        assert np.isfinite(read["values"]).all()


def test_a_record_that_does_not_fit_on_the_disk_is_reported_and_the_lines_before_it_stay(tmp_path):
    file = tmp_path / "records.jsonl"
    append_record(file, {"run": 1})
    whole = file.read_bytes()
    with full_disk(len(whole) + 5), pytest.raises(InputError, match=r"records\.jsonl cannot be written: .*\.$"):
        append_record(file, {"run": 2})
    assert file.read_bytes().startswith(whole)
    drop_unfinished_line(file)
    assert file.read_bytes() == whole


def test_progress_that_nobody_takes_ends_no_solve():
    class Full(io.StringIO):
        def write(self, text):
            raise OSError(28, os.strerror(28))

    times = iter([0.0, 0.0, 5.0, 5.0, 5.0])
    with ProgressLine(Full(), lambda: next(times)) as progress:
        progress("band", 0.0)
        progress("band", 1.0)


@pytest.mark.parametrize("name", ["u.npz", "u.vtp", "u.json"])
def test_threads_that_save_one_name_leave_one_whole_file(name, tmp_path):
    solution = ck.solve(ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(lambda p: p[:, 0])), 0.2)
    solution.save(tmp_path / name)
    whole, together = (tmp_path / name).read_bytes(), threading.Barrier(4)

    def save(_):
        together.wait()
        solution.save(tmp_path / name)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(save, range(4)))  # raises what a thread has raised
    assert os.listdir(tmp_path) == [name]
    assert len((tmp_path / name).read_bytes()) == len(whole)
