"""Reading of scene files: TOML with numbers, formulas and names of array files. Nothing in a file is executed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.files.plain_values import read_toml
from cpmkit.files.whole_files import find_file
from cpmkit.forms.choice import RENAMED_OPTIONS, own_options
from cpmkit.forms.options import AccuracyTarget, Options
from cpmkit.linear.solver_options import SOLVER_OPTIONS, SolverOptions
from cpmkit.manifold.source import ClosestPointSource
from cpmkit.plugins import call_factory, check_accepted, check_keys, factory, source, takes_key
from cpmkit.runtime.deprecation import current_keywords
from cpmkit.runtime.messages import did_you_mean
from cpmkit.runtime.options import check_key_types, declared_options, split_options
from cpmkit.scene.boundary import Boundary
from cpmkit.scene.compound_equations import Biharmonic, Eigen, ReactionDiffusion
from cpmkit.scene.data import is_sequence
from cpmkit.scene.equations import Elliptic, Equation, Helmholtz, Laplace, Poisson, ScreenedPoisson
from cpmkit.scene.equations_in_time import Evolution, Heat, Wave
from cpmkit.scene.nonlinear_equations import NonlinearDiffusion, PLaplacian, TotalVariation
from cpmkit.scene.scene import Scene
from cpmkit.scenefile.condition_tables import (
    DATA_READERS,
    as_table,
    list_of_tables,
    read_edge,
    read_junctions,
    read_side,
    with_vertex_data,
)
from cpmkit.scenefile.documented_keys import APPLICATIONS
from cpmkit.scenefile.look import VERTICES, OutputRequest, PictureRequest, check_links, relative_name

#: Keys in the table [solver] for solver options, by the name of the option.
SOLVER_KEYS = {"solver": "kind", "solver_tolerance": "tolerance"}
#: Tables of a scene file.
SCENE_TABLES = ("surface", "boundary", "problem", "discretization", "solver", "output")
#: The equations that [problem] can name.
EQUATIONS = (
    *(Laplace, Poisson, ScreenedPoisson, Elliptic, Helmholtz, NonlinearDiffusion, PLaplacian, TotalVariation),
    *(Eigen, Biharmonic, Heat, ReactionDiffusion, Wave),
)
PROBLEMS: dict[str, type[Equation]] = {equation.kind: equation for equation in EQUATIONS}
#: Keys of a boundary in addition to those of its kind.
SIDE_KEYS = ("both", "left", "right", "left_of", "across")


@dataclass(frozen=True, eq=False)
class SceneFile:
    """The contents of a scene file: the scene, the options of its solution, and the output."""

    scene: Scene  #: The scene.
    spacing: float | None  #: Spacing of the lattice; None if the file has none.
    options: dict[str, Any]  #: Further keyword arguments of ``solve``.
    output: OutputRequest  #: The files to be written.
    #: Keyword arguments of the function of an application, empty for a scene.
    arguments: dict[str, Any] = field(default_factory=dict)


def load_scene(path: str | Path) -> SceneFile:
    """Return the scene of a scene file, with the options and the output of the file.

    ``cpmkit.solve(file.scene, file.spacing, **file.options)`` solves it; ``cpmkit schema scene`` prints all keys.

    Raises
    ------
    SceneError
        If the file is missing, does not parse, or has a key or value that is not accepted.
    InputError
        If a number or the order of a condition is not accepted, or an array file is missing or damaged.
    PluginError
        If no installed plugin has a kind that the file names.
    """
    return read_toml(path, _scene_file, "scene file", ", such as examples/01-first-curves.toml")


def _scene_file(tables: dict[str, Any], path: Path) -> SceneFile:
    """Return the contents of a scene file ``path`` with these ``tables``; raise errors as :func:`load_scene`."""
    for command, own in APPLICATIONS.items():
        name = next((name for name in own.tables if name in tables), None)
        if name is not None and "problem" not in tables:
            raise SceneError(f"{name!r} is a table of the application that `cpmkit {command}` makes; use that command.")
    check_accepted("the scene", tables, SCENE_TABLES)
    scene = read_scene(tables, path.parent)
    spacing, options = read_options(tables)
    output = read_output(as_table(tables.get("output", {}), "[output]"), path)
    if output.wants_frames and not (isinstance(scene.problem, Evolution) and scene.problem.frame_times):
        raise SceneError("[output] asks for frames, and [problem] gives none; add a key such as frames = 10 to heat.")
    return SceneFile(scene, spacing, options, output)


def read_scene(tables: Mapping[str, Any], folder: Path) -> Scene:
    """Return the scene of the tables [surface], [[boundary]] and [problem]; other tables are ignored.

    The tables are not changed. Files are searched first in the ``folder``. Raises SceneError if a table is missing, or
    has a key or value that is not accepted, and other errors as :func:`load_scene`.
    """
    if "surface" not in tables or "problem" not in tables:
        raise SceneError("a scene needs the tables [surface] and [problem].")
    surface_table = as_table(tables["surface"], "[surface]")
    edge_table = surface_table.pop("edge", {"neumann": 0.0})
    junctions = read_junctions(surface_table.pop("junctions", {}), "junctions of [surface]")
    edge_of = f"edge of {surface_table.get('kind', '[surface]')}"
    surface = read_source(surface_table, folder, "[surface]")
    carriers = [("surface", surface)]
    edge = read_edge(with_vertex_data(edge_table, folder, carriers, edge_of), surface.dim, edge_of)
    problem = with_vertex_data(as_table(tables["problem"], "[problem]"), folder, carriers, "[problem]")
    boundaries = [_boundary(table, number, folder, surface) for number, table in list_of_tables(tables, "boundary")]
    return Scene(surface, _problem(problem, surface.dim), boundaries, edge, junctions)


def read_options(tables: Mapping[str, Any]) -> tuple[float | None, dict[str, Any]]:
    """Return the spacing and the further options of ``solve``, from the tables [discretization] and [solver].

    The spacing is None if the table has none. Raises SceneError if a key or its value is not accepted, and for the
    kind of a plugin's solver the errors of :func:`make_solver`.
    """
    with errors_naming_table("[discretization]"):
        grid = current_keywords(as_table(tables.get("discretization", {}), "[discretization]"), RENAMED_OPTIONS)
        own, accepted = own_options(grid)
        check_accepted(
            "[discretization]", grid, (*declared_options(Options), *declared_options(AccuracyTarget), *accepted)
        )
        target, further = split_options(AccuracyTarget, grid)
        target.check_spacing(grid.get("spacing"))
        split_options(Options, {"spacing": 1.0, **further}, own=own)  # without a spacing too: a study may set it
    solver = as_table(tables.get("solver", {}), "[solver]")
    name = solver.get("kind", SolverOptions.solver)
    if not isinstance(name, str):
        raise SceneError(f"kind of [solver] must be a name such as 'direct', got {shown(name)}.")
    options = {key: name for name, key in SOLVER_KEYS.items()}
    renamed = {options.get(key, key): value for key, value in solver.items()}
    if name in SOLVER_OPTIONS:  # a plugin's solver has keys of its own
        keys = (SOLVER_KEYS[option] for option in declared_options(SolverOptions))
        check_accepted("[solver]", solver, (*keys, *SOLVER_OPTIONS[name]))
    with errors_naming_table("[solver]"):
        SolverOptions.from_keywords(renamed)
    spacing = grid.pop("spacing", None)
    return spacing, {**grid, **renamed}


@contextmanager
def errors_naming_table(where: str) -> Iterator[None]:
    """Raise InputErrors of the block as SceneErrors that begin with a table's name ``where``; SceneErrors unchanged."""
    try:
        yield
    except InputError as error:
        if isinstance(error, SceneError):  # its message names a table
            raise
        raise SceneError(f"{where}: {error}") from error


