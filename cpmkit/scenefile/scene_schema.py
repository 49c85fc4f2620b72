"""JSON schemas of scene files, generated from the code that reads the files; editors use them to check TOML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

from cpmkit.forms.accuracy_target import AccuracyTarget
from cpmkit.forms.choice import FORMS
from cpmkit.forms.options import Options
from cpmkit.linear.solver_options import SolverOptions
from cpmkit.runtime.options import DeclaredOptions, declared_options
from cpmkit.scenefile.application_files import ALONG_KEYS, COLOUR_KEYS
from cpmkit.scenefile.condition_tables import CONDITIONS
from cpmkit.scenefile.documented_keys import Key, keys_of
from cpmkit.scenefile.kinds import Kind, kinds
from cpmkit.scenefile.output_request import PictureRequest
from cpmkit.scenefile.scene_files import SIDE_KEYS, SOLVER_KEYS

DRAFT = "http://json-schema.org/draft-07/schema#"
#: Names of Python's plain types in JSON schemas.
JSON_TYPES = {"float": "number", "int": "integer", "str": "string", "bool": "boolean", "None": "null"}
DATUM = {"$ref": "#/definitions/datum"}

Schema = dict[str, Any]


def scene_schema() -> Schema:
    """Return the JSON schema of scene files, including the kinds that installed plugins add."""
    return {
        "$schema": DRAFT,
        "title": "A scene of cpmkit",
        "type": "object",
        "properties": scene_tables(),
        "required": ["surface", "problem"],
        "additionalProperties": False,
        "definitions": definitions(),
    }


def definitions() -> Schema:
    """Return the definitions to which the schemas of tables refer: datum, condition and source."""
    sources = [kind for kind in kinds() if kind.sort == "source"]
    return {
        "datum": {
            "description": "A number, a formula in x, y, z and t, values by the vertex, or a list of them.",
            "type": ["number", "string", "array", "object"],
        },
        "condition": _condition(),
        "source": one_of_kinds(sources),
    }


def scene_tables(problem_needs: bool = True) -> Schema:
    """Return the JSON schema of each table of a scene, by its name.

    ``problem_needs`` is False if [problem] may lack required keys, which a study sets.
    """
    every = kinds()
    sources = [kind for kind in every if kind.sort == "source"]
    edge = {
        "description": "What holds on the rim; or a list of tables, each with `where`, a formula; or a table of loops."
    }
    condition = {"$ref": "#/definitions/condition"}
    sides: Schema = dict.fromkeys(SIDE_KEYS, condition) | {
        "left_of": {"description": "A point on the left.", "type": "array"},
        "across": {"description": "A transmission, or another condition that couples both sides.", "type": "object"},
        "name": {"description": "For reports, and to ask for a side.", "type": "string"},
    }
    equations = [kind for kind in every if kind.sort == "equation"]
    return {
        "surface": one_of_kinds(sources, {"edge": edge}),
        "boundary": {"type": "array", "items": one_of_kinds(sources, sides)},
        "problem": one_of_kinds(equations, needs=problem_needs, of_data=True),
        "discretization": _options([Options, AccuracyTarget, *FORMS.values()]),
        "solver": _options([SolverOptions], SOLVER_KEYS, further=True),
        "output": _table(
            {
                "folder": {"description": "Where results go, inside the working directory.", "type": "string"},
                "files": {"description": "Names of files in it.", "type": "array", "items": {"type": "string"}},
                "picture": {"anyOf": [{"type": "string"}, table_of(keys_of(PictureRequest))]},
            }
        ),
    }


def table_of(keys: Iterable[Key]) -> Schema:
    """Return the JSON schema of a table with these ``keys``, none of them required."""
    return _table({key.name: _key_schema(key) for key in keys})


def _table(properties: Schema, needed: Iterable[str] = (), further: bool = False) -> Schema:
    """Return the JSON schema of a table with these ``properties``.

    ``needed`` are the required keys; ``further`` is True if other keys are allowed.
    """
    required = sorted(needed)
    schema = {"type": "object", "properties": properties, "additionalProperties": further}
    return {**schema, "required": required} if required else schema


def one_of_kinds(
    choices: Iterable[Kind], more: Mapping[str, Any] = {}, needs: bool = True, of_data: bool = False
) -> Schema:
    """Return the JSON schema of a table whose ``kind``, one of ``choices``, determines its other keys.

    All kinds have the properties ``more`` too. ``needs`` is False if no key is required; with ``of_data`` all keys
    are data. A key ``surface`` is never required: a boundary receives the surface of its scene.
    """
    variants = []
    for choice in choices:
        own = {key.name: {**DATUM, "description": key.summary} if of_data else _key_schema(key) for key in choice.keys}
        needed = [key.name for key in choice.keys if key.needed and needs and key.name != "surface"]
        kind = {"const": choice.name, "description": choice.summary}
        variants.append(_table({"kind": kind, **own, **more}, ["kind", *needed]))
    return {"oneOf": variants}


def _condition() -> Schema:
    """Return the JSON schema of a condition: a table with its kind as key, a plugin's ``kind = NAME``, or a datum."""
    order = {"type": "integer", "minimum": 1, "maximum": 4}
    variants = [_table({kind: _value_schema(kind), "order": order}, [kind]) for kind in CONDITIONS]
    of_plugin = {"kind": {"type": "string"}, "order": order}
    datum = {"description": "Dirichlet's.", "type": ["number", "string", "array"]}
    return {"anyOf": [*variants, _table(of_plugin, ["kind"], further=True), datum]}


