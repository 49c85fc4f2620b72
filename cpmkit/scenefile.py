"""Scene files: TOML that holds numbers, names of array files and formulas. Nothing in a file is executed."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpmkit.conditions import Condition, Data, Dirichlet, Neumann, Robin
from cpmkit.data import find_file
from cpmkit.errors import SceneError
from cpmkit.expressions import Expression
from cpmkit.outputrequest import OutputRequest, PictureRequest
from cpmkit.plugins import call, factory, offered, source, takes
from cpmkit.problems import Laplace, Poisson, Problem, ScreenedPoisson
from cpmkit.protocols import BoundarySet, ClosestPointSource
from cpmkit.scene import Boundary, Scene
from cpmkit.solvers import ACCEPTED

TABLES = ("surface", "boundary", "problem", "discretization", "solver", "output")
PROBLEMS = {"laplace": Laplace, "poisson": Poisson, "screened": ScreenedPoisson}
CONDITIONS: dict[str, Any] = {"dirichlet": Dirichlet, "neumann": Neumann, "robin": Robin}


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene and how its file wants it solved.

    Attributes
    ----------
    scene : Scene
        Surface, boundaries, edge and problem.
    spacing : float or None
        Of the lattice; None if the file gives none.
    options : dict
        Further keyword arguments of ``solve``: degree, order, origin, solver, tolerance, max_iterations.
    output : OutputRequest
        What is written where.
    """

    scene: Scene
    spacing: float | None
    options: dict[str, Any]
    output: OutputRequest


def load_scene(path: str | Path) -> SceneFile:
    """Read a scene file.

    Raises
    ------
    SceneError
        If the file is missing, does not parse, or holds a key or value that is not accepted.
    PluginError
        If a kind is offered by no installed plugin.
    """
    path = Path(path)
    if not path.is_file():
        raise SceneError(
            f"no scene file {str(path)!r}; give the path of a TOML file, such as examples/01-first-curves.toml."
        )
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{path.name} is not TOML: {error}.") from error
    try:
        return _scene_file(tables, path)
    except SceneError as error:
        raise SceneError(f"{path.name}: {error}") from error


def _scene_file(tables: dict[str, Any], path: Path) -> SceneFile:
    _check_keys(tables, TABLES, "the scene")
    if "surface" not in tables or "problem" not in tables:
        raise SceneError("a scene needs the tables [surface] and [problem].")
    surface_table = _table(tables["surface"], "[surface]")
    edge = _edge(surface_table.pop("edge", {"neumann": 0.0}), surface_table)
    surface = _source(surface_table, path.parent, "[surface]")
    boundaries = [
        _boundary(_table(table, f"[[boundary]] {number}"), number, path.parent, surface)
        for number, table in enumerate(_list(tables.get("boundary", []), "boundary"), 1)
    ]
    scene = Scene(surface, _problem(_table(tables["problem"], "[problem]"), surface.dim), boundaries, edge(surface.dim))
    spacing, options = _options(tables)
    return SceneFile(scene, spacing, options, _output(_table(tables.get("output", {}), "[output]"), path))


def _options(tables: dict[str, Any]) -> tuple[float | None, dict[str, Any]]:
    grid = _table(tables.get("discretization", {}), "[discretization]")
    _check_keys(grid, ("spacing", "degree", "order", "origin"), "[discretization]")
    solver = _table(tables.get("solver", {}), "[solver]")
    if solver.get("kind", "auto") in ACCEPTED:  # a plugin's solver has keys of its own
        _check_keys(solver, ("kind", "tolerance", *ACCEPTED[solver.get("kind", "auto")]), "[solver]")
    spacing = grid.pop("spacing", None)
    renamed = {("solver" if key == "kind" else key): value for key, value in solver.items()}
    return spacing, {**grid, **renamed}


def _source(
    table: dict[str, Any], folder: Path, where: str, surface: ClosestPointSource | None = None
) -> ClosestPointSource:
    """Make the source that a table describes; a boundary's may ask for the ``surface`` that it lies on."""
    kind = table.pop("kind", None)
    if not isinstance(kind, str):
        raise SceneError(
            f"{where} needs a kind, such as kind = 'analytic.sphere'; `cpmkit plugins` lists those installed."
        )
    keys = _keys(table, folder, where)
    if surface is not None and not {"surface", "file", "vertices"} & set(keys) and takes(factory(kind), "surface"):
        keys["surface"] = surface
    return source(kind, **keys)


