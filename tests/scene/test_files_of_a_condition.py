"""A kind of condition is known in at most four files of the core: all else asks which of the standard laws it is."""

import ast
from pathlib import Path

import pytest

import cpmkit as ck

CORE = Path(ck.__file__).parent
#: Kinds, and their keys in scene files.
KINDS = {
    "Dirichlet": "dirichlet",
    "Neumann": "neumann",
    "Robin": "robin",
    "NonlinearFlux": "nonlinear flux",
    "Transmission": "across",
    "Steklov": "steklov",
    "SimplySupported": "simply_supported",
}
#: What is written over public names, as a user's own program is: users of conditions, not authors of them.
USERS = ("applications/", "examples/", "plugin", "scenefile/application_files")
#: Where nothing is given, nothing flows out: these take a zero flux, and tell it from no other kind.
ZERO_FLUX = {"scene/scene", "scenefile/scene_files", "solution/boundary_points"}


def named_in(tree):
    """Yield the classes that a module names, and its strings: a key counts as a string alone, not as a variable."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Name) and node.id in KINDS:
            yield node.id
        elif isinstance(node, ast.Attribute) and node.attr in KINDS:
            yield node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


@pytest.fixture(scope="module")
def files():
    """Return the files of the core, each with what it names, that name any kind."""
    words, found = {*KINDS, *KINDS.values()}, {}
    for file in CORE.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        if any(word in text for word in words):
            found[file.relative_to(CORE).with_suffix("").as_posix()] = words & {*named_in(ast.parse(text))}
    return {name: named for name, named in found.items() if named and not name.startswith(USERS)}


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"Transmission"}))
def test_a_kind_is_known_in_four_files(files, kind):
    knowing = {name for name, named in files.items() if {kind, KINDS[kind]} & named}
    if kind == "Neumann":
        assert knowing >= ZERO_FLUX
        knowing -= ZERO_FLUX
    assert knowing & {"scene/conditions", "scene/special_conditions"}
    assert len(knowing) <= 4, sorted(knowing)


def test_what_couples_both_sides_is_known_in_four_files_though_its_key_is_that_of_the_way_it_is_given(files):
    assert len([name for name, named in files.items() if "Transmission" in named]) <= 4


def test_no_form_and_no_family_knows_a_kind(files):
    rooms = ("forms/", "families/", "linear/", "grid/", "manifold/", "view/", "saving/", "forecast/")
    assert [(name, named) for name, named in files.items() if name.startswith(rooms) and named & {*KINDS}] == []
