"""Scene files of applications: a surface with barriers, and directions, landmarks or colours instead of an equation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.files.data_files import find_file
from cpmkit.files.plain_values import from_toml
from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.plugins import check_accepted
from cpmkit.runtime.arrays import as_points, as_vector
from cpmkit.runtime.options import declared_options
from cpmkit.scene.data import evaluate_data, takes_time
from cpmkit.scene.scene import Scene
from cpmkit.scenefile.condition_tables import as_table, list_of_tables, read_data, with_vertex_data
from cpmkit.scenefile.documented_keys import APPLICATIONS
from cpmkit.scenefile.scene_files import (
    SCENE_TABLES,
    SceneFile,
    read_options,
    read_output,
    read_scene,
    read_source,
)
from cpmkit.types import Floats


@dataclass(frozen=True, eq=False)
class FormulaField:
    """A function of points (n, d) whose channels are numbers or formulas."""

    entries: tuple[Any, ...]
    label: str

    def __call__(self, points: Floats) -> Floats:
        """Return the values (n, channels) at ``points`` (n, d)."""
        return evaluate_data(list(self.entries), points, len(self.entries), self.label)


def read_directions(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return the keyword arguments of ``vector_field`` from the tables [[direction]] and [vectors].

    Raises
    ------
    SceneError
        If there is no direction, or a key or value is not accepted.
    """
    options = _options(tables, "vectors")
    pairs = [_direction(table, number, scene, folder) for number, table in list_of_tables(tables, "direction")]
    if not pairs:
        raise SceneError("a scene of vectors needs directions; write one [[direction]] at least.")
    return {**options, "directions": pairs}


def _options(tables: Mapping[str, Any], command: str) -> dict[str, Any]:
    """Return the table of options of an application; raise SceneError if it has an unknown key."""
    options = as_table(tables.get(command, {}), f"[{command}]")
    check_accepted(f"[{command}]", options, tuple(APPLICATIONS[command].options))
    return options


def _direction(table: dict[str, Any], number: int, scene: Scene, folder: Path) -> tuple[Any, Any]:
    """Return the places and the vectors of [[direction]] ``number``: points and vectors, or a curve and its directions.

    Raises
    ------
    SceneError
        If a key or value is not accepted.
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
    return read_source(table, folder, where, scene.surface), directions.get("along", directions)


def _read_direction(value: Any, dim: int, label: str) -> Any:
    """Return a direction along a curve: a name, a vector (dim,), or a function of points if formulas are given."""
    if isinstance(value, str):
        return value
    if isinstance(value, list) and any(isinstance(entry, str) for entry in value):
        return _formulas(value, dim, dim, label)
    return as_vector(value, dim, label)


def read_map(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return the keyword arguments of ``harmonic_map``, and ``texture``, from [target], [[landmark]] and [map].

    Raises
    ------
    SceneError
        If a table is missing, or a key or value is not accepted.
    """
    if "target" not in tables:
        raise SceneError("a scene of a map needs the table [target], whose kind says where the map goes.")
    target = read_source(as_table(tables["target"], "[target]"), folder, "[target]")
    options = _options(tables, "map")
    options = {**options, **with_vertex_data(_only(options, "initial"), folder, [("surface", scene.surface)], "[map]")}
    options = {**options, **with_vertex_data(_only(options, "texture"), folder, [("target", target)], "[map]")}
    if isinstance(options.get("initial"), list):
        options["initial"] = _formulas(options["initial"], scene.surface.dim, target.dim, "initial of [map]")
    if isinstance(options.get("texture"), (list, str)):
        texture = options["texture"] if isinstance(options["texture"], list) else [options["texture"]]
        options["texture"] = _formulas(texture, target.dim, len(texture), "texture of [map]")
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
        curve = read_source(table, folder, where, scene.surface)
        landmarks.append((curve, _formulas(to, scene.surface.dim, target.dim, f"to of {where}")))
    return {**options, "target": target, "landmarks": landmarks}


