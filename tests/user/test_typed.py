"""A user's editor knows every name and every option, and a type checker refuses what there is none of."""

import ast
import os
import re
import subprocess
import sys
import types
import typing
from dataclasses import fields
from functools import cache
from pathlib import Path

import pytest

import cpmkit as ck
import cpmkit.applications
from cpmkit.families import solve_options
from cpmkit.families.solve_options import Checkpointing
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.forms.choice import FORMS
from cpmkit.forms.options import Options
from cpmkit.linear.solver_options import SOLVER_OPTIONS, SolverOptions
from cpmkit.runtime.options import declared_options
from cpmkit.scenefile.look import AXES, LIGHTS, PICTURE_FIELDS, Look, LookKeywords, SavingKeywords

ROOT = Path(__file__).parents[2]
SCRIPT = Path(__file__).with_name("typed_script.py")
TASKS = sorted((ROOT / "examples" / "tasks").glob("*.py"))
#: What options are kept as, where they are given in more ways: text is read as bytes, or as a path.
KEPT = {"Path": "PathLike[str]"}


@pytest.mark.slow
def test_a_type_checker_passes_what_is_right_and_refuses_each_line_that_is_not():
    told = mypy(SCRIPT, *TASKS)
    refused = {int(number) for number in re.findall(rf"{SCRIPT.name}:([0-9]+): error:", told)}
    assert refused == {number for number, line in enumerate(lines(), 1) if line.endswith("# wrong")}, told
    assert [line for line in told.splitlines() if ": error:" in line and SCRIPT.name not in line] == []


def test_the_script_uses_public_names_alone():
    right = [line for line in lines() if not line.endswith("# wrong")]
    used = re.findall(r"\bck\.(\w+)", "\n".join(right))
    assert len(set(used)) > 10
    assert set(used) <= set(ck.__all__)


@pytest.mark.parametrize("package", [ck, cpmkit.applications])
def test_type_checkers_see_the_names_of_the_table(package):
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    seen = {name.name: node.module for node in block.body for name in node.names if name.asname == name.name}
    assert seen == {name: f"{package.__name__}.{module}" for name, module in package._PUBLIC.items()}
    assert set(package._PUBLIC) <= set(dir(package))


def test_a_misspelt_name_is_answered_with_the_one_that_may_be_meant():
    done = subprocess.run(
        [sys.executable, "-P", "-c", "import cpmkit; cpmkit.Dirichlett"], capture_output=True, text=True, check=False
    )
    assert "module 'cpmkit' has no attribute 'Dirichlett'. Did you mean: 'Dirichlet'?" in done.stderr


@pytest.mark.parametrize(
    ("seen", "kinds", "more"),
    [
        (solve_options.SolverKeywords, [SolverOptions], {one for of_one in SOLVER_OPTIONS.values() for one in of_one}),
        (solve_options.DiscretizingKeywords, [Options, *FORMS.values()], set()),
        (solve_options.CheckpointingKeywords, [Checkpointing], set()),
        (solve_options.TargetKeywords, [AccuracyTarget], set()),
    ],
)
def test_typed_options_are_those_that_are_declared(seen, kinds, more):
    stated = {one.name: one.type for kind in kinds for one in fields(kind) if one.name in declared_options(kind)}
    stated.pop("spacing", None)  # a parameter of its own
    typed = {name: str(hint.__forward_arg__) for name, hint in seen.__annotations__.items()}
    assert set(typed) == set(stated) | more
    for name, kept in stated.items():
        kinds_kept = {KEPT.get(one, one) for one in kept.split(" | ")}
        assert typed[name] == "Any" or kept == "Any" or kinds_kept <= set(typed[name].split(" | ")), name
    assert typing.get_type_hints(seen)


def test_typed_options_of_pictures_are_those_of_a_look():
    typed = typing.get_type_hints(LookKeywords)
    assert set(typed) == {one.name for one in fields(Look)}
    for one in fields(Look):
        kinds = {"None" if kind is type(None) else getattr(kind, "__name__", "") for kind in parts(typed[one.name])}
        stated = {kind for kind in one.type.split(" | ") if kind in ("int", "bool", "str", "None")}
        assert stated - kinds <= {"str"}, one.name  # a Literal stands for text
        assert ("str" in stated) == ("str" in kinds or bool(literals(typed[one.name]))), one.name
    assert literals(typed["field"]) == PICTURE_FIELDS
    assert literals(typed["light"]) == LIGHTS
    assert literals(typed["up"]) == AXES
    assert set(typing.get_type_hints(SavingKeywords)) == {*typed, "fps"}


def parts(hint):
    """Return the kinds of which a hint is one."""
    return typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)


def literals(hint):
    return tuple(word for one in parts(hint) if typing.get_origin(one) is typing.Literal for word in one.__args__)


@pytest.mark.parametrize(
    ("draw", "told"),
    [
        (lambda one: one.picture("a.png", widht=100), r"a picture has no option 'widht' \(did you mean 'width'"),
        (lambda one: one.plot(cmpa="jet"), r"a plot has no option 'cmpa' \(did you mean 'cmap'"),
        (lambda one: one.show(titel="A"), r"a page has no option 'titel' \(did you mean 'title'"),
        (lambda one: one.save("a.html", isoline=1), r"a page has no option 'isoline' \(did you mean 'isolines'"),
        (lambda one: one.animate("a.gif", fpss=3), r"a film has no option 'fpss' \(did you mean 'fps'"),
        (lambda one: one.save("a.gif", veiw=(1, 0, 0)), r"a film has no option 'veiw' \(did you mean 'view'"),
    ],
)
def test_a_misspelt_option_of_a_picture_is_answered_with_the_one_that_may_be_meant(draw, told, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ck.InputError, match=told):
        draw(cooling())
    assert not list(tmp_path.iterdir())


@cache
def cooling():
    heat = ck.Heat("x", until=0.2, step=0.1, frames=1)
    return ck.solve(ck.Scene(ck.source("analytic.circle"), heat), spacing=0.3)


def lines():
    return SCRIPT.read_text(encoding="utf-8").splitlines()


def mypy(*files):
    """Return what mypy says; what it found out of cpmkit itself is kept beside the repository's own runs."""
    command = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml", "--no-error-summary", *map(str, files)]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False).stdout
