"""Scene files of applications: a surface with barriers, and directions, landmarks or colours instead of an equation."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from cpmkit.errors import SceneError, shown
from cpmkit.files.plain_values import read_toml
from cpmkit.files.whole_files import find_file
from cpmkit.forms.options import AccuracyTarget
from cpmkit.plugins import check_accepted
from cpmkit.runtime.arrays import as_points, as_vector
from cpmkit.runtime.options import declared_options
from cpmkit.scene.data import is_sequence
from cpmkit.scene.scene import Scene
from cpmkit.scenefile import scene_files
from cpmkit.scenefile.condition_tables import as_table, list_of_tables, read_vector, with_vertex_data
from cpmkit.scenefile.documented_keys import APPLICATIONS
from cpmkit.types import Floats


def read_directions(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return the keyword arguments of ``vector_field`` on ``scene`` from the tables [[direction]] and [vectors].

    Files are searched first in ``folder``. Raises InputError if there is no direction, or a key or value is not
    accepted.
    """
    options = _application_options(tables, "vectors")
    pairs = [_direction_pair(table, number, scene, folder) for number, table in list_of_tables(tables, "direction")]
    if not pairs:
        raise SceneError("a scene of vectors needs directions; write one [[direction]] at least.")
    return {**options, "directions": pairs}


def _application_options(tables: Mapping[str, Any], command: str) -> dict[str, Any]:
    """Return a copy of the table [``command``] of an application's options; raise SceneError for an unknown key."""
    options = as_table(tables.get(command, {}), f"[{command}]")
    check_accepted(f"[{command}]", options, tuple(APPLICATIONS[command].options))
    return options


def _direction_pair(table: dict[str, Any], number: int, scene: Scene, folder: Path) -> tuple[Any, Any]:
    """Return the pair (places, vectors) that the ``table`` [[direction]] ``number`` describes.

    Places are points, each with a vector, or a curve with one direction, or with a table of the directions left and
    right of it. Files are searched first in ``folder``. Raises InputError if a key or value is not accepted.
    """
    where, dim = f"[[direction]] {number}", scene.surface.dim
    if "at" in table:
        check_accepted(where, table, ("at", "vector"))
        if "vector" not in table:
            raise SceneError(f"{where} at a point needs a vector, such as vector = [1, 0, 0].")
        at, vector = (_points(table[key], dim, f"{key} of {where}") for key in ("at", "vector"))
        if len(vector) not in (1, len(at)):
            raise SceneError(
                f"{where} has {len(at)} points and {len(vector)} vectors; give one vector, or one for each."
            )
        return at, vector
    keys = [key for key in APPLICATIONS["vectors"].on_curve if key in table]
    directions = {key: _read_direction(table.pop(key), dim, f"{key} of {where}") for key in keys}
    if set(directions) not in ({"along"}, {"left", "right"}):
        raise SceneError(
            f"{where} needs at and vector, or a curve's kind with along, or with left and right, got "
            f"{', '.join([*directions, *table]) or 'nothing'}."
        )
    return scene_files.read_source(table, folder, where, scene.surface), directions.get("along", directions)


def _read_direction(value: Any, dim: int, label: str) -> Any:
    """Return a direction: a name, a vector (dim,), or a function of points for formulas; ``label`` is for errors."""
    if isinstance(value, str):
        return value
    if is_sequence(value) and any(isinstance(entry, str) for entry in value):
        return read_vector(value, dim, label)
    return as_vector(value, dim, label)


