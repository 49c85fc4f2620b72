"""A user's editor knows every name and every option, and a type checker refuses what there is none of."""

import ast
import inspect
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
from cpmkit.preparing import Prepared
from cpmkit.scenefile.look import Look, LookKeywords, SavingKeywords

ROOT = Path(__file__).parents[2]
SCRIPT = Path(__file__).with_name("typed_script.py")
TASKS = sorted((ROOT / "examples" / "tasks").glob("*.py"))
#: Types of arguments that are converted to the type of an option.
WIDER = {"Path": "PathLike[str]"}


@pytest.mark.slow
def test_a_type_checker_passes_what_is_right_and_refuses_each_line_that_is_not():
    output = mypy(SCRIPT, *TASKS)
    refused = {int(number) for number in re.findall(rf"{SCRIPT.name}:([0-9]+): error:", output)}
    assert refused == {number for number, line in enumerate(lines(), 1) if line.endswith("# wrong")}, output
    assert [line for line in output.splitlines() if ": error:" in line and SCRIPT.name not in line] == []


def test_the_script_uses_public_names_alone():
    right = [line for line in lines() if not line.endswith("# wrong")]
    used = re.findall(r"\bck\.(\w+)", "\n".join(right))
    assert len(set(used)) > 10
    assert set(used) <= set(ck.__all__)


@pytest.mark.parametrize("package", [ck, cpmkit.applications])
def test_the_names_of_a_package_are_those_that_type_checkers_see(package):
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    seen = {name.name: node.module for node in block.body for name in node.names if name.asname == name.name}
    assert package.__all__ == sorted(seen)
    assert set(seen) <= set(dir(package))


def test_a_misspelt_name_is_answered_with_the_one_that_may_be_meant():
    done = subprocess.run(
        [sys.executable, "-P", "-c", "import cpmkit; cpmkit.Dirichlett"], capture_output=True, text=True, check=False
    )
    assert "module 'cpmkit' has no attribute 'Dirichlett'. Did you mean: 'Dirichlet'?" in done.stderr


@pytest.mark.parametrize("call", [ck.solve, ck.prepare, ck.discretize, ck.explain, ck.estimate_error, Prepared.solve])
def test_typed_options_are_those_that_are_declared(call):
    """Signatures show what is declared; the keywords that type checkers see are those of the first overload."""
    first, *_ = [*typing.get_overloads(call), inspect.unwrap(call)]
    (keywords,) = typing.get_args(typing.get_type_hints(first)["options"])
    named = {name for kind in (first, call) for name in inspect.unwrap(kind).__kwdefaults__ or {}}
    declared = {
        name: parameter.annotation
        for name, parameter in inspect.signature(call).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY and name not in named
    }
    typed = {name: str(hint.__forward_arg__) for name, hint in keywords.__annotations__.items()}
    assert set(typed) - named - {"max_iterations"} == set(declared)  # which only some of the solvers have
    for name, stated in declared.items():
        kinds = {WIDER.get(kind, kind) for kind in stated.split(" | ")}
        assert typed[name] == "Any" or stated == "Any" or kinds <= set(typed[name].split(" | ")), name
    assert typing.get_type_hints(keywords)


def test_typed_options_of_pictures_are_those_of_a_look():
    typed = typing.get_type_hints(LookKeywords)
    assert set(typed) == {one.name for one in fields(Look)}
    for one in fields(Look):
        kinds = {"None" if kind is type(None) else getattr(kind, "__name__", "") for kind in parts(typed[one.name])}
        stated = {kind for kind in one.type.split(" | ") if kind in ("int", "bool", "str", "None")}
        assert stated - kinds <= {"str"}, one.name  # a Literal stands for text
        assert ("str" in stated) == ("str" in kinds or bool(literals(typed[one.name]))), one.name
    for name in ("field", "light", "up"):
        with pytest.raises(ck.InputError, match=f"{name} of a picture.* must be ") as error:
            Look(**{name: "nonsense"})
        assert literals(typed[name]) == tuple(re.findall(r"'(\w+)'", str(error.value).partition(", got")[0])), name
    assert set(typing.get_type_hints(SavingKeywords)) == {*typed, "fps"}


def parts(hint):
    """Return the kinds of which a hint is one."""
    return typing.get_args(hint) if typing.get_origin(hint) in (typing.Union, types.UnionType) else (hint,)


def literals(hint):
    return tuple(word for one in parts(hint) if typing.get_origin(one) is typing.Literal for word in one.__args__)


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (
            lambda solution: solution.picture("a.png", widht=100),
            r"a picture has no option 'widht' \(did you mean 'width'",
        ),
        (lambda solution: solution.plot(cmpa="jet"), r"a plot has no option 'cmpa' \(did you mean 'cmap'"),
        (lambda solution: solution.show(titel="A"), r"a page has no option 'titel' \(did you mean 'title'"),
        (
            lambda solution: solution.save("a.html", isoline=1),
            r"a page has no option 'isoline' \(did you mean 'isolines'",
        ),
        (lambda solution: solution.animate("a.gif", fpss=3), r"a film has no option 'fpss' \(did you mean 'fps'"),
        (lambda solution: solution.save("a.gif", veiw=(1, 0, 0)), r"a film has no option 'veiw' \(did you mean 'view'"),
    ],
)
def test_a_misspelt_option_of_a_picture_is_answered_with_the_one_that_may_be_meant(
    draw, message, monkeypatch, tmp_path
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ck.InputError, match=message):
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
