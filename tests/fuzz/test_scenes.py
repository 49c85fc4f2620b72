"""Whatever a scene file holds, it is read, checked and explained, or refused in a sentence."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest
from fuzzing import answered, corpus, long, short
from hypothesis import given
from hypothesis import strategies as st

import cpmkit as ck
from cpmkit.saving.results import check_request

#: Numbers at the ends of their range overflow on the way; what comes out is what counts.
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")

SCENE: dict[str, Any] = {
    "surface": {
        "kind": "analytic.arc",
        "start": 0.0,
        "end": 3,
        "radius": 1.0,
        "translation": [0, 0],
        "edge": {"0": {"dirichlet": "x + 1"}, "1": {"neumann": 0}},
    },
    "boundary": [
        {"name": "pin", "kind": "analytic.point", "at": [0, 1], "both": {"robin": [1, "2 + x", 0.5], "order": 1}},
        {"name": "cut", "kind": "analytic.point", "at": [0.6, 0.8], "left": {"dirichlet": 1}, "right": {"neumann": 0}},
    ],
    "problem": {"kind": "elliptic", "f": "x*y", "c": 1, "diffusivity": "2 + y", "velocity": ["-y", "x"]},
    "discretization": {"spacing": 0.2, "degree": 3, "order": 2, "origin": [0, 0], "sheets": True},
    "solver": {"kind": "direct", "tolerance": 1e-10},
    "output": {"folder": "out", "files": ["summary.json", "solution.npz"], "picture": {"file": "a.png", "width": 300}},
}
HEAT = {"kind": "heat", "initial": "x", "until": 0.2, "step": 0.1, "kappa": 1, "scheme": "bdf2", "frames": 2}
KINDS = {
    "level set": {"kind": "levelset.expression", "phi": "x**2 + y**2 - 1", "bounds": [[-2, -2], [2, 2]]},
    "parametric": {"kind": "parametric.curve", "x": ["cos(t)", "sin(t)"], "range": [0, "pi"], "periodic": False},
    "trimmed": {"kind": "trimmed", "of": {"kind": "analytic.circle"}, "trim": "x - 0.5"},
}
#: Values that no key expects, or that are just beyond what one does.
ODD = [
    True, False, 0, -1, 3, 2**62, 2**70, -0.0, 0.5, 1e300, -1e-300, float("nan"), float("inf"), "", "x", "1/0", "t",
    "a.b", "../x", "/x", "summary.json", "analytic.circle", "shpere", "heat", "²", "é" * 50, "y" * 300, "a\nb",
    "\x1b[31m", "\x00", [], [[]], [1], [0, 1], [1, [2]], ["x", 0], [True, 0], [[0, 0], [1, 1]], {}, {"0": 1},
    {"kind": "analytic.point"}, {"values": "a.npy"}, {"dirichlet": 1}, {"robin": [1, 2]}, {"jump": 1},
    [{"kind": "analytic.circle"}, 3],
]  # fmt: skip
values = st.sampled_from(ODD) | st.integers() | st.floats() | st.text(max_size=12) | st.lists(st.floats(), max_size=3)
names = st.sampled_from([*SCENE, *HEAT, "edge", "lefft", "both", "across", "of", "file", "values", "²", "left_of", "é"])


def toml(value: Any) -> str:
    """Return a value as TOML, in line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_text(key)} = {toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value) if isinstance(value, float) else _text(value)


def _text(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


def written(tables: dict[str, Any]) -> str:
    return "\n".join(f"{_text(key)} = {toml(value)}" for key, value in tables.items())


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all entries of tables and lists."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else []
    return [place for key, entry in pairs for place in [(*path, key), *places(entry, (*path, key))]]


@st.composite
def scenes(draw: st.DrawFn) -> str:
    """Draw the text of a scene with one to three entries changed, renamed, added or removed."""
    tables = copy.deepcopy(SCENE)
    if draw(st.booleans()):
        tables["problem"] = dict(HEAT)
    if draw(st.integers(0, 3)) == 0:
        tables["surface"] = copy.deepcopy(KINDS[draw(st.sampled_from(sorted(KINDS)))])
    for _ in range(draw(st.integers(1, 3))):
        *path, key = draw(st.sampled_from(places(tables)))
        owner: Any = tables
        for step in path:
            owner = owner[step]
        change = draw(st.sampled_from(["value", "value", "rename", "add", "remove"]))
        if change == "value" or isinstance(owner, list):
            owner[key] = copy.deepcopy(draw(values))
        elif change == "add":
            owner[draw(names)] = copy.deepcopy(draw(values))
        else:
            entry = owner.pop(key)
            owner |= {draw(names | st.text(max_size=8)): entry} if change == "rename" else {}
    return written(tables)


@st.composite
def damaged(draw: st.DrawFn) -> str:
    """Draw the text of a scene with a piece of it taken out, doubled or replaced."""
    text = written(SCENE)
    begin, length = draw(st.integers(0, len(text))), draw(st.integers(0, 30))
    return (
        text[:begin] + draw(st.text(max_size=10) | st.just(2 * text[begin : begin + length])) + text[begin + length :]
    )


def target(folder: Path, text: str) -> None:
    """Read a scene and explain it, unless its spacing is fine: as far as `cpmkit explain` goes."""
    file = folder / "scene.toml"
    file.write_bytes(text.encode("utf-8", "surrogatepass"))

    def call() -> None:
        loaded = ck.load_scene(file)
        check_request(loaded.output, loaded.scene.surface, folder / "results")
        if loaded.spacing is None or not loaded.spacing < 0.1:
            ck.explain(loaded.scene, loaded.spacing, dry_run=True, **loaded.options)

    answered(call)
    assert sorted(path.name for path in folder.iterdir()) == ["scene.toml"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_scene_itself_is_explained(folder: Path) -> None:
    (folder / "scene.toml").write_text(written(SCENE), encoding="utf-8")
    loaded = ck.load_scene("scene.toml")
    assert ck.explain(loaded.scene, loaded.spacing, dry_run=True, **loaded.options).unknowns > 50


@pytest.mark.parametrize("file", corpus(".toml"), ids=lambda file: file.name)
def test_what_broke_once_is_answered(folder: Path, file: Path) -> None:
    target(folder, file.read_text(encoding="utf-8"))


@short
@given(text=scenes())
def test_any_change_of_a_scene_is_answered(folder: Path, text: str) -> None:
    target(folder, text)


@short
@given(text=damaged())
def test_any_damage_of_a_file_is_answered(folder: Path, text: str) -> None:
    target(folder, text)


@long
@given(text=scenes() | damaged())
def test_a_long_session_of_scenes(folder: Path, text: str) -> None:
    target(folder, text)
