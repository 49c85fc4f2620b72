"""An option is added in one place: what is declared here, from outside, is known wherever a scene is discretised."""

import inspect
from dataclasses import dataclass, replace

import numpy as np
import pytest

import cpmkit as ck
from cpmkit.errors import shown
from cpmkit.forms import choice
from cpmkit.forms.collocation.options import CollocationOptions
from cpmkit.runtime.options import DeclaredOptions, option
from cpmkit.studies.records import group_into_series, read_records
from cpmkit.studies.run_one import run_study
from cpmkit.studies.studyfile import load_study

CIRCLE = ck.Scene(ck.source("analytic.circle"), ck.ScreenedPoisson(lambda x: 2 * x[:, 0]))
TEXT = """
[surface]
kind = "analytic.circle"

[problem]
kind = "screened"
f = "2*x"
"""
STUDY = '[exact]\nu = "x"\npoints = 50\n[sweep]\nspacings = [0.2]\n'


def flag(value, what):
    if not isinstance(value, bool):
        raise ck.InputError(f"{what} must be true or false, got {shown(value)}.")
    return value


@dataclass(frozen=True)
class WithSmooth(CollocationOptions):
    """The options of the closest point method, and one more."""

    smooth: bool = option(False, "Whether the interpolation is of degree 5, whatever the degree.", flag)

    def __post_init__(self):
        super().__post_init__()
        object.__setattr__(self, "degree", 5 if self.smooth else self.degree)


@dataclass(frozen=True)
class OfAnotherForm(DeclaredOptions):
    """What a second form declares."""

    stretch: float = option(1.0, "How strongly conditions are held.")


@pytest.fixture
def added(monkeypatch):
    monkeypatch.setitem(choice.FORMS, "collocation", WithSmooth)


@pytest.fixture
def another(monkeypatch):
    monkeypatch.setitem(choice.FORMS, "another", OfAnotherForm)


def written(folder, text, name="scene.toml"):
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.usefixtures("added")
def test_it_arrives_in_a_solve_a_forecast_and_the_tables():
    plain, smooth = ck.solve(CIRCLE, 0.2), ck.solve(CIRCLE, 0.2, smooth=True)
    np.testing.assert_array_equal(smooth.values, ck.solve(CIRCLE, 0.2, degree=5).values)
    assert smooth.work.unknowns > plain.work.unknowns
    assert ck.explain(CIRCLE, 0.2, smooth=True, dry_run=True).unknowns == smooth.work.unknowns
    assert ck.discretize(CIRCLE, 0.2, smooth=True).size == smooth.work.unknowns
    coarse = [ck.estimate_error(CIRCLE, 0.1, **one).coarse.values for one in ({"smooth": True}, {"degree": 5})]
    np.testing.assert_array_equal(*coarse)
    for ask in (ck.solve, ck.explain, ck.discretize):
        with pytest.raises(ck.InputError, match="smooth must be true or false, got 3"):
            ask(CIRCLE, 0.2, smooth=3)


@pytest.mark.usefixtures("added")
def test_it_is_a_key_of_scene_files(tmp_path):
    file = written(tmp_path, f"{TEXT}[discretization]\nspacing = 0.2\nsmooth = true\n")
    loaded = ck.load_scene(file)
    assert loaded.options == {"smooth": True}
    assert ck.solve(loaded.scene, loaded.spacing, **loaded.options).discretized.tables.layout.band.degree == 5
    with pytest.raises(ck.SceneError, match=r"scene.toml: \[discretization\]: smooth must be true or false, got 3"):
        ck.load_scene(written(tmp_path, file.read_text().replace("true", "3")))
    with pytest.raises(ck.SceneError, match=r"did you mean 'smooth'\?\); accepted are .*sheets, smooth"):
        ck.load_scene(written(tmp_path, file.read_text().replace("smooth", "smoth")))


@pytest.mark.usefixtures("added")
def test_it_is_varied_by_studies(tmp_path):
    study = load_study(written(tmp_path, f"{TEXT}{STUDY}smooths = [false, true]\n"))
    assert run_study(study, tmp_path).made == 2
    records = read_records(tmp_path / "records.jsonl")
    assert [record["smooth"] for record in records] == [False, True]
    assert records[1]["unknowns"] == ck.solve(CIRCLE, 0.2, degree=5).work.unknowns > records[0]["unknowns"]
    assert [one.label for one in group_into_series(records)] == ["smooth False", "smooth True"]
    assert run_study(study, tmp_path).made == 0
    with pytest.raises(ck.SceneError, match=r"smooths of \[sweep\] must be true or false, got 1"):
        load_study(written(tmp_path, f"{TEXT}{STUDY}smooths = [1]\n"))
    with pytest.raises(ck.SceneError, match=r"a study's smooth stands in smooths of \[sweep\]"):
        load_study(written(tmp_path, f"{TEXT}[discretization]\nsmooth = true\n{STUDY}"))


