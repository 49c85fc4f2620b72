"""Damaged checkpoints and saved solutions: bytes, arrays and their tables of plain values, changed at random."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzzing import answered, corpus, long, short
from hypothesis import given
from hypothesis import strategies as st

import cpmkit as ck
from cpmkit.errors import CpmkitError
from cpmkit.families.evolution.checkpoints import digest_arrays

CUT = ck.Boundary("cut", ck.source("analytic.point", at=[0.6, 0.8]), both=ck.Dirichlet([0.5, 1.0]))
CIRCLE = ck.source("analytic.circle")
WAVE = ck.Wave(lambda x: x[:, 0], until=0.3, step=0.05, frames=2)
SCENES = {
    "heat": ck.Scene(CIRCLE, ck.Heat(lambda x: x[:, 0], until=0.3, step=0.05, frames=3), [CUT]),
    "wave": ck.Scene(CIRCLE, WAVE, [CUT]),
    "steady": ck.Scene(CIRCLE, ck.ScreenedPoisson(1.0), [CUT]),
    "closed": ck.Scene(CIRCLE, ck.Poisson(lambda x: x[:, 0] + 1.0)),
    "eigen": ck.Scene(CIRCLE, ck.Eigen(3)),
}
#: Files and what reads them.
DOORS = ("heat", "wave", "steady", "closed", "eigen")
TEXTS = st.sampled_from(["", "null", "dirichlet", "fem", "\x1b[31m", "x" * 1000])
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**20), 10**20) | st.floats() | TEXTS | st.just(10**400),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=2),
    max_leaves=4,
)
SHAPES = st.lists(st.integers(0, 4), max_size=3).map(tuple)
TYPES = st.sampled_from(["f8", "f4", ">f8", "f2", "i8", "i4", "u8", "b1", "c16", "U5", "S5", "M8[s]"])


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> dict[str, bytes]:
    """Return the bytes of a checkpoint of each run in time and of each solution that was saved."""
    folder = tmp_path_factory.mktemp("written")
    for name, scene in SCENES.items():
        keys: dict[str, Any] = {"checkpoint": folder / "run.npz"} if name in ("heat", "wave") else {}
        ck.solve(scene, 0.2, **keys).save(folder / f"{name}.npz")
        if keys:
            (folder / "run.npz").rename(folder / f"{name}-run.npz")
    return {file.stem: file.read_bytes() for file in folder.iterdir()}


def read(path: Path, name: str) -> None:
    """Go through every door that a file has."""
    if name.endswith("-run"):
        answered(lambda: ck.solve(SCENES[name.removesuffix("-run")], 0.2, resume=path))
        return
    answered(lambda: ck.load(path))
    solution = answered(lambda: ck.load(path, SCENES[name]))
    if not isinstance(solution, CpmkitError):
        assert np.isfinite(solution.evaluate([[0.6, 0.8], [0, 1]])).all()
        assert isinstance(repr(solution) + "".join(w for one in solution.imbalances for w in one.warnings), str)


FILES = st.sampled_from([*DOORS, "heat-run", "wave-run"])


def flip(data: st.DataObject, written: dict[str, bytes], folder: Path) -> None:
    """Change bytes, or cut the file off."""
    name = data.draw(FILES)
    content = bytearray(written[name])
    for _ in range(data.draw(st.integers(1, 8))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    del content[data.draw(st.integers(len(content) // 2, len(content)) | st.just(len(content))) :]
    (folder / "file.npz").write_bytes(content)
    read(folder / "file.npz", name)


def table_in(array: np.ndarray) -> dict[str, Any] | None:
    """Return the table of plain values that text holds, None if it holds none."""
    try:
        table = json.loads(str(array))
    except ValueError:
        return None
    return table if isinstance(table, dict) else None


def changed(data: st.DataObject, array: np.ndarray) -> Any:
    """Return another array in place of one."""
    if array.dtype.kind == "U" and data.draw(st.booleans()):
        table = table_in(array)
        return np.array(json.dumps(data.draw(PLAIN) if table is None else mutated(data, table)))
    kind = data.draw(st.sampled_from(["shape", "type", "rows", "value", "other"]))
    if kind == "type" and array.dtype.kind in "bif":
        with np.errstate(all="ignore"):
            return array.astype(data.draw(TYPES))
    if kind == "rows" and array.ndim:
        return array[: data.draw(st.integers(0, len(array)))]
    if kind == "value" and array.dtype.kind in "fi":
        with np.errstate(all="ignore"):
            return array + np.array(data.draw(st.sampled_from([5, 1e300, np.nan, np.inf, -1]))).astype(array.dtype)
    if kind == "shape":
        return array.reshape(-1) if array.ndim > 1 else array.reshape(1, *array.shape)
    return np.zeros(data.draw(SHAPES), dtype=data.draw(TYPES))


def mutated(data: st.DataObject, value: Any) -> Any:
    """Return plain values with one of them, at any depth, replaced or left out."""
    if isinstance(value, dict) and value and data.draw(st.integers(0, 5)):
        key = data.draw(st.sampled_from(sorted(value)))
        if not data.draw(st.integers(0, 4)):
            return {name: entry for name, entry in value.items() if name != key}
        return value | {key: mutated(data, value[key])}
    if isinstance(value, list) and value and data.draw(st.booleans()):
        number = data.draw(st.integers(0, len(value) - 1))
        return [*value[:number], mutated(data, value[number]), *value[number + 1 :]]
    return data.draw(PLAIN)


def alter(data: st.DataObject, written: dict[str, bytes], folder: Path) -> None:
    """Leave arrays out, or put others in their place; a checkpoint may get the digest of what it then holds."""
    name = data.draw(FILES)
    (folder / "file.npz").write_bytes(written[name])
    with np.load(folder / "file.npz") as opened:
        arrays = {key: opened[key] for key in opened.files}
    for _ in range(data.draw(st.integers(1, 2))):
        key = data.draw(st.sampled_from(sorted(arrays)))
        if data.draw(st.integers(0, 3)):
            arrays[key] = changed(data, arrays[key])
        else:
            del arrays[key]
    if "contents" in arrays and data.draw(st.booleans()):
        rest = {key: array for key, array in arrays.items() if key != "contents"}
        numbers = [one for one in rest.values() if one.dtype.kind not in "bU"]
        if all(one.dtype.kind in "if" and np.abs(one).max(initial=0) < 100 for one in numbers):
            arrays["contents"] = np.array(digest_arrays(rest))
    np.savez(folder / "file.npz", **arrays)
    read(folder / "file.npz", name)


@pytest.mark.parametrize("damage", [flip, alter])
@short
@given(data=st.data())
def test_damaged_files_are_answered(damage, data, written, tmp_path):
    damage(data, written, tmp_path)


@pytest.mark.parametrize("damage", [flip, alter])
@long
@given(data=st.data())
def test_many_damaged_files_are_answered(damage, data, written, tmp_path):
    damage(data, written, tmp_path)


@pytest.mark.parametrize("file", corpus(".npz"), ids=lambda file: file.name)
def test_what_broke_once_is_answered(file):
    for name in (*DOORS, "heat-run", "wave-run"):
        read(file, name)
