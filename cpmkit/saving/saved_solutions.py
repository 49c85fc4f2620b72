"""Saved solutions: their arrays and their summary, checked before they are used."""

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

SAVED_SOLUTION_WORDS = "a solution that was saved as .npz"
#: The version of the format.
FORMAT_ARRAY = SavedArray("format", "i")
#: Arrays of every solution: the display mesh, and the values of some families of equations; others are not read.
MESH_ARRAYS = (
    FORMAT_ARRAY,
    SavedArray("summary", "U"),
    SavedArray("points", "f", ("vertices", "dim"), needed=False),
    SavedArray("cells", "i", ("cells", "corners"), needed=False),
    SavedArray("values", "f", ("vertices", "channels"), needed=False),
    SavedArray("original", "i", needed=False),
    SavedArray("lattice_time", "f", needed=False),
    SavedArray("lattice_frame_times", "f", ("frames",), needed=False),
    SavedArray("lattice_frames", "f", ("frames", "unknowns", "channels"), needed=False),
    SavedArray("lattice_eigenvalues", "f", ("channels",), needed=False),
    SavedArray("lattice_laplacian", "f", ("unknowns", "channels"), needed=False),
)
#: Arrays of the lattice, if there is one.
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
#: The kind of any table.
ANY_TABLE = table_of(ANYTHING)


def _is_boundary(table: Any) -> bool:
    """Return True if ``table`` describes a boundary of a saved scene: a table of texts, none empty, with a name."""
    texts = ANY_TABLE.accepts(table) and "name" in table
    return texts and all(isinstance(text, str) and text for text in table.values())


#: Kinds of the keys of the summary of a solution on a lattice, and of its scene.
REBUILT_KEYS = {
    "scene": ANY_TABLE,
    "report": ANY_TABLE,
    "work": ANY_TABLE,
    "seconds": table_of(numbers(0)),
    "warnings": list_of(TEXT),
}
SCENE_KEYS = {
    "problem": Kind("a table with a kind", lambda table: ANY_TABLE.accepts(table) and TEXT.accepts(table.get("kind"))),
    "boundaries": list_of(Kind("a table with a name and its conditions", _is_boundary)),
}


def read_solution(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the arrays, by name, and the summary of a solution saved as .npz, with all arrays of the lattice or none.

    Raises InputError if there is no such file, it is of another format, or an array or the summary is damaged.
    """
    try:
        exists = path.is_file()
    except OSError:  # too long a name
        exists = False
    if not exists:
        raise InputError(f"There is no file {shown(str(path))}; give the path of a solution that was saved as .npz.")
    saved = int(read_saved(path, (FORMAT_ARRAY,), SAVED_SOLUTION_WORDS)["format"])
    if saved != FORMAT_VERSION:
        raise InputError(
            f"{shown(path.name)} is of format {saved}, and this cpmkit reads format {FORMAT_VERSION}; solve the "
            "scene again, or read the file with the version that its summary names."
        )
    options = [SavedArray(f"lattice_{name}", "bifU", needed=False) for name in (*every_option(), *RENAMED_OPTIONS)]
    rows = {row.name: row for row in (*options, *LATTICE_ARRAYS)}
    numbers_of_lattice = [replace(row, needed=False) for row in rows.values() if not row.shape]
    on_lattice = bool(read_saved(path, numbers_of_lattice, SAVED_SOLUTION_WORDS))
    arrays = read_saved(path, (*MESH_ARRAYS, *(rows.values() if on_lattice else ())), SAVED_SOLUTION_WORDS)
    mesh = [arrays[name] for name in ("points", "values", "cells") if name in arrays]
    if mesh and (len(mesh) < 3 or np.any((mesh[-1] < -1) | (mesh[-1] >= len(mesh[0])))):
        raise InputError(f"{shown(path.name)} holds half a mesh: points, cells and values belong together.")
    summary = read_json_table(arrays["summary"], path, "summary")
    where = f"the summary of {shown(path.name)}"
    check_fields(summary, {"discretization": ANY_TABLE}, where)
    channels = {"channels": whole_numbers(1, 1_000_000)}
    check_fields(summary["discretization"], {}, f"discretization in {where}", channels)
    if on_lattice:
        check_fields(summary, REBUILT_KEYS, where, {"imbalances": list_of(ANY_TABLE)})
        check_fields(summary["scene"], SCENE_KEYS, f"scene in {where}")
    return arrays, summary


def other_scene_error(path: Path, differs: str) -> InputError:
    """Return the error about a file that was saved from another scene; ``differs`` describes the difference."""
    return InputError(
        f"{shown(path.name)} was saved from another scene than the one given: {differs}; give the one that was solved."
    )


def check_same_scene(path: Path, saved: Mapping[str, Any], scene: Scene) -> None:
    """Check that a scene's equation, boundaries and edge are those ``saved``, as far as they are plain values.

    Of files from before the edge was saved, only the kinds of equation and conditions are compared. Raises InputError
    with the first difference.
    """
    described = json.loads(json.dumps(describe_scene(scene)))
    if "edge" not in saved:
        saved, described = _kinds(saved), _kinds(described)
    for key in ("problem", "boundaries", "edge"):
        if saved.get(key) != described.get(key):
            raise other_scene_error(path, f"its {_difference(key, saved[key], described[key])}")


def _difference(place: str, saved: Any, described: Any) -> str:
    """Return the text on the first difference of ``saved`` and ``described``: its place, after ``place``, and both."""
    if type(saved) is type(described) is dict and saved.keys() == described.keys():
        key = next(key for key in saved if saved[key] != described[key])
        return _difference(f"{place}, {key}", saved[key], described[key])
    if type(saved) is type(described) is list and len(saved) == len(described):
        number = next(number for number, pair in enumerate(zip(saved, described, strict=True)) if pair[0] != pair[1])
        return _difference(f"{place}, number {number + 1}", saved[number], described[number])
    return f"{place}: {shown(saved)}, and here it is {shown(described)}"


def _kinds(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the equation's kind, and lists [name, kinds of left and right condition] of boundaries, of a scene."""
    kinds = [
        [boundary["name"], *(boundary[side].split()[0] for side in SIDES if side in boundary)]
        for boundary in scene["boundaries"]
    ]
    return {"problem": scene["problem"]["kind"], "boundaries": kinds}