def test_records_of_before_it_was_declared_are_those_of_its_default(tmp_path, monkeypatch):
    file = written(tmp_path, TEXT + STUDY)
    assert run_study(load_study(file), tmp_path).made == 1
    monkeypatch.setitem(choice.FORMS, "collocation", WithSmooth)
    assert run_study(load_study(file), tmp_path).skipped == 1


@pytest.mark.usefixtures("added")
def test_it_is_saved_and_loaded(tmp_path):
    solution = ck.solve(CIRCLE, 0.2, smooth=True)
    solution.save(tmp_path / "smooth.npz")
    loaded = ck.load(tmp_path / "smooth.npz", CIRCLE)
    assert loaded.discretized.tables.layout.options.own == WithSmooth(degree=5, smooth=True)
    np.testing.assert_array_equal(loaded.evaluate([[0.6, 0.8]]), solution.evaluate([[0.6, 0.8]]))


def test_a_solution_of_before_it_was_declared_has_its_default(tmp_path, monkeypatch):
    ck.solve(CIRCLE, 0.2, order=1).save(tmp_path / "plain.npz")
    monkeypatch.setitem(choice.FORMS, "collocation", WithSmooth)
    assert ck.load(tmp_path / "plain.npz", CIRCLE).discretized.tables.layout.options.own == WithSmooth(order=1)


@pytest.mark.usefixtures("another")
def test_an_option_of_another_form_is_refused_by_name(tmp_path):
    message = (
        r"stretch is an option of the form 'another', got form='collocation', .*; leave it out, or use form='another'"
    )
    for ask in (ck.solve, ck.explain, ck.discretize):
        with pytest.raises(ck.InputError, match=message):
            ask(CIRCLE, 0.2, form="collocation", stretch=2.0)
    with pytest.raises(ck.SceneError, match=message):
        ck.load_scene(written(tmp_path, f"{TEXT}[discretization]\nform = 'collocation'\nstretch = 2.0\n"))
    assert choice.options_of(CIRCLE, 0.2, {"form": "another", "stretch": 2.0})[0].own == OfAnotherForm(2.0)
    with pytest.raises(ck.InputError, match="degree is an option of the form 'collocation', got form='another'"):
        choice.options_of(CIRCLE, 0.2, {"form": "another", "degree": 2})


@pytest.mark.parametrize("form", ["galerkim", 3, ["collocation"], None])
def test_a_form_that_is_none_is_refused(form):
    with pytest.raises(ck.InputError, match="form must be 'collocation', 'galerkin' or 'auto', got"):
        ck.solve(CIRCLE, 0.2, form=form)


def test_signatures_and_docstrings_show_the_options_with_their_defaults():
    shown_by = {
        call: inspect.signature(call).parameters for call in (ck.solve, ck.explain, ck.estimate_error, ck.discretize)
    }
    for call, options in shown_by.items():
        assert options["degree"].default is ...  # that of the form
        assert (options["form"].default, options["sheets"].default, options["refine_levels"].default) == (
            "auto",
            True,
            3,
        )
        assert ("solver" in options) == (call is not ck.discretize)
        assert ("checkpoint_every" in options) == (call is ck.solve)
        keywords = {name for name, option in options.items() if option.kind is option.KEYWORD_ONLY}
        lines = call.__doc__.splitlines()
        for name in keywords - {"backend", "progress", "dry_run", "seconds", "tight"}:
            (line,) = (number for number, text in enumerate(lines) if text.startswith(f"{name} : "))
            assert lines[line + 1].startswith("    ")  # the summary


def test_one_value_makes_the_same_tables_again():
    made = ck.discretize(CIRCLE, 0.2, order=1).tables.layout.options
    assert made.as_dict() == {**choice.options_of(CIRCLE, 0.2, made.as_dict())[0].as_dict()}
    finer = replace(made, spacing=0.1)
    assert (finer.spacing, finer.own) == (0.1, made.own)
