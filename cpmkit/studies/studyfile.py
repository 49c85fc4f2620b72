"""Study files: TOML with the tables of a scene, [let], [exact] and [sweep]."""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property
from keyword import iskeyword
from pathlib import Path
from typing import Any
from unicodedata import normalize

from cpmkit.errors import InputError, SceneError, shown
from cpmkit.files.plain_values import read_toml
from cpmkit.files.whole_files import find_file
from cpmkit.forms.choice import every_option
from cpmkit.formulas.expressions import Expression
from cpmkit.formulas.steps import (
    CONSTANTS,
    COORDINATES,
    FUNCTIONS,
    MAX_FORMULA_CHARACTERS,
    formula_tree,
    parse_expression,
)
from cpmkit.plugins import call_factory, check_accepted
from cpmkit.scene.scene import Scene
from cpmkit.scenefile.condition_tables import as_table
from cpmkit.scenefile.documented_keys import Key, keys_of
from cpmkit.scenefile.kinds import DRAFT, definitions, table_schema, table_schemas
from cpmkit.scenefile.scene_files import read_options, read_scene
from cpmkit.studies.sweep import TARGETS, Sweep, listed_options, read_sweep


def expand_names(table: Mapping[str, Any]) -> dict[str, str]:
    """Return the formulas of a table [let] by name, with the names of earlier formulas replaced by these formulas.

    Raises SceneError if a name is reserved or invalid, a value is no formula, or a formula becomes too long.

    Examples
    --------
    >>> expand_names({"r": "x + y", "double": "2*r"})
    {'r': 'x + y', 'double': '2*(x + y)'}
    """
    known: dict[str, str] = {}
    for name, formula in table.items():
        reserved = name in (*COORDINATES, *CONSTANTS, *FUNCTIONS, "t") or iskeyword(name)
        if reserved or not name.isidentifier() or normalize("NFKC", name) != name:
            raise SceneError(
                f"the name {shown(name)} of [let] is reserved or invalid; use letters, digits and underscores."
            )
        text = str(formula) if type(formula) in (int, float, str) else None
        if text is None:
            raise SceneError(f"{name} of [let] must be a formula or a number, got {shown(formula)}.")
        parse_expression(text, f"{name} of [let]")
        known[name] = expand_formula(text, known)
        formula_tree(known[name], (*COORDINATES, "t", "u", "v"), f"{name} of [let]")
    return known


def expand_formula(formula: str, known: Mapping[str, str]) -> str:
    """Return ``formula`` with names replaced by ``known`` formulas in brackets; text that does not parse is unchanged.

    Raises SceneError if the result is too long: each further name of [let] may double the length.
    """
    try:
        tree = parse_expression(formula)
    except SceneError:  # refused where the formula is read, with the key's name; or it is no formula
        return formula
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name) and node.id in known]
    length = len(formula) + sum(len(known[node.id]) for node in names)
    if length > MAX_FORMULA_CHARACTERS:
        raise SceneError(
            f"the formula {shown(formula)} becomes {length} characters long with the names of [let]; at most "
            f"{MAX_FORMULA_CHARACTERS} are accepted, use fewer."
        )
    lines = [line.encode() for line in formula.strip().split("\n")]  # columns are counted in bytes
    for node in sorted(names, key=lambda node: (node.lineno, node.col_offset), reverse=True):
        line, begin, end = lines[node.lineno - 1], node.col_offset, node.end_col_offset
        lines[node.lineno - 1] = line[:begin] + f"({known[node.id]})".encode() + line[end:]
    return b"\n".join(lines).decode() if names else formula


def expand_all(value: Any, known: Mapping[str, str], formulas: bool = True) -> Any:
    """Return a value of a study file with the names in all its formulas replaced by ``known`` formulas.

    The value may be a text, a list or a table, nested to any depth. Texts under keys such as ``kind`` and ``file`` are
    names and stay; tables there, such as the sources of a union, have formulas. Without ``formulas`` the value is taken
    as one under such a key.
    """
    match value:
        case str():
            return expand_formula(value, known) if formulas else value
        case list():
            return [expand_all(entry, known, formulas) for entry in value]
        case dict():
            named = ("kind", "name", "file", "values", "of", "closest", "scheme", "start")
            return {key: expand_all(entry, known, key not in named) for key, entry in value.items()}
    return value


