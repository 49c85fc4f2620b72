"""A study makes each of its runs once, whatever interrupts it, and its report fits orders to what is recorded."""

import json
import sys

import numpy as np
import pytest
from click.testing import CliRunner

import cpmkit as ck
from cpmkit.cli import main
from cpmkit.errors import InputError, MissingDependencyError, ResolutionError, SceneError
from cpmkit.studies import report
from cpmkit.studies.records import append_record, drop_unfinished_line, group_into_series, read_records
from cpmkit.studies.reference_values import sample_points, solve_by_fixed_nodes
from cpmkit.studies.report import write_report
from cpmkit.studies.run_one import run_study, tie_step_to_spacing
from cpmkit.studies.studyfile import expand_all, expand_names, load_study
from cpmkit.studies.sweep import Run, Sweep

TEXT = """
title = "A cut circle"

[surface]
kind = "analytic.circle"

[[boundary]]
name = "cut"
kind = "analytic.point"
at = [0.6, 0.8]
both = { dirichlet = "exact" }

[problem]
kind = "screened"
f = "2*exact"

[let]
exact = "x + y"

[exact]
u = "exact"
points = 300

[sweep]
spacings = [0.1, 0.05, 0.025]
orders = [1, 2]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "cut.toml"
    path.write_text(TEXT)
    return path


def run(*arguments):
    return CliRunner().invoke(main, ["study", *map(str, arguments)])


def test_a_run_is_made_once(file, tmp_path):
    study = load_study(file)
    first = run_study(study, tmp_path / "out", cheap=True)
    assert (first.made, first.skipped, first.failed) == (4, 0, 0)
    content = first.file.read_bytes()
    second = run_study(study, tmp_path / "out")
    assert (second.made, second.skipped) == (2, 4)
    assert second.file.read_bytes().startswith(content)
    assert run_study(study, tmp_path / "out").made == 0


def test_a_record_says_what_was_run_what_it_cost_and_how_far_off_it_is(file, tmp_path):
    study = load_study(file)
    record = read_records(run_study(study, tmp_path, cheap=True).file)[-1]
    points = sample_points(study.scene, 300)
    solution = ck.solve(study.scene, 0.05, order=2)
    error = solution.evaluate(points) - points.sum(axis=1)
    assert (record["method"], record["spacing"], record["degree"], record["order"]) == ("cpm", 0.05, 3, 2)
    assert record["max_error"] == pytest.approx(np.abs(error).max(), rel=1e-9)
    assert record["rms_error"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    assert record["unknowns"] == solution.work.unknowns
    assert record["closest_point_queries"] > record["unknowns"]
    assert {"nonzeros", "operator_applications", "iterations", "table_bytes", "residual"} <= record.keys()
    assert sum(record["seconds"].values()) > 0
    assert 0 < record["cpu_seconds"] < 100
    assert record["versions"]["cpmkit"] == ck.__version__


def test_what_is_interrupted_goes_on_where_it_stopped(file, tmp_path):
    study = load_study(file)

    def interrupt(stage, share):
        if stage.startswith("run 3 of"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path, progress=interrupt)
    assert len(read_records(tmp_path / "records.jsonl")) == 2
    outcome = run_study(study, tmp_path)
    assert (outcome.made, outcome.skipped) == (4, 2)
    assert len(read_records(outcome.file)) == 6


def test_a_half_written_line_is_made_again(file, tmp_path):
    study = load_study(file)
    outcome = run_study(study, tmp_path, cheap=True)
    content = outcome.file.read_bytes()
    outcome.file.write_bytes(content[:-40])
    assert len(read_records(outcome.file)) == 3
    again = run_study(study, tmp_path, cheap=True)
    assert (again.made, again.skipped) == (1, 3)
    records = read_records(outcome.file)
    assert len(records) == 4
    assert all("max_error" in record for record in records)


def test_records_are_cut_only_after_their_last_whole_line(tmp_path):
    file = tmp_path / "records.jsonl"
    first, second, _ = made_up()
    append_record(file, first)
    append_record(file, second | {"max_error": np.float64(0.5)})
    drop_unfinished_line(file)
    assert read_records(file) == [first, second | {"max_error": 0.5}]
    file.write_text(f"{json.dumps(first)}\nnonsense\n{json.dumps(second)}\n")
    with pytest.raises(InputError, match="line 2 of"):
        read_records(file)


@pytest.mark.parametrize(
    ("old", "new", "kept"),
    [
        ("A cut circle", "Another title", True),
        ("[0.1, 0.05, 0.025]", "[0.1, 0.05]", True),
        ("points = 300", "points = 301", False),
        ("[0.6, 0.8]", "[0.8, 0.6]", False),
        ('exact = "x + y"', 'exact = "x + 2*y"', False),
    ],
)
def test_records_belong_to_what_was_solved_not_to_what_is_swept(file, tmp_path, old, new, kept):
    before = load_study(file)
    run_study(before, tmp_path, cheap=True)
    file.write_text(TEXT.replace(old, new))
    after = load_study(file)
    assert (after.content == before.content) == kept
    outcome = run_study(after, tmp_path, cheap=True)
    assert outcome.made == (0 if kept else 4)
    if not kept:
        assert "4 records belong to the study file as it was before" in write_report(tmp_path).files[0].read_text()


def test_a_run_that_fails_is_recorded_and_the_others_go_on(file, tmp_path):
    file.write_text(TEXT.replace("spacings = [0.1,", "spacings = [0.6, 0.1,"))
    outcome = run_study(load_study(file), tmp_path)
    assert (outcome.made, outcome.failed) == (8, 2)
    failed = [record for record in read_records(outcome.file) if "error" in record]
    assert all(record["error"].startswith("ResolutionError: spacing=0.6 is too coarse") for record in failed)
    assert run_study(load_study(file), tmp_path).made == 0
    report = write_report(tmp_path)
    assert report.failed == 2
    text = report.files[0].read_text()
    assert "- cpm, degree 3, order 1, spacing 0.6: ResolutionError" in text
    assert "| 0.6 |" not in text


def test_a_study_of_failures_only_has_no_report(file, tmp_path):
    file.write_text(TEXT.replace("[0.1, 0.05, 0.025]", "[0.6]"))
    run_study(load_study(file), tmp_path)
    with pytest.raises(InputError, match="all 2 runs of"):
        write_report(tmp_path)


def test_a_wrong_scene_ends_the_study_at_once(file, tmp_path):
    file.write_text(TEXT.replace('f = "2*exact"', 'f = "2*unheard"'))
    with pytest.raises(SceneError, match="unheard"):
        run_study(load_study(file), tmp_path)
    assert read_records(tmp_path / "records.jsonl") == []


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[exact]", "[exakt]", r"unknown key 'exakt' \(did you mean 'exact'\?\); accepted are title, surface"),
        ("points = 300", "samples = 300", r"\[exact\] has the unknown key 'samples'; accepted are u, points"),
        ("points = 300", "points = 0", "points of .exact. must be a whole number"),
        ('u = "exact"', "u = 3", "u of .exact. must be text, got 3"),
        ("orders = [1, 2]", "order = [1, 2]", r"\[sweep\] has the unknown key 'order' \(did you mean 'orders'\?\)"),
        ("orders = [1, 2]", "orders = [5]", "orders of .sweep. must be a whole number from 1 to 2, got 5"),
        ("orders = [1, 2]", "orders = []", "orders of .sweep. must be a list with at least one entry"),
        ("orders = [1, 2]", "origins = 0", "origins of .sweep. must be a whole number"),
        ("orders = [1, 2]", "methods = [3]", "methods of .sweep. must be names"),
        ("[0.1, 0.05, 0.025]", "[0.1, -0.05]", "each spacing of .sweep. must be a finite number above zero"),
        ("[let]", "[discretization]\nspacing = 0.1\n[let]", "spacing stands in spacings of .sweep., not in"),
        ('exact = "x + y"', 'x = "1"', "the name 'x' of .let. is reserved"),
        ('exact = "x + y"', "exact = true", "exact of .let. must be a formula or a number"),
        ("[sweep]", "[sweep", "cut.toml is not TOML"),
    ],
)
def test_a_wrong_study_file_is_answered_in_one_sentence(file, old, new, message):
    file.write_text(TEXT.replace(old, new))
    with pytest.raises(SceneError, match=message) as caught:
        load_study(file)
    assert str(caught.value).startswith("cut.toml")


def test_names_of_formulas_are_put_in_place():
    known = expand_names({"r": "sqrt(x**2 + y**2)", "half": 0.5, "s": "half*r"})
    assert known["s"] == "(0.5)*(sqrt(x**2 + y**2))"
    assert expand_all({"f": "2 - s"}, {"s": "x - y"}) == {"f": "2 - (x - y)"}
    assert expand_all({"f": "no formula at all"}, known) == {"f": "no formula at all"}
    table = {"kind": "s", "both": {"dirichlet": ["s", 1.0]}, "at": [1, 2]}
    assert expand_all(table, {"s": "x"}) == {"kind": "s", "both": {"dirichlet": ["(x)", 1.0]}, "at": [1, 2]}
    parts = {"of": [{"kind": "s", "phi": "s"}], "values": "s", "file": ["s"]}
    assert expand_all(parts, {"s": "x"}) == {"of": [{"kind": "s", "phi": "(x)"}], "values": "s", "file": ["s"]}


def test_names_that_double_a_formula_again_and_again_are_refused():
    names = {f"a{k}": f"a{k - 1} * a{k - 1}" if k else "x + 1" for k in range(40)}
    with pytest.raises(SceneError, match="at most 4000 are accepted"):
        expand_names(names)


def test_the_sweep_is_every_combination_that_has_a_meaning():
    sweep = Sweep({"degree": [2, 3], "order": [1, 2]}, [0.2, 0.1], origins=3, methods=["cpm", "ball", "fem"])
    runs = sweep.runs()
    assert len(runs) == len(set(runs)) == 2 * (2 * 2 * 3 + 2 * 3 + 1)
    assert [run for run in runs if run.method == "fem"] == [Run("fem", h, (), None) for h in (0.2, 0.1)]
    assert {run.as_dict()["order"] for run in runs if run.method == "ball"} == {None}
    assert {run.spacing for run in sweep.runs(cheap=True)} == {0.2}
    assert {run.spacing for run in Sweep({}, [0.1], cheap=[0.3]).runs(cheap=True)} == {0.3}


def test_positions_of_the_lattice_are_those_of_the_convention():
    shifts = [Run("cpm", 0.5, (), number).lattice_shift(3) for number in range(16)]
    assert np.array_equal(shifts, 0.5 * np.random.default_rng(1).uniform(0, 1, (16, 3)))
    assert not Run("cpm", 0.5, (), None).lattice_shift(3).any()


def test_errors_are_rms_over_the_lattices_positions(file, tmp_path):
    file.write_text(TEXT.replace("orders = [1, 2]", "origins = 3"))
    outcome = run_study(load_study(file), tmp_path)
    assert outcome.made == 9
    records = read_records(outcome.file)
    assert len({record["max_error"] for record in records}) == 9
    (series,) = group_into_series(records)
    finest = [record["max_error"] for record in records if record["spacing"] == 0.025]
    assert series.entries[-1].error == pytest.approx(np.sqrt(np.mean(np.square(finest))))
    assert "over 3 positions of the grid" in write_report(tmp_path).files[0].read_text()


def made_up(method="cpm", order=2, slope=2.0, factor=1.0):
    return [
        {
            "study": "made-up", "title": "Made up", "content": "c", "method": method, "spacing": h, "degree": 3,
            "order": order, "origin": None, "max_error": factor * h**slope, "rms_error": 0.5 * factor * h**slope,
            "unknowns": round(100 / h), "iterations": 7, "cpu_seconds": 1 + h,
        }
        for h in (0.2, 0.1, 0.05)
    ]  # fmt: skip


def test_fitted_orders_are_the_slopes_of_the_records():
    series = group_into_series([*made_up(order=1, slope=1.0), *made_up(slope=1.9), *made_up("nearest", None, 0.7)])
    assert [round(one.fitted_order, 9) for one in series] == [1.0, 1.9, 0.7]
    assert [one.label for one in series] == [
        "closest point method, order 1",
        "closest point method, order 2",
        "nearest point",
    ]
    assert group_into_series(made_up()[:1])[0].fitted_order is None


def test_figures_hold_the_records_and_reference_slopes():
    series = group_into_series([*made_up(order=1, slope=1.0), *made_up(slope=2.0)])
    (axes,) = report.convergence_figure(series, "Made up").axes
    drawn = {line.get_label(): line for line in axes.lines}
    second = drawn["order 2 (fitted order 2.00)"]
    assert np.allclose(second.get_xydata(), [(h, h**2) for h in (0.2, 0.1, 0.05)])
    dotted = [line for line in axes.lines if line.get_linestyle() == ":"]
    slopes = [np.diff(np.log(line.get_ydata()))[0] / np.diff(np.log(line.get_xdata()))[0] for line in dotted]
    assert np.allclose(slopes, [1, 2, 3])
    solid = [line for line in axes.lines if line not in dotted]
    assert len({line.get_linestyle() for line in solid}) == len({line.get_color() for line in solid}) == 2
    left, right = report.work_figure(series, "Made up").axes
    assert np.allclose(left.lines[0].get_xdata(), [1.2, 1.1, 1.05])
    assert np.allclose(right.lines[1].get_xydata()[-1], [2000, 0.05**2])


def test_without_matplotlib_a_report_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'cpmkit\[view\]'"):
        report.convergence_figure(group_into_series(made_up()), "Made up")


def test_the_time_step_is_tied_to_the_spacing():
    from dataclasses import dataclass, replace

    @dataclass(frozen=True)
    class Timed:
        step: float = 1.0
        until: float = 0.1
        duration: float = 0.1
        kind: str = "heat"

    @dataclass(frozen=True)
    class Timeful:
        problem: Timed

    scene = Timeful(Timed())
    assert tie_step_to_spacing(scene, None, 0.05) is scene
    for spacing, steps in ((0.2, 5), (0.1, 10), (0.05, 20), (0.15, 7)):
        assert tie_step_to_spacing(scene, 0.1, spacing).problem.step == pytest.approx(0.1 / steps, rel=1e-12)
    steady = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0))
    with pytest.raises(SceneError, match=r"step_per_spacing of .sweep. is for problems with a time step"):
        tie_step_to_spacing(replace(steady), 0.1, 0.05)


def test_sample_points_lie_on_the_surface_and_off_its_boundaries(file):
    scene = load_study(file).scene
    points = sample_points(scene, 500)
    assert 490 <= len(points) <= 500
    assert np.allclose(np.linalg.norm(points, axis=1), 1)
    assert np.linalg.norm(points - [0.6, 0.8], axis=1).min() > 1e-6
    assert np.array_equal(points, sample_points(scene, 500))
    assert np.histogram(np.arctan2(points[:, 1], points[:, 0]), 8)[0].min() > 30


def dirichlet_scene(**sides):
    sides = sides or {"both": ck.Dirichlet(lambda x: x[:, 0] + x[:, 1])}
    cut = ck.Boundary("cut", ck.source("analytic.point", at=[0.6, 0.8]), **sides)
    return ck.Scene(ck.source("analytic.circle"), ck.Poisson(lambda x: x[:, 0] + x[:, 1]), [cut])


@pytest.mark.parametrize(("method", "radius"), [("nearest", None), ("ball", np.hypot(2, 3))])
def test_baselines_fix_nodes_and_solve_for_the_others(method, radius):
    scene = dirichlet_scene()
    solution = solve_by_fixed_nodes(scene, 0.05, method=method)
    band = solution.discretized.tables.layout.band
    from_cut = np.linalg.norm(band.nodes[: band.inner] - np.array([12.0, 16.0]), axis=1)
    fixed = 1 if radius is None else np.count_nonzero(from_cut <= 1.0001 * radius)
    assert len(solution.values) - solution.work.unknowns == fixed
    assert np.abs(solution.values[:, 0] - 1.4).min() < 1e-12
    assert solution.work.queries["cut"] > 0
    theta = np.linspace(0, 2 * np.pi, 200)
    points = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    assert np.abs(solution.evaluate(points) - points.sum(axis=1)).max() < 0.2
    assert solution.report.residual <= 1e-10


def test_baselines_are_of_first_order_and_the_ball_is_the_worse():
    scene, spacings = dirichlet_scene(), (0.05, 0.025, 0.0125, 0.00625)
    points = sample_points(scene, 500)
    rms = {}
    for method in ("nearest", "ball"):
        shifts = np.random.default_rng(1).uniform(0, 1, (4, 2))
        errors = [
            [
                np.abs(
                    solve_by_fixed_nodes(scene, h, method=method, origin=h * o).evaluate(points) - points.sum(axis=1)
                ).max()
                for o in shifts
            ]
            for h in spacings
        ]
        rms[method] = np.sqrt(np.mean(np.square(errors), axis=1))
        assert 0.8 < np.polyfit(np.log(spacings), np.log(rms[method]), 1)[0] < 1.25
    assert np.all(rms["ball"] > 2 * rms["nearest"])


def test_where_two_boundaries_want_a_node_the_nearer_one_has_it():
    cuts = [
        ck.Boundary(name, ck.source("analytic.point", at=at), both=ck.Dirichlet(value))
        for name, at, value in (("one", [1, 0], 1.0), ("two", [np.cos(0.1), np.sin(0.1)], 2.0))
    ]
    for boundaries in (cuts, cuts[::-1]):
        scene = ck.Scene(ck.source("analytic.circle"), ck.Laplace(), boundaries)
        solution = solve_by_fixed_nodes(scene, 0.05, method="ball")
        near = solution.evaluate([[np.cos(-0.1), np.sin(-0.1)], [np.cos(0.2), np.sin(0.2)]])
        assert np.allclose(near, [1, 2], atol=1e-6)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (dirichlet_scene(left=ck.Dirichlet(1.0), right=ck.Dirichlet(0.0)), "boundary 'cut' has others; use"),
        (dirichlet_scene(both=ck.Neumann(0.0)), "holds one Dirichlet condition for both sides"),
        (ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(1.0)), "the scene has none"),
    ],
)
def test_baselines_refuse_what_they_cannot_hold(scene, message):
    with pytest.raises(SceneError, match=message):
        solve_by_fixed_nodes(scene, 0.05, method="nearest")


def test_baselines_tell_of_a_spacing_that_is_too_coarse():
    with pytest.raises(ResolutionError):
        solve_by_fixed_nodes(dirichlet_scene(), 0.6, method="ball")


def test_commands_run_and_report(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run("run", file, "--cheap")
    assert done.exit_code == 0, done.output
    assert "runs       4 made, 0 with errors, 0 recorded before" in done.stdout
    assert done.stderr.count("greatest error") == 4
    quiet = run("run", file, "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")
    for study in (file, tmp_path / "cut"):
        report = run("report", study)
        assert report.exit_code == 0, report.output
        assert report.stdout.startswith("|  | 0.1 | 0.05 | 0.025 | order |")
        assert (tmp_path / "cut" / "convergence.png").stat().st_size > 10_000
    assert json.loads((tmp_path / "cut" / "records.jsonl").read_text().splitlines()[0])["study"] == "cut"
    assert not (tmp_path / "cut" / "work.png").exists()


def test_commands_answer_in_one_sentence(file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cut").mkdir()
    absent = run("report", file)
    assert absent.exit_code == 1
    assert "holds no records; run `cpmkit study run` first." in absent.stderr
    run("run", file, "--cheap", "--output", "elsewhere", "--quiet")
    file.write_text(TEXT.replace("points = 300", "points = 20"))
    (tmp_path / "elsewhere").rename(tmp_path / "cut" / "x")
    (tmp_path / "cut" / "x" / "records.jsonl").rename(tmp_path / "cut" / "records.jsonl")
    stale = run("report", file)
    assert stale.exit_code == 1
    assert "4 records, none of the study file as it is now" in stale.stderr
    assert run("run", tmp_path / "nothing.toml").exit_code == 2