def _value_schema(kind: str) -> Schema:
    """Return the JSON schema of the value of a built-in kind of condition."""
    return {"const": True} if kind == "steklov" else DATUM


def _options(
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
    return _table(properties, further=further)


def _key_schema(key: Key) -> Schema:
    """Return the JSON schema of the value of a key."""
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


#: JSON schemas of values in the tables of applications.
PLACE: Schema = {"description": "A point, or a list of points.", "type": "array"}
IMAGE: Schema = {"description": "A point of the target, or of a curve one formula a coordinate.", "type": "array"}
DIRECTION: Schema = {
    "description": "tangent, backwards, left or right; a vector; or one formula a coordinate.",
    "type": ["string", "array"],
}
COLOURS: Schema = {
    "description": "A colour; colours along the curve; { formula = [...] }; { neumann = 0 } where nothing passes.",
    "type": ["string", "array", "object"],
}
TEXT, NUMBER, WHOLE = ({"type": kind} for kind in ("string", "number", "integer"))


def application_schema(command: str) -> Schema:
    """Return the JSON schema of the scene files for the application of ``cpmkit COMMAND``."""
    tables = {name: table for name, table in scene_tables().items() if name != "problem"}
    own, needed = _TABLES[command]()
    return {
        "$schema": DRAFT,
        "title": f"A scene of `cpmkit {command}`",
        "type": "object",
        "properties": {**tables, **own},
        "required": ["surface", *needed],
        "additionalProperties": False,
        "definitions": definitions(),
    }


def _vector_tables() -> tuple[Schema, list[str]]:
    """Return the JSON schemas of the tables of ``cpmkit vectors``, and the names of the required tables."""
    along = _on_curves(dict.fromkeys(ALONG_KEYS, DIRECTION))
    vector = {"description": "At all of these points, or one for each.", "type": "array"}
    transport = {"description": "How vectors go on.", "enum": ["parallel", "paper"]}
    return {
        "direction": {"type": "array", "items": {"oneOf": [*along, _closed_table({"at": PLACE, "vector": vector})]}},
        "vectors": _closed_table({"transport": transport}, needed=False),
    }, ["direction"]


def _map_tables() -> tuple[Schema, list[str]]:
    """Return the JSON schemas of the tables of ``cpmkit map``, and the names of the required tables."""
    curves = _on_curves({"to": IMAGE})
    own: Schema = {
        "initial": {"description": "nearest; one formula a coordinate; or { values = FILE }, a row a vertex."},
        "method": {"enum": ["implicit", "explicit"]},
        "step": {"description": "Of time.", **NUMBER},
        "most_steps": {"description": "After which the run ends.", **WHOLE},
        "rest": {"description": "It ends where a step lowers the energy by less than this share of it.", **NUMBER},
        "texture": {"description": "Of the target: one formula a channel, three for a colour, or { values = FILE }."},
    }
    return {
        "target": {"$ref": "#/definitions/source"},
        "landmark": {"type": "array", "items": {"oneOf": [*curves, _closed_table({"at": PLACE, "to": IMAGE})]}},
        "map": _closed_table(own, needed=False),
    }, ["target"]


def _paint_tables() -> tuple[Schema, list[str]]:
    """Return the JSON schemas of the tables of ``cpmkit paint``, and the names of the required tables."""
    name = {"name": {"description": "For reports.", **TEXT}}
    curves = _on_curves({**name, **dict.fromkeys(COLOUR_KEYS, COLOURS)})
    return {"curve": {"type": "array", "items": {"oneOf": curves}}}, ["curve"]


_TABLES = {"vectors": _vector_tables, "map": _map_tables, "paint": _paint_tables}


def _on_curves(more: Schema) -> list[Schema]:
    """Return the JSON schemas of a table for each kind of source, with the keys of the kind and ``more``."""
    sources = [kind for kind in kinds() if kind.sort == "source"]
    variants: list[Schema] = one_of_kinds(sources, more)["oneOf"]
    return variants


def _closed_table(properties: Schema, needed: bool = True) -> Schema:
    """Return the JSON schema of a table with no other keys than these ``properties``, all required if ``needed``."""
    required = {"required": sorted(properties)} if needed else {}
    return {"type": "object", "properties": properties, "additionalProperties": False, **required}