STUDY_TABLES = ("title", "surface", "boundary", "problem", "discretization", "solver", "let", "exact", "sweep")


@dataclass(frozen=True, eq=False)
class Exact:
    """The solution that runs are compared with: a formula, or the back end that computes it."""

    u: str | None = None  #: A formula in x, y, z and, where the problem has a time, t.
    #: int or "vertices": number of points of the surface at which errors are measured; or the vertices of a surface
    #: that is a mesh.
    points: int | str = 4000
    #: A back end, such as ``fem``, whose solution is the reference where no formula is known.
    reference: str | None = None

    def __post_init__(self) -> None:
        """Check the entries of [exact]; raise SceneError if one is not accepted."""
        for key, what in (("u", "a formula"), ("reference", "the name of a back end such as 'fem'")):
            value = getattr(self, key)
            if value is not None and not isinstance(value, str):
                raise SceneError(f"{key} of [exact] must be {what}, got {shown(value)}.")
        if (self.u is None) == (self.reference is None):
            got = "neither" if self.u is None else "both"
            raise SceneError(f"[exact] takes either u, a formula, or reference, a back end such as 'fem'; got {got}.")
        if self.points != "vertices" and (type(self.points) is not int or not 0 < self.points <= 1_000_000):
            raise SceneError(
                f"points of [exact] must be a whole number above zero, or 'vertices' of a mesh, got "
                f"{shown(self.points)}; at most 1000000 points are accepted."
            )


@dataclass(frozen=True, eq=False)
class Study:
    """A scene, the solution that its runs are compared with, and the options that the runs vary."""

    name: str  #: Name of the study file without its suffix.
    title: str  #: Title of the report.
    folder: Path  #: Folder of the study file, where the files that it names are looked for first.
    tables: Mapping[str, Any]  #: Tables of the scene, with the formulas of [let] in place of their names.
    exact: Exact  #: The solution, or the back end that computes it.
    sweep: Sweep  #: The options that are varied.
    #: Hash that identifies the records of this study: it changes with everything that the result of a run depends on,
    #: but not with the title or the lists of the sweep.
    content: str

    @cached_property
    def scene(self) -> Scene:
        """The scene, read at first access; if steps are tied to the spacing, with the time step of the first spacing.

        A step in [problem] takes precedence. Raises SceneError if a table is refused, and others as :func:`read_scene`.
        """
        tables = dict(self.tables)
        if self.sweep.step_per_spacing is not None:
            kind, in_time = tables["problem"].get("kind"), ("heat", "reaction-diffusion", "wave")
            if kind not in in_time:
                raise SceneError(
                    f"step_per_spacing of [sweep] is for problems with a time step, {' and '.join(in_time)}, not for "
                    f"{shown(kind)}."
                )
            assert self.sweep.spacings is not None  # a sweep refuses one without the other
            tables["problem"] = {"step": self.sweep.step_per_spacing * self.sweep.spacings[0], **tables["problem"]}
        return read_scene(tables, self.folder)

    @cached_property
    def solution(self) -> Expression | None:
        """The exact solution as a function of points and, if its formula has a t, of time; None with a reference."""
        return None if self.exact.u is None else Expression(self.exact.u, self.scene.surface.dim)

    @property
    def options(self) -> dict[str, Any]:
        """Keyword arguments of ``solve`` that all runs share, from [discretization] and [solver], without spacing."""
        return read_options(self.tables)[1]


def load_study(path: str | Path) -> Study:
    """Return the study in a TOML file; its scene is read at first access.

    Raises SceneError if the file is missing, does not parse, or holds a key or value that is not accepted.
    """
    return read_toml(path, _parse_study, "study file", " with the tables [exact], [sweep]")