def _keys(table: dict[str, Any], folder: Path, where: str) -> dict[str, Any]:
    """Return the table with the path of the file that it names, and with sources in place of the tables in it."""
    keys = {key: _made(value, folder, f"{key} of {where}") for key, value in table.items()}
    return {**keys, "file": str(find_file(keys["file"], folder))} if "file" in keys else keys


def _made(value: Any, folder: Path, where: str) -> Any:
    """Return the source that a table with a kind describes, a list with its tables made, anything else as it is."""
    if isinstance(value, dict):
        return _source(dict(value), folder, where)
    if isinstance(value, list):
        return [_made(entry, folder, f"entry {number} of {where}") for number, entry in enumerate(value, 1)]
    return value


def _boundary(table: dict[str, Any], number: int, folder: Path, surface: ClosestPointSource) -> BoundarySet:
    name = table.pop("name", f"boundary {number}")
    where = f"[[boundary]] {name!r}"
    sides = {key: table.pop(key) for key in ("both", "left", "right", "left_of") if key in table}
    conditions: dict[str, Any] = {
        key: value if key == "left_of" else _condition(value, surface.dim, f"{key} of {where}")
        for key, value in sides.items()
    }
    make = offered(table["kind"], "cpmkit_boundaries") if isinstance(table.get("kind"), str) else None
    if make is None:
        return Boundary(name, _source(table, folder, where, surface), **conditions)
    del table["kind"]
    made: BoundarySet = call(make, where, {"name": name, **_keys(table, folder, where), **conditions})
    return made


def _condition(table: Any, dim: int, where: str) -> Condition:
    table = _table(table, where)
    order = table.pop("order", None)
    if order not in (None, 1, 2):
        raise SceneError(f"order of {where} must be 1 or 2, got {order!r}.")
    kinds = list(table)
    if len(kinds) != 1 or kinds[0] not in CONDITIONS:
        raise SceneError(
            f"{where} must be one of {', '.join(f'{{ {kind} = ... }}' for kind in CONDITIONS)}, got {table!r}."
        )
    value = table[kinds[0]]
    if kinds[0] == "robin":
        if not isinstance(value, list) or len(value) != 3:
            raise SceneError(f"robin of {where} must be [alpha, beta, gamma], got {value!r}.")
        return Robin(value[0], value[1], _data(value[2], dim, where), order=order)
    made: Condition = CONDITIONS[kinds[0]](_data(value, dim, where), order=order)
    return made


def _edge(table: Any, surface: dict[str, Any]) -> Any:
    """Return a function of the dimension that makes the edge's condition, or one a loop number."""
    table = _table(table, f"edge of {surface.get('kind', '[surface]')}")
    if table and all(key.isdigit() for key in table):
        return lambda dim: {int(key): _condition(value, dim, f"edge {key}") for key, value in table.items()}
    return lambda dim: _condition(table, dim, "edge")


def _problem(table: dict[str, Any], dim: int) -> Problem:
    kind = table.pop("kind", None)
    if kind not in PROBLEMS:
        raise SceneError(f"the kind of [problem] must be one of {', '.join(PROBLEMS)}, got {kind!r}.")
    if "f" in table:
        table["f"] = _data(table["f"], dim, "f of [problem]")
    made: Problem = call(PROBLEMS[kind], f"[problem] of kind {kind!r}", table)
    return made


def _data(value: Any, dim: int, where: str) -> Data:
    """Return numbers as they are, formulas as functions, and lists of both entry by entry."""
    if isinstance(value, str):
        return Expression(value, dim)
    if isinstance(value, list):
        return [_data(entry, dim, where) for entry in value]
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SceneError(f"{where} must be a number, a formula, or a list with one of them a channel, got {value!r}.")
    return float(value)


def _output(table: dict[str, Any], path: Path) -> OutputRequest:
    _check_keys(table, ("folder", "files", "picture"), "[output]")
    picture = table.get("picture")
    if picture is not None:
        picture = _table({"file": picture} if isinstance(picture, str) else picture, "picture of [output]")
        picture = call(PictureRequest, "picture of [output]", picture)
    return OutputRequest(Path(table.get("folder", path.stem)), tuple(table.get("files", ("summary.json",))), picture)


def _check_keys(table: Mapping[str, Any], accepted: tuple[str, ...], where: str) -> None:
    unknown = [key for key in table if key not in accepted]
    if unknown:
        raise SceneError(f"{where} has the unknown key {unknown[0]!r}; accepted are {', '.join(accepted)}.")


def _table(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise SceneError(f"{where} must be a table, got {value!r}.")
    return dict(value)


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise SceneError(f"{where} must be a list of tables, written [[{where}]].")
    return value