def read_colours(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return the keyword arguments of ``diffusion_curves`` from the tables [[curve]].

    Raises
    ------
    SceneError
        If two curves have the same name, or a key or value is not accepted.
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
        curves[name] = read_source(table, folder, where, scene.surface), sides.get("both", sides)
    return {"curves": curves}


def _colours(value: Any, dim: int, folder: Path, label: str) -> Any:
    """Return the colours of one side of a curve, as ``diffusion_curves`` takes them; None for zero flux."""
    if isinstance(value, dict):
        if value == {"neumann": 0}:
            return None
        if set(value) == {"formula"}:
            return _formulas(value["formula"], dim, 3, label)
        raise SceneError(
            f"{label} must be a colour, colours along the curve, {{ formula = [red, green, blue] }}, or "
            f"{{ neumann = 0 }} where nothing passes, got {shown(value)}."
        )
    if isinstance(value, str) and Path(value).suffix.lower() in (".npy", ".csv"):
        return str(find_file(value, folder))
    return value


def _formulas(value: Any, dim: int, count: int, label: str) -> FormulaField:
    """Return the function of points with ``count`` channels given as a list of numbers or formulas.

    Raises
    ------
    SceneError
        If the list has another length, or an entry depends on t.
    """
    if not isinstance(value, list) or len(value) != count:
        raise SceneError(f"{label} must be a list of {count} numbers or formulas, got {shown(value)}.")
    entries = tuple(read_data(entry, dim, f"entry {number} of {label}") for number, entry in enumerate(value, 1))
    if takes_time(entries):
        raise SceneError(f"{label} must not depend on t, got {shown(value)}.")
    return FormulaField(entries, label)


def _points(value: Any, dim: int, label: str) -> Floats:
    """Return a point, or a list of points, as an array (n, dim)."""
    is_point = isinstance(value, list) and bool(value) and not isinstance(value[0], list)
    return as_points([value] if is_point else value, dim, label)


def _only(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return the part of a table with this key alone; empty if the table does not have it."""
    return {key: table[key]} if key in table else {}


@dataclass(frozen=True, eq=False)
class ApplicationFile(SceneFile):
    """The scene of an application's file, with the arguments of the application, its options and its output.

    Attributes
    ----------
    arguments : dict
        Keyword arguments of the application's function.
    """

    arguments: dict[str, Any] = field(default_factory=dict)


def load_application(path: str | Path, command: str) -> ApplicationFile:
    """Return the contents of a scene file for the application of ``cpmkit COMMAND``.

    Raises
    ------
    SceneError
        If the file is missing, does not parse, or has a key or value that is not accepted.
    PluginError
        If no installed plugin has a kind that the file names.
    """
    like = f", such as one that `cpmkit examples` lists as applications/{command}-...toml"
    return from_toml(path, partial(_application_file, command), "scene file", like)


def _application_file(command: str, tables: dict[str, Any], path: Path) -> ApplicationFile:
    """Return the contents of the ``tables`` of a scene file for the application of ``cpmkit COMMAND``.

    Raises
    ------
    SceneError
        If a table, key or value is missing or not accepted.
    """
    if "problem" in tables:
        raise SceneError(f"`cpmkit {command}` has its own equation; leave out [problem].")
    shared = (name for name in SCENE_TABLES if name != "problem")
    check_accepted("the scene", tables, (*shared, *APPLICATIONS[command].tables))
    if "surface" not in tables:
        raise SceneError("a scene needs the table [surface].")
    scene = read_scene({**tables, "problem": {"kind": "laplace"}}, path.parent)
    spacing, options = read_options(tables)
    target = next((name for name in declared_options(AccuracyTarget) if name in options), None)
    if target is not None and command != "paint":
        raise SceneError(
            f"`cpmkit {command}` takes a spacing and estimates no error; leave out {target} of [discretization]."
        )
    output = read_output(as_table(tables.get("output", {}), "[output]"), path)
    if output.wants_frames:
        raise SceneError(
            f"[output] asks for frames, and `cpmkit {command}` makes none; leave out films and .pvd files."
        )
    if output.wants_error and command != "paint":
        raise SceneError(f"`cpmkit {command}` makes no estimate of the error; leave out field of the picture.")
    if output.picture is not None and output.picture.vectors:
        raise SceneError(f"`cpmkit {command}` draws in its own way; leave out vectors of the picture.")
    try:
        read = {"vectors": read_directions, "map": read_map, "paint": read_colours}[command]
        arguments = read(tables, scene, path.parent)
    except InputError as error:
        raise error if isinstance(error, SceneError) else SceneError(str(error)) from error
    return ApplicationFile(scene, spacing, options, output, arguments)
