"""A user's editor knows every name and every option, and a type checker refuses what there is none of."""

import ast
import os
import re
import subprocess
import sys
import typing
from dataclasses import fields
from pathlib import Path

import pytest

import cpmkit as ck
import cpmkit.applications
from cpmkit.families import keywords
from cpmkit.families.checkpointing import Checkpointing
from cpmkit.forms.asked import Asked
from cpmkit.forms.choice import FORMS
from cpmkit.forms.options import Options
from cpmkit.linear.choice import SOLVER_OPTIONS, SolverOptions
from cpmkit.runtime.declared import declared

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
        (keywords.SolverKeywords, [SolverOptions], {one for of_one in SOLVER_OPTIONS.values() for one in of_one}),
        (keywords.DiscretizingKeywords, [Options, *FORMS.values()], set()),
        (keywords.CheckpointingKeywords, [Checkpointing], set()),
        (keywords.AskedKeywords, [Asked], set()),
    ],
)
def test_typed_options_are_those_that_are_declared(seen, kinds, more):
    stated = {one.name: one.type for kind in kinds for one in fields(kind) if one.name in declared(kind)}
    stated.pop("spacing", None)  # a parameter of its own
    typed = {name: str(hint.__forward_arg__) for name, hint in seen.__annotations__.items()}
    assert set(typed) == set(stated) | more
    for name, kept in stated.items():
        kinds_kept = {KEPT.get(one, one) for one in kept.split(" | ")}
        assert typed[name] == "Any" or kept == "Any" or kinds_kept <= set(typed[name].split(" | ")), name
    assert typing.get_type_hints(seen)


def lines():
    return SCRIPT.read_text(encoding="utf-8").splitlines()


def mypy(*files):
    """Return what mypy says; what it found out of cpmkit itself is kept beside the repository's own runs."""
    command = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml", "--no-error-summary", *map(str, files)]
    environment = {**os.environ, "MYPYPATH": str(ROOT)}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False).stdout