def _parse_study(tables: dict[str, Any], path: Path) -> Study:
    """Return the study in the ``tables`` of the file ``path``; raise SceneError if a key or value is not accepted."""
    check_accepted("the study", tables, STUDY_TABLES)
    for needed in ("surface", "problem", "exact", "sweep"):
        if not isinstance(tables.get(needed), dict):
            raise SceneError(f"a study needs the table [{needed}].")
    title = tables.get("title", path.stem)
    if not isinstance(title, str) or len(title) > 300:
        raise SceneError(f"title must be text of at most 300 characters, got {shown(title)}.")
    lists = {"spacing": "spacings", **TARGETS, **listed_options()}
    swept = {name: f"{key} of [sweep]" for name, key in lists.items()}  # the places of keys that a study varies
    for name, one in every_option().items():
        if one.methods:
            *others, last = one.methods
            swept[name] = f"methods of [sweep], as {', '.join(map(repr, ['cpm', *others]))} or {last!r}"
    for key in as_table(tables.get("discretization", {}), "[discretization]"):
        if key in swept:
            raise SceneError(f"a study's {key} stands in {swept[key]}, not in [discretization].")
    known = expand_names(as_table(tables.get("let", {}), "[let]"))
    scene = {
        key: expand_all(value, known) for key, value in tables.items() if key not in ("title", "let", "exact", "sweep")
    }
    exact = call_factory(Exact, "[exact]", tables["exact"])
    exact = exact if exact.u is None else replace(exact, u=expand_formula(exact.u, known))
    sweep = read_sweep(tables["sweep"])
    read_options(scene)
    solution = exact.u if exact.reference is None else {"reference": exact.reference}
    digests = [_file_digest(file) for file in _named_files(scene, path.parent)]
    whole = [scene, solution, exact.points, sweep.step_per_spacing, digests]  # besides the parameters of a run
    content = hashlib.sha256(json.dumps(whole, sort_keys=True, default=str).encode()).hexdigest()[:16]
    return Study(path.stem, title, path.parent, scene, exact, sweep, content)


def _named_files(value: Any, folder: Path) -> Iterator[Path]:
    """Yield the files named by texts in tables and lists, under any key, since plugins have their own keys.

    :func:`find_file` searches the files, first in ``folder``; texts that name no file are passed over. A formula that
    equals the name of a file counts too: a change of the file then repeats runs without need.
    """
    match value:
        case str():
            with suppress(InputError, OSError, ValueError):  # not the name of a file
                yield find_file(value, folder)
        case list():
            for entry in value:
                yield from _named_files(entry, folder)
        case dict():
            yield from _named_files([value[key] for key in sorted(value, key=lambda key: key != "file")], folder)


def _file_digest(file: Path) -> str:
    """Return the SHA-256 digest of a file in hexadecimal; raise SceneError if it cannot be read."""
    try:
        with file.open("rb") as opened:
            return hashlib.file_digest(opened, "sha256").hexdigest()
    except OSError as error:
        raise SceneError(f"the file {shown(str(file))} cannot be read: {error.strerror or error}.") from error


def study_schema() -> dict[str, Any]:
    """Return the JSON schema of study files."""
    tables = {name: _without_number_types(table) for name, table in table_schemas(problem_needs=False).items()}
    lists = [Key(key, "list", "list", False, None, f"Values of {name}.") for name, key in listed_options().items()]
    sweep = [key for key in keys_of(Sweep) if key.name in {one.name for one in fields(Sweep)} - {"lists"}]
    return {
        "$schema": DRAFT,
        "title": "A study of cpmkit",
        "type": "object",
        "properties": {
            "title": {"description": "For the report.", "type": "string"},
            **{name: table for name, table in tables.items() if name != "output"},
            "let": {"description": "Names of formulas for the rest of the file.", "type": "object"},
            "exact": table_schema(keys_of(Exact)),
            "sweep": table_schema([*sweep, *lists]),
        },
        "required": ["surface", "problem", "exact", "sweep"],
        "additionalProperties": False,
        "definitions": _without_number_types(definitions()),
    }


def _without_number_types(schema: Any) -> Any:
    """Return a copy of a JSON schema without number types: a name of [let] may stand for any number."""
    numeric = [("type", "number"), ("type", "integer")]
    return json.loads(json.dumps(schema), object_pairs_hook=lambda pairs: dict(p for p in pairs if p not in numeric))
