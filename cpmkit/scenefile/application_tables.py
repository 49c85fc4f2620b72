"""What the applications are given in scene files: directions, landmarks of maps, and the colours of curves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpmkit.errors import SceneError, shown
from cpmkit.files.data_files import find_file
from cpmkit.plugins import check_accepted
from cpmkit.protocols import Floats
from cpmkit.runtime.arrays import as_points, as_vector
from cpmkit.scene.data import evaluate_data, takes_time
from cpmkit.scene.scene import Scene
from cpmkit.scene.vertex_data import with_vertex_data
from cpmkit.scenefile.condition_tables import as_table, read_data
from cpmkit.scenefile.reading import read_source

#: Keys of a curve's sides, and of a direction along one.
COLOUR_KEYS = ("both", "left", "right")
ALONG_KEYS = ("along", "left", "right")
#: Keys of [vectors] and of [map].
VECTORS_KEYS = ("transport",)
MAP_KEYS = ("initial", "method", "step", "most_steps", "rest", "texture")
#: Files of colours along a curve.
COLOUR_SUFFIXES = (".npy", ".csv")


@dataclass(frozen=True, eq=False)
class FormulaField:
    """A function of points (n, d) with one number or formula a channel."""

    entries: tuple[Any, ...]
    what: str

    def __call__(self, points: Floats) -> Floats:
        """Return the values (n, channels)."""
        return evaluate_data(list(self.entries), points, len(self.entries), self.what)


def read_directions(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return the keyword arguments of ``vector_field`` that [[direction]] and [vectors] are."""
    own = as_table(tables.get("vectors", {}), "[vectors]")
    check_accepted("[vectors]", own, VECTORS_KEYS)
    pairs = [_direction(table, number, scene, folder) for number, table in _listed(tables, "direction")]
    if not pairs:
        raise SceneError("a scene of vectors needs directions; write one [[direction]] at least.")
    return {**own, "directions": pairs}


def _direction(table: dict[str, Any], number: int, scene: Scene, folder: Path) -> tuple[Any, Any]:
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
    given = {key: _way(table.pop(key), dim, f"{key} of {where}") for key in ALONG_KEYS if key in table}
    if set(given) not in ({"along"}, {"left", "right"}):
        raise SceneError(
            f"{where} needs at and vector, or a curve's kind with along, or with left and right, got "
            f"{', '.join([*given, *table]) or 'nothing'}."
        )
    return read_source(table, folder, where, scene.surface), given.get("along", given)


def _way(value: Any, dim: int, what: str) -> Any:
    """Return a direction along a curve: a name, a vector, or a function of one formula a coordinate."""
    if isinstance(value, str):
        return value
    if isinstance(value, list) and any(isinstance(entry, str) for entry in value):
        return _formulas(value, dim, dim, what)
    return as_vector(value, dim, what)


def read_map(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return the keyword arguments of ``harmonic_map`` that [target], [[landmark]] and [map] are, and ``texture``."""
    if "target" not in tables:
        raise SceneError("a scene of a map needs the table [target], whose kind says where the map goes.")
    target = read_source(as_table(tables["target"], "[target]"), folder, "[target]")
    own = as_table(tables.get("map", {}), "[map]")
    check_accepted("[map]", own, MAP_KEYS)
    own = {**own, **with_vertex_data(_only(own, "initial"), folder, [("surface", scene.surface)], "[map]")}
    own = {**own, **with_vertex_data(_only(own, "texture"), folder, [("target", target)], "[map]")}
    if isinstance(own.get("initial"), list):
        own["initial"] = _formulas(own["initial"], scene.surface.dim, target.dim, "initial of [map]")
    if isinstance(own.get("texture"), (list, str)):
        texture = own["texture"] if isinstance(own["texture"], list) else [own["texture"]]
        own["texture"] = _formulas(texture, target.dim, len(texture), "texture of [map]")
    landmarks: list[tuple[Any, Any]] = []
    for number, table in _listed(tables, "landmark"):
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
    return {**own, "target": target, "landmarks": landmarks}


def read_colours(tables: Mapping[str, Any], scene: Scene, folder: Path) -> dict[str, Any]:
    """Return the keyword arguments of ``diffusion_curves`` that [[curve]] is."""
    curves: dict[str, Any] = {}
    for number, table in _listed(tables, "curve"):
        name = table.pop("name", f"curve {number}")
        if not isinstance(name, str) or name in curves:
            raise SceneError(f"name of [[curve]] {number} must be text that no other curve has, got {shown(name)}.")
        where = f"[[curve]] {name!r}"
        sides = {
            key: _colours(table.pop(key), scene.surface.dim, folder, f"{key} of {where}")
            for key in COLOUR_KEYS
            if key in table
        }
        if set(sides) not in ({"both"}, {"left", "right"}):
            raise SceneError(f"{where} needs both, or left and right, got {', '.join(sides) or 'neither'}.")
        curves[name] = read_source(table, folder, where, scene.surface), sides.get("both", sides)
    return {"curves": curves}


def _colours(value: Any, dim: int, folder: Path, what: str) -> Any:
    """Return the colours of a side: as the application takes them, where nothing passes None."""
    if isinstance(value, dict):
        if value == {"neumann": 0}:
            return None
        if set(value) == {"formula"}:
            return _formulas(value["formula"], dim, 3, what)
        raise SceneError(
            f"{what} must be a colour, colours along the curve, {{ formula = [red, green, blue] }}, or "
            f"{{ neumann = 0 }} where nothing passes, got {shown(value)}."
        )
    if isinstance(value, str) and Path(value).suffix.lower() in COLOUR_SUFFIXES:
        return str(find_file(value, folder))
    return value


def _listed(tables: Mapping[str, Any], name: str) -> list[tuple[int, dict[str, Any]]]:
    """Return the tables of a list, with their numbers from 1."""
    given = tables.get(name, [])
    if not isinstance(given, list):
        raise SceneError(f"{name} must be a list of tables, written [[{name}]].")
    return [(number, as_table(table, f"[[{name}]] {number}")) for number, table in enumerate(given, 1)]


def _formulas(value: Any, dim: int, count: int, what: str) -> FormulaField:
    if not isinstance(value, list) or len(value) != count:
        raise SceneError(f"{what} must be a list of {count} numbers or formulas, got {shown(value)}.")
    entries = tuple(read_data(entry, dim, f"entry {number} of {what}") for number, entry in enumerate(value, 1))
    if takes_time(entries):
        raise SceneError(f"{what} must not depend on t, got {shown(value)}.")
    return FormulaField(entries, what)


def _points(value: Any, dim: int, what: str) -> Floats:
    """Return one point, or a list of them, as (n, dim)."""
    one = isinstance(value, list) and bool(value) and not isinstance(value[0], list)
    return as_points([value] if one else value, dim, what)


def _only(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    return {key: table[key]} if key in table else {}