def read_map(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return the keyword arguments of ``harmonic_map``, and ``texture``, from [target], [[landmark]] and [map].

    Landmarks are on the surface of ``scene``; files are searched first in ``folder``. Raises InputError if a table is
    missing, or a key or value is not accepted.
    """
    if "target" not in tables:
        raise SceneError("a scene of a map needs the table [target], whose kind says where the map goes.")
    target = scene_files.read_source(as_table(tables["target"], "[target]"), folder, "[target]")
    options = _application_options(tables, "map")
    for key, name, source, count in (
        ("initial", "surface", scene.surface, target.dim),
        ("texture", "target", target, None),
    ):
        if key in options:
            value = with_vertex_data(options[key], folder, [(name, source)], f"{key} of [map]")
            if key == "texture" and isinstance(value, str):
                value = [value]
            if is_sequence(value):
                value = read_vector(value, source.dim, f"{key} of [map]", count or len(value))
            options[key] = value
    landmarks: list[tuple[Any, Any]] = []
    for number, table in list_of_tables(tables, "landmark"):
        where = f"[[landmark]] {number}"
        if "to" not in table:
            raise SceneError(f"{where} needs to, where it goes.")
        to = table.pop("to")
        if "at" in table:
            check_accepted(where, table, ("at",))
            at = _points(table["at"], scene.surface.dim, f"at of {where}")
            landmarks.append((at, _points(to, target.dim, f"to of {where}")))
            continue
        curve = scene_files.read_source(table, folder, where, scene.surface)
        landmarks.append((curve, read_vector(to, scene.surface.dim, f"to of {where}", target.dim)))
    return {**options, "target": target, "landmarks": landmarks}


def read_colours(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return {"curves": {name: (source, colours of both sides, or by side)}} for ``diffusion_curves``, from [[curve]].

    Files are searched first in ``folder``. Raises InputError if a name of curves repeats, or an entry is not accepted.
    """
    curves: dict[str, Any] = {}
    for number, table in list_of_tables(tables, "curve"):
        name = table.pop("name", f"curve {number}")
        if not isinstance(name, str) or name in curves:
            raise SceneError(f"name of [[curve]] {number} must be text that no other curve has, got {shown(name)}.")
        where = f"[[curve]] {name!r}"
        sides = {
            key: _colours(table.pop(key), scene.surface.dim, folder, f"{key} of {where}")
            for key in ("both", "left", "right")
            if key in table
        }
        if set(sides) not in ({"both"}, {"left", "right"}):
            raise SceneError(f"{where} needs both, or left and right, got {', '.join(sides) or 'neither'}.")
        curves[name] = scene_files.read_source(table, folder, where, scene.surface), sides.get("both", sides)
    return {"curves": curves}


def _colours(value: Any, dim: int, folder: Path, label: str) -> Any:
    """Return the colours on a side of a curve, as ``diffusion_curves`` takes them; None for zero flux.

    A formula becomes a function of points (n, dim). The name of a .npy or .csv file becomes the path at which
    :func:`find_file` finds the file, first in ``folder``. Other values are unchanged. Raises SceneError, with
    ``label``, for any other table, InputError if a file is missing.
    """
    if isinstance(value, dict):
        if value == {"neumann": 0}:
            return None
        if set(value) == {"formula"}:
            return read_vector(value["formula"], dim, label, 3)
        raise SceneError(
            f"{label} must be a colour, colours along the curve, {{ formula = [red, green, blue] }}, or "
            f"{{ neumann = 0 }} where nothing passes, got {shown(value)}."
        )
    if isinstance(value, str) and Path(value).suffix.lower() in (".npy", ".csv"):
        return str(find_file(value, folder))
    return value


def _points(value: Any, dim: int, label: str) -> Floats:
    """Return a point, or a list of points or vectors, as (n, dim); raise InputError, with ``label``, for others."""
    is_point = is_sequence(value) and not any(map(is_sequence, value))
    return as_points([value] if is_point else value, dim, label)


def load_application(path: str | Path, command: str) -> scene_files.SceneFile:
    """Return the contents of a scene file for the application ``command``: ``vectors``, ``map`` or ``paint``.

    Raises errors as :func:`cpmkit.scenefile.scene_files.load_scene`.
    """
    like = f", such as one that `cpmkit examples` lists as applications/{command}-...toml"
    return read_toml(path, partial(_application_file, command), "scene file", like)


def _application_file(command: str, tables: dict[str, Any], path: Path) -> scene_files.SceneFile:
    """Return the contents of the ``tables`` of a scene file for the application of ``cpmkit COMMAND``.

    Raises SceneError if a table, key or value is missing or not accepted; PluginError if a kind is not installed.
    """
    if "problem" in tables:
        raise SceneError(f"`cpmkit {command}` has its own equation; leave out [problem].")
    shared = (name for name in scene_files.SCENE_TABLES if name != "problem")
    check_accepted("the scene", tables, (*shared, *APPLICATIONS[command].tables))
    if "surface" not in tables:
        raise SceneError("a scene needs the table [surface].")
    scene = scene_files.read_scene({**tables, "problem": {"kind": "laplace"}}, path.parent)
    spacing, options = scene_files.read_options(tables)
    target = next((name for name in declared_options(AccuracyTarget) if name in options), None)
    if target is not None and command != "paint":
        raise SceneError(
            f"`cpmkit {command}` takes a spacing and estimates no error; leave out {target} of [discretization]."
        )
    output = scene_files.read_output(as_table(tables.get("output", {}), "[output]"), path)
    if output.wants_frames:
        raise SceneError(
            f"[output] asks for frames, and `cpmkit {command}` makes none; leave out films and .pvd files."
        )
    if output.wants_error and command != "paint":
        raise SceneError(f"`cpmkit {command}` makes no estimate of the error; leave out field of the picture.")
    if output.picture is not None and output.picture.vectors:
        raise SceneError(f"`cpmkit {command}` draws in its own way; leave out vectors of the picture.")
    read = {"vectors": read_directions, "map": read_map, "paint": read_colours}[command]
    with scene_files.errors_naming_table("the scene"):
        return scene_files.SceneFile(scene, spacing, options, output, read(tables, scene, path.parent))