def read_source(
    table: dict[str, Any], folder: Path, where: str, surface: ClosestPointSource | None = None
) -> ClosestPointSource:
    """Return the closest-point source that a table describes; the key ``kind`` is removed from ``table``.

    Files are searched first in ``folder``. ``surface`` is given for a boundary, whose source receives it as an argument
    if it takes a surface and the table has no surface, file or vertices. Raises SceneError, with the table's name
    ``where``, if the kind or a key is not accepted, InputError for a value, PluginError if the kind is not installed.
    """
    kind = table.pop("kind", None)
    if not isinstance(kind, str):
        raise SceneError(
            f"{where} needs a kind, such as kind = 'analytic.sphere'; `cpmkit plugins` lists those installed."
        )
    check_keys(factory(kind), f"{where} of kind {kind!r}", table, () if surface is None else SIDE_KEYS)
    if "file" in table and not isinstance(table["file"], str):
        raise SceneError(f"file of {where} must be the name of a file, got {shown(table['file'])}.")
    keys = {key: _as_source(value, folder, f"{key} of {where}") for key, value in table.items()}
    if "file" in keys:
        keys["file"] = str(find_file(keys["file"], folder))
    if surface is not None and not {"surface", "file", "vertices"} & set(keys) and takes_key(factory(kind), "surface"):
        keys["surface"] = surface
    return source(kind, **keys)


