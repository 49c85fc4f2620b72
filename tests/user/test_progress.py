"""Long work shows a bar where a person looks on, unless stages otherwise; a logger says what was done."""

import io
import logging
import sys
from functools import partial
from types import SimpleNamespace

import pytest

import cpmkit as ck
from cpmkit.runtime import compilation, progress

SCENE = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson("x"))


class Terminal(io.StringIO):
    def isatty(self):
        return True


class Clock:
    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def writing_to(monkeypatch, stream):
    """Let work write to a stream; pytest puts its own in the place of what a fixture does."""
    monkeypatch.setattr(progress, "sys", SimpleNamespace(stderr=stream, modules=sys.modules))
    return stream


@pytest.fixture(params=["tqdm", "plain"])
def terminal(request, monkeypatch):
    if request.param == "plain":
        monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    else:
        pytest.importorskip("tqdm")
    return writing_to(monkeypatch, Terminal())


def work(target, clock, seconds=3.0):
    """Two stages, the second of which passes the two seconds."""
    with progress.shown_progress(target, clock) as report:
        report("band", 0.5)
        clock.now = 1.5
        report("band", 1.0)
        report("solve", 0.25)
        clock.now = seconds
        report("solve", 0.75)


def test_a_bar_appears_after_two_seconds_and_goes(terminal):
    work(None, Clock())
    shown = terminal.getvalue()
    assert "solve" in shown
    assert "75%" in shown
    assert "band" not in shown
    assert shown.endswith(("\r", "\x1b[K"))


def test_it_is_shown_at_once_or_never_on_request(terminal):
    work(True, Clock())
    assert "band" in terminal.getvalue()
    before = terminal.getvalue()
    work(False, Clock())
    assert terminal.getvalue() == before


def test_nothing_is_shown_where_nobody_looks(monkeypatch):
    stream = writing_to(monkeypatch, io.StringIO())
    work(None, Clock())
    assert stream.getvalue() == ""
    writing_to(monkeypatch, None)
    work(True, Clock())


def test_short_work_shows_nothing(terminal):
    work(None, Clock(), seconds=1.9)
    assert terminal.getvalue() == ""


def test_a_callback_gets_all_stages_and_what_is_no_choice_is_refused():
    stages = []
    for call in (ck.solve, ck.prepare, partial(ck.explain, dry_run=True), ck.discretize):
        stages.clear()
        call(SCENE, 0.2, progress=lambda stage, fraction: stages.append((stage, fraction)))
        assert stages
        with pytest.raises(ck.InputError, match="progress must be True, False or a function"):
            call(SCENE, 0.2, progress="bar")


def test_a_prepared_scene_shows_each_solve(terminal, monkeypatch):
    monkeypatch.setattr(progress, "SILENT_SECONDS", 0.0)
    prepared = ck.prepare(SCENE, spacing=0.2, solver="direct")
    before = len(terminal.getvalue())
    assert before > 0
    prepared.solve(problem=ck.ScreenedPoisson("y"))
    assert len(terminal.getvalue()) > before
    quiet = len(terminal.getvalue())
    ck.prepare(SCENE, spacing=0.2, progress=False).solve()
    assert len(terminal.getvalue()) == quiet


def test_a_reader_that_has_gone_ends_no_solve(monkeypatch):
    class Gone(Terminal):
        def write(self, text):
            raise BrokenPipeError

    writing_to(monkeypatch, Gone())
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    ck.solve(SCENE, spacing=0.2, progress=True)


def test_compiled_kernels_are_reported_to_the_innermost_callback(caplog, tmp_path, monkeypatch):
    stages = []
    with caplog.at_level(logging.DEBUG, "cpmkit"), progress.shown_progress(lambda *one: stages.append(one)):
        from numba import njit

        compilation._register_listener()
        assert njit(lambda x: 2 * x)(3.0) == 6.0
    assert (compilation.COMPILING_STAGE, 0.0) in stages
    assert any("is compiled" in record.message for record in caplog.records)
    assert {stage for stage, _ in stages} == {compilation.COMPILING_STAGE}


def test_the_logger_names_what_was_solved_and_is_silent_by_itself(caplog, capfd):
    assert any(isinstance(handler, logging.NullHandler) for handler in logging.getLogger("cpmkit").handlers)
    with caplog.at_level(logging.INFO, "cpmkit"):
        solution = ck.solve(SCENE, spacing=0.2)
    (record,) = [one for one in caplog.records if one.message.startswith("Solved")]
    assert f"Solved screened: {len(solution.values)} unknowns by {solution.report.solver}" in record.message
    assert capfd.readouterr().err == ""
