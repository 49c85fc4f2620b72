"""The kinds that a scene file can name, with their keys, and the JSON schemas of scene files that follow from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from cpmkit.errors import PluginError, shown
from cpmkit.forms.choice import FORMS
from cpmkit.forms.options import AccuracyTarget, Options
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.plugins import FACTORY_HOOKS, any_factory, installed_kinds
from cpmkit.runtime.deprecation import DeprecatedMember
from cpmkit.runtime.messages import did_you_mean
from cpmkit.runtime.options import DeclaredOptions, declared_options
from cpmkit.scenefile.condition_tables import CONDITIONS
from cpmkit.scenefile.documented_keys import APPLICATIONS, JSON_TYPES, Key, first_sentence, keys_of
from cpmkit.scenefile.look import PictureRequest
from cpmkit.scenefile.scene_files import PROBLEMS, SIDE_KEYS, SOLVER_KEYS


@dataclass(frozen=True)
class Kind:
    """A kind of source, condition, equation, solver or back end."""

    name: str  #: Name of the kind in scene files and in :func:`cpmkit.source`.
    sort: str  #: ``source``, ``condition``, ``equation``, ``solver`` or ``back end``.
    distribution: str  #: The installed package that provides the kind.
    summary: str  #: One sentence that describes the kind.
    keys: tuple[Key, ...]  #: The keys of the kind.
    told = DeprecatedMember("summary")

    def __str__(self) -> str:
        """Return the name, the sort and the summary of the kind, and a line for each key."""
        return "\n  ".join([f"{self.name}: {self.sort} of {self.distribution}", self.summary, *map(str, self.keys)])


def kinds(name: str | None = None) -> tuple[Kind, ...]:
    """Return all kinds that a scene can name, or the kinds of a name, sorted by sort and name.

    This imports the plugins; ``cpmkit plugins`` lists names without importing them.

    Parameters
    ----------
    name : str, optional
        A kind, such as ``"analytic.torus"``, or a family of kinds, such as ``"analytic"``.

    Raises
    ------
    PluginError
        If there is no such kind, or a plugin does not import.

    Examples
    --------
    >>> import cpmkit as ck
    >>> (circle,) = ck.kinds("analytic.circle")
    >>> [key.name for key in circle.keys][:3]
    ['center', 'radius', 'normal']
    """
    built_in: dict[str, Any] = {**PROBLEMS, **CONDITIONS}
    known = {**dict.fromkeys(built_in, "cpmkit"), **{each.kind: each.distribution for each in installed_kinds()}}
    matching, sorts = [], dict(zip(FACTORY_HOOKS, ("source", "condition", "solver", "back end"), strict=True))
    for kind, distribution in known.items():
        if name is None or name in (kind, kind.partition(".")[0]):
            hook, make = ("", built_in[kind]) if kind in built_in else any_factory(kind)
            sort = sorts.get(hook, "equation" if kind in PROBLEMS else "condition")
            matching.append(Kind(kind, sort, distribution, first_sentence(make.__doc__), keys_of(make)))
    if not matching:
        raise PluginError(
            f"There is no kind {shown(name)}{did_you_mean(name, known)}; `cpmkit plugins` lists those installed."
        )
    return tuple(sorted(matching, key=lambda kind: (kind.sort, kind.name)))


DRAFT = "http://json-schema.org/draft-07/schema#"
DATUM = {"$ref": "#/definitions/datum"}

Schema = dict[str, Any]


def scene_schema(command: str | None = None) -> Schema:
    """Return the JSON schema of scene files, or of those for the application of ``cpmkit COMMAND``.

    ``command`` is the name of an application, such as ``paint``; None for a scene with an equation. The kinds that
    installed plugins add are included.
    """
    title, tables, needed = "A scene of cpmkit", table_schemas(), ["problem", "surface"]
    if command is not None:
        keys = APPLICATIONS[command]
        entries: list[Schema] = _kinds_schema("source", keys.on_curve)["oneOf"]
        if keys.at_points:
            entries.append(_object_schema(keys.at_points, keys.at_points))
        del tables["problem"]
        tables[keys.entry] = {"type": "array", "items": {"oneOf": entries}}
        tables |= {keys.table: _object_schema(keys.options)} if keys.options else {}
        tables |= {"target": {"$ref": "#/definitions/source"}} if keys.has_target else {}
        title, needed = f"A scene of `cpmkit {command}`", ["surface", "target" if keys.has_target else keys.entry]
    return {"$schema": DRAFT, "title": title, **_object_schema(tables, needed), "definitions": definitions()}


def definitions() -> Schema:
    """Return the definitions to which the JSON schemas of tables refer: datum, condition and source.

    A condition is a table with its kind as key, a plugin's ``kind = NAME``, or a datum.
    """
    order = {"type": "integer", "minimum": 1, "maximum": 4}
    values = dict.fromkeys(CONDITIONS, DATUM) | {"steklov": {"const": True}}
    conditions = [_object_schema({kind: value, "order": order}, [kind]) for kind, value in values.items()]
    of_plugin = {"kind": {"type": "string"}, "order": order}
    datum = {"description": "Dirichlet's.", "type": ["number", "string", "array"]}
    return {
        "datum": {
            "description": "A number, a formula in x, y, z and t, values by the vertex, or a list of them.",
            "type": ["number", "string", "array", "object"],
        },
        "condition": {"anyOf": [*conditions, _object_schema(of_plugin, ["kind"], further=True), datum]},
        "source": _kinds_schema("source"),
    }


def table_schemas(problem_needs: bool = True) -> Schema:
    """Return the JSON schema of each table of a scene, by its name.

    ``problem_needs`` is False if [problem] may lack required keys, which a study sets.
    """
    edge = {
        "description": "What holds on the rim; or a list of tables, each with `where`, a formula; or a table of loops."
    }
    junctions = {"description": "Where members of different dimension meet; or a list of tables with `members`."}
    condition = {"$ref": "#/definitions/condition"}
    sides: Schema = dict.fromkeys(SIDE_KEYS, condition) | {
        "left_of": {"description": "A point on the left.", "type": "array"},
        "across": {"description": "A transmission, or another condition that couples both sides.", "type": "object"},
        "name": {"description": "For reports, and to ask for a side.", "type": "string"},
    }
    return {
        "surface": _kinds_schema("source", {"edge": edge, "junctions": junctions}),
        "boundary": {"type": "array", "items": _kinds_schema("source", sides)},
        "problem": _kinds_schema("equation", needs=problem_needs),
        "discretization": _options_schema([Options, AccuracyTarget, *FORMS.values()]),
        "solver": _options_schema([SolverOptions], SOLVER_KEYS, further=True),
        "output": _object_schema(
            {
                "folder": {"description": "Where results go, inside the working directory.", "type": "string"},
                "files": {"description": "Names of files in it.", "type": "array", "items": {"type": "string"}},
                "picture": {"anyOf": [{"type": "string"}, table_schema(keys_of(PictureRequest))]},
            }
        ),
    }


def table_schema(keys: Iterable[Key]) -> Schema:
    """Return the JSON schema of a table with these ``keys``, none of them required."""
    return _object_schema({key.name: _key_schema(key) for key in keys})


def _object_schema(properties: Schema, needed: Iterable[str] = (), further: bool = False) -> Schema:
    """Return the JSON schema of a table whose keys have the schemas ``properties``.

    ``needed`` are the required keys; ``further`` is True if other keys are allowed.
    """
    required = sorted(needed)
    schema = {"type": "object", "properties": properties, "additionalProperties": further}
    return {**schema, "required": required} if required else schema


def _kinds_schema(sort: str, more: Mapping[str, Any] = {}, needs: bool = True) -> Schema:
    """Return the JSON schema of a table whose ``kind``, one of this :attr:`Kind.sort`, determines its other keys.

    ``more`` are schemas of further keys by name; ``needs`` is False if only ``kind`` is required. Keys of equations are
    described as data. A key ``surface`` is never required: a boundary receives its scene's. Raises PluginError if a
    plugin does not import.
    """
    variants = []
    for choice in (kind for kind in kinds() if kind.sort == sort):
        own = {
            key.name: {**DATUM, "description": key.summary} if sort == "equation" else _key_schema(key)
            for key in choice.keys
        }
        needed = [key.name for key in choice.keys if key.needed and needs and key.name != "surface"]
        kind = {"const": choice.name, "description": choice.summary}
        variants.append(_object_schema({"kind": kind, **own, **more}, ["kind", *needed]))
    return {"oneOf": variants}


def _options_schema(
    declaring: Iterable[type[DeclaredOptions]], renamed: Mapping[str, str] = {}, further: bool = False
) -> Schema:
    """Return the JSON schema of a table with the options that the classes ``declaring`` declare.

    An option of several classes has all their descriptions. ``renamed`` maps options to keys; ``further`` is True
    if other keys are allowed.
    """
    properties: Schema = {}
    for kind in declaring:
        types = {member.name: str(member.type) for member in fields(kind)}
        for name, option in declared_options(kind).items():
            earlier = properties.get(renamed.get(name, name), {}).get("description", "")
            summary = f"{earlier} {option.summary}".strip()
            properties[renamed.get(name, name)] = {**_json_type(types[name]), "description": summary}
    properties |= {"memory": {**properties["memory"], "type": ["number", "string"]}} if "memory" in properties else {}
    return _object_schema(properties, further=further)


def _key_schema(key: Key) -> Schema:
    """Return the JSON schema of the value of a key; ``of`` is a source, ``members`` a list of sources."""
    if key.name == "of":
        return {"$ref": "#/definitions/source"}
    if key.name == "members":
        return {"type": "array", "items": {"$ref": "#/definitions/source"}}
    summary = {"description": key.summary} if key.summary else {}
    default = {"default": key.default} if isinstance(key.default, (bool, int, float, str)) else {}
    return {**_json_type(key.declared), **summary, **default}


def _json_type(declared_type: str) -> Schema:
    """Return the JSON schema of a declared Python type; empty if the type is not a union of plain types."""
    names = [JSON_TYPES.get(name.strip(), "") for name in declared_type.split("|")]
    if not all(names):
        return {}
    plain = [name for name in names if name != "null"]
    return {"type": plain[0] if len(plain) == 1 else plain}