def _as_source(value: Any, folder: Path, where: str) -> Any:
    """Return the source of a table by :func:`read_source`, lists entry by entry, and other values unchanged."""
    match value:
        case dict():
            return read_source(dict(value), folder, where)
        case list():
            return [_as_source(entry, folder, f"entry {number} of {where}") for number, entry in enumerate(value, 1)]
    return value


def _boundary(table: dict[str, Any], number: int, folder: Path, surface: ClosestPointSource) -> Boundary:
    """Return the boundary of [[boundary]] ``number``; remove keys of ``table``, raise errors as :func:`load_scene`."""
    name = table.pop("name", f"boundary {number}")
    if not isinstance(name, str) or not name.strip() or not name.isprintable() or len(name) > 100:
        raise SceneError(
            f"name of [[boundary]] {number} must be one line of at most 100 characters, got {shown(name)}."
        )
    where = f"[[boundary]] {name!r}"
    sides = {key: table.pop(key) for key in SIDE_KEYS if key in table}
    curve = read_source(table, folder, where, surface)
    carriers = [("boundary", curve), ("surface", surface)]
    conditions: dict[str, Any] = {
        key: read_side(key, value, surface.dim, f"{key} of {where}")
        for key, value in with_vertex_data(sides, folder, carriers, where).items()
    }
    return Boundary(name, curve, **conditions)


def _problem(table: dict[str, Any], dim: int) -> Equation:
    """Return the equation of the table [problem], for a manifold in space of ``dim`` dimensions.

    ``table`` is changed. Raises SceneError if the kind, a key or its value is not accepted.
    """
    kind = table.pop("kind", None)
    if not isinstance(kind, str) or kind not in PROBLEMS:
        hint = did_you_mean(kind, PROBLEMS)
        raise SceneError(f"the kind of [problem] must be one of {', '.join(PROBLEMS)}, got {shown(kind)}{hint}.")
    check_key_types(PROBLEMS[kind], f"[problem] of kind {kind!r}", table)
    for member in fields(PROBLEMS[kind]):
        reader = DATA_READERS.get(str(member.type).removesuffix(" | None"))
        if reader is not None and member.name in table:
            table[member.name] = reader(table[member.name], dim, f"{member.name} of [problem]")
    return call_factory(PROBLEMS[kind], f"[problem] of kind {kind!r}", table)


def read_output(table: dict[str, Any], path: Path) -> OutputRequest:
    """Return the output that the table [output] of the scene file ``path`` asks for.

    The folder is by default named as the file, without its suffix. Raises SceneError if a key or value is not accepted.
    """
    check_accepted("[output]", table, ("folder", "files", "picture", "vertices"))
    picture, files = table.get("picture"), table.get("files", ["summary.json"])
    if picture is not None:
        picture = as_table({"file": picture} if isinstance(picture, str) else picture, "picture of [output]")
        with errors_naming_table("[output]"):
            picture = call_factory(PictureRequest, "picture of [output]", picture)
    if not is_sequence(files):
        raise SceneError(f"files of [output] must be a list of names, such as ['summary.json'], got {shown(files)}.")
    folder = table.get("folder", path.stem)
    folder = Path(relative_name(folder, "folder of [output]") if "folder" in table and folder != "." else folder)
    check_links(folder, Path.cwd(), "folder of [output]")
    vertices = table.get("vertices", VERTICES[0])
    with errors_naming_table("[output]"):
        return OutputRequest(folder, tuple(files), picture, vertices)
