"""What a saved solution holds: its arrays and its summary, checked before anything is made of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cpmkit.errors import InputError, shown
from cpmkit.files.array_files import SavedArray, read_json_table, read_saved
from cpmkit.files.plain_values import ANYTHING, TEXT, Kind, check_fields, list_of, numbers, table_of, whole_numbers
from cpmkit.forms.choice import RENAMED_OPTIONS, every_option
from cpmkit.saving.export import FORMAT_VERSION
from cpmkit.scene.scene import Scene
from cpmkit.solution.summary import describe_scene
from cpmkit.types import SIDES

#: Channels that a summary may tell of.
MOST_CHANNELS = 1_000_000
SAVED_SOLUTION_WORDS = "a solution that was saved as .npz"
#: The arrays of a display mesh, and of the lattice: what is saved beside them is not read.
FORMAT_ARRAYS = (SavedArray("format", "i"),)
MESH_ARRAYS = (
    SavedArray("summary", "U"),
    SavedArray("points", "f", ("vertices", "dim"), needed=False),
    SavedArray("cells", "i", ("cells", "corners"), needed=False),
    SavedArray("values", "f", ("vertices", "channels"), needed=False),
    SavedArray("original", "i", needed=False),
)
LATTICE_ARRAYS = (
    SavedArray("lattice_spacing", "f"),
    SavedArray("lattice_origin", "f", ("dim",)),
    SavedArray("lattice_nodes", "i", ("inner", "dim")),
    SavedArray("lattice_ghosts", "i", ("ghosts", 2), needed=False),
    SavedArray("lattice_left", "b", ("ghosts",), needed=False),
    SavedArray("lattice_parted_cells", "i", ("parted", "level_and_cell"), needed=False),
    SavedArray("lattice_sides", "f", ("boundaries", "dim", "moments"), needed=False),
    SavedArray("lattice_unknowns", "f", ("unknowns", "channels")),
)
#: What solutions of some families have beside their unknowns, on a lattice or on a mesh.
FURTHER = (
    SavedArray("lattice_time", "f", needed=False),
    SavedArray("lattice_frame_times", "f", ("frames",), needed=False),
    SavedArray("lattice_frames", "f", ("frames", "unknowns", "channels"), needed=False),
    SavedArray("lattice_eigenvalues", "f", ("channels",), needed=False),
    SavedArray("lattice_laplacian", "f", ("unknowns", "channels"), needed=False),
)
#: An option's own check says what it accepts; one that is not in the file has its default.
OPTION_ARRAY = SavedArray("", "bifU", needed=False)
#: What of a summary is read.
ANY_TABLE = table_of(ANYTHING)
SUMMARY_KEYS = {"discretization": ANY_TABLE}
REBUILT_KEYS = {
    "scene": ANY_TABLE,
    "report": ANY_TABLE,
    "work": ANY_TABLE,
    "seconds": table_of(numbers(0)),
    "warnings": list_of(TEXT),
}
LISTED_KEYS = {"imbalances": list_of(ANY_TABLE)}
BOUNDARY_TABLE = Kind(
    "a table with a name and its conditions",
    lambda one: (
        ANY_TABLE.accepts(one) and "name" in one and all(isinstance(text, str) and text for text in one.values())
    ),
)
PROBLEM_TABLE = Kind("a table with a kind", lambda one: ANY_TABLE.accepts(one) and TEXT.accepts(one.get("kind")))
SCENE_KEYS = {"problem": PROBLEM_TABLE, "boundaries": list_of(BOUNDARY_TABLE)}


def read_solution(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arrays of a file that cpmkit wrote, of the lattice all or none, and its summary.

    Raises
    ------
    InputError
        If it is no such file, is damaged, of another format, or an array in it is not what belongs there.
    """
    try:
        exists = path.is_file()
    except OSError:  # too long a name
        exists = False
    if not exists:
        raise InputError(f"There is no file {shown(str(path))}; give the path of a solution that was saved as .npz.")
    saved = int(read_saved(path, FORMAT_ARRAYS, SAVED_SOLUTION_WORDS)["format"])
    if saved != FORMAT_VERSION:
        raise InputError(
            f"{shown(path.name)} is of format {saved}, and this cpmkit reads format {FORMAT_VERSION}; solve the "
            "scene again, or read the file with the version that its summary names."
        )
    options = [replace(OPTION_ARRAY, name=f"lattice_{name}") for name in (*every_option(), *RENAMED_OPTIONS)]
    rows = {row.name: row for row in (*options, *LATTICE_ARRAYS)}
    numbers_of_lattice = [replace(row, needed=False) for row in rows.values() if not row.shape]
    on_lattice = bool(read_saved(path, numbers_of_lattice, SAVED_SOLUTION_WORDS))
    table = (*FORMAT_ARRAYS, *MESH_ARRAYS, *FURTHER, *(rows.values() if on_lattice else ()))
    arrays = read_saved(path, table, SAVED_SOLUTION_WORDS)
    mesh = [arrays[name] for name in ("points", "values", "cells") if name in arrays]
    if mesh and (len(mesh) < 3 or np.any((mesh[-1] < -1) | (mesh[-1] >= len(mesh[0])))):
        raise InputError(f"{shown(path.name)} holds half a mesh: points, cells and values belong together.")
    summary = read_json_table(arrays["summary"], path, "summary")
    where = f"the summary of {shown(path.name)}"
    check_fields(summary, SUMMARY_KEYS, where)
    check_fields(
        summary["discretization"], {}, f"discretization in {where}", {"channels": whole_numbers(1, MOST_CHANNELS)}
    )
    if on_lattice:
        check_fields(summary, REBUILT_KEYS, where, LISTED_KEYS)
        check_fields(summary["scene"], SCENE_KEYS, f"scene in {where}")
    return arrays, summary


def of_another_scene(path: Path, differs: str) -> InputError:
    """Return the error that says in what the scene of a file ``differs`` from the one given."""
    return InputError(
        f"{shown(path.name)} was saved from another scene than the one given: {differs}; give the one that was solved."
    )


def check_same_scene(path: Path, saved: Mapping[str, Any], scene: Scene) -> None:
    """Refuse another scene by its equation, its boundaries and its edge, as far as they are plain values.

    Files of before the edge was saved tell the kinds of their conditions only.
    """
    given = json.loads(json.dumps(describe_scene(scene)))
    if "edge" not in saved:
        saved, given = _kinds(saved), _kinds(given)
    for what in ("problem", "boundaries", "edge"):
        if saved.get(what) != given.get(what):
            raise of_another_scene(path, f"its {_differing(what, saved[what], given[what])}")


def _differing(what: str, saved: Any, given: Any) -> str:
    """Return where two plain values differ, in words."""
    if isinstance(saved, Mapping) and isinstance(given, Mapping) and saved.keys() == given.keys():
        key = next(key for key in saved if saved[key] != given[key])
        return _differing(f"{what}, {key}", saved[key], given[key])
    if isinstance(saved, list) and isinstance(given, list) and len(saved) == len(given):
        number = next(number for number, pair in enumerate(zip(saved, given, strict=True)) if pair[0] != pair[1])
        return _differing(f"{what}, number {number + 1}", saved[number], given[number])
    return f"{what}: {shown(saved)}, and here it is {shown(given)}"


def _kinds(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the equation's kind, and the names of the boundaries with the kinds of their conditions."""
    kinds = [[one["name"], *(one[side].split()[0] for side in SIDES if side in one)] for one in scene["boundaries"]]
    return {"problem": scene["problem"]["kind"], "boundaries": kinds}
